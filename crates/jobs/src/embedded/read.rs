//! Queries that change nothing.

use super::rows::{all, first};
use crate::queue::{Lookup, Page, PageRequest, Paused, Search, Stats};
use crate::record::{Event, JobId, Moment};
use crate::row::{self, Row as _, select_record};
use crate::transition::Status;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use rusqlite::{Connection, Result, params};
use std::collections::HashSet;

pub(super) fn get(connection: &Connection, owner: &Owner, id: JobId) -> Result<Lookup> {
    let sql = select_record!(
        ", COALESCE(expires_at <= ?3, 0) AS is_expired FROM jobs WHERE id = ?1 AND owner = ?2"
    );
    let parameters = params![id.as_bytes(), owner.as_str(), Moment::now().0];
    let found = first(connection, sql, parameters, |row| {
        Ok(match row.flag("is_expired")? {
            true => Lookup::Gone,
            false => Lookup::Found(Box::new(row::record(row)?)),
        })
    })?;
    match found {
        Some(found) => Ok(found),
        None if is_gone(connection, owner, id)? => Ok(Lookup::Gone),
        None => Ok(Lookup::Unknown),
    }
}

/// Whether a job of an owner has expired and is deleted.
pub(super) fn is_gone(connection: &Connection, owner: &Owner, id: JobId) -> Result<bool> {
    let sql = "SELECT 1 FROM gone WHERE id = ?1 AND owner = ?2";
    let found = first(connection, sql, params![id.as_bytes(), owner.as_str()], |_| Ok(()));
    found.map(|found| found.is_some())
}

pub(super) fn list(connection: &Connection, owner: &Owner, request: PageRequest) -> Result<Page> {
    let PageRequest { state, before, limit } = request;
    let sql = select_record!(
        "FROM jobs WHERE owner = ?1 AND length(id) = 16 AND COALESCE(expires_at > ?2, 1)
           AND (?3 IS NULL OR state = ?3) AND (?4 IS NULL OR id < ?4)
         ORDER BY id DESC LIMIT ?5"
    );
    let before = before.map(|id| *id.as_bytes());
    let state = state.map(|state| state as usize);
    let parameters = params![owner.as_str(), Moment::now().0, state, before, limit + 1];
    let rows = all(connection, sql, parameters, |row| Ok((row.id()?, row::record(row))))?;
    Ok(Page::of(rows, limit))
}

pub(super) fn search(connection: &Connection, search: &Search, limit: usize) -> Result<Page> {
    let (owner, state, problem) = search.indexed();
    // A condition on a parameter that may be null would hide the index.
    let equals = |column, number, is_given| match is_given {
        true => format!("{column} = ?{number}"),
        false => format!("?{number} IS NULL"),
    };
    let sql = format!(
        select_record!(
            "FROM jobs WHERE length(id) = 16 AND {} AND {} AND {} AND id >= ?4 AND id < ?5
             ORDER BY id DESC LIMIT ?6"
        ),
        equals("owner", 1, owner.is_some()),
        equals("state", 2, state.is_some()),
        equals("problem_type", 3, problem.is_some())
    );
    let [from, before] = search.ids().map(|id| *id.as_bytes());
    let state = state.map(|state| state as usize);
    let parameters = params![owner, state, problem, from, before, limit + 1];
    let rows = all(connection, &sql, parameters, |row| Ok((row.id()?, row::record(row))))?;
    Ok(Page::of(rows, limit))
}

pub(super) fn paused(connection: &Connection) -> Result<Paused> {
    let paused = first(connection, "SELECT intake, work FROM paused", [], |row| {
        Ok(Paused { intake: row.flag("intake")?, work: row.flag("work")? })
    });
    paused.map(Option::unwrap_or_default)
}

pub(super) fn status(connection: &Connection, id: JobId) -> Result<Option<Status>> {
    let sql = "SELECT state, fence, attempt, cancel_requested FROM jobs WHERE id = ?1";
    first(connection, sql, [id.as_bytes()], |row| row::status(row))
}

pub(super) fn events(
    connection: &Connection,
    owner: &Owner,
    id: JobId,
    after: u64,
) -> Result<(Vec<Event>, bool)> {
    let sql = "SELECT state, attempt, revision, history, progress, progress_at FROM jobs
               WHERE id = ?1 AND owner = ?2";
    let found = first(connection, sql, params![id.as_bytes(), owner.as_str()], |row| {
        Ok((row::events(row, after)?, !row::state(row)?.is_final()))
    });
    found.map(Option::unwrap_or_default)
}

pub(super) fn stats(connection: &Connection) -> Result<Stats> {
    let sql = "SELECT (SELECT count(*) FROM jobs WHERE state = 0),
                      (SELECT count(*) FROM jobs WHERE state = 1),
                      (SELECT min(created_at) FROM jobs WHERE state = 0)";
    let stats = first(connection, sql, [], |row| {
        let oldest: Option<i64> = row.get(2)?;
        let age_ms = oldest.map_or(0, |oldest| Moment::now().0.saturating_sub(oldest).max(0));
        let oldest_queued_s = age_ms as f64 / 1e3;
        Ok(Stats { queued: row.get(0)?, running: row.get(1)?, oldest_queued_s })
    });
    stats.map(Option::unwrap_or_default)
}

/// A damaged record counts as nothing.
pub(super) fn stored_bytes(connection: &Connection) -> Result<Vec<(Owner, u64)>> {
    let sql = "
        SELECT owner, CAST(sum(CASE
            WHEN state IN (0, 1, 3) THEN image_bytes
                + iif(json_valid(image_shape), coalesce(image_shape -> 'weights' ->> 'bytes', 0), 0)
            WHEN json_valid(mesh) THEN coalesce(mesh ->> 'bytes', 0)
                + coalesce(mesh -> 'progression' ->> 'bytes', 0)
                + coalesce(mesh -> 'texture' ->> 'bytes', 0)
                + coalesce(mesh -> 'image' ->> 'bytes', 0)
            ELSE 0 END) AS INTEGER) AS bytes FROM jobs GROUP BY owner";
    all(connection, sql, [], |row| Ok((row::owner(row)?, row::number(row, "bytes")?)))
}

/// Which of the blobs a job uses: its picture until it is completed or cancelled, and its mesh.
pub(super) fn referenced(connection: &Connection, blobs: Vec<Digest>) -> Result<HashSet<Digest>> {
    let sql = "SELECT EXISTS (SELECT 1 FROM jobs WHERE state IN (0, 1, 3)
                                     AND image_digest = ?1)
                   OR EXISTS (SELECT 1 FROM jobs WHERE mesh_digest = ?1)";
    let mut found = HashSet::new();
    for blob in blobs {
        if first(connection, sql, [blob.to_string()], |row| row.get(0))? == Some(true) {
            found.insert(blob);
        }
    }
    Ok(found)
}
