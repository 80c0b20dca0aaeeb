//! The record of a job, and its events.

use crate::blobs::chunks::ChunkedBlob;
use pixmesh_codec::Header;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fmt;
use std::ops::Range;
use std::time::Duration;
use uuid::Uuid;

/// The id of a job: a UUID of version 7, so that later ids compare greater.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct JobId(Uuid);

impl JobId {
    /// A new id.
    #[must_use]
    pub fn new() -> Self {
        Self(Uuid::now_v7())
    }

    /// The id in its canonical text form, with hyphens and lower case; `None` for any other text.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let id = Self(Uuid::try_parse(text).ok()?);
        (id.to_string() == text).then_some(id)
    }

    /// The bytes of the id, which have the same order.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8; 16] {
        self.0.as_bytes()
    }

    /// An id that is less than all ids made at this time or later, and greater than all before.
    #[must_use]
    pub fn first_at(moment: Moment) -> Self {
        let mut bytes = [0; 16];
        bytes[..6].copy_from_slice(&moment.0.max(0).to_be_bytes()[2..]);
        Self::from_bytes(bytes)
    }

    /// The least id that is greater.
    #[must_use]
    pub fn following(self) -> Self {
        Self(Uuid::from_u128(self.0.as_u128().saturating_add(1)))
    }

    /// The id with these bytes.
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

/// The state of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum State {
    /// The job waits for a worker, for the first time or again.
    Queued,
    /// A worker has the job.
    Running,
    /// The mesh is stored.
    Completed,
    /// The job has a problem document instead of a mesh.
    Failed,
    /// The owner cancelled the job.
    Cancelled,
}

impl State {
    /// Every state, in the order of [`Self::NAMES`].
    pub const ALL: [Self; 5] =
        [Self::Queued, Self::Running, Self::Completed, Self::Failed, Self::Cancelled];
    /// The name of every state.
    pub const NAMES: &'static [&'static str] =
        &["queued", "running", "completed", "failed", "cancelled"];

    /// The name of the state.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }

    /// The state with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let index = Self::NAMES.iter().position(|known| *known == name)?;
        Some(Self::ALL[index])
    }

    /// Whether the job has ended.
    #[must_use]
    pub fn is_final(self) -> bool {
        matches!(self, Self::Completed | Self::Failed | Self::Cancelled)
    }
}

/// A time in milliseconds since 1970.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Moment(pub i64);

impl Moment {
    /// The time of the system's clock.
    #[must_use]
    pub fn now() -> Self {
        Self(jiff::Timestamp::now().as_millisecond())
    }

    /// The time that a text in the format of RFC 3339 names.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        text.parse::<jiff::Timestamp>().ok().map(|moment| Self(moment.as_millisecond()))
    }

    pub(crate) fn after(self, duration: Duration) -> Self {
        Self(self.0.saturating_add(i64::try_from(duration.as_millis()).unwrap_or(i64::MAX)))
    }

    /// The time so much earlier.
    #[must_use]
    pub fn before(self, duration: Duration) -> Self {
        Self(self.0.saturating_sub(i64::try_from(duration.as_millis()).unwrap_or(i64::MAX)))
    }
}

impl fmt::Display for Moment {
    /// In the format of RFC 3339, in UTC.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let moment = jiff::Timestamp::from_millisecond(self.0).unwrap_or_default();
        write!(formatter, "{moment:.3}")
    }
}

/// The picture of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    /// The name of the blob with the picture's file, followed by the file of the weights.
    pub digest: Digest,
    /// The length of the picture's file in bytes.
    pub bytes: u64,
    /// The shape according to the header.
    pub shape: PictureShape,
}

impl Picture {
    /// The length of the blob in bytes.
    #[must_use]
    pub fn stored_bytes(&self) -> u64 {
        self.bytes + self.shape.weights.map_or(0, |weights| weights.bytes)
    }
}

/// The shape of a picture.
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
    /// The picture of weights, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<StoredWeights>,
}

/// The weights of a picture, whose file follows that of the picture in the blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoredWeights {
    /// The length of the file in bytes.
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

