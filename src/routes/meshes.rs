//! `POST /v1/meshes`: an image in, its mesh out.

use super::Service;
use crate::admission::{Cost, Memory};
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
use bytes::Bytes;
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
    let (answer, memory) = run(service, upload, order, representation).await?;
    respond(answer, memory, representation, &ran)
}

/// Checks the order against the image's header, waits for a ticket, and does the work; the answer
/// comes with the memory that it holds.
async fn run(
    service: &Service,
    upload: Upload,
    order: Order,
    representation: Representation,
) -> Result<(Answer, Option<Memory>), Problem> {
    let limits = service.pictures;
    let header = pixmesh_codec::probe(&upload.image, &limits)?;
    let plan = order.plan(&header)?;
    let cost = Cost::of_mesh(&header, &plan, &order.parameters, representation.format);
    let deadline = Instant::now() + service.deadline;
    let ticket = service.admission.admit(cost, deadline).await?;
    pool::run(ticket, deadline, move |watch, ticket| {
        let answer = pipeline::mesh(upload, &order, representation, &limits, watch)?;
        let memory = ticket.keep(answer.bytes.len());
        Ok((answer, memory))
    })
    .await
}

/// The bytes of an answer, which hold their memory until the client has taken them or gone.
struct Held {
    bytes: Vec<u8>,
    _memory: Option<Memory>,
}

impl AsRef<[u8]> for Held {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

/// The answer with its headers.
fn respond(
    answer: Answer,
    memory: Option<Memory>,
    representation: Representation,
    ran: &str,
) -> Result<Response, Problem> {
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
    let bytes = Bytes::from_owner(Held { bytes: answer.bytes, _memory: memory });
    Ok((headers, Body::from(bytes)).into_response())
}
