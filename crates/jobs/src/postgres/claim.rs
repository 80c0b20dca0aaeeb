//! Workers take jobs.
//!
//! Owners take turns: a node goes round all owners with waiting jobs in the order of their names, and
//! takes the oldest job of each. It finds the next owner by one step in an index, however many owners
//! there are and however many jobs they have, and keeps nothing of its round in the database. Rows that
//! another node takes at the same moment are passed over.
//!
//! While an owner's running jobs are counted, the owner's door is locked. An owner whose door another
//! node has locked is passed over and comes again at once.
//!
//! The last attempt that a job has is made alone on its node. A node that is busy when it meets such a
//! job sets it aside, which keeps it from other nodes for a lease, and takes nothing else before it.

use super::Node;
use super::database::Transaction;
use super::finish::{Transition, apply, count_changes};
use super::leases::Reserved;
use super::row::{self, ms, number, uuid};
use crate::embedded::watchers::Changes;
use crate::queue::{Claim, Lease, MAX_ATTEMPTS, Outcome, QueueError};
use crate::record::{self, JobId, State};
use pixmesh_engine::Owner;
use sqlx::Row;
use sqlx::postgres::PgRow;
use std::collections::{HashMap, HashSet};
use std::sync::PoisonError;

/// How many more owners are looked at when those before have as many running as they may.
const MORE: usize = 4;

/// A job that waits, and that nobody else can take now.
struct Waiting {
    id: JobId,
    owner: Owner,
    is_last_attempt: bool,
}

/// What a transaction took.
#[derive(Default)]
struct Taken {
    claims: Vec<Claim>,
    /// The job that was set aside.
    reserved: Option<JobId>,
    /// Where the next round begins.
    next: Option<String>,
    /// Owners were passed over that may have jobs to be taken.
    is_more: bool,
    damaged: Vec<JobId>,
}

/// Owners whose turn it is.
struct Turns {
    owners: Vec<String>,
    /// Whether no other owner has jobs waiting.
    are_all: bool,
}

impl Node {
    /// Gives jobs to workers, up to a number, and counts the attempts.
    pub(super) async fn claim(&self, wanted: usize) -> Result<Vec<Option<Claim>>, QueueError> {
        if self.leases.last_attempt_runs() {
            return Ok(vec![None; wanted]);
        }
        let reserved = self.leases.reserved();
        if let Some(reserved) = reserved
            && !self.leases.is_empty()
        {
            self.keep_aside(reserved).await?;
            return Ok(vec![None; wanted]);
        }
        let taken = self.database.retry(|| self.try_claim(wanted, reserved)).await?;
        for Claim { lease, attempt, .. } in &taken.claims {
            self.leases.add(*lease, *attempt, self.terms.lease);
        }
        self.leases.reserve(taken.reserved);
        if let Some(next) = taken.next {
            *self.turn.lock().unwrap_or_else(PoisonError::into_inner) = next;
        }
        let is_more = taken.is_more || !taken.damaged.is_empty();
        for job in &taken.damaged {
            tracing::error!(%job, "a job's record cannot be read");
        }
        let mut jobs: Vec<_> = taken.claims.iter().map(|claim| claim.lease.job).collect();
        jobs.extend(taken.damaged);
        self.notifications.send(Changes { jobs, work: false });
        if is_more {
            self.notifications.wake_workers();
        }
        let mut claims: Vec<_> = taken.claims.into_iter().map(Some).collect();
        claims.resize(wanted, None);
        Ok(claims)
    }

    /// Keeps a job from other nodes that waits until nothing else runs here.
    async fn keep_aside(&self, reserved: Reserved) -> Result<(), QueueError> {
        if reserved.since.elapsed() < self.terms.lease / 3 {
            return Ok(());
        }
        let keep = || async {
            let mut transaction = self.database.begin().await?;
            reserve(&mut transaction, reserved.job, ms(self.terms.lease)).await?;
            transaction.commit().await
        };
        self.database.retry(keep).await?;
        self.leases.reserve(Some(reserved.job));
        Ok(())
    }

