//! What is asked without changing anything.

use super::Node;
use super::database::Transaction;
use super::row::{self, select_record, uuid};
use crate::queue::{Lookup, Page, PageRequest, QueueError, Stats};
use crate::record::{Event, JobId, State};
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use sqlx::Row;
use std::collections::HashSet;
use uuid::Uuid;

impl Node {
    /// An owner's job.
    pub(super) async fn get(&self, owner: &Owner, id: JobId) -> Result<Lookup, QueueError> {
        let read = || async {
            let mut reading = self.database.reading().await?;
            let found = reading
                .query(select_record!(
                    ", COALESCE(expires_at <= now(), false) AS is_over FROM jobs
                 WHERE id = $1 AND owner = $2"
                ))
                .bind(uuid(id))
                .bind(owner.as_str())
                .fetch_optional(&mut *reading)
                .await?;
            let lookup = match &found {
                None if is_gone(&mut reading, owner, id).await? => Ok(Lookup::Gone),
                None => Ok(Lookup::Unknown),
                Some(found) if found.try_get("is_over")? => Ok(Lookup::Gone),
                Some(found) => row::record(found).map(|record| Lookup::Found(Box::new(record))),
            };
            reading.commit().await?;
            lookup
        };
        self.database.retry(read).await
    }

    /// An owner's jobs, newest first; what cannot be read is left out.
    pub(super) async fn list(
        &self,
        owner: &Owner,
        request: PageRequest,
    ) -> Result<Page, QueueError> {
        let PageRequest { state, before, limit } = request;
        let states: Vec<i16> = match state {
            Some(state) => vec![state as i16],
            None => State::ALL.iter().map(|state| *state as i16).collect(),
        };
        let read = || async {
            let mut reading = self.database.reading().await?;
            // The index has the jobs of an owner in one state in their order: five short lists are
            // merged, whatever there is in them.
            let rows = reading
                .query(
                    "SELECT job.* FROM unnest($1::smallint[]) AS asked (state), LATERAL (
                     SELECT * FROM jobs WHERE state = asked.state AND owner = $2 AND id < $3
                       AND (expires_at IS NULL OR expires_at > now())
                     ORDER BY id DESC LIMIT $4) AS job
                 ORDER BY id DESC LIMIT $4",
                )
                .bind(&states)
                .bind(owner.as_str())
                .bind(before.map_or(Uuid::max(), uuid))
                .bind(limit as i64 + 1)
                .fetch_all(&mut *reading)
                .await?;
            reading.commit().await?;
            Ok(rows)
        };
        let rows = self.database.retry(read).await?;
        let (mut jobs, mut last) = (Vec::new(), None);
        for found in rows.iter().take(limit) {
            last = row::id(found).ok();
            match row::record(found) {
                Ok(record) => jobs.push(record),
                Err(error) => tracing::error!(job = ?last, %error, "a job's record cannot be read"),
            }
        }
        Ok(Page { jobs, next: last.filter(|_| rows.len() > limit) })
    }

    /// What happened to a job after a revision, and whether more may come.
    pub(super) async fn events(
        &self,
        owner: &Owner,
        id: JobId,
        after: u64,
    ) -> Result<(Vec<Event>, bool), QueueError> {
        let read = || async {
            let mut reading = self.database.reading().await?;
            let found = reading.query(
                "SELECT state, attempt, revision, history, stage, fraction, progress_at FROM jobs
                 WHERE id = $1 AND owner = $2",
            )
            .bind(uuid(id))
            .bind(owner.as_str())
            .fetch_optional(&mut *reading)
            .await?;
            reading.commit().await?;
            let Some(found) = found else { return Ok((Vec::new(), false)) };
            Ok((row::events(&found, after)?, !row::state(&found)?.is_final()))
        };
        self.database.retry(read).await
    }

    /// How much there is of what.
    pub(super) async fn stats(&self) -> Result<Stats, QueueError> {
        let read = || async {
            let mut reading = self.database.reading().await?;
            let (queued, running, oldest): (i64, i64, Option<f64>) = reading
                .query_as(
                    "SELECT SUM(queued)::bigint, SUM(running)::bigint,
                        (SELECT extract(epoch FROM clock_timestamp() - min(created_at))
                         FROM jobs WHERE state = 0)::double precision FROM job_counts",
                )
                .fetch_one(&mut *reading)
                .await?;
            reading.commit().await?;
            let count = |number: i64| usize::try_from(number).unwrap_or_default();
            let oldest_queued_s = oldest.unwrap_or_default().max(0.0);
            Ok(Stats { queued: count(queued), running: count(running), oldest_queued_s })
        };
        self.database.retry(read).await
    }

    /// Those of the blobs that a job has.
    pub(super) async fn referenced(&self, blobs: &[Digest]) -> Result<HashSet<Digest>, QueueError> {
        let asked: Vec<&[u8]> = blobs.iter().map(|blob| blob.as_bytes().as_slice()).collect();
        let read = || async {
            let mut reading = self.database.reading().await?;
            let rows = reading
                .query(
                    "SELECT blob FROM unnest($1::bytea[]) AS asked (blob)
                 WHERE EXISTS (SELECT 1 FROM jobs WHERE state < 2 AND image_digest = blob)
                    OR EXISTS (SELECT 1 FROM jobs WHERE mesh_digest = blob)",
                )
                .bind(&asked)
                .fetch_all(&mut *reading)
                .await?;
            reading.commit().await?;
            rows.iter().map(|row| row::digest(row, "blob")).collect()
        };
        self.database.retry(read).await
    }
}

/// Whether an owner had a job that is no longer kept.
pub(super) async fn is_gone(
    transaction: &mut Transaction,
    owner: &Owner,
    id: JobId,
) -> sqlx::Result<bool> {
    transaction
        .query_scalar("SELECT EXISTS (SELECT 1 FROM gone WHERE id = $1 AND owner = $2)")
        .bind(uuid(id))
        .bind(owner.as_str())
        .fetch_one(&mut **transaction)
        .await
}
