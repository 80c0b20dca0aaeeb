//! Receives the upload: the bytes of its files, and with a form the parameters beside them.
//!
//! A body is the image itself, or `multipart/form-data` with one part `image`, and the parameters
//! as fields or as one JSON part `params`, perhaps with a part `weights`. A job also takes a JSON
//! object with the image in base64. Other resources take other files, as their [`Wanted`] says.
//!
//! The whole body is collected first, then read. Every byte counts against the body limit and the
//! memory for bodies as it arrives, and the body must arrive within the timeout. Content-Type only
//! tells a form from a file: the content decides the file's format.

mod curl;
mod form;
mod json;
mod meter;

pub use meter::{BodyLimit, BodyMemory, Charge};

use super::fields::Fields;
use crate::problem::{Kind, Problem, internal};
use axum::body::Body;
use axum::http::HeaderMap;
use axum::http::header::{CONTENT_ENCODING, CONTENT_LENGTH, CONTENT_TYPE};
use bytes::Bytes;
use http_body::Body as _;
use http_body_util::BodyExt;
use meter::Meter;
use pixmesh_engine::Owner;
use std::sync::Arc;
use std::time::Duration;
use tokio::task::spawn_blocking;

/// The limits of request bodies, and the memory that they share.
#[derive(Clone, Debug)]
pub struct Intake {
    /// Longest body.
    pub max_body: BodyLimit,
    /// Longest time for a body to arrive.
    pub timeout: Duration,
    /// Memory for all bodies at a time.
    pub memory: BodyMemory,
}

/// The files that a resource wants.
#[derive(Clone, Copy, Debug)]
pub struct Wanted<const N: usize> {
    /// Their names as parts of a form; a body that is no form is the only one of them.
    pub files: [&'static str; N],
    /// How many of them are required, from the first; the others are optional.
    pub required: usize,
    /// The media types that the Content-Type of each may name; the content decides.
    pub labels: [&'static [&'static str]; N],
    /// Whether a JSON object with base64 is accepted.
    pub json: bool,
}

const IMAGE_LABELS: &[&str] = &["image/*", "application/octet-stream"];
const MESH_LABELS: &[&str] = &[
    "text/plain",
    "application/vnd.pixmesh.model",
    "application/vnd.pixmesh.pmesh",
    "application/octet-stream",
];
const ANY_LABELS: &[&str] = &[
    "image/*",
    "text/plain",
    "application/vnd.pixmesh.model",
    "application/vnd.pixmesh.pmesh",
    "application/octet-stream",
];

/// An image to mesh, and a picture that says how much its pixels matter.
pub const IMAGE: Wanted<2> =
    Wanted { files: ["image", "weights"], required: 1, labels: [IMAGE_LABELS; 2], json: false };

/// The same for a job.
pub const IMAGE_OF_JOB: Wanted<2> = Wanted { json: true, ..IMAGE };

/// A mesh to convert, and the picture that glTF shows.
pub const MESH: Wanted<2> = Wanted {
    files: ["mesh", "image"],
    required: 1,
    labels: [MESH_LABELS, IMAGE_LABELS],
    json: false,
};

/// A mesh to rebuild the picture of.
pub const MODEL: Wanted<1> =
    Wanted { files: ["model"], required: 1, labels: [MESH_LABELS], json: false };

/// A picture, and a picture or a mesh that approximates it.
pub const COMPARED: Wanted<2> = Wanted {
    files: ["image", "approximation"],
    required: 2,
    labels: [IMAGE_LABELS, ANY_LABELS],
    json: false,
};

/// A file as it was received, with the memory it is charged for.
#[derive(Debug)]
pub struct Upload {
    /// The file's bytes, of any format.
    pub bytes: Bytes,
    /// Freed with the bytes.
    pub charge: Arc<Charge>,
}