    async fn try_claim(&self, wanted: usize, reserved: Option<Reserved>) -> sqlx::Result<Taken> {
        let start = self.turn.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let lease_ms = ms(self.terms.lease);
        let mut transaction = self.database.begin().await?;
        let (mut waiting, is_more) = self
            .next_jobs(&mut transaction, &start, wanted, reserved.map(|reserved| reserved.job))
            .await?;
        let mut taken = Taken { is_more, ..Taken::default() };
        match waiting.iter().position(|job| job.is_last_attempt) {
            Some(0) if self.leases.is_empty() => waiting.truncate(1),
            Some(last) => {
                let Waiting { id, owner, .. } = &waiting[last];
                reserve(&mut transaction, *id, lease_ms).await?;
                (taken.reserved, taken.next) = (Some(*id), Some(owner.as_str().to_owned()));
                waiting.truncate(last);
            }
            None => {}
        }
        if taken.reserved.is_none() {
            taken.next = waiting.last().map(|job| after(job.owner.as_str()));
        }
        let rows = take(&mut transaction, &waiting, lease_ms).await?;
        for Waiting { id, .. } in &waiting {
            match rows.get(id).map(claim) {
                Some(Ok(claim)) => taken.claims.push(claim),
                // One whose row cannot be read comes to its end, so that the others go on.
                _ => taken.damaged.push(*id),
            }
        }
        let outcome = Outcome::Failed(record::damaged());
        let ended: Vec<_> =
            taken.damaged.iter().map(|id| Transition::by(*id, State::Running, &outcome)).collect();
        apply(&mut transaction, &ended, self.terms.result_ttl).await?;
        let claimed = waiting.len() as i64;
        count_changes(&mut transaction, -claimed, claimed).await?;
        transaction.commit().await?;
        Ok(taken)
    }

    /// The next jobs in turn, and whether others were passed over.
    async fn next_jobs(
        &self,
        transaction: &mut Transaction,
        start: &str,
        wanted: usize,
        reserved: Option<JobId>,
    ) -> sqlx::Result<(Vec<Waiting>, bool)> {
        let running_per_owner =
            i64::try_from(self.terms.caps.running_per_owner).unwrap_or(i64::MAX);
        let mut most = wanted;
        loop {
            let turns = turns(transaction, start, most, running_per_owner).await?;
            let may_run = turns.owners.len();
            let open = with_free_locks(transaction, turns.owners).await?;
            // Where no other owner waits, one may have several turns.
            let turns_each = if turns.are_all { wanted.div_ceil(open.len().max(1)) } else { 1 };
            let rows = transaction
                .query(NEXT_JOBS)
                .bind(&open)
                .bind(turns_each as i64)
                .bind(running_per_owner)
                .bind(reserved.map(uuid))
                .fetch_all(&mut **transaction)
                .await?;
            let waiting = in_turns(&rows, wanted)?;
            if !waiting.is_empty() || turns.are_all {
                let is_passed_over = !turns.are_all || open.len() < may_run;
                let is_more = is_passed_over && waiting.len() < wanted;
                return Ok((waiting, is_more));
            }
            most *= MORE;
        }
    }
}

/// The oldest jobs of owners, up to a number for each, and no more than may run.
const NEXT_JOBS: &str = "
    SELECT job.id, job.owner, job.attempt
    FROM unnest($1::text[]) WITH ORDINALITY AS turn (owner, place),
    LATERAL (
        SELECT id, owner, attempt FROM jobs
        WHERE state = 0 AND owner = turn.owner
          AND (lease_end IS NULL OR lease_end <= now() OR id = $4)
        ORDER BY id
        LIMIT CASE WHEN turn.owner = '' THEN $2 ELSE LEAST($2, GREATEST(0, $3 -
            (SELECT count(*) FROM jobs AS other
             WHERE other.state = 1 AND other.owner = turn.owner))) END
        FOR UPDATE SKIP LOCKED
    ) AS job ORDER BY turn.place";

/// The owners whose turns come next, each found by one step in the index, who may have more running.
const NEXT_OWNERS: &str = "
    WITH RECURSIVE turn (owner, place) AS (
        (SELECT owner, 1 FROM jobs WHERE state = 0 AND owner >= $1 ORDER BY owner LIMIT 1)
        UNION ALL
        SELECT next.owner, turn.place + 1 FROM turn,
            LATERAL (SELECT owner FROM jobs WHERE state = 0 AND owner > turn.owner
                     ORDER BY owner LIMIT 1) AS next
        WHERE turn.place < $2)
    SELECT owner, owner = '' OR (SELECT count(*) FROM jobs
                                 WHERE state = 1 AND jobs.owner = turn.owner) < $3 AS may_run
    FROM turn ORDER BY place";

