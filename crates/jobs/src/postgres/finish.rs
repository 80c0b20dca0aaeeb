//! Jobs come to their end, or back to those that wait.

use super::Node;
use super::database::Transaction;
use super::row::{self, ms, number, uuid};
use crate::embedded::watchers::Changes;
use crate::queue::{Cancellation, Finish, Lease, MAX_ATTEMPTS, Outcome, QueueError};
use crate::record::{JobId, MeshFigures, State};
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use serde_json::Value;
use sqlx::Row;
use std::collections::{BTreeSet, HashMap};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How many rows the tallies have.
const SLOTS: u32 = 64;

/// What becomes of a job.
#[derive(Clone, Debug)]
pub(super) struct Transition<'a> {
    pub(super) id: JobId,
    pub(super) was: State,
    pub(super) next: State,
    /// Attempts that do not count.
    given_back: i32,
    mesh: Option<&'a MeshFigures>,
    problem: Option<&'a Value>,
}

impl<'a> Transition<'a> {
    /// By the outcome of an attempt at a job that runs.
    pub(super) fn after(
        id: JobId,
        attempt: u32,
        cancel_requested: bool,
        outcome: &'a Outcome,
    ) -> Self {
        let waits = |given_back| Self {
            given_back,
            ..Self::ended(id, State::Running, &Outcome::Cancelled, State::Queued)
        };
        match outcome {
            _ if cancel_requested => Self::by(id, State::Running, &Outcome::Cancelled),
            Outcome::HandedBack => waits(1),
            Outcome::Retry(_) if attempt < MAX_ATTEMPTS => waits(0),
            outcome => Self::by(id, State::Running, outcome),
        }
    }

    /// An end.
    pub(super) fn by(id: JobId, was: State, outcome: &'a Outcome) -> Self {
        let next = match outcome {
            Outcome::Completed(_) => State::Completed,
            Outcome::Failed(_) | Outcome::Retry(_) => State::Failed,
            Outcome::Cancelled | Outcome::HandedBack => State::Cancelled,
        };
        Self::ended(id, was, outcome, next)
    }

    fn ended(id: JobId, was: State, outcome: &'a Outcome, next: State) -> Self {
        let (mesh, problem) = match outcome {
            Outcome::Completed(mesh) => (Some(mesh), None),
            Outcome::Failed(problem) | Outcome::Retry(problem) => (None, Some(problem)),
            Outcome::Cancelled | Outcome::HandedBack => (None, None),
        };
        Self { id, was, next, given_back: 0, mesh, problem }
    }
}

