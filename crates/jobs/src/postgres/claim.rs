//! Workers claim jobs.
//!
//! Owners take turns in the order of their names: a node takes the oldest job of each owner with
//! queued jobs, and starts the next claim with the owner after the last one. Each owner is found by
//! one step in an index, however many owners and jobs there are, and only the node knows where it
//! stands. Rows that another node has locked are skipped.
//!
//! A node counts an owner's running jobs under the owner lock. It skips an owner whose lock another
//! node holds, and then claims again at once.
//!
//! The last attempt of a job runs alone on its node, so that a job that crashes its process costs
//! no other job an attempt. A busy node reserves such a job, which keeps it from other nodes for
//! the term of a lease, and claims nothing until the job can run.

use super::database::Transaction;
use super::finish::{apply, count_changes};
use super::leases::Reserved;
use super::node::Node;
use super::rows::{ms, uuid};
use crate::queue::{Claim, MAX_ATTEMPTS, QueueError};
use crate::record::{JobId, State};
use crate::row::{self, Row as _};
use crate::transition::Transition;
use crate::watchers::Changes;
use pixmesh_engine::Owner;
use sqlx::Postgres;
use sqlx::postgres::{PgArguments, PgRow};
use sqlx::query::Query;
use std::collections::{HashMap, HashSet};
use std::sync::PoisonError;

/// How many times more owners are read after the jobs of all owners read were locked.
const MORE_OWNERS: usize = 4;

/// The owners with queued jobs from `$1` on, at most `$2` and each once, and whether each may have
/// another job running by the limit `$3`. After the last owner follows the first one.
const NEXT_OWNERS: &str = "
    WITH RECURSIVE next (owner, first, position) AS (
        SELECT owner, owner, 1 FROM (SELECT COALESCE(
            (SELECT min(owner) FROM jobs WHERE state = 0 AND owner >= $1),
            (SELECT min(owner) FROM jobs WHERE state = 0)) AS owner) AS start
        WHERE owner IS NOT NULL
        UNION ALL
        SELECT following.owner, first, position + 1 FROM next, LATERAL (SELECT COALESCE(
            (SELECT min(owner) FROM jobs WHERE state = 0 AND owner > next.owner),
            (SELECT min(owner) FROM jobs WHERE state = 0)) AS owner) AS following
        WHERE position < $2 AND following.owner <> first)
    SELECT owner, owner = '' OR (SELECT count(*) FROM jobs
                                 WHERE state = 1 AND jobs.owner = next.owner) < $3 AS may_run
    FROM next ORDER BY position";

/// The oldest jobs of the owners `$1`, at most `$2` of each and no more than may run by the limit
/// `$3`: the first job of each owner, then the second of each, and so on, at most `$6`. This node
/// has reserved the job `$4`. `$5` is the number of attempts.
const NEXT_JOBS: &str = "
    SELECT job.id, job.owner, job.attempt + 1 >= $5 AS is_last_attempt
    FROM unnest($1::text[]) WITH ORDINALITY AS next (owner, position),
    LATERAL (
        SELECT id, owner, attempt FROM jobs
        WHERE state = 0 AND owner = next.owner
          AND (lease_end IS NULL OR lease_end <= now() OR id = $4)
        ORDER BY id
        LIMIT CASE WHEN next.owner = '' THEN $2 ELSE LEAST($2, GREATEST(0, $3 -
            (SELECT count(*) FROM jobs AS other
             WHERE other.state = 1 AND other.owner = next.owner))) END
        FOR UPDATE SKIP LOCKED
    ) AS job
    ORDER BY row_number() OVER (PARTITION BY next.position ORDER BY job.id), next.position
    LIMIT $6";

/// A queued job whose row the transaction has locked.
struct Queued {
    id: JobId,
    owner: Owner,
    is_last_attempt: bool,
}

/// What a transaction claimed.
#[derive(Default)]
struct Claimed {
    claims: Vec<Claim>,
    reserved: Option<JobId>,
    damaged: Vec<JobId>,
    /// The owner with whom the next claim starts.
    next_owner: Option<String>,
    /// Whether owners were skipped who may have jobs to claim.
    may_be_more: bool,
}

