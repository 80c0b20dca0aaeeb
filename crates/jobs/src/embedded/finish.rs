//! A job comes to its end, or back to those that wait.

use super::read::holder;
use super::row;
use super::writer::Write;
use crate::queue::{Cancellation, Finish, Lease, MAX_ATTEMPTS, Outcome};
use crate::record::{self, JobId, Moment, Progress, State};
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use rusqlite::{OptionalExtension, Result, Row, params};
use std::time::Duration;

/// Ends a worker's attempt, if the job is still the worker's.
pub(super) fn finish(
    write: &mut Write<'_>,
    lease: Lease,
    outcome: &Outcome,
    ttl: Duration,
) -> Result<Finish> {
    let id = lease.job;
    if holder(write.connection, id)? != Some((State::Running, lease.fence)) {
        if let Outcome::Completed(mesh) = outcome
            && let Ok(digest) = mesh.digest.parse()
        {
            give_up(write, digest)?;
        }
        return Ok(Finish::Fenced);
    }
    let (attempt, cancel_requested) = write
        .connection
        .prepare_cached("SELECT attempt, cancel_requested FROM jobs WHERE id = ?1")?
        .query_row([id.as_bytes()], |row| Ok((row.get::<_, u32>(0)?, row.get::<_, bool>(1)?)))?;
    match outcome {
        _ if cancel_requested => {
            if let Outcome::Completed(mesh) = outcome
                && let Ok(digest) = mesh.digest.parse()
            {
                give_up(write, digest)?;
            }
            end(write, id, &Outcome::Cancelled, ttl)?;
        }
        Outcome::HandedBack => requeue(write, id, 1)?,
        Outcome::Retry(_) if attempt < MAX_ATTEMPTS => requeue(write, id, 0)?,
        _ => end(write, id, outcome, ttl)?,
    }
    write.changes.work = true;
    let state = holder(write.connection, id)?.map_or(State::Queued, |(state, _)| state);
    Ok(Finish::Committed(state))
}

/// Takes a job from a worker that fell silent.
pub(super) fn take_back(
    write: &mut Write<'_>,
    id: JobId,
    attempt: u32,
    cancel_requested: bool,
    ttl: Duration,
) -> Result<State> {
    write.changes.work = true;
    if cancel_requested {
        end(write, id, &Outcome::Cancelled, ttl)?;
        return Ok(State::Cancelled);
    }
    if attempt >= MAX_ATTEMPTS {
        end(write, id, &Outcome::Failed(record::exhausted(attempt)), ttl)?;
        return Ok(State::Failed);
    }
    requeue(write, id, 0)?;
    Ok(State::Queued)
}

/// Lets a job wait again, with so many attempts given back.
fn requeue(write: &mut Write<'_>, id: JobId, given_back: u32) -> Result<()> {
    write
        .connection
        .prepare_cached(
            "UPDATE jobs SET state = 0, attempt = attempt - ?2, fence = fence + 1,
                             lease_end_ms = NULL, stage = NULL, fraction = NULL
             WHERE id = ?1",
        )?
        .execute(params![id.as_bytes(), given_back])?;
    tell(write, id, None)
}

/// Writes down how a job ended, and gives up what it no longer needs.
pub(super) fn end(
    write: &mut Write<'_>,
    id: JobId,
    outcome: &Outcome,
    ttl: Duration,
) -> Result<()> {
    let (state, mesh, problem) = match outcome {
        Outcome::Completed(mesh) => (State::Completed, Some(mesh), None),
        Outcome::Failed(problem) | Outcome::Retry(problem) => (State::Failed, None, Some(problem)),
        Outcome::Cancelled | Outcome::HandedBack => (State::Cancelled, None, None),
    };
    let now = Moment::now().0;
    let expires = now.saturating_add(i64::try_from(ttl.as_millis()).unwrap_or(i64::MAX));
    let image: Option<String> = write
        .connection
        .prepare_cached(
            "UPDATE jobs SET state = ?2, mesh = ?3, mesh_digest = ?4, problem = ?5,
                             finished_ms = ?6, expires_ms = ?7, has_image = 0,
                             lease_end_ms = NULL, stage = NULL, fraction = NULL
             WHERE id = ?1 RETURNING image_digest",
        )?
        .query_row(
            params![
                id.as_bytes(),
                state as usize,
                mesh.and_then(|mesh| serde_json::to_string(mesh).ok()),
                mesh.map(|mesh| &mesh.digest),
                problem.map(ToString::to_string),
                now,
                expires
            ],
            |row| row.get(0),
        )
        .optional()?;
    if let Some(digest) = image.and_then(|text| text.parse().ok()) {
        give_up(write, digest)?;
    }
    // What led here is of no use to anybody who asks from now on; the changes of state are.
    write
        .connection
        .prepare_cached("DELETE FROM events WHERE job = ?1 AND stage IS NOT NULL")?
        .execute([id.as_bytes()])?;
    tell(write, id, None)
}

