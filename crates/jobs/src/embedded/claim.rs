//! A worker takes a job, and keeps it.

use super::row;
use super::writer::Write;
use super::{finish, read};
use crate::fairness::{Caps, OwnerLoad, next_owner};
use crate::queue::{Claim, Lease, MAX_ATTEMPTS, Outcome, Renewal};
use crate::record::{self, JobId, Moment, Progress};
use rusqlite::{Result, Row, params};
use std::time::Duration;

/// A job that waits, as far as the choice needs it.
struct Waiting {
    id: JobId,
    attempt: Result<u32>,
}

/// Gives the next job to a worker, and counts the attempt.
///
/// The last attempt that a job has is made alone: when it takes the process down with it, no other
/// job's attempt is used up.
pub(super) fn claim(
    write: &mut Write<'_>,
    caps: &Caps,
    ttl: Duration,
    lease_end_ms: i64,
) -> Result<Option<Claim>> {
    loop {
        let loads = loads(write)?;
        let running: usize = loads.iter().map(|load| load.running).sum();
        let Some(next) = next_owner(&loads, caps) else { return Ok(None) };
        let waiting = oldest(write, next)?;
        let attempt = match waiting.attempt {
            Ok(attempt) => attempt,
            Err(error) => {
                set_aside(write, waiting.id, &error, ttl)?;
                continue;
            }
        };
        let is_last = attempt.saturating_add(1) >= MAX_ATTEMPTS;
        if running > 0 && (is_last || last_attempt_runs(write)?) {
            return Ok(None);
        }
        take_turn(write, next)?;
        match take(write, waiting.id, lease_end_ms) {
            Ok(claim) => return Ok(Some(claim)),
            Err(error) => set_aside(write, waiting.id, &error, ttl)?,
        }
    }
}

/// What each owner has waiting and running.
fn loads(write: &Write<'_>) -> Result<Vec<OwnerLoad>> {
    let mut statement = write.connection.prepare_cached(
        "SELECT jobs.owner AS owner, SUM(state = 0) AS queued, SUM(state = 1) AS running,
                COALESCE(MAX(turns.turn), 0) AS last_turn
         FROM jobs LEFT JOIN turns ON turns.owner = jobs.owner
         WHERE state < 2 GROUP BY jobs.owner",
    )?;
    let load = |row: &Row<'_>| {
        Ok(OwnerLoad {
            owner: row::owner(row)?,
            queued: row.get("queued")?,
            running: row.get("running")?,
            last_turn: row.get("last_turn")?,
        })
    };
    statement.query_map([], load)?.collect()
}

fn oldest(write: &Write<'_>, load: &OwnerLoad) -> Result<Waiting> {
    write
        .connection
        .prepare_cached(
            "SELECT id, attempt FROM jobs WHERE state < 2 AND state = 0 AND owner = ?1
             ORDER BY id LIMIT 1",
        )?
        .query_row([load.owner.as_str()], |row| {
            Ok(Waiting { id: row::id(row, "id")?, attempt: row.get("attempt") })
        })
}

fn last_attempt_runs(write: &Write<'_>) -> Result<bool> {
    let sql = "SELECT EXISTS (SELECT 1 FROM jobs WHERE state < 2 AND state = 1
                                AND attempt >= ?1)";
    write.connection.prepare_cached(sql)?.query_row([MAX_ATTEMPTS], |row| row.get(0))
}

fn take_turn(write: &Write<'_>, load: &OwnerLoad) -> Result<()> {
    let sql = "INSERT OR REPLACE INTO turns
               SELECT ?1, COALESCE(MAX(turn), 0) + 1 FROM turns";
    write.connection.prepare_cached(sql)?.execute([load.owner.as_str()])?;
    Ok(())
}

fn take(write: &mut Write<'_>, id: JobId, lease_end_ms: i64) -> Result<Claim> {
    let claim = write
        .connection
        .prepare_cached(
            "UPDATE jobs SET state = 1, attempt = attempt + 1, fence = fence + 1,
                             lease_end_ms = ?2, started_ms = COALESCE(started_ms, ?3)
             WHERE id = ?1
             RETURNING owner, attempt, fence, order_query, image_digest, image_bytes, image_shape",
        )?
        .query_row(params![id.as_bytes(), lease_end_ms, Moment::now().0], |row| {
            Ok(Claim {
                lease: Lease { job: id, fence: row.get("fence")? },
                owner: row::owner(row)?,
                attempt: row.get("attempt")?,
                order: row.get("order_query")?,
                picture: row::picture(row)?,
            })
        })?;
    finish::tell(write, id, None)?;
    Ok(claim)
}

/// Ends a job whose row cannot be read, so that the others go on.
fn set_aside(
    write: &mut Write<'_>,
    id: JobId,
    error: &rusqlite::Error,
    ttl: Duration,
) -> Result<()> {
    tracing::error!(job = %id, %error, "a job's record cannot be read");
    let outcome = Outcome::Failed(record::damaged());
    finish::end(write, id, &outcome, ttl)
}

/// Lengthens a lease, and takes down how far the work is.
pub(super) fn renew(
    write: &mut Write<'_>,
    lease: Lease,
    progress: Option<&Progress>,
    lease_end_ms: i64,
) -> Result<Renewal> {
    let standing = read::standing(write.connection, lease)?;
    if standing == Renewal::Lost {
        return Ok(standing);
    }
    write
        .connection
        .prepare_cached("UPDATE jobs SET lease_end_ms = ?2 WHERE id = ?1")?
        .execute(params![lease.job.as_bytes(), lease_end_ms])?;
    if let Some(progress) = progress {
        finish::tell(write, lease.job, Some(progress))?;
    }
    Ok(standing)
}
