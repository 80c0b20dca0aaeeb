//! What is asked without changing anything.

use super::row::{self, EVENT, RECORD};
use crate::queue::{Lease, Lookup, Page, PageRequest, Renewal, Stats};
use crate::record::{Event, JobId, Moment, Record, State};
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use rusqlite::{Connection, OptionalExtension, Result, Row, params};
use std::collections::HashSet;

/// An owner's job.
pub(super) fn get(connection: &Connection, owner: &Owner, id: JobId) -> Result<Lookup> {
    let sql = format!("SELECT {RECORD}, is_gone FROM jobs WHERE id = ?1 AND owner = ?2");
    let found = connection
        .prepare_cached(&sql)?
        .query_row(params![id.as_bytes(), owner.as_str()], |row| {
            if row.get("is_gone")? {
                return Ok(Lookup::Gone);
            }
            let record = row::record(row)?;
            let is_over = record.expires.is_some_and(|end| end <= Moment::now());
            Ok(if is_over { Lookup::Gone } else { Lookup::Found(Box::new(record)) })
        })
        .optional()?;
    Ok(found.unwrap_or(Lookup::Unknown))
}

/// A job that is kept, whoever it belongs to.
pub(super) fn kept(connection: &Connection, id: JobId) -> Result<Option<Record>> {
    let sql = format!(
        "SELECT {RECORD} FROM jobs
         WHERE id = ?1 AND is_gone = 0 AND COALESCE(expires_ms > ?2, 1)"
    );
    let mut statement = connection.prepare_cached(&sql)?;
    statement.query_row(params![id.as_bytes(), Moment::now().0], row::record).optional()
}

/// An owner's jobs, newest first; what cannot be read is left out.
pub(super) fn list(connection: &Connection, owner: &Owner, request: PageRequest) -> Result<Page> {
    let PageRequest { state, before, limit } = request;
    let sql = format!(
        "SELECT {RECORD} FROM jobs
         WHERE owner = ?1 AND is_gone = 0 AND COALESCE(expires_ms > ?2, 1)
           AND (?3 IS NULL OR state = ?3) AND (?4 IS NULL OR id < ?4)
         ORDER BY id DESC LIMIT ?5"
    );
    let mut statement = connection.prepare_cached(&sql)?;
    let before = before.map(|id| *id.as_bytes());
    let state = state.map(|state| state as usize);
    let mut rows =
        statement.query(params![owner.as_str(), Moment::now().0, state, before, limit + 1])?;
    let (mut jobs, mut last, mut count) = (Vec::new(), None, 0);
    while let Some(found) = rows.next()? {
        count += 1;
        if count > limit {
            return Ok(Page { jobs, next: last });
        }
        last = Some(row::id(found, "id")?);
        match row::record(found) {
            Ok(record) => jobs.push(record),
            Err(error) => tracing::error!(job = ?last, %error, "a job's record cannot be read"),
        }
    }
    Ok(Page { jobs, next: None })
}

/// Whether a worker still has a job, and shall have it.
pub(super) fn standing(connection: &Connection, lease: Lease) -> Result<Renewal> {
    let found = connection
        .prepare_cached("SELECT state, fence, cancel_requested FROM jobs WHERE id = ?1")?
        .query_row([lease.job.as_bytes()], |row: &Row<'_>| {
            let holder = (row::state(row)?, row.get::<_, u64>("fence")?);
            Ok((holder, row.get::<_, bool>("cancel_requested")?))
        })
        .optional()?;
    Ok(match found {
        Some((holder, cancel_requested)) if holder == (State::Running, lease.fence) => {
            if cancel_requested {
                Renewal::CancelRequested
            } else {
                Renewal::Ok
            }
        }
        _ => Renewal::Lost,
    })
}

/// The most events that are read at a time.
const MOST_EVENTS: usize = 256;

/// What happened to a job after a revision, and whether more may come.
pub(super) fn events(
    connection: &Connection,
    owner: &Owner,
    id: JobId,
    after: u64,
) -> Result<(Vec<Event>, bool)> {
    let state = connection
        .prepare_cached("SELECT state FROM jobs WHERE id = ?1 AND owner = ?2 AND is_gone = 0")?
        .query_row(params![id.as_bytes(), owner.as_str()], row::state)
        .optional()?;
    if state.is_none() {
        return Ok((Vec::new(), false));
    }
    let sql = format!(
        "SELECT {EVENT} FROM events WHERE job = ?1 AND revision > ?2 ORDER BY revision LIMIT ?3"
    );
    let mut statement = connection.prepare_cached(&sql)?;
    // A revision that this job cannot have is as good as its last one.
    let after = i64::try_from(after).unwrap_or(i64::MAX);
    let events = statement.query_map(params![id.as_bytes(), after, MOST_EVENTS], row::event)?;
    let more_may_come = state.is_some_and(|state| !state.is_final());
    Ok((events.collect::<Result<_>>()?, more_may_come))
}

/// How much there is of what.
pub(super) fn stats(connection: &Connection) -> Result<Stats> {
    let sql = "SELECT COALESCE(SUM(state = 0), 0), COALESCE(SUM(state = 1), 0) FROM jobs
               WHERE state < 2";
    let (queued, running) =
        connection.prepare_cached(sql)?.query_row([], |row| Ok((row.get(0)?, row.get(1)?)))?;
    let sql = "SELECT MIN(created_ms) FROM jobs WHERE state < 2 AND state = 0";
    let oldest: Option<i64> = connection.prepare_cached(sql)?.query_row([], |row| row.get(0))?;
    let waited_ms = oldest.map_or(0, |oldest| Moment::now().0.saturating_sub(oldest).max(0));
    Ok(Stats { queued, running, oldest_queued_s: waited_ms as f64 / 1e3 })
}

/// Those of the blobs that a job has.
pub(super) fn referenced(connection: &Connection, blobs: Vec<Digest>) -> Result<HashSet<Digest>> {
    let mut statement = connection.prepare_cached(
        "SELECT EXISTS (SELECT 1 FROM jobs WHERE has_image = 1 AND image_digest = ?1)
             OR EXISTS (SELECT 1 FROM jobs WHERE mesh_digest IS NOT NULL AND mesh_digest = ?1)",
    )?;
    let mut found = HashSet::new();
    for blob in blobs {
        if statement.query_row([blob.to_string()], |row| row.get(0))? {
            found.insert(blob);
        }
    }
    Ok(found)
}

/// The state and fence of a job.
pub(super) fn holder(connection: &Connection, id: JobId) -> Result<Option<(State, u64)>> {
    connection
        .prepare_cached("SELECT state, fence FROM jobs WHERE id = ?1")?
        .query_row([id.as_bytes()], |row| Ok((row::state(row)?, row.get("fence")?)))
        .optional()
}