/// Cancels an owner's job, or deletes it where it has come to its end.
pub(super) fn cancel(
    write: &mut Write<'_>,
    owner: &Owner,
    id: JobId,
    ttl: Duration,
) -> Result<Cancellation> {
    let found = write
        .connection
        .prepare_cached(
            "SELECT state, is_gone OR COALESCE(expires_ms <= ?3, 0)
             FROM jobs WHERE id = ?1 AND owner = ?2",
        )?
        .query_row(params![id.as_bytes(), owner.as_str(), Moment::now().0], |row: &Row<'_>| {
            // One in no known state can at least be deleted.
            Ok((row::state(row).unwrap_or(State::Failed), row.get::<_, bool>(1)?))
        })
        .optional()?;
    Ok(match found {
        None => Cancellation::Unknown,
        Some((_, true)) => Cancellation::Gone,
        Some((State::Queued, _)) => {
            end(write, id, &Outcome::Cancelled, ttl)?;
            Cancellation::Cancelled
        }
        Some((State::Running, _)) => {
            let sql = "UPDATE jobs SET cancel_requested = 1 WHERE id = ?1";
            write.connection.prepare_cached(sql)?.execute([id.as_bytes()])?;
            write.changes.jobs.push(id);
            Cancellation::Requested
        }
        Some(_) => {
            delete(write, id)?;
            Cancellation::Deleted
        }
    })
}

/// Leaves nothing of a job but the blobs that are given up.
fn delete(write: &mut Write<'_>, id: JobId) -> Result<()> {
    let mesh: Option<String> = write
        .connection
        .prepare_cached("DELETE FROM jobs WHERE id = ?1 RETURNING mesh_digest")?
        .query_row([id.as_bytes()], |row| row.get(0))?;
    if let Some(digest) = mesh.and_then(|text| text.parse().ok()) {
        give_up(write, digest)?;
    }
    for sql in ["DELETE FROM events WHERE job = ?1", "DELETE FROM idempotency WHERE job = ?1"] {
        write.connection.prepare_cached(sql)?.execute([id.as_bytes()])?;
    }
    write.changes.jobs.push(id);
    Ok(())
}

/// Takes down that a job no longer has a blob, which others may have.
pub(super) fn give_up(write: &Write<'_>, blob: Digest) -> Result<()> {
    let sql = "INSERT OR IGNORE INTO given_up VALUES (?1)";
    write.connection.prepare_cached(sql)?.execute([blob.to_string()])?;
    Ok(())
}

/// Counts a change of a job and takes it down, for those who follow it.
pub(super) fn tell(write: &mut Write<'_>, id: JobId, progress: Option<&Progress>) -> Result<()> {
    if let Some(Progress { stage, fraction }) = progress {
        let sql = "UPDATE jobs SET stage = ?2, fraction = ?3 WHERE id = ?1";
        write.connection.prepare_cached(sql)?.execute(params![id.as_bytes(), stage, fraction])?;
    }
    let sql = "UPDATE jobs SET revision = revision + 1 WHERE id = ?1";
    write.connection.prepare_cached(sql)?.execute([id.as_bytes()])?;
    let (stage, fraction) = progress.map(|p| (p.stage.as_str(), p.fraction)).unzip();
    write
        .connection
        .prepare_cached(
            "INSERT INTO events (job, revision, at_ms, state, attempt, stage, fraction)
             SELECT id, revision, ?2, state, attempt, ?3, ?4 FROM jobs WHERE id = ?1",
        )?
        .execute(params![id.as_bytes(), Moment::now().0, stage, fraction])?;
    write.changes.jobs.push(id);
    Ok(())
}
