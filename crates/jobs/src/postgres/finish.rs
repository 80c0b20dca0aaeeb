//! Jobs end, or are queued again.

use super::database::Transaction;
use super::node::Node;
use super::read::is_gone;
use super::rows::{bytes, ms, uuid};
use crate::queue::{Cancellation, Change, Finish, Lease, Outcome, Paused, QueueError, Terms};
use crate::record::{JobId, State};
use crate::row::{self, Row as _};
use crate::transition::{Status, Step, Transition, cancellation, orphaned_mesh, step};
use crate::watchers::Changes;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use sqlx::Row;
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};

/// The number of rows of the table `job_counts`.
const COUNT_SLOTS: u32 = 64;

/// Stores transitions of jobs whose rows the transaction has locked, and marks the pictures of jobs
/// that end as orphan candidates, unless they failed and may be retried.
pub(super) async fn apply(
    transaction: &mut Transaction,
    transitions: &[Transition<'_>],
    terms: &Terms,
) -> sqlx::Result<()> {
    if transitions.is_empty() {
        return Ok(());
    }
    let (meshes, digests): (Vec<_>, Vec<_>) =
        transitions.iter().map(Transition::mesh_columns).unzip();
    let digests: Vec<_> =
        digests.iter().map(|d| d.map(|digest| digest.as_bytes().to_vec())).collect();
    transaction
        .query(
            "WITH changed AS (
                 UPDATE jobs SET state = new.state, attempt = attempt - new.returned_attempts,
                    lease_end = NULL, progress = NULL, progress_at = NULL, mesh = new.mesh,
                    mesh_digest = new.mesh_digest, problem = new.problem,
                    finished_at = CASE WHEN new.state >= 2 THEN now() END,
                    expires_at = CASE WHEN new.state >= 2
                                      THEN now() + $8 * interval '1 millisecond' END,
                    revision = revision + 1,
                    history = history || ARRAY[revision + 1,
                                               (extract(epoch FROM now()) * 1000)::bigint,
                                               new.state, attempt - new.returned_attempts]
                 FROM unnest($1::uuid[], $2::smallint[], $3::smallint[], $4::integer[], $5::text[],
                             $6::bytea[], $7::text[])
                      AS new (id, old_state, state, returned_attempts, mesh, mesh_digest, problem)
                 WHERE jobs.id = new.id AND jobs.state = new.old_state
                 RETURNING jobs.state, image_digest)
             INSERT INTO orphan_candidates (blob, eligible_at)
             SELECT DISTINCT image_digest, now() + $9 * interval '1 millisecond'
             FROM changed WHERE state IN (2, 4)
             ORDER BY image_digest ON CONFLICT DO NOTHING",
        )
        .bind(transitions.iter().map(|new| uuid(new.job)).collect::<Vec<_>>())
        .bind(transitions.iter().map(|new| new.from as i16).collect::<Vec<_>>())
        .bind(transitions.iter().map(|new| new.to as i16).collect::<Vec<_>>())
        .bind(transitions.iter().map(|new| new.returned_attempts as i32).collect::<Vec<_>>())
        .bind(meshes)
        .bind(digests)
        .bind(transitions.iter().map(|new| new.problem_column()).collect::<Vec<_>>())
        .bind(ms(terms.result_ttl))
        .bind(ms(terms.unused_blob_ttl))
        .execute(&mut **transaction)
        .await?;
    let change = |state| {
        transitions
            .iter()
            .map(|new| i64::from(new.to == state) - i64::from(new.from == state))
            .sum()
    };
    count_changes(transaction, change(State::Queued), change(State::Running)).await
}

/// Changes the numbers of queued and running jobs. The last statement of a transaction, so that it
/// locks its row only briefly.
pub(super) async fn count_changes(
    transaction: &mut Transaction,
    queued: i64,
    running: i64,
) -> sqlx::Result<()> {
    if (queued, running) == (0, 0) {
        return Ok(());
    }
    let slot = getrandom::u32().unwrap_or_default() % COUNT_SLOTS;
    transaction
        .query("UPDATE job_counts SET queued = queued + $2, running = running + $3 WHERE slot = $1")
        .bind(slot as i32)
        .bind(queued)
        .bind(running)
        .execute(&mut **transaction)
        .await
        .map(|_| ())
}

