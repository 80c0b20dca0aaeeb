//! A job comes in.

use super::writer::Write;
use super::{finish, read};
use crate::queue::{Submitted, Terms};
use crate::record::{JobId, Moment, NewJob, State};
use pixmesh_engine::digest::Digest;
use rusqlite::{OptionalExtension, Result, params};

/// Puts a job among those that wait, unless there is a reason not to.
pub(super) fn submit(write: &mut Write<'_>, job: &NewJob, terms: &Terms) -> Result<Submitted> {
    let submitted = match earlier(write, job)? {
        Some(submitted) => submitted,
        None => match full(write, job, terms)? {
            Some(submitted) => submitted,
            None => create(write, job, terms)?,
        },
    };
    if !matches!(submitted, Submitted::Created(_)) {
        // Its blob was stored before, for nothing.
        finish::give_up(write, job.picture.digest)?;
    }
    Ok(submitted)
}

/// What the same word was given for before.
fn earlier(write: &Write<'_>, job: &NewJob) -> Result<Option<Submitted>> {
    let Some(word) = &job.idempotency_key else { return Ok(None) };
    let found = write
        .connection
        .prepare_cached(
            "SELECT fingerprint, job FROM idempotency
             WHERE owner = ?1 AND word = ?2 AND until_ms > ?3",
        )?
        .query_row(params![job.owner.as_str(), word, Moment::now().0], |row| {
            Ok((row.get::<_, String>(0)?, JobId::from_bytes(row.get(1)?)))
        })
        .optional()?;
    let Some((fingerprint, id)) = found else { return Ok(None) };
    if fingerprint.parse::<Digest>() != Ok(job.fingerprint()) {
        return Ok(Some(Submitted::KeyReused));
    }
    Ok(read::kept(write.connection, id)?.map(Submitted::Existing))
}

/// Why there is no room for another job.
fn full(write: &Write<'_>, job: &NewJob, terms: &Terms) -> Result<Option<Submitted>> {
    let count = |sql: &str, owner: Option<&str>| {
        write
            .connection
            .prepare_cached(sql)?
            .query_row(rusqlite::params_from_iter(owner), |row| row.get::<_, usize>(0))
    };
    let caps = terms.caps;
    if count("SELECT COUNT(*) FROM jobs WHERE state < 2 AND state = 0", None)? >= caps.queued {
        return Ok(Some(Submitted::QueueFull { limit: caps.queued }));
    }
    let owned = "SELECT COUNT(*) FROM jobs WHERE state < 2 AND state = 0 AND owner = ?1";
    let limit = caps.queued_of(&job.owner);
    if count(owned, Some(job.owner.as_str()))? >= limit {
        return Ok(Some(Submitted::OwnerFull { limit }));
    }
    Ok(None)
}

fn create(write: &mut Write<'_>, job: &NewJob, terms: &Terms) -> Result<Submitted> {
    let NewJob { id, owner, order, picture, .. } = job;
    let shape = serde_json::to_string(&picture.shape).unwrap_or_default();
    let now = Moment::now().0;
    write
        .connection
        .prepare_cached(
            "INSERT INTO jobs (id, owner, state, order_query, image_digest, image_bytes,
                               image_shape, created_ms, revision)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, 0)",
        )?
        .execute(params![
            id.as_bytes(),
            owner.as_str(),
            State::Queued as usize,
            order,
            picture.digest.to_string(),
            picture.bytes,
            shape,
            now
        ])?;
    finish::tell(write, *id, None)?;
    if let Some(word) = &job.idempotency_key {
        let until = now.saturating_add(terms.idempotency_ttl.as_millis() as i64);
        write
            .connection
            .prepare_cached("INSERT OR REPLACE INTO idempotency VALUES (?1, ?2, ?3, ?4, ?5)")?
            .execute(params![
                owner.as_str(),
                word,
                job.fingerprint().to_string(),
                id.as_bytes(),
                until
            ])?;
    }
    write.changes.work = true;
    let record = read::kept(write.connection, *id)?;
    record.map(Submitted::Created).ok_or(rusqlite::Error::QueryReturnedNoRows)
}