impl AsRef<[u8]> for Upload {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

impl Upload {
    /// Appends another file, and reserves memory for the copy meanwhile.
    ///
    /// # Errors
    /// `overloaded` when bodies take all of their memory.
    pub fn append(&mut self, other: &Self) -> Result<(), Problem> {
        let both = (self.bytes.len() + other.bytes.len()) as u64;
        self.charge.grow_or_refuse(2 * both)?;
        self.bytes = [&self.bytes[..], &other.bytes].concat().into();
        Ok(())
    }
}

impl Intake {
    /// Receives all of the files wanted, and adds the parameters beside them to `fields`.
    ///
    /// # Errors
    /// `unsupported-encoding`, `unsupported-media-type`, `body-too-large`, `request-timeout`,
    /// `overloaded` when bodies take all of their memory, and whatever is wrong with a form.
    pub async fn receive<const N: usize>(
        &self,
        owner: &Owner,
        wanted: &Wanted<N>,
        headers: &HeaderMap,
        body: Body,
        fields: &mut dyn Fields,
    ) -> Result<[Upload; N], Problem> {
        let found = self.receive_some(owner, wanted, headers, body, fields).await?;
        let files = wanted.files.into_iter().zip(found);
        let files = files.map(|(name, file)| file.ok_or_else(|| missing(name)));
        let files: Vec<Upload> = files.collect::<Result<_, _>>()?;
        files.try_into().map_err(|_| missing(wanted.files[0]))
    }

    /// Receives the first file, and the last if there may be two and it comes.
    ///
    /// # Errors
    /// As [`Self::receive`].
    pub async fn receive_first<const N: usize>(
        &self,
        owner: &Owner,
        wanted: &Wanted<N>,
        headers: &HeaderMap,
        body: Body,
        fields: &mut dyn Fields,
    ) -> Result<(Upload, Option<Upload>), Problem> {
        let found = self.receive_some(owner, wanted, headers, body, fields).await?;
        let mut found = found.into_iter();
        let first = found.next().flatten().ok_or_else(|| missing(wanted.files[0]))?;
        Ok((first, found.next().flatten()))
    }

    /// Receives the files that come.
    ///
    /// # Errors
    /// As [`Self::receive`].
    pub async fn receive_some<const N: usize>(
        &self,
        owner: &Owner,
        wanted: &Wanted<N>,
        headers: &HeaderMap,
        body: Body,
        fields: &mut dyn Fields,
    ) -> Result<[Option<Upload>; N], Problem> {
        refuse_encoded(headers)?;
        let label = wanted.label(headers)?;
        self.refuse_announced(headers)?;
        let charge = Arc::new(self.memory.charge(owner));
        let meter = Meter::new(self.max_body, Arc::clone(&charge));
        let receiving = async {
            let body = collect(body, meter).await?;
            wanted.read(&label, headers, body, &charge, fields).await
        };
        tokio::time::timeout(self.timeout, receiving).await.map_err(|_| self.too_slow())?
    }

    /// Refuses a body that is too long before any of it is read.
    fn refuse_announced(&self, headers: &HeaderMap) -> Result<(), Problem> {
        let text = headers.get(CONTENT_LENGTH).and_then(|length| length.to_str().ok());
        match text.and_then(|length| length.parse::<u64>().ok()) {
            Some(length) => self.max_body.check(length),
            None => Ok(()),
        }
    }

    /// Takes a stored file in the place of one that is sent, with the memory for its bytes.
    ///
    /// # Errors
    /// `overloaded` when bodies take all of their memory.
    pub fn hold(&self, owner: &Owner, bytes: Bytes) -> Result<Upload, Problem> {
        let charge = Arc::new(self.memory.charge(owner));
        charge.grow_or_refuse(bytes.len() as u64)?;
        Ok(Upload { bytes, charge })
    }

