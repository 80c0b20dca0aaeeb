//! A worker takes a job, keeps it, and leaves it.

use super::Nats;
use super::holdings::answer;
use super::records::Step;
use super::stored::TakenBack;
use super::streams::job_of_name;
use super::table::Versioned;
use crate::queue::{Claim, Finish, Lease, MAX_ATTEMPTS, Outcome, QueueError, Renewal};
use crate::record::{self, JobId, Progress, State};
use crate::telemetry;
use async_nats::jetstream::{AckKind, Message};
use pixmesh_engine::Owner;
use std::time::Duration;

/// The pause before a job is given to anybody again whose record could not be read or written.
const PAUSE_AFTER_ERROR: Duration = Duration::from_secs(5);

/// What becomes of a job whose message arrived.
enum Begun {
    /// It is this worker's.
    Claimed(Box<Claim>),
    /// It is on its last attempt, which is made alone.
    Later,
    /// It is over, or came to its end by this.
    Over(Option<State>),
}

impl Nats {
    /// Gives the next job to a worker.
    pub(super) async fn next_claim(&self) -> Result<Option<Claim>, QueueError> {
        let _one_at_a_time = self.claiming.lock().await;
        if self.holdings.last_attempt_runs() {
            return Ok(None);
        }
        if let Some(message) = self.holdings.take_aside() {
            if self.holdings.count() > 0 {
                answer(&message, AckKind::Progress).await;
                self.holdings.put_aside(message);
                return Ok(None);
            }
            if let Some(claim) = self.take(message).await? {
                return Ok(Some(claim));
            }
        }
        let running = |owner: &Owner| self.holdings.count_of(owner);
        while let Some((owner, message)) =
            self.owners.fetch(&self.terms.caps, running, self.terms.look_again).await?
        {
            if let Some(claim) = self.take(message).await? {
                self.owners.take_turn(&owner);
                return Ok(Some(claim));
            }
            if self.holdings.has_aside() {
                return Ok(None);
            }
        }
        Ok(None)
    }

    /// Takes the job of a message, unless it is over or must wait.
    async fn take(&self, message: Message) -> Result<Option<Claim>, QueueError> {
        let subject = self.streams.work.name_of(&message.subject).to_owned();
        let Some((owner, id)) = job_of_name(&subject) else {
            answer(&message, AckKind::Term).await;
            return Ok(None);
        };
        match self.begin(&owner, id).await {
            Ok(Some((Begun::Claimed(claim), record))) => {
                self.holdings.add(claim.lease, owner, message, record);
                self.announce(id).await;
                Ok(Some(*claim))
            }
            Ok(Some((Begun::Later, _))) => {
                self.holdings.put_aside(message);
                Ok(None)
            }
            Ok(Some((Begun::Over(end), record))) => {
                if let Some(state) = end {
                    telemetry::job_ended(state);
                    self.let_go(id, &record.value).await?;
                }
                answer(&message, AckKind::Ack).await;
                Ok(None)
            }
            Ok(None) => {
                answer(&message, AckKind::Ack).await;
                Ok(None)
            }
            Err(QueueError::Damaged(error)) => {
                tracing::error!(job = %id, error, "a job's record cannot be read, and is set aside");
                answer(&message, AckKind::Term).await;
                Ok(None)
            }
            Err(error) => {
                answer(&message, AckKind::Nak(Some(PAUSE_AFTER_ERROR))).await;
                Err(error)
            }
        }
    }

    /// Counts an attempt at a job, whose last worker fell silent where it runs: the server gives its
    /// message to nobody else before.
    async fn begin(
        &self,
        owner: &Owner,
        id: JobId,
    ) -> Result<Option<(Begun, Versioned<super::stored::StoredJob>)>, QueueError> {
        let ttl = self.terms.result_ttl;
        let others_run = self.holdings.count() > 0;
        self.change(owner, id, None, |job| {
            let Some(state) = job.state().filter(|state| !state.is_final()) else {
                return Step::Leave(Begun::Over(None));
            };
            let was_running = state == State::Running;
            if was_running {
                match job.take_back(ttl) {
                    TakenBack::Queued => {}
                    TakenBack::Exhausted => return Step::Store(Begun::Over(Some(State::Failed))),
                    TakenBack::Cancelled => {
                        return Step::Store(Begun::Over(Some(State::Cancelled)));
                    }
                }
            }
            if job.attempt() + 1 >= MAX_ATTEMPTS && others_run {
                return if was_running {
                    Step::Store(Begun::Later)
                } else {
                    Step::Leave(Begun::Later)
                };
            }
            match job.begin(id) {
                Some(claim) => Step::Store(Begun::Claimed(Box::new(claim))),
                None => {
                    job.end(&Outcome::Failed(record::damaged()), ttl);
                    Step::Store(Begun::Over(Some(State::Failed)))
                }
            }
        })
        .await
    }

