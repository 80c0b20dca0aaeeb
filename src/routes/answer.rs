//! The answer with a mesh, or with the picture rebuilt from one: its headers and its bytes.

use crate::extract::accept::Representation;
use crate::problem::{Kind, Problem, internal};
use axum::body::Body;
use axum::http::header::{
    ACCEPT_RANGES, CONTENT_DISPOSITION, CONTENT_RANGE, CONTENT_TYPE, ETAG, InvalidHeaderValue, VARY,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use headers::{HeaderMapExt, IfMatch, IfNoneMatch, IfRange};
use pixmesh_engine::scheduler::Memory;
use pixmesh_meshing::Fidelity;
use std::ops::{Bound, Range};

/// What is known of a mesh.
#[derive(Clone, Debug)]
pub(super) struct Figures {
    pub(super) vertices: usize,
    pub(super) faces: usize,
    /// How close the mesh is to the image; `None` where that is not known.
    pub(super) error: Option<MeshError>,
    /// What was run, as a query.
    pub(super) parameters: String,
    /// The value of `Server-Timing`.
    pub(super) timing: String,
}

/// The error of a mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeshError {
    pub(super) psnr_db: f64,
    pub(super) mse: f64,
}

impl From<&Fidelity> for MeshError {
    fn from(fidelity: &Fidelity) -> Self {
        Self { psnr_db: fidelity.psnr_db(), mse: fidelity.mse() }
    }
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

/// Bytes that hold memory.
pub(super) fn held(bytes: Vec<u8>, memory: Memory) -> Bytes {
    Bytes::from_owner(Held { bytes, _memory: memory })
}

/// A strong entity tag.
pub(super) fn tag(text: impl std::fmt::Display) -> String {
    format!("\"{text}\"")
}

/// The headers of a representation, by its entity tag.
pub(super) fn headers_of(representation: Representation, tag: &str) -> Result<HeaderMap, Problem> {
    let disposition = format!("inline; filename=\"{}\"", representation.format.file_name());
    collected([
        (CONTENT_TYPE, representation.content_type().to_owned()),
        (CONTENT_DISPOSITION, disposition),
        (ETAG, tag.to_owned()),
        (VARY, "Accept".to_owned()),
    ])
}

/// The headers with the figures of a mesh.
pub(super) fn figures_of(figures: &Figures) -> Result<HeaderMap, Problem> {
    let mut headers = collected([
        (HeaderName::from_static("mesh-vertices"), figures.vertices.to_string()),
        (HeaderName::from_static("mesh-faces"), figures.faces.to_string()),
        (HeaderName::from_static("mesh-parameters"), figures.parameters.clone()),
        (HeaderName::from_static("server-timing"), figures.timing.clone()),
    ])?;
    if let Some(MeshError { psnr_db, mse }) = figures.error {
        headers.extend(collected([
            (HeaderName::from_static("mesh-psnr"), psnr_db.to_string()),
            (HeaderName::from_static("mesh-mse"), mse.to_string()),
        ])?);
    }
    Ok(headers)
}

fn collected<const N: usize>(headers: [(HeaderName, String); N]) -> Result<HeaderMap, Problem> {
    let headers = headers.into_iter().map(|(name, text)| Ok((name, HeaderValue::try_from(text)?)));
    headers
        .collect::<Result<HeaderMap, InvalidHeaderValue>>()
        .map_err(|error| internal("a header of the answer is not valid", &error))
}

/// Whether the client has this representation already.
pub(super) fn is_known(request: &HeaderMap, tag: &str) -> bool {
    let (Some(known), Ok(tag)) = (request.typed_get::<IfNoneMatch>(), tag.parse()) else {
        return false;
    };
    !known.precondition_passes(&tag)
}

/// Refuses a client that asks for another representation alone.
///
/// # Errors
/// `precondition-failed`.
pub(super) fn refuse_other(request: &HeaderMap, tag: &str) -> Result<(), Problem> {
    let (Some(wanted), Ok(parsed)) = (request.typed_get::<IfMatch>(), tag.parse()) else {
        return Ok(());
    };
    if wanted.precondition_passes(&parsed) {
        return Ok(());
    }
    let detail = format!("If-Match names other entity tags than {tag}");
    Err(Problem::new(Kind::PreconditionFailed, detail).param("If-Match").member("actual", tag))
}

/// The answer to a client that has the representation already.
pub(super) fn not_modified(mut headers: HeaderMap) -> Response {
    for described in [CONTENT_TYPE, CONTENT_DISPOSITION] {
        headers.remove(described);
    }
    (StatusCode::NOT_MODIFIED, headers).into_response()
}

/// The part of a representation that the client asks for; `None` for all of it.
///
/// Several ranges in one request are answered with the whole, as RFC 9110 allows.
///
/// # Errors
/// `range-not-satisfiable` when it begins beyond the end.
pub(super) fn part(
    request: &HeaderMap,
    tag: &str,
    length: u64,
) -> Result<Option<Range<u64>>, Problem> {
    let Some(range) = request.typed_get::<headers::Range>() else { return Ok(None) };
    if let Some(condition) = request.typed_get::<IfRange>()
        && condition.is_modified(tag.parse().ok().as_ref(), None)
    {
        return Ok(None);
    }
    // What is written as a range and cannot be satisfied is left out by the library.
    let written = request.get(axum::http::header::RANGE).map_or(b"" as &[u8], |v| v.as_bytes());
    if written.contains(&b',') || !written.starts_with(b"bytes=") {
        return Ok(None);
    }
    let satisfied = range.satisfiable_ranges(length).next();
    let range = satisfied.and_then(|bounds| within(bounds, length));
    range.map(Some).ok_or_else(|| {
        let detail = format!("the representation has {length} bytes");
        Problem::new(Kind::RangeNotSatisfiable, detail).member("limit", length)
    })
}

/// Bounds as a range of a length; `None` for an empty one.
fn within((start, end): (Bound<u64>, Bound<u64>), length: u64) -> Option<Range<u64>> {
    let start = match start {
        Bound::Included(start) => start,
        Bound::Excluded(start) => start + 1,
        Bound::Unbounded => 0,
    };
    let end = match end {
        Bound::Included(end) => end.saturating_add(1),
        Bound::Excluded(end) => end,
        Bound::Unbounded => length,
    };
    let range = start..end.min(length);
    (!range.is_empty()).then_some(range)
}

/// The answer with all of a representation or a part of it.
pub(super) fn respond(
    mut headers: HeaderMap,
    part: Option<&Range<u64>>,
    length: u64,
    body: Body,
) -> Response {
    headers.insert(ACCEPT_RANGES, HeaderValue::from_static("bytes"));
    let sent = part.map_or(length, |range| range.end - range.start);
    headers.insert(axum::http::header::CONTENT_LENGTH, sent.into());
    let Some(range) = part else { return (headers, body).into_response() };
    let content = format!("bytes {}-{}/{length}", range.start, range.end - 1);
    if let Ok(content) = HeaderValue::try_from(content) {
        headers.insert(CONTENT_RANGE, content);
    }
    (StatusCode::PARTIAL_CONTENT, headers, body).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(headers: &[(&'static str, &str)]) -> HeaderMap {
        let pairs = headers.iter();
        pairs.map(|(name, text)| (HeaderName::from_static(name), text.parse().unwrap())).collect()
    }

    fn range(text: &str) -> Result<Option<Range<u64>>, Kind> {
        part(&request(&[("range", text)]), "\"t\"", 10).map_err(|problem| problem.kind())
    }

    #[test]
    fn one_range_is_a_part_and_anything_else_the_whole() {
        assert_eq!(range("bytes=0-3"), Ok(Some(0..4)));
        assert_eq!(range("bytes=4-"), Ok(Some(4..10)));
        assert_eq!(range("bytes=-3"), Ok(Some(7..10)));
        assert_eq!(range("bytes=8-99"), Ok(Some(8..10)));
        assert_eq!(range("bytes=0-1,3-4"), Ok(None));
        assert_eq!(range("lines=0-1"), Ok(None));
        for text in ["bytes=10-", "bytes=99-100", "bytes=-0"] {
            assert_eq!(range(text), Err(Kind::RangeNotSatisfiable), "{text}");
        }
    }

    #[test]
    fn a_range_of_another_representation_is_the_whole() {
        let of = |tag| part(&request(&[("range", "bytes=0-3"), ("if-range", tag)]), "\"t\"", 10);
        assert_eq!(of("\"t\""), Ok(Some(0..4)));
        assert_eq!(of("\"old\""), Ok(None));
    }

    #[test]
    fn another_representation_than_the_wanted_one_is_refused() {
        let refusal = |text| {
            let refused = refuse_other(&request(&[("if-match", text)]), "\"t\"");
            refused.err().map(|problem| problem.kind())
        };
        assert_eq!([refusal("\"t\""), refusal("\"a\", \"t\""), refusal("*")], [None; 3]);
        assert_eq!(refusal("\"a\""), Some(Kind::PreconditionFailed));
        assert_eq!(refusal("W/\"t\""), Some(Kind::PreconditionFailed), "a weak tag never matches");
    }

    #[test]
    fn a_known_tag_is_not_sent_again() {
        let is_known = |text| is_known(&request(&[("if-none-match", text)]), "\"t\"");
        assert!(is_known("\"t\"") && is_known("\"a\", W/\"t\"") && is_known("*"));
        assert!(!is_known("\"a\""));
    }
}