impl Node {
    /// Claims jobs, one for each request as long as there are any.
    pub(super) async fn claim(&self, wanted: usize) -> Result<Vec<Option<Claim>>, QueueError> {
        let reserved = self.leases.reserved();
        if self.leases.last_attempt_runs() || reserved.is_some() && !self.leases.is_empty() {
            self.extend_reservation(reserved).await?;
            return Ok(vec![None; wanted]);
        }
        let reserved = reserved.map(|reserved| reserved.job);
        let claimed = self.database.retry(|| self.try_claim(wanted, reserved)).await?;
        claimed.claims.iter().for_each(|claim| self.leases.add(claim, self.terms.lease));
        self.leases.reserve(claimed.reserved);
        if let Some(next) = claimed.next_owner {
            *self.next_owner.lock().unwrap_or_else(PoisonError::into_inner) = next;
        }
        for job in &claimed.damaged {
            tracing::error!(%job, "job record damaged");
        }
        let jobs = claimed.claims.iter().map(|claim| claim.lease.job);
        let jobs = jobs.chain(claimed.damaged.iter().copied()).collect();
        self.notifications.send(Changes { jobs, work: false });
        if claimed.may_be_more || !claimed.damaged.is_empty() {
            self.notifications.wake_workers();
        }
        let mut claims: Vec<_> = claimed.claims.into_iter().map(Some).collect();
        claims.resize(wanted, None);
        Ok(claims)
    }

    /// Keeps the reserved job from other nodes for another term, well before the last one ends.
    async fn extend_reservation(&self, reserved: Option<Reserved>) -> Result<(), QueueError> {
        let is_due = |reserved: &Reserved| reserved.since.elapsed() >= self.terms.lease / 3;
        if let Some(Reserved { job, .. }) = reserved.filter(is_due) {
            self.database.execute(|| reservation(job, ms(self.terms.lease))).await?;
            self.leases.reserve(Some(job));
        }
        Ok(())
    }

    async fn try_claim(&self, wanted: usize, reserved: Option<JobId>) -> sqlx::Result<Claimed> {
        let lease_ms = ms(self.terms.lease);
        let mut transaction = self.database.begin().await?;
        let (mut jobs, may_be_more) = self.next_jobs(&mut transaction, wanted, reserved).await?;
        let mut claimed = Claimed { may_be_more, ..Claimed::default() };
        match jobs.iter().position(|job| job.is_last_attempt) {
            Some(0) if self.leases.is_empty() => jobs.truncate(1),
            Some(last) => {
                let Queued { id, owner, .. } = &jobs[last];
                reservation(*id, lease_ms).execute(&mut *transaction).await?;
                claimed.reserved = Some(*id);
                claimed.next_owner = Some(owner.as_str().to_owned());
                jobs.truncate(last);
            }
            None => {}
        }
        let after_last = jobs.last().map(|job| owner_after(job.owner.as_str()));
        claimed.next_owner = claimed.next_owner.or(after_last);
        let rows = start(&mut transaction, &jobs, lease_ms).await?;
        for Queued { id, .. } in &jobs {
            match rows.get(id).map(row::claim) {
                Some(Ok(claim)) => claimed.claims.push(claim),
                _ => claimed.damaged.push(*id),
            }
        }
        let damaged = claimed.damaged.iter().map(|id| Transition::damaged(*id, State::Running));
        apply(&mut transaction, &damaged.collect::<Vec<_>>(), &self.terms).await?;
        let count = jobs.len() as i64;
        count_changes(&mut transaction, -count, count).await?;
        transaction.commit().await?;
        Ok(claimed)
    }

