//! `POST /v1/meshes`: an image in, its mesh out.

use super::Service;
use crate::admission::Cost;
use crate::extract::accept::{self, Representation};
use crate::extract::params::{Order, ParameterSet};
use crate::extract::upload::Upload;
use crate::pipeline::{self, Answer};
use crate::pool;
use crate::problem::{Kind, Problem};
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE, ETAG, VARY};
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::response::{IntoResponse, Response};
use std::sync::Arc;
use std::time::Instant;

/// Answers with the mesh, or says at once what is wrong.
///
/// # Errors
/// Every refusal of upload, parameters, admission and work.
pub async fn create(
    State(service): State<Arc<Service>>,
    request: Request,
) -> Result<Response, Problem> {
    let cut = service.cut.clone();
    tokio::select! {
        answer = make(&service, request) => answer,
        () = cut.cancelled() => Err(Problem::new(Kind::ShuttingDown, "the service is stopping")),
    }
}

async fn make(service: &Service, request: Request) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let mut parameters = ParameterSet::of_query(head.uri.query())?;
    let upload = service.intake.receive(&head.headers, body, &mut parameters).await?;
    let order = parameters.finish()?;
    let representation = accept::choose(order.format, &head.headers)?;
    let ran = order.query();
    let answer = run(service, upload, order, representation).await?;
    respond(answer, representation, &ran)
}

/// Checks the order against the image's header, waits for a ticket, and does the work.
async fn run(
    service: &Service,
    upload: Upload,
    order: Order,
    representation: Representation,
) -> Result<Answer, Problem> {
    let limits = service.pictures;
    let header = pixmesh_codec::probe(&upload.image, &limits)?;
    let cost = Cost::of_mesh(&header, &order.plan(&header)?);
    let deadline = Instant::now() + service.deadline;
    let ticket = service.admission.admit(cost, deadline).await?;
    pool::run(ticket, deadline, move |watch| {
        pipeline::mesh(upload, &order, representation, &limits, watch)
    })
    .await
}

/// The answer with its headers.
fn respond(answer: Answer, representation: Representation, ran: &str) -> Result<Response, Problem> {
    let disposition = format!("inline; filename=\"{}\"", representation.file_name);
    let headers = [
        (CONTENT_TYPE, representation.content_type.to_owned()),
        (CONTENT_DISPOSITION, disposition),
        (ETAG, format!("\"{}\"", answer.digest)),
        (VARY, "Accept".to_owned()),
        (HeaderName::from_static("mesh-vertices"), answer.vertices.to_string()),
        (HeaderName::from_static("mesh-faces"), answer.faces.to_string()),
        (HeaderName::from_static("mesh-psnr"), answer.psnr_db.to_string()),
        (HeaderName::from_static("mesh-mse"), answer.mse.to_string()),
        (HeaderName::from_static("mesh-parameters"), ran.to_owned()),
        (HeaderName::from_static("server-timing"), answer.server_timing()),
    ];
    let headers = headers.into_iter().map(|(name, text)| Ok((name, HeaderValue::try_from(text)?)));
    let headers = headers
        .collect::<Result<HeaderMap, axum::http::header::InvalidHeaderValue>>()
        .map_err(|error| crate::problem::internal("a header of the answer is not valid", &error))?;
    Ok((headers, Body::from(answer.bytes)).into_response())
}
