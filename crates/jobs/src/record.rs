//! What is kept of a job, and what happens to it.

use crate::blobs::chunks::ChunkedBlob;
use pixmesh_codec::Header;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fmt;
use uuid::Uuid;

/// A job's name: a UUID of version 7, so that later ones compare greater.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct JobId(Uuid);

impl JobId {
    /// A new one.
    #[must_use]
    pub fn new() -> Self {
        Self(Uuid::now_v7())
    }

    /// The one written so, hyphens and lower case included; `None` for anything else.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let id = Self(Uuid::try_parse(text).ok()?);
        (id.to_string() == text).then_some(id)
    }

    /// Its bytes, which order like it.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8; 16] {
        self.0.as_bytes()
    }

    /// The one of these bytes.
    #[must_use]
    pub fn from_bytes(bytes: [u8; 16]) -> Self {
        Self(Uuid::from_bytes(bytes))
    }
}

impl Default for JobId {
    fn default() -> Self {
        Self::new()
    }
}

impl fmt::Display for JobId {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.hyphenated().fmt(formatter)
    }
}

/// Where in its life a job is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum State {
    /// It waits for a worker, for the first time or again.
    Queued,
    /// A worker has it.
    Running,
    /// Its mesh is there.
    Completed,
    /// It has a problem instead of a mesh.
    Failed,
    /// Its owner wanted it no more.
    Cancelled,
}

impl State {
    /// Every state, in the order of [`Self::NAMES`].
    pub const ALL: [Self; 5] =
        [Self::Queued, Self::Running, Self::Completed, Self::Failed, Self::Cancelled];
    /// The name of every state.
    pub const NAMES: &'static [&'static str] =
        &["queued", "running", "completed", "failed", "cancelled"];

    /// The state's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }

    /// The state of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let index = Self::NAMES.iter().position(|known| *known == name)?;
        Some(Self::ALL[index])
    }

    /// Whether nothing more will happen to the job.
    #[must_use]
    pub fn is_final(self) -> bool {
        matches!(self, Self::Completed | Self::Failed | Self::Cancelled)
    }
}

/// A moment in milliseconds since 1970, of the system's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Moment(pub i64);

impl Moment {
    /// The present.
    #[must_use]
    pub fn now() -> Self {
        Self(jiff::Timestamp::now().as_millisecond())
    }
}

impl fmt::Display for Moment {
    /// As RFC 3339 has it, in UTC.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let moment = jiff::Timestamp::from_millisecond(self.0).unwrap_or_default();
        write!(formatter, "{moment:.3}")
    }
}

/// The image that a job meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Name of the blob with its bytes, and those of its weights behind them.
    pub digest: Digest,
    /// Length of the picture's file in bytes.
    pub bytes: u64,
    /// What its header says.
    pub shape: PictureShape,
}

/// The shape of a picture, as it is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PictureShape {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Components, alpha included.
    pub components: usize,
    /// Bits per sample.
    pub precision: u8,
    /// The picture that says how much its points matter, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<KeptWeights>,
}

/// The weights of a picture: their file follows the picture's in its blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeptWeights {
    /// Length of the file in bytes.
    pub bytes: u64,
    /// SHA-256 of the file.
    pub digest: Digest,
    /// SHA-256 of the picture's file alone.
    pub picture_digest: Digest,
}

impl From<&Header> for PictureShape {
    fn from(header: &Header) -> Self {
        let Header { width, height, component_count: components, precision, .. } = *header;
        Self { width, height, components, precision, weights: None }
    }
}

/// How far running work is.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// The stage that runs.
    pub stage: String,
    /// How much of that stage is behind, 0 to 1.
    pub fraction: f64,
}

/// The mesh of a completed job, which is kept as MODEL.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeshFigures {
    /// SHA-256 of the blob, in hexadecimal digits, which is its name: of the MODEL text, and of
    /// what follows it.
    pub digest: String,
    /// Length of the MODEL text.
    pub bytes: u64,
    /// Vertices.
    pub vertices: usize,
    /// Faces.
    pub faces: usize,
    /// Mean squared error.
    pub mse: f64,
    /// PSNR in decibels; `None` for a perfect copy.
    pub psnr_db: Option<f64>,
    /// Milliseconds of each stage, in their order.
    pub timings_ms: Vec<(String, f64)>,
    /// SHA-256 of each chunk of the blob; empty for one of one chunk.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub chunks: Vec<Digest>,
    /// The order of importance of the vertices, where it is kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub progression: Option<KeptProgression>,
}

/// The order of importance of a mesh's vertices, as pmesh: it follows the MODEL in its blob.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeptProgression {
    /// Length of the pmesh.
    pub bytes: u64,
    /// SHA-256 of the MODEL text alone.
    pub model_digest: String,
}

impl MeshFigures {
    /// The blob with the MODEL text, and the progression behind it where that is kept; `None` when
    /// the stored digest is damaged.
    #[must_use]
    pub fn blob(&self) -> Option<ChunkedBlob> {
        let progression = self.progression.as_ref().map_or(0, |kept| kept.bytes);
        Some(ChunkedBlob {
            digest: self.digest.parse().ok()?,
            bytes: self.bytes + progression,
            chunks: self.chunks.clone(),
        })
    }

