//! Queries that change nothing.

use super::database::{Transaction, failure};
use super::node::Node;
use super::rows::{bytes, uuid};
use crate::queue::{Lease, Lookup, Page, PageRequest, Paused, QueueError, Renewal, Search, Stats};
use crate::record::{Event, JobId, State};
use crate::row::{self, Row as _, select_record};
use crate::transition::Status;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use sqlx::postgres::PgRow;
use sqlx::{AssertSqlSafe, Row};
use std::collections::HashSet;
use uuid::Uuid;

impl Node {
    pub(super) async fn get(&self, owner: &Owner, id: JobId) -> Result<Lookup, QueueError> {
        let read = || async {
            let mut reading = self.database.reading().await?;
            let found = reading
                .query(select_record!(
                    ", COALESCE(expires_at <= now(), false) AS is_expired
                     FROM jobs WHERE id = $1 AND owner = $2"
                ))
                .bind(uuid(id))
                .bind(owner.as_str())
                .fetch_optional(&mut *reading)
                .await?;
            let lookup = match &found {
                None if is_gone(&mut reading, owner, id).await? => Ok(Lookup::Gone),
                None => Ok(Lookup::Unknown),
                Some(found) if found.try_get("is_expired")? => Ok(Lookup::Gone),
                Some(found) => row::record(found).map(|record| Lookup::Found(Box::new(record))),
            };
            reading.commit().await?;
            lookup
        };
        self.database.retry(read).await
    }

    pub(super) async fn list(
        &self,
        owner: &Owner,
        request: PageRequest,
    ) -> Result<Page, QueueError> {
        let PageRequest { state, before, limit } = request;
        let states = state.as_ref().map_or(&State::ALL[..], std::slice::from_ref);
        let states: Vec<i16> = states.iter().map(|state| *state as i16).collect();
        // The index has the jobs of an owner in one state in their order: the page is merged from
        // one short list for each state.
        let statement = || {
            sqlx::query(
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
        };
        page(&self.database.execute(statement).await?, limit)
    }

    pub(super) async fn search(&self, search: &Search, limit: usize) -> Result<Page, QueueError> {
        let (owner, state, problem) = search.indexed();
        // As in a list. Only failed jobs have problems.
        let state = problem.map(|_| State::Failed).or(state);
        let states = state.as_ref().map_or(&State::ALL[..], std::slice::from_ref);
        let states: Vec<i16> = states.iter().map(|state| *state as i16).collect();
        let equals = |column, number, is_given| match is_given {
            true => format!("{column} = ${number}"),
            false => format!("${number}::text IS NULL"),
        };
        let sql = format!(
            "SELECT job.* FROM unnest($1::smallint[]) AS asked (state), LATERAL (
                 SELECT * FROM jobs WHERE state = asked.state AND {} AND {}
                   AND id >= $4 AND id < $5 ORDER BY id DESC LIMIT $6) AS job
             ORDER BY id DESC LIMIT $6",
            equals("owner", 2, owner.is_some()),
            equals("problem_type", 3, problem.is_some())
        );
        let [from, before] = search.ids().map(uuid);
        let statement = || {
            sqlx::query(AssertSqlSafe(sql.as_str()))
                .bind(&states)
                .bind(owner)
                .bind(problem)
                .bind(from)
                .bind(before)
                .bind(limit as i64 + 1)
        };
        page(&self.database.execute(statement).await?, limit)
    }

    pub(super) async fn paused(&self) -> Result<Paused, QueueError> {
        let rows = self.database.execute(|| sqlx::query("SELECT intake, work FROM paused")).await?;
        let paused = |row: &PgRow| {
            sqlx::Result::Ok(Paused { intake: row.flag("intake")?, work: row.flag("work")? })
        };
        let paused = rows.first().map(paused).transpose().map_err(|error| failure(&error))?;
        Ok(paused.unwrap_or_default())
    }

    pub(super) async fn events(
        &self,
        owner: &Owner,
        id: JobId,
        after: u64,
    ) -> Result<(Vec<Event>, bool), QueueError> {
        let statement = || {
            sqlx::query(
                "SELECT state, attempt, revision, history, progress, progress_at FROM jobs
                 WHERE id = $1 AND owner = $2",
            )
            .bind(uuid(id))
            .bind(owner.as_str())
        };
        let rows = self.database.execute(statement).await?;
        let Some(found) = rows.first() else { return Ok((Vec::new(), false)) };
        let events = |found| Ok((row::events(found, after)?, !row::state(found)?.is_final()));
        events(found).map_err(|error: sqlx::Error| failure(&error))
    }