/// The owners whose turns come next, up to a number, from one on and then from the first.
async fn turns(
    transaction: &mut Transaction,
    start: &str,
    most: usize,
    running_per_owner: i64,
) -> sqlx::Result<Turns> {
    let (mut found, mut owners) = (0, Vec::new());
    for (from, before) in [(start, None), ("", Some(start))] {
        if found >= most || before == Some("") {
            continue;
        }
        let part: Vec<(String, bool)> = transaction
            .query_as(NEXT_OWNERS)
            .bind(from)
            .bind((most - found) as i32)
            .bind(running_per_owner)
            .fetch_all(&mut **transaction)
            .await?;
        let new =
            part.into_iter().filter(|(owner, _)| before.is_none_or(|end| owner.as_str() < end));
        for (owner, may_run) in new {
            found += 1;
            if may_run {
                owners.push(owner);
            }
        }
    }
    Ok(Turns { owners, are_all: found < most })
}

/// Those of the owners whose running jobs nobody else counts now, or that need not be counted.
async fn with_free_locks(
    transaction: &mut Transaction,
    owners: Vec<String>,
) -> sqlx::Result<Vec<String>> {
    if owners.iter().all(String::is_empty) {
        return Ok(owners);
    }
    let open: HashSet<String> = transaction
        .query_scalar(
            "SELECT owner FROM owner_locks WHERE owner = ANY ($1) AND purpose = 1 FOR UPDATE SKIP LOCKED",
        )
        .bind(&owners)
        .fetch_all(&mut **transaction)
        .await?
        .into_iter()
        .collect();
    Ok(owners.into_iter().filter(|owner| owner.is_empty() || open.contains(owner)).collect())
}

/// Jobs one turn of all owners after the other, up to a number.
fn in_turns(rows: &[PgRow], wanted: usize) -> sqlx::Result<Vec<Waiting>> {
    let (mut turns, mut waiting) = (HashMap::<Owner, usize>::new(), Vec::new());
    for row in rows {
        let (id, owner) = (row::id(row)?, row::owner(row)?);
        let turn = turns.entry(owner.clone()).or_default();
        *turn += 1;
        // A job whose attempts cannot be counted is not tried.
        let attempt: u32 = number::<i32, _>(row, "attempt")?;
        waiting.push((*turn, Waiting { id, owner, is_last_attempt: attempt + 1 >= MAX_ATTEMPTS }));
    }
    waiting.sort_by_key(|(turn, _)| *turn);
    Ok(waiting.into_iter().map(|(_, waiting)| waiting).take(wanted).collect())
}

/// Keeps a job that waits from other nodes.
async fn reserve(transaction: &mut Transaction, job: JobId, lease_ms: i64) -> sqlx::Result<()> {
    transaction
        .query(
            "UPDATE jobs SET lease_end = now() + $2 * interval '1 millisecond'
         WHERE id = $1 AND state = 0",
        )
        .bind(uuid(job))
        .bind(lease_ms)
        .execute(&mut **transaction)
        .await
        .map(|_| ())
}

/// Gives jobs to workers.
async fn take(
    transaction: &mut Transaction,
    jobs: &[Waiting],
    lease_ms: i64,
) -> sqlx::Result<HashMap<JobId, PgRow>> {
    if jobs.is_empty() {
        return Ok(HashMap::new());
    }
    let taken = transaction
        .query(
            "UPDATE jobs SET state = 1, attempt = attempt + 1, fence = fence + 1,
                lease_end = now() + $2 * interval '1 millisecond',
                started_at = COALESCE(started_at, now()), revision = revision + 1,
                history = history || ARRAY[revision + 1,
                                           (extract(epoch FROM now()) * 1000)::bigint,
                                           1, attempt + 1]
         WHERE id = ANY ($1)
         RETURNING id, owner, fence, attempt, order_query, image_digest, image_bytes, image_shape",
        )
        .bind(jobs.iter().map(|job| uuid(job.id)).collect::<Vec<_>>())
        .bind(lease_ms)
        .fetch_all(&mut **transaction)
        .await?;
    taken.into_iter().map(|row| Ok((row::id(&row)?, row))).collect()
}

fn claim(row: &PgRow) -> sqlx::Result<Claim> {
    Ok(Claim {
        lease: Lease { job: row::id(row)?, fence: number::<i64, _>(row, "fence")? },
        owner: row::owner(row)?,
        attempt: number::<i32, _>(row, "attempt")?,
        order: row.try_get("order_query")?,
        picture: row::picture(row)?,
    })
}

/// What comes next after an owner in the order of names.
fn after(owner: &str) -> String {
    format!("{owner}\u{1}")
}
