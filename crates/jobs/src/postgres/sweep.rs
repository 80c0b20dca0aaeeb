//! What time brings: workers that fell silent, jobs that are no longer kept. All nodes sweep, and pass
//! over what another has under way.

use super::Node;
use super::finish::{Transition, apply};
use super::row::{self, ms, number};
use crate::embedded::watchers::Changes;
use crate::queue::{MAX_ATTEMPTS, Outcome, QueueError, Swept};
use crate::record::{self, JobId, State};
use pixmesh_engine::digest::Digest;
use sqlx::Row;
use std::time::Duration;
use tokio::time::Instant;

/// The most rows that one transaction changes, so that it is short.
const MOST_ROWS: i64 = 2000;
/// The most blobs that one sweep names.
const MOST_BLOBS: i64 = 256;
/// How long a sweep goes on with what is due; the rest is left to the next.
const SWEEPING: Duration = Duration::from_secs(4);

/// Forgets that jobs were, once that has been remembered long enough.
const FORGET_GONE: &str = "
    DELETE FROM gone WHERE id = ANY (ARRAY(
        SELECT id FROM gone WHERE until <= now() LIMIT $1 FOR UPDATE SKIP LOCKED))";
/// Leaves out of the blobs that were given up those that a job has: they are given up again later.
const KEEP_REFERENCED: &str = "
    DELETE FROM given_up WHERE blob = ANY (ARRAY(
        SELECT blob FROM (SELECT blob FROM given_up ORDER BY since LIMIT $1
                          FOR UPDATE SKIP LOCKED) AS oldest
        WHERE EXISTS (SELECT 1 FROM jobs WHERE state < 2 AND image_digest = blob)
           OR EXISTS (SELECT 1 FROM jobs WHERE mesh_digest = blob)))";

impl Node {
    /// Does what is due.
    pub(super) async fn sweep(&self) -> Result<Swept, QueueError> {
        let (mut swept, until) = (Swept::default(), Instant::now() + SWEEPING);
        loop {
            let taken = self.database.retry(|| self.take_back()).await?;
            let of = |wanted| taken.iter().filter(|(_, state)| *state == wanted).count();
            swept.requeued += of(State::Queued);
            swept.exhausted += of(State::Failed);
            let (jobs, work) = (taken.iter().map(|(id, _)| *id).collect(), !taken.is_empty());
            self.notifications.send(Changes { jobs, work });
            if (taken.len() as i64) < MOST_ROWS || Instant::now() >= until {
                break;
            }
        }
        loop {
            let expired = self.database.retry(|| self.expire()).await?;
            swept.expired += expired as usize;
            if (expired as i64) < MOST_ROWS || Instant::now() >= until {
                break;
            }
        }
        for sql in [FORGET_GONE, KEEP_REFERENCED] {
            while self.database.retry(|| self.delete(sql)).await? as i64 >= MOST_ROWS
                && Instant::now() < until
            {}
        }
        swept.given_up = self.database.retry(|| self.given_up()).await?;
        Ok(swept)
    }

    /// Takes jobs from workers that fell silent.
    async fn take_back(&self) -> sqlx::Result<Vec<(JobId, State)>> {
        let mut transaction = self.database.begin().await?;
        let rows = transaction.query(
            "SELECT id, attempt, cancel_requested FROM jobs WHERE state = 1 AND lease_end <= now()
             ORDER BY owner, id LIMIT $1 FOR UPDATE SKIP LOCKED",
        )
        .bind(MOST_ROWS)
        .fetch_all(&mut *transaction)
        .await?;
        let silent = |row| {
            // A job whose attempts cannot be counted gets no further one.
            let attempt = number::<i32, _>(row, "attempt").unwrap_or(MAX_ATTEMPTS);
            let outcome = Outcome::Retry(record::exhausted(attempt));
            Ok((row::id(row)?, attempt, row.try_get("cancel_requested")?, outcome))
        };
        let silent: Vec<_> = rows.iter().map(silent).collect::<sqlx::Result<_>>()?;
        let settled: Vec<_> = silent
            .iter()
            .map(|(id, attempt, cancelled, outcome)| {
                Transition::after(*id, *attempt, *cancelled, outcome)
            })
            .collect();
        apply(&mut transaction, &settled, self.terms.result_ttl).await?;
        transaction.commit().await?;
        Ok(settled.iter().map(|job| (job.id, job.next)).collect())
    }

