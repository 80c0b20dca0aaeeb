//! Periodic maintenance: leases that expired, jobs that expired, blobs that no job uses. All nodes
//! sweep, and skip the rows that another node has locked.

use super::database::failure;
use super::finish::apply;
use super::node::Node;
use super::rows::{bytes, ms};
use crate::queue::{DELETION_TIME, QueueError, Swept, Terms};
use crate::record::{JobId, State};
use crate::row::{self, Row as _};
use crate::telemetry;
use crate::transition::Transition;
use crate::watchers::Changes;
use pixmesh_engine::digest::Digest;
use sqlx::Row;
use std::sync::PoisonError;
use std::time::Duration;
use tokio::time::Instant;

/// The most rows that one transaction changes, so that it is short.
const MAX_ROWS: i64 = 2000;
/// The most blobs that one sweep takes, so that it deletes them in less than [`DELETION_TIME`].
const MAX_ORPHANS: i64 = 256;
/// How long a sweep may take. The next sweep does the rest.
const SWEEP_TIME: Duration = Duration::from_secs(4);

/// Deletes expired jobs and remembers their ids. A failed job has its picture, a completed one its mesh.
const EXPIRE: &str = "
    WITH expired AS (
        DELETE FROM jobs WHERE id = ANY (ARRAY(
            SELECT id FROM jobs WHERE expires_at <= now() ORDER BY expires_at LIMIT $1
            FOR UPDATE SKIP LOCKED))
        RETURNING id, owner, CASE state WHEN 3 THEN image_digest ELSE mesh_digest END AS blob,
                  expires_at, created_at, idempotency_key),
    kept AS (
        INSERT INTO kept_keys
        SELECT owner, idempotency_key, created_at + $4 * interval '1 millisecond' FROM expired
        WHERE idempotency_key IS NOT NULL ORDER BY owner, idempotency_key
        ON CONFLICT (owner, idempotency_key) DO UPDATE SET until = excluded.until),
    remembered AS (
        INSERT INTO gone SELECT id, owner, expires_at + $2 * interval '1 millisecond'
        FROM expired ON CONFLICT DO NOTHING),
    released AS (
        INSERT INTO orphan_candidates (blob, eligible_at)
        SELECT DISTINCT blob, now() + $3 * interval '1 millisecond' FROM expired
        WHERE blob IS NOT NULL ORDER BY blob ON CONFLICT DO NOTHING)
    SELECT count(*) FROM expired";
/// Deletes the ids of jobs that expired long ago.
const FORGET_GONE: &str = "
    WITH forgotten AS (
        DELETE FROM gone WHERE id = ANY (ARRAY(
            SELECT id FROM gone WHERE until <= now() LIMIT $1 FOR UPDATE SKIP LOCKED))
        RETURNING 1)
    SELECT count(*) FROM forgotten";
/// Deletes the idempotency keys of jobs that were submitted long ago.
const FORGET_KEYS: &str = "
    WITH forgotten AS (
        DELETE FROM kept_keys WHERE (owner, idempotency_key) IN (
            SELECT owner, idempotency_key FROM kept_keys WHERE until <= now() LIMIT $1
            FOR UPDATE SKIP LOCKED)
        RETURNING 1)
    SELECT count(*) FROM forgotten";
/// Removes candidates that a job uses. The job marks them again when it releases them.
const UNMARK_REFERENCED: &str = "
    WITH unmarked AS (
        DELETE FROM orphan_candidates WHERE blob = ANY (ARRAY(
            SELECT blob FROM (SELECT blob FROM orphan_candidates ORDER BY eligible_at LIMIT $1
                              FOR UPDATE SKIP LOCKED) AS oldest
            WHERE EXISTS (SELECT 1 FROM jobs WHERE state IN (0, 1, 3) AND image_digest = blob)
               OR EXISTS (SELECT 1 FROM jobs WHERE mesh_digest = blob)))
        RETURNING 1)
    SELECT count(*) FROM unmarked";

impl Node {
    pub(super) async fn sweep(&self) -> Result<Swept, QueueError> {
        let (mut swept, until) = (Swept::default(), Instant::now() + SWEEP_TIME);
        loop {
            let ended = self.database.retry(|| self.end_expired_leases()).await?;
            let count = |wanted| ended.iter().filter(|(_, state)| *state == wanted).count();
            swept.requeued += count(State::Queued);
            swept.exhausted += count(State::Failed);
            let (jobs, work) = (ended.iter().map(|(id, _)| *id).collect(), !ended.is_empty());
            self.notifications.send(Changes { jobs, work });
            if (ended.len() as i64) < MAX_ROWS || Instant::now() >= until {
                break;
            }
        }
        let Terms { gone_ttl, unused_blob_ttl, idempotency_ttl, .. } = self.terms;
        let ttls = [gone_ttl, unused_blob_ttl, idempotency_ttl].map(ms);
        swept.expired = self.repeat(EXPIRE, &ttls, until).await?;
        self.repeat(FORGET_GONE, &[], until).await?;
        self.repeat(FORGET_KEYS, &[], until).await?;
        self.repeat(UNMARK_REFERENCED, &[], until).await?;
        let (began, (used, limit)) = (Instant::now(), self.database.connections());
        swept.orphans = self.orphans().await?;
        let commit = began.elapsed();
        // Some databases have no such view, and no standby of this kind.
        let lag_s = self.replication_lag_s().await.ok().flatten();
        telemetry::database(used, limit, commit, lag_s.unwrap_or_default());
        Ok(swept)
    }