/// Marks blobs that a job does not use any more. Other jobs may use them.
pub(super) async fn mark_orphan_candidates(
    transaction: &mut Transaction,
    mut blobs: Vec<Digest>,
    terms: &Terms,
) -> sqlx::Result<()> {
    if blobs.is_empty() {
        return Ok(());
    }
    // All transactions insert in the same order, so that none deadlock.
    blobs.sort_unstable();
    transaction
        .query(
            "INSERT INTO orphan_candidates (blob, eligible_at)
             SELECT blob, now() + $2 * interval '1 millisecond'
             FROM unnest($1::bytea[]) AS blobs (blob) ON CONFLICT DO NOTHING",
        )
        .bind(bytes(&blobs))
        .bind(ms(terms.unused_blob_ttl))
        .execute(&mut **transaction)
        .await
        .map(|_| ())
}

impl Node {
    /// Ends attempts.
    pub(super) async fn finish(
        &self,
        requests: &[(Lease, Outcome)],
    ) -> Result<Vec<Finish>, QueueError> {
        let finished = self.database.retry(|| self.try_finish(requests)).await?;
        requests.iter().for_each(|(lease, _)| self.leases.remove(*lease));
        let work = finished.iter().any(|finish| matches!(finish, Finish::Committed(_)));
        let jobs = requests.iter().map(|(lease, _)| lease.job).collect();
        self.notifications.send(Changes { jobs, work });
        Ok(finished)
    }

    async fn try_finish(&self, requests: &[(Lease, Outcome)]) -> sqlx::Result<Vec<Finish>> {
        let mut transaction = self.database.begin().await?;
        let ids: Vec<_> = requests.iter().map(|(lease, _)| uuid(lease.job)).collect();
        let rows = transaction
            .query(
                "SELECT id, state, fence, attempt, cancel_requested FROM jobs WHERE id = ANY ($1)
                 ORDER BY id FOR UPDATE",
            )
            .bind(ids)
            .fetch_all(&mut *transaction)
            .await?;
        let mut stored = HashMap::new();
        for row in &rows {
            let status = row::status(row)?;
            stored.insert(Lease { job: row.id()?, fence: status.fence }, status);
        }
        let (mut finished, mut transitions, mut orphans) = (Vec::new(), Vec::new(), Vec::new());
        for (lease, outcome) in requests {
            let (finish, transition) = Status::finish(stored.remove(lease), *lease, outcome);
            orphans.extend(orphaned_mesh(outcome, finish));
            transitions.extend(transition);
            finished.push(finish);
        }
        mark_orphan_candidates(&mut transaction, orphans, &self.terms).await?;
        apply(&mut transaction, &transitions, &self.terms).await?;
        transaction.commit().await?;
        Ok(finished)
    }

    /// Changes jobs for an operator, and returns the states of those that it changed.
    pub(super) async fn change(
        &self,
        jobs: Vec<JobId>,
        change: Change,
    ) -> Result<Vec<State>, QueueError> {
        let changed = self.database.retry(|| self.try_change(&jobs, change)).await?;
        self.notifications.send(Changes { jobs, work: change == Change::Retry });
        Ok(changed)
    }

    async fn try_change(&self, jobs: &[JobId], change: Change) -> sqlx::Result<Vec<State>> {
        let mut transaction = self.database.begin().await?;
        let sql = "SELECT id, state, fence, attempt, cancel_requested FROM jobs WHERE id = ANY ($1)
                   ORDER BY id FOR UPDATE";
        let ids: Vec<_> = jobs.iter().map(|job| uuid(*job)).collect();
        let rows = transaction.query(sql).bind(ids).fetch_all(&mut *transaction).await?;
        let (mut transitions, mut requested, mut expired) = (Vec::new(), Vec::new(), Vec::new());
        let mut changed = Vec::new();
        for row in &rows {
            let (job, status) = (row.id()?, row::status(row)?);
            let Some(step) = step(change, job, status) else { continue };
            changed.push(match &step {
                Step::Transition(transition) => transition.to,
                _ => status.state,
            });
            match step {
                Step::Transition(transition) => transitions.push(transition),
                Step::RequestCancellation => requested.push(uuid(job)),
                Step::Expire => expired.push(uuid(job)),
            }
        }
        for (sql, jobs) in [
            ("UPDATE jobs SET cancel_requested = true WHERE id = ANY ($1)", requested),
            ("UPDATE jobs SET expires_at = now() WHERE id = ANY ($1)", expired),
        ] {
            transaction.query(sql).bind(jobs).execute(&mut *transaction).await?;
        }
        apply(&mut transaction, &transitions, &self.terms).await?;
        transaction.commit().await?;
        Ok(changed)
    }

