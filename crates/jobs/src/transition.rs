//! The state transitions of a job, the same for both engines.
//!
//! | from | event | to |
//! |---|---|---|
//! | queued | a worker claims the job | running |
//! | queued | the owner cancels the job | cancelled |
//! | running | the mesh is stored | completed |
//! | running | an attempt fails for good, or the last one fails | failed |
//! | running | an attempt before the last one fails, or its lease expires | queued |
//! | running | the worker hands the job back | queued, and the attempt does not count |
//! | failed | an operator retries the job | queued, with no attempt made |
//! | running | an attempt ends in any way after the owner cancelled the job | cancelled |

use crate::queue::{Cancellation, Change, Finish, Lease, MAX_ATTEMPTS, Outcome, Renewal};
use crate::record::{self, JobId, MeshFigures, State};
use pixmesh_engine::digest::Digest;
use serde_json::Value;
use std::borrow::Cow;

/// The columns of a job that decide who may change it, and to what.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Status {
    pub(crate) state: State,
    pub(crate) fence: u64,
    pub(crate) attempt: u32,
    pub(crate) cancel_requested: bool,
}

/// A change of a job's state, except that by a claim.
#[derive(Debug)]
pub(crate) struct Transition<'a> {
    pub(crate) job: JobId,
    pub(crate) from: State,
    pub(crate) to: State,
    /// Attempts that do not count: 1 for a job that was handed back, all of one that is retried.
    pub(crate) returned_attempts: u32,
    pub(crate) mesh: Option<&'a MeshFigures>,
    pub(crate) problem: Option<Cow<'a, Value>>,
}

impl Status {
    /// Whether the holder of a lease still has the job; `status` is `None` when there is no such
    /// job.
    pub(crate) fn renewal(status: Option<Self>, lease: Lease) -> Renewal {
        match status.filter(|status| status.fence == lease.fence) {
            Some(Self { state: State::Running, cancel_requested: true, .. }) => {
                Renewal::CancelRequested
            }
            Some(Self { state: State::Running, .. }) => Renewal::Ok,
            _ => Renewal::Lost,
        }
    }

    /// What an outcome does to the job of a lease.
    pub(crate) fn finish<'a>(
        status: Option<Self>,
        lease: Lease,
        outcome: &'a Outcome,
    ) -> (Finish, Option<Transition<'a>>) {
        match status.filter(|status| status.fence == lease.fence) {
            Some(status) if status.state == State::Running => {
                let transition = status.end_attempt(lease.job, outcome);
                (Finish::Committed(transition.to), Some(transition))
            }
            // The outcome was committed before, and its acknowledgement was lost.
            Some(status) if status.state.is_final() => (Finish::Committed(status.state), None),
            _ => (Finish::Fenced, None),
        }
    }

    fn end_attempt(self, job: JobId, outcome: &Outcome) -> Transition<'_> {
        let to = |to| Transition::new(job, State::Running, to);
        match outcome {
            _ if self.cancel_requested => to(State::Cancelled),
            Outcome::Completed(mesh) => Transition { mesh: Some(mesh), ..to(State::Completed) },
            Outcome::HandedBack => Transition { returned_attempts: 1, ..to(State::Queued) },
            Outcome::Retry(_) if self.attempt < MAX_ATTEMPTS => to(State::Queued),
            Outcome::Retry(problem) | Outcome::Failed(problem) => {
                Transition { problem: Some(Cow::Borrowed(problem)), ..to(State::Failed) }
            }
            Outcome::Cancelled => to(State::Cancelled),
        }
    }

    /// What becomes of a running job whose worker did not renew its lease.
    pub(crate) fn lease_expired(self, job: JobId) -> Transition<'static> {
        let to = |to| Transition::new(job, State::Running, to);
        if self.cancel_requested {
            to(State::Cancelled)
        } else if self.attempt < MAX_ATTEMPTS {
            to(State::Queued)
        } else {
            let problem = Some(Cow::Owned(record::exhausted(self.attempt)));
            Transition { problem, ..to(State::Failed) }
        }
    }
}

impl Transition<'_> {
    fn new(job: JobId, from: State, to: State) -> Self {
        Self { job, from, to, returned_attempts: 0, mesh: None, problem: None }
    }

    /// The owner cancels a queued job.
    pub(crate) fn cancelled(job: JobId) -> Self {
        Self::new(job, State::Queued, State::Cancelled)
    }

    /// The record of a job cannot be read: the job fails, so that others are claimed.
    pub(crate) fn damaged(job: JobId, from: State) -> Self {
        Self { problem: Some(Cow::Owned(record::damaged())), ..Self::new(job, from, State::Failed) }
    }

    /// The mesh as JSON, and the digest of its blob.
    pub(crate) fn mesh_columns(&self) -> (Option<String>, Option<Digest>) {
        let json = self.mesh.and_then(|mesh| serde_json::to_string(mesh).ok());
        (json, self.mesh.and_then(|mesh| mesh.digest.parse().ok()))
    }

    /// The problem document as JSON.
    pub(crate) fn problem_column(&self) -> Option<String> {
        self.problem.as_ref().map(ToString::to_string)
    }
}

/// The mesh that a worker stored for a job that was not completed by it.
pub(crate) fn orphaned_mesh(outcome: &Outcome, finish: Finish) -> Option<Digest> {
    match outcome {
        Outcome::Completed(mesh) if finish != Finish::Committed(State::Completed) => {
            mesh.digest.parse().ok()
        }
        _ => None,
    }
}

/// What an operator's change does to one job.
#[derive(Debug)]
pub(crate) enum Step {
    Transition(Transition<'static>),
    RequestCancellation,
    /// The job expires now, and the next sweep deletes it.
    Expire,
}

/// What an operator's change does to a job; `None` in a state that the change is not for.
pub(crate) fn step(change: Change, job: JobId, status: Status) -> Option<Step> {
    match (change, status.state) {
        (Change::Cancel, State::Queued) => Some(Step::Transition(Transition::cancelled(job))),
        (Change::Cancel, State::Running) => Some(Step::RequestCancellation),
        (Change::Retry, State::Failed) => {
            let queued = Transition::new(job, State::Failed, State::Queued);
            Some(Step::Transition(Transition { returned_attempts: status.attempt, ..queued }))
        }
        (Change::Delete, state) if state.is_final() => Some(Step::Expire),
        _ => None,
    }
}

/// What a cancellation by the owner does to a job that is stored.
pub(crate) fn cancellation(state: State, is_expired: bool) -> Cancellation {
    match state {
        _ if is_expired => Cancellation::Gone,
        State::Queued => Cancellation::Cancelled,
        State::Running => Cancellation::Requested,
        State::Completed | State::Failed | State::Cancelled => Cancellation::Deleted,
    }
}
