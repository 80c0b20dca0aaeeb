//! What is kept of a job in its record, and how it changes.

use crate::queue::{Claim, Lease, MAX_ATTEMPTS, Outcome};
use crate::record::{
    self, Event, JobId, MeshFigures, Moment, NewJob, Picture, PictureShape, Progress, Record, State,
};
use pixmesh_engine::Owner;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::time::Duration;

/// The most changes of state that are kept; of a job that is handed back more often, the latest.
const MOST_CHANGES: usize = 64;

/// A job's record.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct StoredJob {
    owner: String,
    state: String,
    attempt: u32,
    fence: u64,
    #[serde(default)]
    cancel_requested: bool,
    order: String,
    image: StoredPicture,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    progress: Option<StoredProgress>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mesh: Option<MeshFigures>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    problem: Option<Value>,
    created_ms: i64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    started_ms: Option<i64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    finished_ms: Option<i64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    expires_ms: Option<i64>,
    revision: u64,
    changes: Vec<Change>,
    /// The name of the word that the job was submitted with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    word: Option<String>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct StoredPicture {
    sha256: String,
    bytes: u64,
    shape: PictureShape,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct StoredProgress {
    revision: u64,
    at_ms: i64,
    stage: String,
    fraction: f64,
}

/// A change of state.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Change {
    revision: u64,
    at_ms: i64,
    state: String,
    attempt: u32,
}

/// How a worker that fell silent leaves its job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TakenBack {
    /// It waits again.
    Queued,
    /// That was the last attempt.
    Exhausted,
    /// Its owner did not want it any more.
    Cancelled,
}

impl StoredJob {
    /// A job that comes in.
    pub(super) fn new(job: &NewJob, word: Option<String>) -> Self {
        let mut stored = Self {
            owner: job.owner.as_str().to_owned(),
            state: State::Queued.name().to_owned(),
            attempt: 0,
            fence: 0,
            cancel_requested: false,
            order: job.order.clone(),
            image: StoredPicture {
                sha256: job.picture.digest.to_string(),
                bytes: job.picture.bytes,
                shape: job.picture.shape,
            },
            progress: None,
            mesh: None,
            problem: None,
            created_ms: Moment::now().0,
            started_ms: None,
            finished_ms: None,
            expires_ms: None,
            revision: 0,
            changes: Vec::new(),
            word,
        };
        stored.enter(State::Queued);
        stored
    }

    /// Whose it is.
    pub(super) fn owner(&self) -> Owner {
        Owner::of_stored(&self.owner)
    }

    /// Where in its life it is; `None` for a state of another version of the program.
    pub(super) fn state(&self) -> Option<State> {
        State::named(&self.state)
    }

    /// Whether nothing more will happen to it.
    pub(super) fn is_final(&self) -> bool {
        self.state().is_some_and(State::is_final)
    }

    /// Grows whenever somebody gets or loses the job.
    pub(super) fn fence(&self) -> u64 {
        self.fence
    }

    /// How many times it was given to a worker.
    pub(super) fn attempt(&self) -> u32 {
        self.attempt
    }

    /// Whether its owner wants it no more.
    pub(super) fn is_cancel_requested(&self) -> bool {
        self.cancel_requested
    }

    /// Whether the time that it is kept for is over.
    pub(super) fn is_over(&self) -> bool {
        self.expires_ms.is_some_and(|end| end <= Moment::now().0)
    }

    /// The name of its image's blob.
    pub(super) fn image(&self) -> &str {
        &self.image.sha256
    }

    /// The name of its mesh's blob.
    pub(super) fn mesh(&self) -> Option<&str> {
        self.mesh.as_ref().map(|mesh| mesh.digest.as_str())
    }

    /// The names of all its blobs.
    pub(super) fn blobs(&self) -> impl Iterator<Item = &str> {
        std::iter::once(self.image()).chain(self.mesh())
    }

    /// Whether it needs a blob: its image until it has ended, its mesh from then on. A worker's
    /// mesh is referred to before the job has it.
    pub(super) fn needs(&self, blob: &str) -> bool {
        !self.is_final() || self.mesh() == Some(blob)
    }

    /// The name of the word that it was submitted with.
    pub(super) fn word(&self) -> Option<&str> {
        self.word.as_deref()
    }

    /// Whether a worker has it by this lease.
    pub(super) fn is_held_by(&self, lease: Lease) -> bool {
        self.state() == Some(State::Running) && self.fence == lease.fence
    }