    pub(super) async fn pause(&self, paused: Paused) -> Result<(), QueueError> {
        let statement = || {
            sqlx::query(
                "INSERT INTO paused VALUES (0, $1, $2)
                 ON CONFLICT (id) DO UPDATE SET intake = excluded.intake, work = excluded.work",
            )
            .bind(paused.intake)
            .bind(paused.work)
        };
        self.database.execute(statement).await.map(|_| ())
    }

    /// Cancels an owner's job, or deletes it if it has ended.
    pub(super) async fn cancel(
        &self,
        owner: &Owner,
        id: JobId,
    ) -> Result<Cancellation, QueueError> {
        // Set once an attempt has cancelled the job: its commit may succeed although its
        // acknowledgement is lost, and the retry must not delete the job then.
        let may_be_cancelled = AtomicBool::new(false);
        let done = self.database.retry(|| self.try_cancel(owner, id, &may_be_cancelled)).await?;
        self.notifications.send(Changes { jobs: vec![id], work: false });
        Ok(done)
    }

    async fn try_cancel(
        &self,
        owner: &Owner,
        id: JobId,
        may_be_cancelled: &AtomicBool,
    ) -> sqlx::Result<Cancellation> {
        let mut transaction = self.database.begin().await?;
        let found = transaction
            .query(
                "SELECT state, COALESCE(expires_at <= now(), false) AS is_expired FROM jobs
                 WHERE id = $1 AND owner = $2 FOR UPDATE",
            )
            .bind(uuid(id))
            .bind(owner.as_str())
            .fetch_optional(&mut *transaction)
            .await?;
        let done = match found {
            // A job in an unknown state can be deleted.
            Some(found) => match row::state(&found).unwrap_or(State::Failed) {
                State::Cancelled if may_be_cancelled.load(Ordering::Acquire) => {
                    transaction.commit().await?;
                    return Ok(Cancellation::Cancelled);
                }
                state => cancellation(state, found.try_get("is_expired")?),
            },
            None if is_gone(&mut transaction, owner, id).await? => Cancellation::Gone,
            None => Cancellation::Unknown,
        };
        match done {
            Cancellation::Cancelled => {
                apply(&mut transaction, &[Transition::cancelled(id)], &self.terms).await?;
                may_be_cancelled.store(true, Ordering::Release);
            }
            Cancellation::Requested => {
                let sql = "UPDATE jobs SET cancel_requested = true WHERE id = $1";
                transaction.query(sql).bind(uuid(id)).execute(&mut *transaction).await?;
            }
            Cancellation::Deleted => {
                let sql = "WITH deleted AS (DELETE FROM jobs WHERE id = $1 RETURNING *),
                           kept AS (
                               INSERT INTO kept_keys
                               SELECT owner, idempotency_key,
                                      created_at + $2 * interval '1 millisecond' FROM deleted
                               WHERE idempotency_key IS NOT NULL
                               ON CONFLICT (owner, idempotency_key)
                               DO UPDATE SET until = excluded.until)
                           SELECT CASE state WHEN 3 THEN image_digest ELSE mesh_digest END AS blob
                           FROM deleted";
                let deleting = transaction.query(sql).bind(uuid(id));
                let deleting = deleting.bind(ms(self.terms.idempotency_ttl));
                let row = deleting.fetch_one(&mut *transaction).await?;
                let blob = row.digest("blob")?.into_iter().collect();
                mark_orphan_candidates(&mut transaction, blob, &self.terms).await?;
            }
            Cancellation::Unknown | Cancellation::Gone => {}
        }
        transaction.commit().await?;
        Ok(done)
    }
}
