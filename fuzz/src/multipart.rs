//! Forms: the first byte is how the rest is cut into pieces on its way.

use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, HeaderValue, header::CONTENT_TYPE};
use futures_util::stream;
use pixmesh::extract::upload::{BodyLimit, BodyMemory, IMAGE, Intake};
use pixmesh::problem::Problem;
use pixmesh_engine::Owner;
use pixmesh_engine::params::ParameterSet;
use std::convert::Infallible;
use std::time::Duration;
use tokio::runtime::{Builder, Runtime};

thread_local! {
    static RUNTIME: Runtime =
        Builder::new_current_thread().enable_time().build().expect("a runtime of one thread");
}

/// What became of a form: the picture, its weights and the parameters, or what was wrong.
type Outcome = Result<(Vec<u8>, Option<Vec<u8>>, String), &'static str>;

/// Receives a form in one piece and in small ones.
pub fn run(bytes: &[u8]) {
    let Some((&cut, body)) = bytes.split_first() else { return };
    let whole = receive(body, body.len().max(1));
    let pieces = receive(body, 1 + usize::from(cut % 40));
    assert_eq!(whole, pieces, "the outcome depends on how the bytes arrive");
}

fn receive(body: &[u8], length: usize) -> Outcome {
    let pieces: Vec<Result<Bytes, Infallible>> =
        body.chunks(length).map(|piece| Ok(Bytes::copy_from_slice(piece))).collect();
    let mut headers = HeaderMap::new();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static("multipart/form-data; boundary=limit"));
    let intake = Intake {
        max_body: BodyLimit { bytes: 1 << 20, setting: "--max-body" },
        timeout: Duration::from_secs(30),
        memory: BodyMemory::new(8 << 20),
    };
    let mut parameters = ParameterSet::default();
    let body = Body::from_stream(stream::iter(pieces));
    let owner = Owner::Anonymous;
    let receiving = intake.receive_first(&owner, &IMAGE, &headers, body, &mut parameters);
    let received = RUNTIME.with(|runtime| runtime.block_on(receiving));
    let (image, weights) = received.map_err(|problem| problem.kind().slug())?;
    let order = parameters.finish().map_err(|error| Problem::from(error).kind().slug())?;
    let weights = weights.map(|weights| weights.bytes.to_vec());
    Ok((image.bytes.to_vec(), weights, order.query()))
}