    /// The job as others see it; `None` for one that cannot be read.
    pub(super) fn record(&self, id: JobId) -> Option<Record> {
        Some(Record {
            id,
            owner: self.owner(),
            state: self.state()?,
            attempt: self.attempt,
            order: self.order.clone(),
            picture: self.picture()?,
            progress: self.progress.as_ref().map(StoredProgress::value),
            mesh: self.mesh.clone(),
            problem: self.problem.clone(),
            created: Moment(self.created_ms),
            started: self.started_ms.map(Moment),
            finished: self.finished_ms.map(Moment),
            expires: self.expires_ms.map(Moment),
            revision: self.revision,
        })
    }

    fn picture(&self) -> Option<Picture> {
        let StoredPicture { sha256, bytes, shape } = &self.image;
        Some(Picture { digest: sha256.parse().ok()?, bytes: *bytes, shape: *shape })
    }

    /// What happened after a revision: every change of state, and how far running work is.
    pub(super) fn events(&self, after: u64) -> Vec<Event> {
        let changes = self.changes.iter().filter(|change| change.revision > after);
        let mut events: Vec<Event> = changes.filter_map(Change::event).collect();
        if let (Some(progress), Some(state)) = (&self.progress, self.state())
            && progress.revision > after
        {
            events.push(Event {
                revision: progress.revision,
                at: Moment(progress.at_ms),
                state,
                attempt: self.attempt,
                progress: Some(progress.value()),
            });
        }
        events.sort_by_key(|event| event.revision);
        events
    }

    /// Gives it to a worker, and counts the attempt.
    pub(super) fn begin(&mut self, id: JobId) -> Option<Claim> {
        self.attempt += 1;
        self.fence += 1;
        self.started_ms.get_or_insert(Moment::now().0);
        self.enter(State::Running);
        Some(Claim {
            lease: Lease { job: id, fence: self.fence },
            owner: self.owner(),
            attempt: self.attempt,
            order: self.order.clone(),
            picture: self.picture()?,
        })
    }

    /// Takes down how far its work is.
    pub(super) fn tell(&mut self, progress: &Progress) {
        self.revision += 1;
        self.progress = Some(StoredProgress {
            revision: self.revision,
            at_ms: Moment::now().0,
            stage: progress.stage.clone(),
            fraction: progress.fraction,
        });
    }

    /// Takes down that its owner wants it no more.
    pub(super) fn request_cancellation(&mut self) {
        self.cancel_requested = true;
    }

    /// Ends its worker's attempt.
    pub(super) fn finish(&mut self, outcome: &Outcome, ttl: Duration) {
        match outcome {
            _ if self.cancel_requested => self.end(&Outcome::Cancelled, ttl),
            Outcome::HandedBack => {
                self.attempt -= 1;
                self.requeue();
            }
            Outcome::Retry(_) if self.attempt < MAX_ATTEMPTS => self.requeue(),
            _ => self.end(outcome, ttl),
        }
    }

    /// Takes it from a worker that fell silent.
    pub(super) fn take_back(&mut self, ttl: Duration) -> TakenBack {
        if self.cancel_requested {
            self.fence += 1;
            self.end(&Outcome::Cancelled, ttl);
            return TakenBack::Cancelled;
        }
        if self.attempt >= MAX_ATTEMPTS {
            self.fence += 1;
            self.end(&Outcome::Failed(record::exhausted(self.attempt)), ttl);
            return TakenBack::Exhausted;
        }
        self.requeue();
        TakenBack::Queued
    }

    /// Writes down how it ended.
    pub(super) fn end(&mut self, outcome: &Outcome, ttl: Duration) {
        let (state, mesh, problem) = match outcome {
            Outcome::Completed(mesh) => (State::Completed, Some(mesh.clone()), None),
            Outcome::Failed(problem) | Outcome::Retry(problem) => {
                (State::Failed, None, Some(problem.clone()))
            }
            Outcome::Cancelled | Outcome::HandedBack => (State::Cancelled, None, None),
        };
        let now = Moment::now().0;
        let kept_ms = i64::try_from(ttl.as_millis()).unwrap_or(i64::MAX);
        (self.mesh, self.problem) = (mesh, problem);
        (self.finished_ms, self.expires_ms) = (Some(now), Some(now.saturating_add(kept_ms)));
        self.enter(state);
    }

    /// Lets it wait again.
    fn requeue(&mut self) {
        self.fence += 1;
        self.enter(State::Queued);
    }

    /// Takes a change of state down. What progress led here is of no use to anybody any more.
    fn enter(&mut self, state: State) {
        self.progress = None;
        self.revision += 1;
        state.name().clone_into(&mut self.state);
        self.changes.push(Change {
            revision: self.revision,
            at_ms: Moment::now().0,
            state: self.state.clone(),
            attempt: self.attempt,
        });
        if self.changes.len() > MOST_CHANGES {
            self.changes.remove(0);
        }
    }
}

