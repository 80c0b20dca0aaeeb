//! Workers claim jobs, and renew their leases.
//!
//! Owners take turns in the order of their names: a claim takes the oldest job of the next owner
//! with queued jobs. The last attempt of a job runs alone, so that a job that crashes the process
//! costs no other job an attempt.

use super::finish::apply;
use super::read::status;
use super::rows::first;
use super::writer::Write;
use crate::queue::{Claim, Lease, MAX_ATTEMPTS, Renewal, Terms};
use crate::record::{JobId, Moment, Progress, State};
use crate::row::{self, Row as _, number};
use crate::transition::{Status, Transition};
use rusqlite::{Result, params};
use std::sync::{Mutex, PoisonError};

/// The oldest job of the first owner after `?1` who may have another job running by the limit `?2`.
/// After the last owner follows the first one; `UNION` ends the recursion there.
const NEXT_JOB: &str = "
    WITH RECURSIVE next (owner) AS (
        SELECT COALESCE((SELECT min(owner) FROM jobs WHERE state = 0 AND owner > ?1),
                        (SELECT min(owner) FROM jobs WHERE state = 0))
        UNION
        SELECT COALESCE((SELECT min(owner) FROM jobs WHERE state = 0 AND owner > next.owner),
                        (SELECT min(owner) FROM jobs WHERE state = 0)) FROM next)
    SELECT id, owner, attempt FROM jobs
    WHERE state = 0 AND owner = (
        SELECT owner FROM next
        WHERE owner = '' OR
            (SELECT count(*) FROM jobs WHERE state = 1 AND jobs.owner = next.owner) < ?2
        LIMIT 1)
    ORDER BY id LIMIT 1";

/// Claims the next job. `last_owner` is the owner of the last claim.
pub(super) fn claim(
    write: &mut Write<'_>,
    last_owner: &Mutex<String>,
    terms: &Terms,
    lease_end: i64,
) -> Result<Option<Claim>> {
    let mut last_owner = last_owner.lock().unwrap_or_else(PoisonError::into_inner);
    let sql = "SELECT count(*), COALESCE(max(attempt), 0) >= ?1 FROM jobs WHERE state = 1";
    let running =
        first(write.connection, sql, [MAX_ATTEMPTS], |row| Ok((row.get(0)?, row.get(1)?)));
    let (running, last_attempt_runs): (u64, bool) = running?.unwrap_or_default();
    if last_attempt_runs {
        return Ok(None);
    }
    let limit = i64::try_from(terms.caps.running_per_owner).unwrap_or(i64::MAX);
    loop {
        let next = first(write.connection, NEXT_JOB, params![*last_owner, limit], |row| {
            Ok((row.id()?, row::owner(row)?, number::<_, u32>(row, "attempt")))
        });
        let Some((id, owner, attempt)) = next? else { return Ok(None) };
        let claimed = match attempt {
            Ok(attempt) if attempt.saturating_add(1) >= MAX_ATTEMPTS && running > 0 => {
                return Ok(None);
            }
            Ok(_) => start(write, id, lease_end),
            Err(error) => Err(error),
        };
        owner.as_str().clone_into(&mut last_owner);
        match claimed {
            Ok(claim) => return Ok(Some(claim)),
            // A job whose record is damaged fails, so that others are claimed.
            Err(error) => {
                tracing::error!(job = %id, %error, "job record damaged");
                apply(write, &Transition::damaged(id, State::Queued), terms.result_ttl)?;
            }
        }
    }
}

/// Changes a queued job to a running one.
fn start(write: &mut Write<'_>, id: JobId, lease_end: i64) -> Result<Claim> {
    write.changes.jobs.push(id);
    let sql = "UPDATE jobs SET state = 1, attempt = attempt + 1, fence = fence + 1, lease_end = ?2,
                   started_at = COALESCE(started_at, ?3), revision = revision + 1,
                   history = history || format(' %d %d 1 %d', revision + 1, ?3, attempt + 1)
               WHERE id = ?1
               RETURNING id, owner, fence, attempt, options, image_digest, image_bytes,
                         image_shape";
    let parameters = params![id.as_bytes(), lease_end, Moment::now().0];
    let claim = first(write.connection, sql, parameters, |row| row::claim(row))?;
    claim.ok_or(rusqlite::Error::QueryReturnedNoRows)
}

/// Renews a lease, and stores new progress.
pub(super) fn renew(
    write: &mut Write<'_>,
    lease: Lease,
    progress: Option<&Progress>,
    lease_end: i64,
) -> Result<Renewal> {
    let renewal = Status::renewal(status(write.connection, lease.job)?, lease);
    if renewal == Renewal::Lost {
        return Ok(renewal);
    }
    let job = lease.job.as_bytes();
    write.execute("UPDATE jobs SET lease_end = ?2 WHERE id = ?1", params![job, lease_end])?;
    if let Some(json) = progress.and_then(|progress| serde_json::to_string(progress).ok()) {
        let sql = "UPDATE jobs SET progress = ?2, progress_at = ?3, revision = revision + 1
                   WHERE id = ?1";
        write.execute(sql, params![job, json, Moment::now().0])?;
        write.changes.jobs.push(lease.job);
    }
    Ok(renewal)
}