    /// How far the slowest standby is behind; `None` without a standby, or without the right to
    /// read it.
    async fn replication_lag_s(&self) -> sqlx::Result<Option<f64>> {
        let mut connection = self.database.reading().await?;
        // The lag is NULL when the standby has caught up, the state is without the right.
        let sql = "SELECT max(extract(epoch FROM COALESCE(replay_lag, interval '0')))::float8
                   FROM pg_stat_replication WHERE state IS NOT NULL";
        let (lag_s,) = connection.query_as(sql).fetch_one(&mut *connection).await?;
        connection.commit().await?;
        Ok(lag_s)
    }

    async fn end_expired_leases(&self) -> sqlx::Result<Vec<(JobId, State)>> {
        let mut transaction = self.database.begin().await?;
        let rows = transaction
            .query(
                "SELECT id, state, fence, attempt, cancel_requested FROM jobs
                 WHERE state = 1 AND lease_end <= now()
                 ORDER BY owner, id LIMIT $1 FOR UPDATE SKIP LOCKED",
            )
            .bind(MAX_ROWS)
            .fetch_all(&mut *transaction)
            .await?;
        let mut transitions = Vec::new();
        for row in &rows {
            let job = row.id()?;
            transitions.push(match row::status(row) {
                Ok(status) => status.lease_expired(job),
                Err(_) => Transition::damaged(job, State::Running),
            });
        }
        apply(&mut transaction, &transitions, &self.terms).await?;
        transaction.commit().await?;
        Ok(transitions.iter().map(|transition| (transition.job, transition.to)).collect())
    }

    /// Executes a statement that changes at most `MAX_ROWS` rows and counts them, until it changes
    /// fewer or the time is over; returns how many rows were changed.
    async fn repeat(
        &self,
        sql: &'static str,
        parameters: &[i64],
        until: Instant,
    ) -> Result<usize, QueueError> {
        let mut sum = 0;
        loop {
            let statement = || {
                let statement = sqlx::query(sql).bind(MAX_ROWS);
                parameters.iter().fold(statement, |statement, parameter| statement.bind(parameter))
            };
            let rows = self.database.execute(statement).await?;
            let count = rows.first().map_or(Ok(0), |row| row.try_get::<i64, _>(0));
            let count = count.map_err(|error| failure(&error))?;
            sum += count as usize;
            if count < MAX_ROWS || Instant::now() >= until {
                return Ok(sum);
            }
        }
    }

    /// Takes blobs that no job uses, to delete them. The write shows whether the database takes
    /// writes.
    ///
    /// No blob is deleted that a node stores for a new job. The node marks it before, in
    /// [`Node::expect`]. If the mark comes first, the blob becomes eligible no earlier than
    /// `unused_blob_ttl` later, even if a sweep removes the mark because another job uses the blob:
    /// that job marks it again when it ends. If the sweep comes first, the node waits until the
    /// blob is deleted.
    async fn orphans(&self) -> Result<Vec<Digest>, QueueError> {
        let statement = || {
            sqlx::query(
                "WITH pulse AS (
                     INSERT INTO shared_values VALUES ('pulse', 0, now())
                     ON CONFLICT (name) DO UPDATE SET at = excluded.at)
                 UPDATE orphan_candidates
                 SET deleting = true, eligible_at = now() + $2 * interval '1 millisecond'
                 WHERE blob = ANY (ARRAY(
                     SELECT blob FROM orphan_candidates
                     WHERE eligible_at <= now()
                       AND NOT EXISTS (SELECT 1 FROM jobs
                                       WHERE state IN (0, 1, 3) AND image_digest = blob)
                       AND NOT EXISTS (SELECT 1 FROM jobs WHERE mesh_digest = blob)
                     ORDER BY eligible_at LIMIT $1 FOR UPDATE SKIP LOCKED))
                 RETURNING blob",
            )
            .bind(MAX_ORPHANS)
            .bind(ms(DELETION_TIME * 2))
        };
        let rows = self.database.execute(statement).await?;
        let blobs = rows.iter().filter_map(|row| row.digest("blob").transpose());
        blobs.collect::<sqlx::Result<_>>().map_err(|error| failure(&error))
    }

    pub(super) async fn forget(&self, blobs: &[Digest]) -> Result<(), QueueError> {
        let sql = "DELETE FROM orphan_candidates WHERE blob = ANY ($1) AND deleting";
        let statement = || sqlx::query(sql).bind(bytes(blobs));
        self.database.execute(statement).await.map(|_| ())
    }

    /// Shares this node's mean duration with other nodes if it has changed, and returns the mean
    /// that a node shared last.
    pub(super) async fn share_mean(&self, own_s: Option<f64>) -> Result<Option<f64>, QueueError> {
        let shared = || self.shared_mean_s.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own_s) = own_s.filter(|own_s| *shared() != Some(*own_s)) {
            let statement = || {
                sqlx::query(
                    "INSERT INTO shared_values VALUES ('mean', $1, now())
                     ON CONFLICT (name) DO UPDATE SET value = excluded.value, at = excluded.at",
                )
                .bind(own_s)
            };
            self.database.execute(statement).await?;
            *shared() = Some(own_s);
        }
        let statement = || sqlx::query("SELECT value FROM shared_values WHERE name = 'mean'");
        let rows = self.database.execute(statement).await?;
        let mean_s = rows.first().map(|row| row.try_get(0)).transpose();
        mean_s.map_err(|error| failure(&error))
    }
}
