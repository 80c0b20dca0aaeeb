//! Periodic maintenance: leases that expired, jobs that expired, blobs that no job uses.

use super::finish::apply;
use super::rows::all;
use super::writer::Write;
use crate::queue::{Swept, Terms};
use crate::record::{JobId, Moment, State};
use crate::row::{self, Row as _};
use crate::transition::Transition;
use crate::watchers::Changes;
use pixmesh_engine::digest::Digest;
use rusqlite::{Connection, Result, params};

/// The most rows of each kind that one sweep changes, so that it is short.
const MAX_ROWS: i64 = 256;

/// Ends the leases of the last process, and the jobs that nobody can name any more.
pub(super) fn recover(connection: &Connection, terms: &Terms) -> Result<()> {
    connection.execute_batch("BEGIN IMMEDIATE")?;
    let mut write = Write { connection, changes: Changes::default() };
    let sql = "UPDATE jobs SET state = 4, expires_at = NULL WHERE length(id) <> 16";
    let unnamed = write.execute(sql, [])?;
    if unnamed > 0 {
        tracing::error!(records = unnamed, "job records with damaged ids ignored");
    }
    for (job, state) in end_leases(&mut write, terms, i64::MAX, i64::MAX)? {
        tracing::info!(%job, state = state.name(), "job was running when the process ended");
    }
    connection.execute_batch("COMMIT")
}

/// One sweep at a time of the process's own clock.
pub(super) fn sweep(write: &mut Write<'_>, terms: &Terms, own_now: i64) -> Result<Swept> {
    let mut swept = Swept::default();
    for (_, state) in end_leases(write, terms, own_now, MAX_ROWS)? {
        swept.requeued += usize::from(state == State::Queued);
        swept.exhausted += usize::from(state == State::Failed);
    }
    swept.expired = expire(write, terms)?;
    swept.orphans = orphans(write)?;
    let now = Moment::now().0;
    write.execute("INSERT OR REPLACE INTO pulse VALUES (0, ?1)", [now])?;
    Ok(swept)
}

/// Ends the leases that expire by a time of the process's own clock.
fn end_leases(
    write: &mut Write<'_>,
    terms: &Terms,
    until: i64,
    limit: i64,
) -> Result<Vec<(JobId, State)>> {
    let sql = "SELECT id, state, fence, attempt, cancel_requested FROM jobs
               WHERE state = 1 AND COALESCE(lease_end, 0) <= ?1 LIMIT ?2";
    let running =
        all(write.connection, sql, params![until, limit], |row| Ok((row.id()?, row::status(row))))?;
    let mut ended = Vec::new();
    for (job, status) in running {
        let transition = match status {
            Ok(status) => status.lease_expired(job),
            Err(_) => Transition::damaged(job, State::Running),
        };
        apply(write, &transition, terms.result_ttl)?;
        write.changes.work = true;
        ended.push((job, transition.to));
    }
    Ok(ended)
}

/// Deletes expired jobs, and remembers their ids for a time.
fn expire(write: &mut Write<'_>, terms: &Terms) -> Result<usize> {
    let now = Moment::now();
    let sql = "SELECT id FROM jobs WHERE expires_at <= ?1 LIMIT ?2";
    let expired = all(write.connection, sql, params![now.0, MAX_ROWS], |row| row.id())?;
    for id in &expired {
        let sql = "INSERT OR IGNORE INTO gone SELECT id, owner, expires_at + ?2 FROM jobs
                   WHERE id = ?1";
        write.execute(sql, params![id.as_bytes(), terms.gone_ttl.as_millis() as i64])?;
        write.delete(*id, terms)?;
    }
    for forget in ["DELETE FROM gone WHERE until <= ?1", "DELETE FROM kept_keys WHERE until <= ?1"]
    {
        write.execute(forget, [now.0])?;
    }
    Ok(expired.len())
}

/// The blobs that no job uses. A candidate that a job uses is marked again when the job releases
/// it.
fn orphans(write: &Write<'_>) -> Result<Vec<Digest>> {
    write.execute(
        "DELETE FROM orphan_candidates WHERE
             EXISTS (SELECT 1 FROM jobs WHERE state IN (0, 1, 3) AND image_digest = blob)
             OR EXISTS (SELECT 1 FROM jobs WHERE mesh_digest = blob)",
        [],
    )?;
    let sql = "SELECT blob FROM orphan_candidates LIMIT ?1";
    let blobs = all(write.connection, sql, [MAX_ROWS], |row| row.digest("blob"))?;
    Ok(blobs.into_iter().flatten().collect())
}

pub(super) fn forget(write: &Write<'_>, blobs: &[Digest]) -> Result<()> {
    let sql = "DELETE FROM orphan_candidates WHERE blob = ?1";
    blobs.iter().try_for_each(|blob| write.execute(sql, [blob.to_string()]).map(|_| ()))
}