    /// SHA-256 of the MODEL text, in hexadecimal digits.
    #[must_use]
    pub fn model_digest(&self) -> &str {
        self.progression.as_ref().map_or(&self.digest, |kept| &kept.model_digest)
    }
}

/// A job that was not submitted yet.
#[derive(Clone, Debug)]
pub struct NewJob {
    /// Its name.
    pub id: JobId,
    /// Whose it is.
    pub owner: Owner,
    /// What to make: [stored](pixmesh_engine::MeshOptions::stored) options.
    pub order: String,
    /// Of which image: its blob is stored already.
    pub picture: Picture,
    /// The client's word by which a repeated submission is known.
    pub idempotency_key: Option<String>,
}

impl NewJob {
    /// What must be the same in a repeated submission: the image and the order.
    #[must_use]
    pub fn fingerprint(&self) -> Digest {
        // The version of the stored options may change between a submission and its repetition.
        let query = self.order.split_once(';').map_or(&*self.order, |(_, query)| query);
        Digest::of_texts(&[&self.picture.digest.to_string(), query])
    }
}

/// A job as it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Its name.
    pub id: JobId,
    /// Whose it is.
    pub owner: Owner,
    /// Where in its life it is.
    pub state: State,
    /// How many times a worker took it, this time included.
    pub attempt: u32,
    /// What to make.
    pub order: String,
    /// Of which image.
    pub picture: Picture,
    /// How far the work is, while it runs.
    pub progress: Option<Progress>,
    /// The mesh, once it is there.
    pub mesh: Option<MeshFigures>,
    /// The problem document of a job that failed.
    pub problem: Option<Value>,
    /// When it was submitted.
    pub created: Moment,
    /// When a worker first took it.
    pub started: Option<Moment>,
    /// When it came to its end.
    pub finished: Option<Moment>,
    /// When it will be forgotten.
    pub expires: Option<Moment>,
    /// Counts the changes, from 1.
    pub revision: u64,
}

/// The problem document (RFC 9457) of a job whose worker ended in every attempt.
#[must_use]
pub fn exhausted(attempts: u32) -> Value {
    json!({
        "type": "/problems/attempts-exhausted",
        "detail": format!(
            "the worker ended in each of {attempts} attempts before the job was done: the image \
             may be one that the service cannot take"
        ),
        "attempts": attempts,
    })
}

/// The problem document of a job whose record cannot be read.
#[must_use]
pub fn damaged() -> Value {
    json!({
        "type": "/problems/storage-damaged",
        "detail": "the record of the job is damaged: submit the job again",
    })
}

/// One change of a job's state or progress.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// The job's revision after it.
    pub revision: u64,
    /// When it happened.
    pub at: Moment,
    /// The state after it.
    pub state: State,
    /// The attempt that it belongs to.
    pub attempt: u32,
    /// How far the work is, where that is what changed.
    pub progress: Option<Progress>,
}

impl Picture {
    /// The picture of a file whose header was read.
    #[must_use]
    pub fn new(digest: Digest, bytes: usize, header: &Header) -> Self {
        Self { digest, bytes: bytes as u64, shape: header.into() }
    }

    /// SHA-256 of the picture's file.
    #[must_use]
    pub fn file_digest(&self) -> Digest {
        self.shape.weights.map_or(self.digest, |weights| weights.picture_digest)
    }

    /// One that stands for none, where tests need none.
    #[cfg(test)]
    pub(crate) fn of_bytes(bytes: &[u8]) -> Self {
        let header = Header {
            format: pixmesh_codec::PictureFormat::Png,
            width: 2,
            height: 2,
            component_count: 1,
            precision: 8,
        };
        Self::new(Digest::of(bytes), bytes.len(), &header)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_with_a_progression_behind_it_has_two_digests() {
        let alone = MeshFigures {
            digest: "of all".into(),
            bytes: 5,
            vertices: 4,
            faces: 2,
            mse: 0.0,
            psnr_db: None,
            timings_ms: Vec::new(),
            chunks: Vec::new(),
            progression: None,
        };
        assert_eq!(alone.model_digest(), "of all");
        let kept = KeptProgression { bytes: 3, model_digest: "of the model".into() };
        let both = MeshFigures { progression: Some(kept), ..alone };
        assert_eq!(both.model_digest(), "of the model");
    }

    #[test]
    fn only_the_one_way_of_writing_a_name_is_a_name() {
        let id = JobId::new();
        assert_eq!(JobId::parse(&id.to_string()), Some(id));
        let plain = id.to_string().replace('-', "");
        for wrong in [&plain, &id.to_string().to_uppercase(), &format!("{{{id}}}"), "..", ""] {
            assert_eq!(JobId::parse(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn later_names_compare_greater_and_so_do_their_bytes() {
        let ids: Vec<JobId> = (0..1000).map(|_| JobId::new()).collect();
        assert!(ids.is_sorted() && ids.is_sorted_by_key(|id| *id.as_bytes()));
    }

    #[test]
    fn states_have_the_names_that_they_are_found_by() {
        for state in State::ALL {
            assert_eq!(State::named(state.name()), Some(state));
        }
        assert_eq!(State::named("Queued"), None);
    }

    #[test]
    fn moments_are_written_in_utc() {
        assert_eq!(Moment(1_700_000_000_123).to_string(), "2023-11-14T22:13:20.123Z");
    }
}