/// The progress of a running job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// The running stage.
    pub stage: String,
    /// The completed fraction of the stage, 0 to 1.
    pub fraction: f64,
    /// The completed fraction of the job, 0 to 1.
    #[serde(default)]
    pub overall_fraction: f64,
    /// About how many seconds the rest takes; `None` while that cannot be told.
    #[serde(default)]
    pub remaining_s: Option<f64>,
}

/// The mesh of a completed job, which is stored as MODEL.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeshFigures {
    /// The name of the blob: SHA-256, in hexadecimal digits, of the MODEL text and the parts after it.
    pub digest: String,
    /// The length of the MODEL text in bytes.
    pub bytes: u64,
    /// Vertices.
    pub vertices: usize,
    /// Faces.
    pub faces: usize,
    /// Mean squared error.
    pub mse: f64,
    /// PSNR in decibels; `None` if the mesh equals the picture.
    pub psnr_db: Option<f64>,
    /// The stages in their order, with their durations in milliseconds.
    pub timings_ms: Vec<(String, f64)>,
    /// SHA-256 of each chunk of the blob; empty if the blob is one chunk.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub chunks: Vec<Digest>,
    /// The order of importance of the vertices, if it is stored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub progression: Option<StoredPart>,
    /// The picture that glTF shows, if it is stored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texture: Option<StoredPart>,
    /// The image as it was sent, if it is kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<StoredPart>,
}

/// A part of the blob behind the MODEL text: first the order of importance of the vertices as pmesh,
/// then the picture that glTF shows, then the image as it was sent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoredPart {
    /// The length of the part in bytes.
    pub bytes: u64,
    /// SHA-256 of the MODEL text alone, in hexadecimal digits.
    pub model_digest: String,
}

impl MeshFigures {
    /// The blob; `None` if the stored digest is damaged.
    #[must_use]
    pub fn blob(&self) -> Option<ChunkedBlob> {
        Some(ChunkedBlob {
            digest: self.digest.parse().ok()?,
            bytes: self.place_of_image().end,
            chunks: self.chunks.clone(),
        })
    }

    /// SHA-256 of the MODEL text, in hexadecimal digits.
    #[must_use]
    pub fn model_digest(&self) -> &str {
        let part = self.progression.as_ref().or(self.texture.as_ref()).or(self.image.as_ref());
        part.map_or(&self.digest, |part| &part.model_digest)
    }

    /// Where the progression lies in the blob; empty if there is none.
    #[must_use]
    pub fn place_of_progression(&self) -> Range<u64> {
        self.bytes..self.bytes + self.progression.as_ref().map_or(0, |part| part.bytes)
    }

    /// Where the texture lies in the blob; empty if there is none.
    #[must_use]
    pub fn place_of_texture(&self) -> Range<u64> {
        let start = self.place_of_progression().end;
        start..start + self.texture.as_ref().map_or(0, |part| part.bytes)
    }

    /// Where the image lies in the blob; empty if it is not kept.
    #[must_use]
    pub fn place_of_image(&self) -> Range<u64> {
        let start = self.place_of_texture().end;
        start..start + self.image.as_ref().map_or(0, |part| part.bytes)
    }
}

/// A job to submit.
#[derive(Clone, Debug)]
pub struct NewJob {
    /// The id.
    pub id: JobId,
    /// The owner.
    pub owner: Owner,
    /// The [stored](pixmesh_engine::MeshOptions::stored) options of the mesh.
    pub options: String,
    /// The picture, whose blob is stored already.
    pub picture: Picture,
    /// The client's idempotency key.
    pub idempotency_key: Option<String>,
}

impl NewJob {
    /// The digest of what must be equal in a repeated submission: the picture and the options.
    #[must_use]
    pub fn fingerprint(&self) -> Digest {
        // Without the version of the format, which may change between the submissions.
        let query = self.options.split_once(';').map_or(&*self.options, |(_, query)| query);
        Digest::of_texts(&[&self.picture.digest.to_string(), query])
    }
}