    fn too_slow(&self) -> Problem {
        let detail = format!(
            "the body did not arrive within {} s: use a faster connection or send a smaller file",
            self.timeout.as_secs_f64()
        );
        Problem::new(Kind::RequestTimeout, detail).setting("--body-timeout")
    }
}

/// The problem of a file that did not come.
pub fn missing(name: &str) -> Problem {
    let kind = if name == "image" { Kind::ImageMissing } else { Kind::PartMissing };
    Problem::new(kind, format!("the request has no part '{name}': send the file under this name"))
        .param(name)
}

/// Reads a JSON object: its files lie in memory beside its text, and its length takes its time.
async fn read_json<const N: usize>(
    files: [&'static str; N],
    body: Bytes,
    charge: &Charge,
    fields: &mut dyn Fields,
) -> Result<[Option<Bytes>; N], Problem> {
    charge.grow_or_refuse(2 * body.len() as u64)?;
    let read = spawn_blocking(move || json::read(files, &body)).await;
    let (found, pairs) = read.map_err(|error| internal("a body could not be read", &error))??;
    pairs.iter().try_for_each(|(name, text)| fields.add(name, text))?;
    Ok(found.map(|file| file.map(Bytes::from)))
}

/// The kind of body that the Content-Type names.
enum Label {
    File,
    Form,
    Json,
}

impl<const N: usize> Wanted<N> {
    /// The files of a body of this label.
    async fn read(
        &self,
        label: &Label,
        headers: &HeaderMap,
        body: Bytes,
        charge: &Arc<Charge>,
        fields: &mut dyn Fields,
    ) -> Result<[Option<Upload>; N], Problem> {
        let found = match label {
            Label::File => {
                curl::refuse_slips(headers, &body)?;
                let mut files = [const { None }; N];
                files[0] = Some(body);
                files
            }
            Label::Form => form::read(self, headers, body, fields).await?,
            Label::Json => read_json(self.files, body, charge, fields).await?,
        };
        let upload = |bytes| Upload { bytes, charge: Arc::clone(charge) };
        Ok(found.map(|file| file.map(upload)))
    }

    fn label(&self, headers: &HeaderMap) -> Result<Label, Problem> {
        let Some(value) = headers.get(CONTENT_TYPE) else { return self.only_file("") };
        let label = value.to_str().unwrap_or("(unreadable)");
        let is = |name: &str| essence(label).eq_ignore_ascii_case(name);
        if is("multipart/form-data") {
            return Ok(Label::Form);
        }
        if self.json && is("application/json") {
            return Ok(Label::Json);
        }
        // What curl calls any body given with --data-binary unless told otherwise: no statement.
        if !is(curl::LABEL) {
            self.accept_label(0, label)?;
        }
        self.only_file(label)
    }

    /// A body that is no form is a file where one is wanted.
    fn only_file(&self, label: &str) -> Result<Label, Problem> {
        if self.required == 1 { Ok(Label::File) } else { Err(self.refuse_label(label, &[])) }
    }

    /// Accepts the labels that the file of this index may have, right or wrong.
    fn accept_label(&self, index: usize, label: &str) -> Result<(), Problem> {
        let essence = essence(label).to_ascii_lowercase();
        let is_accepted = |accepted: &&str| match accepted.strip_suffix('*') {
            Some(kind) => essence.starts_with(kind),
            None => essence == **accepted,
        };
        if self.labels[index].iter().any(is_accepted) {
            return Ok(());
        }
        Err(self.refuse_label(&essence, self.labels[index]))
    }

    fn refuse_label(&self, label: &str, files: &[&str]) -> Problem {
        let essence: String = essence(label).chars().take(64).collect();
        let whole =
            ["multipart/form-data"].into_iter().chain(self.json.then_some("application/json"));
        let allowed: Vec<&str> = files.iter().copied().chain(whole).collect();
        let detail = format!(
            "a body of type '{essence}' is not accepted: send {}{}",
            allowed.join(", "),
            if files.is_empty() { "" } else { ", or the file without a type" }
        );
        Problem::new(Kind::UnsupportedMediaType, detail).allowed(&allowed)
    }
}

/// Type and subtype of a media type, without its parameters.
fn essence(label: &str) -> &str {
    label.split(';').next().unwrap_or_default().trim()
}

/// Refuses compressed bodies: they could be of any size.
fn refuse_encoded(headers: &HeaderMap) -> Result<(), Problem> {
    let identity = |value: &[u8]| value.trim_ascii().eq_ignore_ascii_case(b"identity");
    if headers.get_all(CONTENT_ENCODING).iter().all(|value| identity(value.as_bytes())) {
        return Ok(());
    }
    let detail = "compressed bodies are not accepted: send the body without a Content-Encoding";
    Err(Problem::new(Kind::UnsupportedEncoding, detail).allowed(&["identity"]))
}

/// How much of a body must have arrived before memory for all that it announces is reserved.
const TRUSTED_AFTER: usize = 256 * 1024;

/// The whole of a body. A large one is copied only once as it grows.
async fn collect(mut body: Body, mut meter: Meter) -> Result<Bytes, Problem> {
    let announced = usize::try_from(body.size_hint().lower()).unwrap_or_default();
    let mut bytes = Vec::new();
    while let Some(frame) = body.frame().await {
        let Ok(data) = frame.map_err(|_| broken_off())?.into_data() else { continue };
        meter.count(data.len())?;
        if bytes.len() >= TRUSTED_AFTER {
            // Without that much memory at once the buffer grows step by step.
            let _ = bytes.try_reserve_exact(announced.saturating_sub(bytes.len()));
        }
        bytes.extend_from_slice(&data);
    }
    Ok(bytes.into())
}

fn broken_off() -> Problem {
    Problem::new(
        Kind::BadRequest,
        "the body ended before the announced length: send the request again",
    )
}
