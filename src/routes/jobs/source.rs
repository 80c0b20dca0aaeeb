//! The image that a mesh is made of: sent with the request, or kept by a job; and
//! `GET /v1/jobs/{id}/image`.

use super::found::{find, found, unknown};
use crate::extract::fields::{Few, Fields};
use crate::extract::upload::{Upload, Wanted, missing};
use crate::problem::{Kind, Problem};
use crate::routes::openapi::answers::{Problems, ProblemsOf};
use crate::routes::openapi::bodies::Binary;
use crate::routes::openapi::parameters::JobPath;
use crate::service::Service;
use axum::Extension;
use axum::body::Body;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, Request, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::request::Parts;
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use pixmesh_codec::PictureFormat;
use pixmesh_engine::params::{MeshOptions, ParameterSet, pairs_of_query};
use pixmesh_engine::{InputError, Owner, Weighed};
use pixmesh_jobs::record::{JobId, Record};
use std::sync::Arc;

/// The parameter that names the job whose image is taken.
const IMAGE_OF: &str = "image_of";

/// Answers with the image of a job, as it was sent.
///
/// # Errors
/// `not-found`, `gone`, and `job-without-image` where the job does not keep it.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/image", operation_id = "getJobImage",
    summary = "The image of a job, as it was sent",
    description = "While the job waits or runs, and as long as the job is kept where it was submitted \
                   with keep_image=true.",
    params(JobPath),
    responses(
        (status = 200, description = "The image", body = inline(Binary), content_type = "image/*"),
        Problems, ProblemsOf::<404>, ProblemsOf::<409>, ProblemsOf::<410>,
    ),
    security((), ("key" = [])),
)]
pub(in crate::routes) async fn show(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    path: Result<Path<String>, PathRejection>,
    request: Request,
) -> Result<Response, Problem> {
    Few::of_query(&[], request.uri().query())?;
    let record = find(&service, &owner, path).await?;
    let Upload { bytes, charge } = kept(&service, &owner, record).await?;
    let headers = [(CONTENT_TYPE, media_type(&bytes)), (CACHE_CONTROL, "private, no-cache")];
    let held = Upload { bytes, charge };
    Ok((headers, Body::from(Bytes::from_owner(held))).into_response())
}

/// The media type of a picture's file.
fn media_type(file: &[u8]) -> &'static str {
    match PictureFormat::sniff(file) {
        Ok(PictureFormat::Png) => "image/png",
        Ok(PictureFormat::Jpeg) => "image/jpeg",
        Ok(PictureFormat::WebP) => "image/webp",
        Ok(PictureFormat::Gif) => "image/gif",
        Ok(PictureFormat::Tiff) => "image/tiff",
        Ok(PictureFormat::Bmp) => "image/bmp",
        Ok(PictureFormat::Pnm) => "image/x-portable-anymap",
        Ok(_) | Err(_) => "application/octet-stream",
    }
}

/// The image and the weights of a request, and what is to be made of them.
///
/// # Errors
/// Every refusal of upload and parameters, `not-found`, `gone` and `job-without-image` for the job
/// that the request names, and `duplicate-parameter` when there is an image beside its name.
pub(in crate::routes) async fn receive(
    service: &Service,
    owner: &Owner,
    wanted: &Wanted<2>,
    head: &Parts,
    body: Body,
) -> Result<(Weighed<Upload>, MeshOptions), Problem> {
    let mut parameters = ParameterSet::default();
    let mut named = Few::of(&[IMAGE_OF]);
    for pair in pairs_of_query(head.uri.query()) {
        let (name, text) = pair?;
        match &*name {
            IMAGE_OF => named.add(&name, &text)?,
            _ => parameters.add(&name, &text)?,
        }
    }
    let receiving =
        service.intake.receive_some(owner, wanted, &head.headers, body, &mut parameters);
    let [sent, weights] = receiving.await?;
    let image = match named.get(IMAGE_OF) {
        None => sent.ok_or_else(|| missing(wanted.files[0]))?,
        Some(_) if sent.is_some_and(|file| !file.bytes.is_empty()) => {
            return Err(InputError::Exclusive(IMAGE_OF, "image").into());
        }
        Some(id) => {
            let id = JobId::parse(id).ok_or_else(unknown).map_err(named_by)?;
            let record = found(service.jobs.queue.get(owner, id).await?).map_err(named_by)?;
            kept(service, owner, record).await.map_err(named_by)?
        }
    };
    Ok((Weighed { image, weights }, parameters.finish()?))
}

fn named_by(problem: Problem) -> Problem {
    problem.param(IMAGE_OF)
}

/// The image of a job: its own blob until the job ends, and then a part of the mesh's.
async fn kept(service: &Service, owner: &Owner, mut record: Record) -> Result<Upload, Problem> {
    let blobs = &service.jobs.blobs;
    if !record.state.is_final() {
        let blob = blobs.get(record.picture.digest).await;
        let length = usize::try_from(record.picture.bytes).unwrap_or(usize::MAX);
        match blob {
            Ok(file) if length <= file.len() => {
                return service.intake.hold(owner, file.slice(..length));
            }
            Ok(_) => return Err(without_image()),
            Err(error) => {
                // A job that ends meanwhile has no blob of its own any more.
                record = found(service.jobs.queue.get(owner, record.id).await?)?;
                if !record.state.is_final() {
                    return Err(error.into());
                }
            }
        }
    }
    let mesh = record.mesh.as_ref().filter(|mesh| mesh.image.is_some());
    let mesh = mesh.ok_or_else(without_image)?;
    let blob = mesh.blob().ok_or_else(|| {
        Problem::new(Kind::StorageDamaged, "what was stored of this job is damaged")
    })?;
    let file = blobs.get_part(blob, mesh.place_of_image()).await?;
    service.intake.hold(owner, file)
}

fn without_image() -> Problem {
    let detail = "the job has ended, and was not submitted with keep_image=true: send the image";
    Problem::new(Kind::JobWithoutImage, detail)
}