    pub(super) async fn standing(&self, lease: Lease) -> Result<Renewal, QueueError> {
        let statement = || {
            sqlx::query("SELECT state, fence, attempt, cancel_requested FROM jobs WHERE id = $1")
                .bind(uuid(lease.job))
        };
        let rows = self.database.execute(statement).await?;
        let status = rows.first().map(row::status).transpose().map_err(|error| failure(&error))?;
        let standing = Status::renewal(status, lease);
        if standing == Renewal::Lost {
            self.leases.remove(lease);
        }
        Ok(standing)
    }

    pub(super) async fn stats(&self) -> Result<Stats, QueueError> {
        let statement = || {
            sqlx::query(
                "SELECT SUM(queued)::bigint AS queued, SUM(running)::bigint AS running,
                        (SELECT extract(epoch FROM clock_timestamp() - min(created_at))
                         FROM jobs WHERE state = 0)::double precision AS oldest_s FROM job_counts",
            )
        };
        let rows = self.database.execute(statement).await?;
        let stats = |row: &PgRow| {
            let count = |number: i64| usize::try_from(number).unwrap_or_default();
            Ok(Stats {
                queued: count(row.try_get("queued")?),
                running: count(row.try_get("running")?),
                oldest_queued_s: row.try_get::<Option<f64>, _>("oldest_s")?.unwrap_or(0.0).max(0.0),
            })
        };
        let stats = rows.first().map(stats).transpose();
        stats.map(Option::unwrap_or_default).map_err(|error: sqlx::Error| failure(&error))
    }

    pub(super) async fn stored_bytes(&self) -> Result<Vec<(Owner, u64)>, QueueError> {
        let statement = || {
            sqlx::query(
                "SELECT owner, sum(CASE
                     WHEN state IN (0, 1, 3) THEN image_bytes
                         + coalesce((image_shape::json -> 'weights' ->> 'bytes')::bigint, 0)
                     ELSE coalesce((mesh::json ->> 'bytes')::bigint, 0)
                         + coalesce((mesh::json -> 'progression' ->> 'bytes')::bigint, 0)
                         + coalesce((mesh::json -> 'texture' ->> 'bytes')::bigint, 0)
                         + coalesce((mesh::json -> 'image' ->> 'bytes')::bigint, 0)
                 END)::bigint AS bytes FROM jobs GROUP BY owner",
            )
        };
        let rows = self.database.execute(statement).await?;
        let bytes = rows.iter().map(|row| Ok((row::owner(row)?, row::number(row, "bytes")?)));
        bytes.collect::<sqlx::Result<_>>().map_err(|error| failure(&error))
    }

    /// Which of the blobs a job uses: its picture until it is completed or cancelled, and its mesh.
    pub(super) async fn referenced(&self, blobs: &[Digest]) -> Result<HashSet<Digest>, QueueError> {
        let statement = || {
            sqlx::query(
                "SELECT blob FROM unnest($1::bytea[]) AS asked (blob)
                 WHERE EXISTS (SELECT 1 FROM jobs WHERE state IN (0, 1, 3) AND image_digest = blob)
                    OR EXISTS (SELECT 1 FROM jobs WHERE mesh_digest = blob)",
            )
            .bind(bytes(blobs))
        };
        let rows = self.database.execute(statement).await?;
        let blobs = rows.iter().filter_map(|row| row.digest("blob").transpose());
        blobs.collect::<sqlx::Result<_>>().map_err(|error| failure(&error))
    }
}

/// The page of the first `limit` rows.
fn page(rows: &[PgRow], limit: usize) -> Result<Page, QueueError> {
    let jobs = rows.iter().map(|row| Ok((row.id()?, row::record(row))));
    let jobs = jobs.collect::<sqlx::Result<_>>().map_err(|error| failure(&error))?;
    Ok(Page::of(jobs, limit))
}

/// Whether a job of an owner has expired and is deleted.
pub(super) async fn is_gone(
    transaction: &mut Transaction,
    owner: &Owner,
    id: JobId,
) -> sqlx::Result<bool> {
    let query = transaction
        .query_as("SELECT EXISTS (SELECT 1 FROM gone WHERE id = $1 AND owner = $2)")
        .bind(uuid(id))
        .bind(owner.as_str());
    query.fetch_one(&mut **transaction).await.map(|(is_gone,)| is_gone)
}