    /// Keeps of jobs past their time nothing but that they were.
    async fn expire(&self) -> sqlx::Result<u64> {
        let mut transaction = self.database.begin().await?;
        let (expired,): (i64,) = transaction
            .query_as(
                "WITH ended AS (
                 DELETE FROM jobs WHERE id = ANY (ARRAY(
                     SELECT id FROM jobs WHERE expires_at <= now() ORDER BY expires_at LIMIT $1
                     FOR UPDATE SKIP LOCKED))
                 RETURNING id, owner, mesh_digest, expires_at),
             remembered AS (
                 INSERT INTO gone SELECT id, owner, expires_at + $2 * interval '1 millisecond'
                 FROM ended ON CONFLICT DO NOTHING),
             freed AS (
                 INSERT INTO given_up SELECT DISTINCT mesh_digest, now() FROM ended
                 WHERE mesh_digest IS NOT NULL ORDER BY mesh_digest ON CONFLICT DO NOTHING)
             SELECT count(*) FROM ended",
            )
            .bind(MOST_ROWS)
            .bind(ms(self.terms.gone_ttl))
            .fetch_one(&mut *transaction)
            .await?;
        transaction.commit().await?;
        Ok(expired.unsigned_abs())
    }

    async fn delete(&self, sql: &'static str) -> sqlx::Result<u64> {
        let mut transaction = self.database.begin().await?;
        let done = transaction.query(sql).bind(MOST_ROWS).execute(&mut *transaction).await?;
        transaction.commit().await?;
        Ok(done.rows_affected())
    }

    /// The blobs that were given up first, and that no job has. A write at each sweep tells whether the
    /// storage takes any.
    async fn given_up(&self) -> sqlx::Result<Vec<Digest>> {
        let mut transaction = self.database.begin().await?;
        transaction
            .query(
                "INSERT INTO shared_values VALUES ('pulse', 0, now())
             ON CONFLICT (name) DO UPDATE SET at = excluded.at",
            )
            .execute(&mut *transaction)
            .await?;
        let rows = transaction
            .query(
                "SELECT blob FROM given_up
             WHERE NOT EXISTS (SELECT 1 FROM jobs WHERE state < 2 AND image_digest = blob)
               AND NOT EXISTS (SELECT 1 FROM jobs WHERE mesh_digest = blob)
             ORDER BY since LIMIT $1",
            )
            .bind(MOST_BLOBS)
            .fetch_all(&mut *transaction)
            .await?;
        transaction.commit().await?;
        rows.iter().map(|row| row::digest(row, "blob")).collect()
    }

    /// Blobs that were given up are seen to.
    pub(super) async fn forget(&self, blobs: &[Digest]) -> Result<(), QueueError> {
        let blobs: Vec<&[u8]> = blobs.iter().map(|blob| blob.as_bytes().as_slice()).collect();
        let forget = || async {
            let mut transaction = self.database.begin().await?;
            transaction
                .query("DELETE FROM given_up WHERE blob = ANY ($1)")
                .bind(&blobs)
                .execute(&mut *transaction)
                .await?;
            transaction.commit().await
        };
        self.database.retry(forget).await
    }

    /// Tells other nodes how long jobs take here, where that is news, and returns what was told last.
    pub(super) async fn share_mean(&self, own_s: Option<f64>) -> Result<Option<f64>, QueueError> {
        let sent_mean_s =
            || self.sent_mean_s.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let news = own_s.filter(|own_s| *sent_mean_s() != Some(*own_s));
        let share = || async {
            let mut transaction = self.database.begin().await?;
            if let Some(mean_s) = news {
                transaction
                    .query(
                        "INSERT INTO shared_values VALUES ('mean', $1, now())
                     ON CONFLICT (name) DO UPDATE SET value = excluded.value, at = excluded.at",
                    )
                    .bind(mean_s)
                    .execute(&mut *transaction)
                    .await?;
            }
            let last = transaction
                .query_scalar("SELECT value FROM shared_values WHERE name = 'mean'")
                .fetch_optional(&mut *transaction)
                .await?;
            transaction.commit().await?;
            Ok(last)
        };
        let last = self.database.retry(share).await?;
        if news.is_some() {
            *sent_mean_s() = news;
        }
        Ok(last)
    }
}