    /// The next jobs in the order of owners, and whether owners were skipped.
    async fn next_jobs(
        &self,
        transaction: &mut Transaction,
        wanted: usize,
        reserved: Option<JobId>,
    ) -> sqlx::Result<(Vec<Queued>, bool)> {
        let start = self.next_owner.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let per_owner = i64::try_from(self.terms.caps.running_per_owner).unwrap_or(i64::MAX);
        let mut limit = wanted;
        loop {
            let found: Vec<(String, bool)> = transaction
                .query_as(NEXT_OWNERS)
                .bind(&start)
                .bind(limit as i32)
                .bind(per_owner)
                .fetch_all(&mut **transaction)
                .await?;
            let are_all = found.len() < limit;
            let may_run = found.into_iter().filter(|(_, may_run)| *may_run);
            let may_run: Vec<String> = may_run.map(|(owner, _)| owner).collect();
            let owners = lock(transaction, &may_run).await?;
            // If no other owner has queued jobs, each may have several turns.
            let turns = if are_all { wanted.div_ceil(owners.len().max(1)) } else { 1 };
            let rows = transaction
                .query(NEXT_JOBS)
                .bind(&owners)
                .bind(turns as i64)
                .bind(per_owner)
                .bind(reserved.map(uuid))
                .bind(MAX_ATTEMPTS as i32)
                .bind(wanted as i64)
                .fetch_all(&mut **transaction)
                .await?;
            let jobs = rows.iter().map(queued).collect::<sqlx::Result<Vec<_>>>()?;
            if !jobs.is_empty() || are_all {
                let are_skipped = !are_all || owners.len() < may_run.len();
                let may_be_more = are_skipped && jobs.len() < wanted;
                return Ok((jobs, may_be_more));
            }
            limit *= MORE_OWNERS;
        }
    }
}

/// Locks owners for claims, and returns those whose locks no other node holds. Anonymous jobs have
/// no limit and need no lock.
async fn lock(transaction: &mut Transaction, owners: &[String]) -> sqlx::Result<Vec<String>> {
    let mut locked = HashSet::new();
    if owners.iter().any(|owner| !owner.is_empty()) {
        let query = transaction
            .query_as(
                "SELECT owner FROM owner_locks WHERE owner = ANY ($1) AND purpose = 1
                 FOR UPDATE SKIP LOCKED",
            )
            .bind(owners);
        let rows: Vec<(String,)> = query.fetch_all(&mut **transaction).await?;
        locked.extend(rows.into_iter().map(|(owner,)| owner));
    }
    let is_locked = |owner: &&String| owner.is_empty() || locked.contains(*owner);
    Ok(owners.iter().filter(is_locked).cloned().collect())
}

fn queued(row: &PgRow) -> sqlx::Result<Queued> {
    let is_last_attempt = row.flag("is_last_attempt")?;
    Ok(Queued { id: row.id()?, owner: row::owner(row)?, is_last_attempt })
}

/// The statement that keeps a queued job from other nodes.
fn reservation<'q>(job: JobId, lease_ms: i64) -> Query<'q, Postgres, PgArguments> {
    let sql = "UPDATE jobs SET lease_end = now() + $2 * interval '1 millisecond'
               WHERE id = $1 AND state = 0";
    sqlx::query(sql).persistent(false).bind(uuid(job)).bind(lease_ms)
}

/// Changes queued jobs to running ones, and returns their rows.
async fn start(
    transaction: &mut Transaction,
    jobs: &[Queued],
    lease_ms: i64,
) -> sqlx::Result<HashMap<JobId, PgRow>> {
    if jobs.is_empty() {
        return Ok(HashMap::new());
    }
    let rows = transaction
        .query(
            "UPDATE jobs SET state = 1, attempt = attempt + 1, fence = fence + 1,
                lease_end = now() + $2 * interval '1 millisecond',
                started_at = COALESCE(started_at, now()), revision = revision + 1,
                history = history || ARRAY[revision + 1,
                                           (extract(epoch FROM now()) * 1000)::bigint,
                                           1, attempt + 1]
             WHERE id = ANY ($1)
             RETURNING id, owner, fence, attempt, options, image_digest, image_bytes, image_shape",
        )
        .bind(jobs.iter().map(|job| uuid(job.id)).collect::<Vec<_>>())
        .bind(lease_ms)
        .fetch_all(&mut **transaction)
        .await?;
    rows.into_iter().map(|row| Ok((row.id()?, row))).collect()
}

/// A name that comes after an owner and before all later owners.
fn owner_after(owner: &str) -> String {
    format!("{owner}\u{1}")
}