/// A stored job.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// The id.
    pub id: JobId,
    /// The owner.
    pub owner: Owner,
    /// The state.
    pub state: State,
    /// The number of attempts that were started.
    pub attempt: u32,
    /// The [stored](pixmesh_engine::MeshOptions::stored) options of the mesh.
    pub options: String,
    /// The picture.
    pub picture: Picture,
    /// The progress while the job runs.
    pub progress: Option<Progress>,
    /// The mesh of a completed job.
    pub mesh: Option<MeshFigures>,
    /// The problem document of a failed job.
    pub problem: Option<Value>,
    /// The time of the submission.
    pub created: Moment,
    /// The time of the first claim.
    pub started: Option<Moment>,
    /// The time of the end.
    pub finished: Option<Moment>,
    /// The time at which the job expires.
    pub expires: Option<Moment>,
    /// The number of changes, from 1.
    pub revision: u64,
}

impl Record {
    /// The record of a new job.
    pub(crate) fn queued(job: &NewJob, created: Moment) -> Self {
        Self {
            id: job.id,
            owner: job.owner.clone(),
            state: State::Queued,
            attempt: 0,
            options: job.options.clone(),
            picture: job.picture,
            progress: None,
            mesh: None,
            problem: None,
            created,
            started: None,
            finished: None,
            expires: None,
            revision: 1,
        }
    }
}

/// The problem document (RFC 9457) of a job whose lease expired in the last attempt.
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

/// The problem document of a job with a damaged record.
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
    /// The revision of the job after the change.
    pub revision: u64,
    /// The time of the change.
    pub at: Moment,
    /// The state after the change.
    pub state: State,
    /// The attempt.
    pub attempt: u32,
    /// The new progress; `None` for a change of state.
    pub progress: Option<Progress>,
}

impl Picture {
    /// The picture of a file with this header.
    #[must_use]
    pub fn new(digest: Digest, bytes: usize, header: &Header) -> Self {
        Self { digest, bytes: bytes as u64, shape: header.into() }
    }

    /// SHA-256 of the picture's file.
    #[must_use]
    pub fn file_digest(&self) -> Digest {
        self.shape.weights.map_or(self.digest, |weights| weights.picture_digest)
    }

    /// The shape as JSON.
    pub(crate) fn shape_column(&self) -> String {
        serde_json::to_string(&self.shape).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::figures;

    #[test]
    fn progression_changes_the_digest_of_the_blob_only() {
        let alone = MeshFigures { digest: "of all".into(), ..figures("mesh") };
        assert_eq!(alone.model_digest(), "of all");
        let progression = StoredPart { bytes: 3, model_digest: "of the model".into() };
        let both = MeshFigures { progression: Some(progression), ..alone };
        assert_eq!(both.model_digest(), "of the model");
    }

    #[test]
    fn only_the_canonical_text_is_an_id() {
        let id = JobId::new();
        assert_eq!(JobId::parse(&id.to_string()), Some(id));
        let plain = id.to_string().replace('-', "");
        for wrong in [&plain, &id.to_string().to_uppercase(), &format!("{{{id}}}"), "..", ""] {
            assert_eq!(JobId::parse(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn later_ids_and_their_bytes_compare_greater() {
        let ids: Vec<JobId> = (0..1000).map(|_| JobId::new()).collect();
        assert!(ids.is_sorted() && ids.is_sorted_by_key(|id| *id.as_bytes()));
    }

    #[test]
    fn ids_are_found_by_the_time_they_were_made() {
        let (before, id) = (Moment::now(), JobId::new());
        assert!(JobId::first_at(before) < id && id < JobId::first_at(Moment(before.0 + 60_000)));
        assert_eq!(Moment::parse(&before.to_string()), Some(before));
    }

    #[test]
    fn states_are_found_by_their_names() {
        for state in State::ALL {
            assert_eq!(State::named(state.name()), Some(state));
        }
        assert_eq!(State::named("Queued"), None);
    }

    #[test]
    fn moments_are_formatted_in_utc() {
        assert_eq!(Moment(1_700_000_000_123).to_string(), "2023-11-14T22:13:20.123Z");
    }
}
