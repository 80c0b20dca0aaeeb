//! Jobs end, or are queued again.

use super::read::{is_gone, status};
use super::rows::first;
use super::writer::Write;
use crate::queue::{Cancellation, Change, Finish, Lease, Outcome, Paused, Terms};
use crate::record::{JobId, Moment, State};
use crate::row::{self, Row as _};
use crate::transition::{Status, Step, Transition, cancellation, orphaned_mesh, step};
use pixmesh_engine::Owner;
use rusqlite::{Result, params};
use std::time::Duration;

/// Stores a transition, and marks the picture of a job that ends as an orphan candidate, unless the job
/// failed and may be retried.
pub(super) fn apply(
    write: &mut Write<'_>,
    transition: &Transition<'_>,
    result_ttl: Duration,
) -> Result<()> {
    let (now, is_final) = (Moment::now(), transition.to.is_final());
    let keeps_picture = transition.to == State::Failed;
    let (mesh, mesh_digest) = transition.mesh_columns();
    let sql = "UPDATE jobs SET state = ?2, attempt = attempt - ?3, lease_end = NULL,
                   progress = NULL, progress_at = NULL, mesh = ?4, mesh_digest = ?5, problem = ?6,
                   finished_at = ?7, expires_at = ?8, revision = revision + 1,
                   history = history
                       || format(' %d %d %d %d', revision + 1, ?9, ?2, attempt - ?3)
               WHERE id = ?1 RETURNING image_digest";
    let parameters = params![
        transition.job.as_bytes(),
        transition.to as usize,
        transition.returned_attempts,
        mesh,
        mesh_digest.map(|digest| digest.to_string()),
        transition.problem_column(),
        is_final.then_some(now.0),
        is_final.then(|| now.after(result_ttl).0),
        now.0
    ];
    let picture =
        first(write.connection, sql, parameters, |row| Ok(row.digest("image_digest").ok()));
    if let Some(picture) = picture?.flatten().flatten().filter(|_| is_final && !keeps_picture) {
        write.mark_orphan_candidate(picture)?;
    }
    write.changes.jobs.push(transition.job);
    Ok(())
}

/// Ends an attempt.
pub(super) fn finish(
    write: &mut Write<'_>,
    lease: Lease,
    outcome: &Outcome,
    terms: &Terms,
) -> Result<Finish> {
    let status = status(write.connection, lease.job)?;
    let (finish, transition) = Status::finish(status, lease, outcome);
    if let Some(mesh) = orphaned_mesh(outcome, finish) {
        write.mark_orphan_candidate(mesh)?;
    }
    if let Some(transition) = transition {
        apply(write, &transition, terms.result_ttl)?;
        write.changes.work = true;
    }
    Ok(finish)
}

/// Changes jobs for an operator, and returns the states of those that it changed.
pub(super) fn change(
    write: &mut Write<'_>,
    jobs: &[JobId],
    change: Change,
    terms: &Terms,
) -> Result<Vec<State>> {
    let mut changed = Vec::new();
    for &job in jobs {
        let Some(status) = status(write.connection, job)? else { continue };
        let Some(step) = step(change, job, status) else { continue };
        let (id, mut state) = (job.as_bytes(), status.state);
        match step {
            Step::Transition(transition) => {
                apply(write, &transition, terms.result_ttl)?;
                state = transition.to;
            }
            Step::RequestCancellation => {
                write.execute("UPDATE jobs SET cancel_requested = 1 WHERE id = ?1", [id])?;
            }
            Step::Expire => {
                let sql = "UPDATE jobs SET expires_at = ?2 WHERE id = ?1";
                write.execute(sql, params![id, Moment::now().0])?;
            }
        }
        write.changes.jobs.push(job);
        changed.push(state);
    }
    write.changes.work |= change == Change::Retry;
    Ok(changed)
}

pub(super) fn pause(write: &Write<'_>, paused: Paused) -> Result<()> {
    let sql = "INSERT OR REPLACE INTO paused VALUES (0, ?1, ?2)";
    write.execute(sql, [paused.intake, paused.work]).map(|_| ())
}

/// Cancels an owner's job, or deletes it if it has ended.
pub(super) fn cancel(
    write: &mut Write<'_>,
    owner: &Owner,
    id: JobId,
    terms: &Terms,
) -> Result<Cancellation> {
    let sql = "SELECT state, COALESCE(expires_at <= ?3, 0) AS is_expired
               FROM jobs WHERE id = ?1 AND owner = ?2";
    let parameters = params![id.as_bytes(), owner.as_str(), Moment::now().0];
    let done = first(write.connection, sql, parameters, |row| {
        // A job in an unknown state can be deleted.
        Ok(cancellation(row::state(row).unwrap_or(State::Failed), row.flag("is_expired")?))
    })?;
    match done {
        Some(Cancellation::Cancelled) => {
            apply(write, &Transition::cancelled(id), terms.result_ttl)?;
        }
        Some(Cancellation::Requested) => {
            write.execute("UPDATE jobs SET cancel_requested = 1 WHERE id = ?1", [id.as_bytes()])?;
            write.changes.jobs.push(id);
        }
        Some(Cancellation::Deleted) => {
            write.delete(id, terms)?;
        }
        Some(Cancellation::Gone | Cancellation::Unknown) => {}
        None if is_gone(write.connection, owner, id)? => return Ok(Cancellation::Gone),
        None => {}
    }
    Ok(done.unwrap_or(Cancellation::Unknown))
}
