//! Reads a form: one part for each file, and the parameters as fields or as one JSON part `params`.

use super::{Wanted, missing};
use crate::extract::fields::Fields;
use crate::problem::{Kind, Problem};
use axum::body::Body;
use axum::extract::multipart::{Field, MultipartError};
use axum::extract::{DefaultBodyLimit, FromRequest, Multipart, Request};
use axum::http::HeaderMap;
use axum::http::header::CONTENT_TYPE;
use bytes::Bytes;
use pixmesh_codec::{DecodeError, Limits, PictureFormat, probe_mesh};
use pixmesh_engine::params::pairs_of_json;

/// The most parts of a form.
const MAX_PARTS: usize = 16;
/// The longest field in bytes; a file is only bound by the body's limit.
const MAX_FIELD: usize = 64 * 1024;

/// Reads a form: adds its parameters to `fields` and returns the bytes of its files, which share the
/// memory of the body.
pub(super) async fn read<const N: usize>(
    wanted: &Wanted<N>,
    headers: &HeaderMap,
    body: Bytes,
    fields: &mut dyn Fields,
) -> Result<[Option<Bytes>; N], Problem> {
    let mut form = parts_of(headers, body).await?;
    let mut contents = Contents { wanted, files: [const { None }; N], has_params: false };
    let mut count = 0;
    while let Some(field) = form.next_field().await.map_err(|error| malformed(&error))? {
        count += 1;
        if count > MAX_PARTS {
            return Err(too_many_parts());
        }
        contents.take(field, fields).await?;
    }
    Ok(contents.files)
}

/// The parts of a body, split at the boundary that its label names.
async fn parts_of(headers: &HeaderMap, body: Bytes) -> Result<Multipart, Problem> {
    let mut request = Request::new(Body::from(body));
    if let Some(label) = headers.get(CONTENT_TYPE) {
        request.headers_mut().insert(CONTENT_TYPE, label.clone());
    }
    // The body is within the service's own limit; the framework has another, of 2 MiB.
    DefaultBodyLimit::disable().apply(&mut request);
    Multipart::from_request(request, &()).await.map_err(|_| {
        Problem::new(Kind::MultipartMalformed, "the form's Content-Type names no boundary")
    })
}

/// What was found in a form so far.
struct Contents<'a, const N: usize> {
    wanted: &'a Wanted<N>,
    files: [Option<Bytes>; N],
    has_params: bool,
}

impl<const N: usize> Contents<'_, N> {
    /// Takes one part.
    async fn take(&mut self, field: Field<'_>, fields: &mut dyn Fields) -> Result<(), Problem> {
        let name = field.name().map(str::to_owned).ok_or_else(nameless)?;
        if let Some(index) = self.wanted.files.iter().position(|file| *file == name) {
            if self.files[index].is_some() {
                return Err(repeated(&name));
            }
            if let Some(label) = field.content_type() {
                self.wanted.accept_label(index, label)?;
            }
            self.files[index] = Some(file_of(field).await?);
            return Ok(());
        }
        match name.as_str() {
            "params" if self.has_params => return Err(repeated("params")),
            "params" => {
                self.has_params = true;
                let pairs = pairs_of_json(&within_field(file_of(field).await?)?)?;
                pairs.iter().try_for_each(|(name, text)| fields.add(name, text))?;
            }
            _ => {
                let bytes = file_of(field).await?;
                if let Some(content) = content_of(&bytes) {
                    return Err(self.misnamed(&name, content));
                }
                fields.add(&name, text(&within_field(bytes)?, &name)?)?;
            }
        }
        Ok(())
    }

    /// A file in a part that is no file's.
    fn misnamed(&self, found: &str, content: &str) -> Problem {
        let found: String = found.chars().take(64).collect();
        let wanted = self.wanted.files.join("' or '");
        let detail = format!("the part '{found}' holds a {content}: name it '{wanted}' instead");
        missing(self.wanted.files[0]).detail(detail).member("actual", found)
    }
}

/// What file a part holds, if any: a picture, of a format that is read or not, or a mesh.
fn content_of(bytes: &[u8]) -> Option<&'static str> {
    match PictureFormat::sniff(bytes) {
        Err(DecodeError::UnknownFormat | DecodeError::Empty) => {
            probe_mesh(bytes, &Limits::default()).is_ok().then_some("mesh")
        }
        _ => Some("picture"),
    }
}

/// The bytes of a part that is no file.
fn within_field(bytes: Bytes) -> Result<Bytes, Problem> {
    if bytes.len() > MAX_FIELD {
        let detail = format!("a field of the form is longer than {MAX_FIELD} bytes");
        return Err(Problem::new(Kind::MultipartMalformed, detail));
    }
    Ok(bytes)
}

/// The bytes of a file.
async fn file_of(field: Field<'_>) -> Result<Bytes, Problem> {
    field.bytes().await.map_err(|error| malformed(&error))
}

fn text<'b>(bytes: &'b [u8], name: &str) -> Result<&'b str, Problem> {
    str::from_utf8(bytes).map_err(|_| {
        let name: String = name.chars().take(64).collect();
        Problem::new(Kind::ParameterMalformed, format!("{name} is not UTF-8")).param(name)
    })
}

fn malformed(error: &MultipartError) -> Problem {
    let detail = format!("the form cannot be read: {}", error.body_text());
    Problem::new(Kind::MultipartMalformed, detail)
}

fn nameless() -> Problem {
    Problem::new(Kind::MultipartMalformed, "a part of the form has no name")
}

fn repeated(name: &str) -> Problem {
    let detail = format!("the form has more than one part '{name}'");
    Problem::new(Kind::DuplicatePart, detail).param(name)
}

fn too_many_parts() -> Problem {
    let detail = format!("the form has more than {MAX_PARTS} parts");
    Problem::new(Kind::TooManyParts, detail).limit(MAX_PARTS, MAX_PARTS + 1)
}