    /// Lengthens a lease, and takes down how far the work is.
    pub(super) async fn renew_lease(
        &self,
        lease: Lease,
        progress: Option<Progress>,
    ) -> Result<Renewal, QueueError> {
        let Some(holding) = self.holdings.get(lease) else { return Ok(Renewal::Lost) };
        let renewed = self
            .change_held(&holding.owner, lease.job, holding.record, |job| {
                if !job.is_held_by(lease) {
                    return Step::Leave(Renewal::Lost);
                }
                if let Some(progress) = &progress {
                    job.tell(progress);
                }
                Step::Store(standing(job.is_cancel_requested()))
            })
            .await?;
        let Some((renewal, record)) = renewed else {
            self.holdings.remove(lease);
            return Ok(Renewal::Lost);
        };
        if renewal == Renewal::Lost {
            self.holdings.remove(lease);
            return Ok(renewal);
        }
        self.holdings.keep(lease, record);
        answer(&holding.message, AckKind::Progress).await;
        if progress.is_some() {
            self.announce(lease.job).await;
        }
        Ok(renewal)
    }

    /// Whether a worker still has a job, and shall have it.
    pub(super) async fn standing(&self, lease: Lease) -> Result<Renewal, QueueError> {
        let Some(holding) = self.holdings.get(lease) else { return Ok(Renewal::Lost) };
        let record = self.readable_record(&holding.owner, lease.job).await?;
        Ok(match record.filter(|record| record.value.is_held_by(lease)) {
            Some(record) => standing(record.value.is_cancel_requested()),
            None => {
                self.holdings.remove(lease);
                Renewal::Lost
            }
        })
    }

    /// Ends a worker's attempt, if the job is still the worker's.
    pub(super) async fn end_attempt(
        &self,
        lease: Lease,
        outcome: &Outcome,
    ) -> Result<Finish, QueueError> {
        let mesh = match outcome {
            Outcome::Completed(mesh) => Some(mesh.digest.as_str()),
            _ => None,
        };
        let Some(holding) = self.holdings.get(lease) else {
            self.give_up_all(mesh).await?;
            return Ok(Finish::Fenced);
        };
        if let Some(mesh) = mesh {
            self.refer(mesh, &holding.owner, lease.job).await?;
        }
        let ttl = self.terms.result_ttl;
        let ended = self
            .change_held(&holding.owner, lease.job, holding.record, |job| {
                if job.is_held_by(lease) {
                    job.finish(outcome, ttl);
                    return Step::Store(true);
                }
                // What was written before its acknowledgement was lost is written.
                Step::Leave(job.is_final() && job.fence() == lease.fence)
            })
            .await?;
        let Some((true, record)) = ended else {
            self.holdings.remove(lease);
            if let Some(mesh) = mesh {
                self.release(mesh, lease.job).await?;
            }
            return Ok(Finish::Fenced);
        };
        let state = record.value.state().unwrap_or(State::Failed);
        if state.is_final() {
            if record.value.mesh() != mesh
                && let Some(mesh) = mesh
            {
                self.release(mesh, lease.job).await?;
            }
            self.let_go(lease.job, &record.value).await?;
            answer(&holding.message, AckKind::Ack).await;
        } else {
            answer(&holding.message, AckKind::Nak(None)).await;
        }
        self.holdings.remove(lease);
        self.announce(lease.job).await;
        if state == State::Queued {
            self.call_to_work(&holding.owner).await;
        }
        Ok(Finish::Committed(state))
    }
}

fn standing(is_cancel_requested: bool) -> Renewal {
    if is_cancel_requested { Renewal::CancelRequested } else { Renewal::Ok }
}