/// Writes down what becomes of jobs, whose rows the transaction has locked, and gives up the pictures of
/// those that have ended.
pub(super) async fn apply(
    transaction: &mut Transaction,
    jobs: &[Transition<'_>],
    ttl: Duration,
) -> sqlx::Result<()> {
    if jobs.is_empty() {
        return Ok(());
    }
    let json = |mesh: &MeshFigures| serde_json::to_string(mesh).ok();
    let digest = |mesh: &MeshFigures| Some(mesh.digest.parse::<Digest>().ok()?.as_bytes().to_vec());
    transaction.query(
        "WITH settled AS (
             UPDATE jobs SET state = new.state, attempt = attempt - new.given_back, lease_end = NULL,
                    stage = NULL, fraction = NULL, progress_at = NULL, mesh = new.mesh,
                    mesh_digest = new.mesh_digest, problem = new.problem,
                    finished_at = CASE WHEN new.state >= 2 THEN now() END,
                    expires_at = CASE WHEN new.state >= 2
                                      THEN now() + $8 * interval '1 millisecond' END,
                    revision = revision + 1,
                    history = history || ARRAY[revision + 1,
                                               (extract(epoch FROM now()) * 1000)::bigint,
                                               new.state, attempt - new.given_back]
             FROM unnest($1::uuid[], $2::smallint[], $3::smallint[], $4::integer[], $5::text[],
                         $6::bytea[], $7::text[])
                  AS new (id, was, state, given_back, mesh, mesh_digest, problem)
             WHERE jobs.id = new.id AND jobs.state = new.was
             RETURNING jobs.state, image_digest)
         INSERT INTO given_up SELECT DISTINCT image_digest, now() FROM settled WHERE state >= 2
         ORDER BY image_digest ON CONFLICT DO NOTHING",
    )
    .bind(jobs.iter().map(|job| uuid(job.id)).collect::<Vec<_>>())
    .bind(jobs.iter().map(|job| job.was as i16).collect::<Vec<_>>())
    .bind(jobs.iter().map(|job| job.next as i16).collect::<Vec<_>>())
    .bind(jobs.iter().map(|job| job.given_back).collect::<Vec<_>>())
    .bind(jobs.iter().map(|job| job.mesh.and_then(json)).collect::<Vec<_>>())
    .bind(jobs.iter().map(|job| job.mesh.and_then(digest)).collect::<Vec<_>>())
    .bind(jobs.iter().map(|job| job.problem.map(Value::to_string)).collect::<Vec<_>>())
    .bind(ms(ttl))
    .execute(&mut **transaction)
    .await?;
    let change = |state| {
        let count =
            |of: fn(&Transition<'_>) -> State| jobs.iter().filter(|job| of(job) == state).count();
        count(|job| job.next) as i64 - count(|job| job.was) as i64
    };
    count_changes(transaction, change(State::Queued), change(State::Running)).await
}

/// Counts what waits and runs; the last statement of a transaction, so that others wait briefly.
pub(super) async fn count_changes(
    transaction: &mut Transaction,
    queued: i64,
    running: i64,
) -> sqlx::Result<()> {
    if (queued, running) == (0, 0) {
        return Ok(());
    }
    let slot = getrandom::u32().unwrap_or_default() % SLOTS;
    transaction
        .query("UPDATE job_counts SET queued = queued + $2, running = running + $3 WHERE slot = $1")
        .bind(slot as i32)
        .bind(queued)
        .bind(running)
        .execute(&mut **transaction)
        .await
        .map(|_| ())
}

/// Takes down that a job no longer has blobs, which others may have.
pub(super) async fn give_up(
    transaction: &mut Transaction,
    blobs: BTreeSet<Digest>,
) -> sqlx::Result<()> {
    if blobs.is_empty() {
        return Ok(());
    }
    let blobs: Vec<&[u8]> = blobs.iter().map(|blob| blob.as_bytes().as_slice()).collect();
    transaction
        .query(
            "INSERT INTO given_up SELECT blob, now() FROM unnest($1::bytea[]) AS blobs (blob)
         ON CONFLICT DO NOTHING",
        )
        .bind(blobs)
        .execute(&mut **transaction)
        .await
        .map(|_| ())
}

impl Node {
    /// Ends attempts, of those jobs that are still their workers'.
    pub(super) async fn finish(
        &self,
        ends: &[(Lease, Outcome)],
    ) -> Result<Vec<Finish>, QueueError> {
        let finished = self.database.retry(|| self.try_finish(ends)).await?;
        ends.iter().for_each(|(lease, _)| self.leases.remove(*lease));
        let work = finished.iter().any(|end| matches!(end, Finish::Committed(_)));
        let jobs = ends.iter().map(|(lease, _)| lease.job).collect();
        self.notifications.send(Changes { jobs, work });
        Ok(finished)
    }

    async fn try_finish(&self, ends: &[(Lease, Outcome)]) -> sqlx::Result<Vec<Finish>> {
        let mut transaction = self.database.begin().await?;
        let ids: Vec<_> = ends.iter().map(|(lease, _)| uuid(lease.job)).collect();
        let rows = transaction
            .query(
                "SELECT id, state, fence, attempt, cancel_requested FROM jobs WHERE id = ANY ($1)
             ORDER BY id FOR UPDATE",
            )
            .bind(ids)
            .fetch_all(&mut *transaction)
            .await?;
        let mut held = HashMap::new();
        for row in &rows {
            held.insert((row::id(row)?, number::<i64, u64>(row, "fence")?), row);
        }
        let (mut settled, mut unused) = (Vec::new(), BTreeSet::new());
        let mut finished = Vec::new();
        for (Lease { job, fence }, outcome) in ends {
            let row = held.remove(&(*job, *fence));
            let state = row.map(row::state).transpose()?;
            let end = match (row, state) {
                (Some(row), Some(State::Running)) => {
                    let cancel_requested = row.try_get("cancel_requested")?;
                    let attempt = number::<i32, _>(row, "attempt")?;
                    let next = Transition::after(*job, attempt, cancel_requested, outcome);
                    let end = Finish::Committed(next.next);
                    settled.push(next);
                    end
                }
                // What was written before its acknowledgement was lost is written.
                (_, Some(state)) if state.is_final() => Finish::Committed(state),
                _ => Finish::Fenced,
            };
            if let Outcome::Completed(mesh) = outcome
                && end != Finish::Committed(State::Completed)
            {
                unused.extend(mesh.digest.parse::<Digest>());
            }
            finished.push(end);
        }
        give_up(&mut transaction, unused).await?;
        apply(&mut transaction, &settled, self.terms.result_ttl).await?;
        transaction.commit().await?;
        Ok(finished)
    }

    /// Cancels an owner's job, or deletes it where it has come to its end.
    pub(super) async fn cancel(
        &self,
        owner: &Owner,
        id: JobId,
    ) -> Result<Cancellation, QueueError> {
        // Whether it may be cancelled by an attempt whose end was not heard of.
        let is_written = AtomicBool::new(false);
        let done = self.database.retry(|| self.try_cancel(owner, id, &is_written)).await?;
        self.notifications.send(Changes { jobs: vec![id], work: false });
        Ok(done)
    }

    async fn try_cancel(
        &self,
        owner: &Owner,
        id: JobId,
        is_written: &AtomicBool,
    ) -> sqlx::Result<Cancellation> {
        let mut transaction = self.database.begin().await?;
        let found = transaction
            .query(
                "SELECT state, COALESCE(expires_at <= now(), false) AS is_over FROM jobs
             WHERE id = $1 AND owner = $2 FOR UPDATE",
            )
            .bind(uuid(id))
            .bind(owner.as_str())
            .fetch_optional(&mut *transaction)
            .await?;
        let Some(found) = found else {
            let is_gone = super::read::is_gone(&mut transaction, owner, id).await?;
            transaction.commit().await?;
            return Ok(if is_gone { Cancellation::Gone } else { Cancellation::Unknown });
        };
        // One in no known state can at least be deleted.
        let state = row::state(&found).unwrap_or(State::Failed);
        let done = if found.try_get("is_over")? {
            Cancellation::Gone
        } else if state == State::Queued {
            let cancelled = [Transition::by(id, state, &Outcome::Cancelled)];
            apply(&mut transaction, &cancelled, self.terms.result_ttl).await?;
            is_written.store(true, Ordering::Release);
            Cancellation::Cancelled
        } else if state == State::Running {
            transaction
                .query("UPDATE jobs SET cancel_requested = true WHERE id = $1")
                .bind(uuid(id))
                .execute(&mut *transaction)
                .await?;
            Cancellation::Requested
        } else if state == State::Cancelled && is_written.load(Ordering::Acquire) {
            Cancellation::Cancelled
        } else {
            transaction
                .query(
                    "WITH deleted AS (DELETE FROM jobs WHERE id = $1 RETURNING mesh_digest)
                 INSERT INTO given_up SELECT mesh_digest, now() FROM deleted
                 WHERE mesh_digest IS NOT NULL ON CONFLICT DO NOTHING",
                )
                .bind(uuid(id))
                .execute(&mut *transaction)
                .await?;
            Cancellation::Deleted
        };
        transaction.commit().await?;
        Ok(done)
    }
}