impl StoredProgress {
    fn value(&self) -> Progress {
        Progress { stage: self.stage.clone(), fraction: self.fraction }
    }
}

impl Change {
    fn event(&self) -> Option<Event> {
        Some(Event {
            revision: self.revision,
            at: Moment(self.at_ms),
            state: State::named(&self.state)?,
            attempt: self.attempt,
            progress: None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pixmesh_engine::digest::Digest;

    const HOUR: Duration = Duration::from_secs(3600);

    fn waiting() -> StoredJob {
        let job = NewJob {
            id: JobId::new(),
            owner: Owner::named("somebody"),
            order: "density=2".into(),
            picture: Picture::of_bytes(b"image"),
            idempotency_key: None,
        };
        StoredJob::new(&job, None)
    }

    fn running() -> (StoredJob, Lease) {
        let mut job = waiting();
        let lease = job.begin(JobId::new()).unwrap().lease;
        (job, lease)
    }

    fn figures() -> MeshFigures {
        MeshFigures {
            progression: None,
            digest: Digest::of(b"mesh").to_string(),
            bytes: 4,
            vertices: 4,
            faces: 2,
            mse: 0.25,
            psnr_db: None,
            chunks: Vec::new(),
            timings_ms: Vec::new(),
        }
    }

    #[test]
    fn a_job_needs_its_image_until_it_has_ended_and_its_mesh_from_then_on() {
        let (image, mesh) = (Digest::of(b"image").to_string(), Digest::of(b"mesh").to_string());
        let (mut job, _) = running();
        assert!(job.needs(&image) && job.needs(&mesh));
        assert_eq!(job.mesh(), None);
        assert!(job.blobs().eq([&image]));
        job.end(&Outcome::Completed(figures()), HOUR);
        assert!(!job.needs(&image) && job.needs(&mesh));
        assert_eq!(job.mesh(), Some(&*mesh));
        assert!(job.blobs().eq([&image, &mesh]));
    }

    #[test]
    fn a_lease_holds_while_its_attempt_runs_and_no_longer() {
        let (mut job, first) = running();
        assert!(job.is_held_by(first));
        assert_eq!(job.fence(), first.fence);
        job.finish(&Outcome::HandedBack, HOUR);
        assert!(!job.is_held_by(first));
        assert!(!job.is_held_by(Lease { fence: job.fence(), ..first }), "nobody has it");
        let second = job.begin(first.job).unwrap().lease;
        assert!(job.is_held_by(second) && !job.is_held_by(first));
        assert!(second.fence > first.fence);
    }

    #[test]
    fn whoever_fell_silent_holds_a_job_no_more_however_it_goes_on() {
        let attempts = |count: u32| {
            let (mut job, mut lease) = running();
            for _ in 1..count {
                job.finish(&Outcome::Retry(Value::Null), HOUR);
                lease = job.begin(lease.job).unwrap().lease;
            }
            (job, lease)
        };
        let (cancelled, lease) = attempts(1);
        let cancelled = (StoredJob { cancel_requested: true, ..cancelled }, lease);
        for ((mut job, lease), expected) in [
            (attempts(1), TakenBack::Queued),
            (attempts(MAX_ATTEMPTS), TakenBack::Exhausted),
            (cancelled, TakenBack::Cancelled),
        ] {
            assert_eq!(job.take_back(HOUR), expected);
            assert!(job.fence() > lease.fence, "{expected:?}");
            assert_eq!(job.is_final(), expected != TakenBack::Queued);
        }
    }

    #[test]
    fn a_job_is_over_from_the_end_of_its_time_on() {
        let mut job = waiting();
        assert!(!job.is_over());
        job.end(&Outcome::Cancelled, HOUR);
        assert!(!job.is_over());
        job.end(&Outcome::Cancelled, Duration::ZERO);
        assert!(job.is_over());
    }

    #[test]
    fn the_latest_changes_of_a_job_that_is_handed_back_again_and_again_are_kept() {
        let mut job = waiting();
        for _ in 0..MOST_CHANGES {
            let all = job.events(0);
            assert_eq!(all.len() as u64, job.revision.min(MOST_CHANGES as u64));
            let last = all.last().unwrap();
            assert_eq!((last.revision, last.state), (job.revision, job.state().unwrap()));
            assert!(all.is_sorted_by(|a, b| a.revision + 1 == b.revision));
            match job.state() {
                Some(State::Queued) => _ = job.begin(JobId::new()),
                _ => job.finish(&Outcome::HandedBack, HOUR),
            }
        }
        assert_eq!(job.events(0).len(), MOST_CHANGES);
        assert_eq!(job.events(job.revision - 3).len(), 3);
        assert_eq!(job.attempt(), 0);
    }
}
