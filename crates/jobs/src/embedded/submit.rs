//! Jobs are submitted.

use super::rows::first;
use super::writer::Write;
use crate::queue::{Submitted, Terms};
use crate::record::{Moment, NewJob, Record};
use crate::row::{self, Row as _, select_record};
use rusqlite::{Result, params};

pub(super) fn submit(write: &mut Write<'_>, job: &NewJob, terms: &Terms) -> Result<Submitted> {
    let refused = match submitted_before(write, job, terms)? {
        None => beyond_caps(write, job, terms)?,
        before => before,
    };
    if let Some(refused) = refused {
        // The picture was stored in vain.
        write.mark_orphan_candidate(job.picture.digest)?;
        return Ok(refused);
    }
    let created = Moment::now();
    let fingerprint = job.idempotency_key.as_ref().map(|_| job.fingerprint().to_string());
    write.execute(
        "INSERT INTO jobs (id, owner, state, attempt, fence, cancel_requested, idempotency_key,
                           fingerprint, options, image_digest, image_bytes, image_shape, created_at,
                           revision, history)
         VALUES (?1, ?2, 0, 0, 0, 0, ?3, ?4, ?5, ?6, ?7, ?8, ?9, 1, format('1 %d 0 0', ?9))",
        params![
            job.id.as_bytes(),
            job.owner.as_str(),
            job.idempotency_key,
            fingerprint,
            job.options,
            job.picture.digest.to_string(),
            job.picture.bytes,
            job.picture.shape_column(),
            created.0
        ],
    )?;
    write.changes.work = true;
    Ok(Submitted::Created(Record::queued(job, created)))
}

/// The result of a job whose idempotency key is known.
fn submitted_before(write: &Write<'_>, job: &NewJob, terms: &Terms) -> Result<Option<Submitted>> {
    let Some(key) = &job.idempotency_key else { return Ok(None) };
    let (owner, now) = (job.owner.as_str(), Moment::now());
    write.execute(
        "UPDATE jobs SET idempotency_key = NULL
         WHERE owner = ?1 AND idempotency_key = ?2 AND created_at <= ?3",
        params![owner, key, now.before(terms.idempotency_ttl).0],
    )?;
    let sql = select_record!(
        ", fingerprint, COALESCE(expires_at <= ?3, 0) AS is_expired
         FROM jobs WHERE owner = ?1 AND idempotency_key = ?2"
    );
    let known = first(write.connection, sql, params![owner, key, now.0], |row| {
        if row.flag("is_expired")? {
            return Ok(Submitted::KeyOfGone);
        }
        Ok(Submitted::again(job, row::record(row)?, row.digest("fingerprint")?))
    })?;
    if known.is_some() {
        return Ok(known);
    }
    let sql = "SELECT 1 FROM kept_keys WHERE owner = ?1 AND idempotency_key = ?2 AND until > ?3";
    first(write.connection, sql, params![owner, key, now.0], |_| Ok(Submitted::KeyOfGone))
}

fn beyond_caps(write: &Write<'_>, job: &NewJob, terms: &Terms) -> Result<Option<Submitted>> {
    let sql = "SELECT (SELECT count(*) FROM jobs WHERE state = 0),
                      (SELECT count(*) FROM jobs WHERE state = 0 AND owner = ?1)";
    let refusal = first(write.connection, sql, [job.owner.as_str()], |row| {
        Ok(terms.caps.refusal(row.get(0)?, &job.owner, row.get(1)?))
    });
    refusal.map(Option::flatten)
}
