//! `POST /v1/meshes`: an image in, its mesh out.

use super::Service;
use crate::admission::{Cost, Memory};
use crate::extract::accept::{self, Representation};
use crate::extract::owner::Owner;
use crate::extract::params::{Order, ParameterSet};
use crate::extract::upload::Upload;
use crate::pipeline::{self, Answer};
use crate::pool;
use crate::problem::{Kind, Problem};
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_TYPE, ETAG, VARY};
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use std::sync::Arc;
use std::time::Instant;

/// Bytes of a body that is received even when its request will be refused, so that the connection
/// stays open.
const LONG_BODY: u64 = 256 << 10;

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
    let owner = Owner::of(&head.extensions);
    let mut parameters = ParameterSet::of_query(head.uri.query())?;
    if is_long(&head.headers) {
        service.admission.refuse_crowd(&owner)?;
    }
    let upload = service.intake.receive(&owner, &head.headers, body, &mut parameters).await?;
    let order = parameters.finish()?;
    let representation = accept::choose(order.format, &head.headers)?;
    let ran = order.query();
    let (answer, memory) = run(service, &owner, upload, order, representation).await?;
    respond(answer, memory, representation, &ran)
}

/// Whether a body is so long, or may be, that it is worth the connection to refuse it unread.
fn is_long(headers: &HeaderMap) -> bool {
    let length = headers.get(CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse().ok());
    length.is_none_or(|length: u64| length > LONG_BODY)
}

/// Checks the order against the image's header, waits for a ticket, and does the work; the answer
/// comes with the memory that it holds.
async fn run(
    service: &Service,
    owner: &Owner,
    upload: Upload,
    order: Order,
    representation: Representation,
) -> Result<(Answer, Memory), Problem> {
    let limits = service.pictures;
    let header = order.output.reading(&limits).probe(&upload.image)?;
    let plan = order.plan(&header)?;
    let cost = Cost::of_mesh(&header, &plan, &order.parameters, representation.format).of_output(
        &header,
        &order.output,
        representation.format,
    );
    let deadline = Instant::now() + service.deadline;
    let ticket = service.admission.admit(owner, cost, deadline).await?;
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
    _memory: Memory,
}

impl AsRef<[u8]> for Held {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

/// The answer with its headers.
fn respond(
    answer: Answer,
    memory: Memory,
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
