//! What time brings: workers that fell silent, jobs that are no longer kept.

use super::finish::{give_up, take_back};
use super::row;
use super::watchers::Changes;
use super::writer::Write;
use crate::queue::{MAX_ATTEMPTS, Swept, Terms};
use crate::record::{JobId, Moment, State};
use pixmesh_engine::digest::Digest;
use rusqlite::{Connection, Result, Row, params};
use std::time::Duration;

/// The most rows that one sweep changes, so that it is short.
const MOST_ROWS: i64 = 256;

/// A job that a worker has.
struct Held {
    id: JobId,
    attempt: u32,
    cancel_requested: bool,
}

/// Lets jobs wait again that were running when the last process ended.
pub(super) fn recover(connection: &Connection, ttl: Duration) -> Result<()> {
    connection.execute_batch("BEGIN IMMEDIATE")?;
    let mut write = Write { connection, changes: Changes::default() };
    let held = held(&write, i64::MAX, i64::MAX)?;
    for Held { id, attempt, cancel_requested } in &held {
        let state = take_back(&mut write, *id, *attempt, *cancel_requested, ttl)?;
        tracing::info!(job = %id, attempt, state = state.name(), "was running when the process ended");
    }
    connection.execute_batch("COMMIT")
}

/// Does what is due.
pub(super) fn sweep(write: &mut Write<'_>, terms: &Terms, now_ms: i64) -> Result<Swept> {
    let mut swept = Swept::default();
    for Held { id, attempt, cancel_requested } in held(write, now_ms, MOST_ROWS)? {
        match take_back(write, id, attempt, cancel_requested, terms.result_ttl)? {
            State::Queued => swept.requeued += 1,
            State::Failed => swept.exhausted += 1,
            _ => {}
        }
    }
    swept.expired = expire(write, terms)?;
    swept.given_up = given_up(write)?;
    // A write at each sweep tells whether the storage takes any.
    let sql = "INSERT OR REPLACE INTO pulse VALUES (0, ?1)";
    write.connection.prepare_cached(sql)?.execute([Moment::now().0])?;
    Ok(swept)
}

/// Jobs whose leases end by a moment.
fn held(write: &Write<'_>, lease_end_ms: i64, limit: i64) -> Result<Vec<Held>> {
    let mut statement = write.connection.prepare_cached(
        "SELECT id, attempt, cancel_requested FROM jobs
         WHERE state < 2 AND state = 1 AND COALESCE(lease_end_ms, 0) <= ?1 LIMIT ?2",
    )?;
    let held = |row: &Row<'_>| {
        Ok(Held {
            id: row::id(row, "id")?,
            // A job whose attempts cannot be counted gets no further one.
            attempt: row.get("attempt").unwrap_or(MAX_ATTEMPTS),
            cancel_requested: row.get("cancel_requested").unwrap_or(false),
        })
    };
    statement.query_map(params![lease_end_ms, limit], held)?.collect()
}

/// Keeps of jobs past their time nothing but that they were, and after a longer time not even that.
fn expire(write: &mut Write<'_>, terms: &Terms) -> Result<usize> {
    let now = Moment::now().0;
    let ids: Vec<JobId> = write
        .connection
        .prepare_cached("SELECT id FROM jobs WHERE is_gone = 0 AND expires_ms <= ?1 LIMIT ?2")?
        .query_map(params![now, MOST_ROWS], |row| row::id(row, "id"))?
        .collect::<Result<_>>()?;
    for id in &ids {
        let mesh: Option<String> = write
            .connection
            .prepare_cached("SELECT mesh_digest FROM jobs WHERE id = ?1")?
            .query_row([id.as_bytes()], |row| row.get(0))?;
        if let Some(digest) = mesh.and_then(|text| text.parse().ok()) {
            give_up(write, digest)?;
        }
        for sql in [
            "UPDATE jobs SET is_gone = 1, mesh = NULL, mesh_digest = NULL, problem = NULL,
                             order_query = '' WHERE id = ?1",
            "DELETE FROM events WHERE job = ?1",
            "DELETE FROM idempotency WHERE job = ?1",
        ] {
            write.connection.prepare_cached(sql)?.execute([id.as_bytes()])?;
        }
        write.changes.jobs.push(*id);
    }
    let forgotten = now.saturating_sub(terms.gone_ttl.as_millis() as i64);
    for (sql, before) in [
        ("DELETE FROM jobs WHERE is_gone = 1 AND expires_ms <= ?1", forgotten),
        ("DELETE FROM idempotency WHERE until_ms <= ?1", now),
    ] {
        write.connection.prepare_cached(sql)?.execute([before])?;
    }
    Ok(ids.len())
}

/// The blobs that were given up and that no job has: one that a job has is given up again later.
fn given_up(write: &Write<'_>) -> Result<Vec<Digest>> {
    let sql = "DELETE FROM given_up WHERE
        EXISTS (SELECT 1 FROM jobs WHERE has_image = 1 AND image_digest = blob)
        OR EXISTS (SELECT 1 FROM jobs WHERE mesh_digest IS NOT NULL AND mesh_digest = blob)";
    write.connection.prepare_cached(sql)?.execute([])?;
    let mut statement = write.connection.prepare_cached("SELECT blob FROM given_up LIMIT ?1")?;
    statement.query_map([MOST_ROWS], |row| row::digest(row, "blob"))?.collect()
}

/// Blobs that were given up are seen to.
pub(super) fn forget(write: &mut Write<'_>, blobs: &[Digest]) -> Result<()> {
    let mut statement = write.connection.prepare_cached("DELETE FROM given_up WHERE blob = ?1")?;
    blobs.iter().try_for_each(|blob| statement.execute([blob.to_string()]).map(|_| ()))
}
