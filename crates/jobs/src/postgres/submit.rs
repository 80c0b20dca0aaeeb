//! Jobs are submitted.

use super::database::{Transaction, failure};
use super::finish::{count_changes, mark_orphan_candidates};
use super::node::Node;
use super::rows::{bytes, ms, uuid};
use crate::queue::{QueueError, Submitted};
use crate::record::{Moment, NewJob, Record};
use crate::row::{self, Row as _, select_record};
use crate::watchers::Changes;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use sqlx::Row;
use std::collections::{BTreeSet, HashMap, HashSet};

impl Node {
    /// Submits jobs in their order.
    pub(super) async fn submit(&self, jobs: &[NewJob]) -> Result<Vec<Submitted>, QueueError> {
        let submitted = self.database.retry(|| self.try_submit(jobs)).await?;
        if submitted.iter().any(|result| matches!(result, Submitted::Created(_))) {
            self.notifications.send(Changes { jobs: Vec::new(), work: true });
        }
        Ok(submitted)
    }

    /// Marks blobs that are about to be stored for jobs that may never be submitted, and returns
    /// for each whether it may be stored now: not while a sweep deletes it.
    pub(super) async fn expect(&self, blobs: &[Digest]) -> Result<Vec<bool>, QueueError> {
        // In ascending order, so that no transactions deadlock.
        let marked: Vec<Digest> = BTreeSet::from_iter(blobs.iter().copied()).into_iter().collect();
        let statement = || {
            sqlx::query(
                "INSERT INTO orphan_candidates AS known (blob, eligible_at)
                 SELECT blob, now() + $2 * interval '1 millisecond'
                 FROM unnest($1::bytea[]) AS blobs (blob)
                 ON CONFLICT (blob)
                 DO UPDATE SET eligible_at = excluded.eligible_at, deleting = false
                 WHERE NOT known.deleting OR known.eligible_at <= now() RETURNING blob",
            )
            .bind(bytes(&marked))
            .bind(ms(self.terms.unused_blob_ttl))
        };
        let rows = self.database.execute(statement).await?;
        let free: sqlx::Result<HashSet<_>> = rows.iter().map(|row| row.digest("blob")).collect();
        let free = free.map_err(|error| failure(&error))?;
        Ok(blobs.iter().map(|&blob| free.contains(&Some(blob))).collect())
    }

    /// One transaction. It conflicts if another node has just inserted one of the idempotency keys,
    /// and its retry finds the job of that key.
    async fn try_submit(&self, jobs: &[NewJob]) -> sqlx::Result<Vec<Submitted>> {
        let mut transaction = self.database.begin().await?;
        let mut results = self.submitted_before(&mut transaction, jobs).await?;
        self.refuse_beyond_caps(&mut transaction, jobs, &mut results).await?;
        let (mut new, mut orphans, mut first_of_key) = (Vec::new(), Vec::new(), HashMap::new());
        for (job, result) in jobs.iter().zip(&results) {
            let is_first = |key| first_of_key.entry(key).or_insert(job).id == job.id;
            if result.is_none() && key_of(job).is_none_or(is_first) {
                new.push(job);
            } else {
                // The picture of a job that is not created may have been stored in vain.
                orphans.push(job.picture.digest);
            }
        }
        let created = insert(&mut transaction, &new).await?;
        mark_orphan_candidates(&mut transaction, orphans, &self.terms).await?;
        count_changes(&mut transaction, new.len() as i64, 0).await?;
        transaction.commit().await?;
        let result = |(job, result): (&NewJob, Option<Submitted>)| {
            // Jobs with a new idempotency key get the result of the first one in the batch.
            let first = *key_of(job).and_then(|key| first_of_key.get(&key)).unwrap_or(&job);
            let stored = || Record::queued(first, created);
            result.unwrap_or_else(|| Submitted::again(job, stored(), Some(first.fingerprint())))
        };
        Ok(jobs.iter().zip(results).map(result).collect())
    }

    /// The results of jobs whose idempotency keys are known.
    async fn submitted_before(
        &self,
        transaction: &mut Transaction,
        jobs: &[NewJob],
    ) -> sqlx::Result<Vec<Option<Submitted>>> {
        let (owners, keys): (Vec<&str>, Vec<&str>) =
            jobs.iter().filter_map(key_of).map(|(owner, key)| (owner.as_str(), key)).unzip();
        if keys.is_empty() {
            return Ok(vec![None; jobs.len()]);
        }
        transaction
            .query(
                "UPDATE jobs SET idempotency_key = NULL
                 FROM unnest($1::text[], $2::text[]) AS new (owner, idempotency_key)
                 WHERE jobs.owner = new.owner AND jobs.idempotency_key = new.idempotency_key
                   AND jobs.created_at <= now() - $3 * interval '1 millisecond'",
            )
            .bind(&owners)
            .bind(&keys)
            .bind(ms(self.terms.idempotency_ttl))
            .execute(&mut **transaction)
            .await?;
        let rows = transaction
            .query(select_record!(
                ", idempotency_key, fingerprint, COALESCE(expires_at <= now(), false) AS is_expired
                 FROM jobs WHERE idempotency_key IS NOT NULL
                 AND (owner, idempotency_key) IN (SELECT * FROM unnest($1::text[], $2::text[]))"
            ))
            .bind(&owners)
            .bind(&keys)
            .fetch_all(&mut **transaction)
            .await?;
        let mut known = HashMap::new();
        for row in &rows {
            let key = (row::owner(row)?, row.try_get("idempotency_key")?);
            let stored = (row::record(row)?, row.digest("fingerprint")?);
            let is_expired: bool = row.try_get("is_expired")?;
            known.insert(key, (!is_expired).then_some(stored));
        }
        let gone: Vec<(String, String)> = transaction
            .query_as(
                "SELECT owner, idempotency_key FROM kept_keys WHERE until > now()
                 AND (owner, idempotency_key) IN (SELECT * FROM unnest($1::text[], $2::text[]))",
            )
            .bind(&owners)
            .bind(&keys)
            .fetch_all(&mut **transaction)
            .await?;
        for (owner, key) in gone {
            known.entry((Owner::of_stored(&owner), key)).or_insert(None);
        }
        let result = |job: &NewJob| {
            let key: (Owner, String) = (job.owner.clone(), job.idempotency_key.clone()?);
            Some(match known.get(&key)?.clone() {
                Some((record, fingerprint)) => Submitted::again(job, record, fingerprint),
                None => Submitted::KeyOfGone,
            })
        };
        Ok(jobs.iter().map(result).collect())
    }

    /// Refuses jobs beyond the caps. The queued jobs of an owner are counted under the owner lock;
    /// those of all owners as far as they are committed.
    async fn refuse_beyond_caps(
        &self,
        transaction: &mut Transaction,
        jobs: &[NewJob],
        results: &mut [Option<Submitted>],
    ) -> sqlx::Result<()> {
        let caps = self.terms.caps;
        let is_new = |(_, result): &(&NewJob, &Option<Submitted>)| result.is_none();
        let new = jobs.iter().zip(&*results).filter(is_new).map(|(job, _)| &job.owner);
        let owners: BTreeSet<&Owner> = new.filter(|owner| owner.is_key()).collect();
        let mut of_owners = count_queued(transaction, &owners, caps.queued_per_owner).await?;
        let (mut of_all,): (i64,) = transaction
            .query_as("SELECT COALESCE(SUM(queued), 0)::bigint FROM job_counts")
            .fetch_one(&mut **transaction)
            .await?;
        for (job, result) in jobs.iter().zip(results).filter(|(_, result)| result.is_none()) {
            let of_owner = of_owners.entry(job.owner.as_str().to_owned()).or_default();
            *result = caps.refusal(of_all.max(0) as usize, &job.owner, *of_owner as usize);
            if result.is_none() {
                of_all += 1;
                *of_owner += 1;
            }
        }
        Ok(())
    }
}

/// The owner and the idempotency key of a job that has one.
fn key_of(job: &NewJob) -> Option<(&Owner, &str)> {
    Some((&job.owner, job.idempotency_key.as_deref()?))
}

/// The numbers of queued jobs of owners, each up to a limit. The owner locks are held until the end
/// of the transaction.
async fn count_queued(
    transaction: &mut Transaction,
    owners: &BTreeSet<&Owner>,
    limit: usize,
) -> sqlx::Result<HashMap<String, i64>> {
    if owners.is_empty() {
        return Ok(HashMap::new());
    }
    let owners: Vec<&str> = owners.iter().map(|owner| owner.as_str()).collect();
    for sql in [
        "INSERT INTO owner_locks
         SELECT owner, purpose FROM unnest($1::text[]) AS owners (owner),
                                    (VALUES (0), (1)) AS purposes (purpose)
         ORDER BY owner, purpose ON CONFLICT DO NOTHING",
        "SELECT owner FROM owner_locks WHERE owner = ANY ($1) AND purpose = 0
         ORDER BY owner FOR UPDATE",
    ] {
        transaction.query(sql).bind(&owners).execute(&mut **transaction).await?;
    }
    let counts = transaction
        .query_as(
            "SELECT owner, (SELECT count(*) FROM (SELECT 1 FROM jobs WHERE state = 0
                            AND jobs.owner = owners.owner LIMIT $2) AS queued)
             FROM unnest($1::text[]) AS owners (owner)",
        )
        .bind(&owners)
        .bind(limit as i64)
        .fetch_all(&mut **transaction)
        .await?;
    Ok(counts.into_iter().collect())
}

/// Inserts jobs and returns the time of their creation.
async fn insert(transaction: &mut Transaction, jobs: &[&NewJob]) -> sqlx::Result<Moment> {
    if jobs.is_empty() {
        return Ok(Moment::now());
    }
    let digests: Vec<Digest> = jobs.iter().map(|job| job.picture.digest).collect();
    let keys: Vec<_> = jobs.iter().map(|job| job.idempotency_key.as_deref()).collect();
    let fingerprint =
        |job: &&NewJob| job.idempotency_key.as_ref().map(|_| job.fingerprint().as_bytes().to_vec());
    let rows = transaction
        .query(
            "INSERT INTO jobs (id, owner, state, attempt, fence, cancel_requested, idempotency_key,
                               fingerprint, options, image_digest, image_bytes, image_shape,
                               created_at, revision, history)
             SELECT id, owner, 0, 0, 0, false, idempotency_key, fingerprint, options, image_digest,
                    image_bytes, image_shape, now(), 1,
                    ARRAY[1, (extract(epoch FROM now()) * 1000)::bigint, 0, 0]
             FROM unnest($1::uuid[], $2::text[], $3::text[], $4::bytea[], $5::text[], $6::bytea[],
                         $7::bigint[], $8::text[])
                  AS new (id, owner, idempotency_key, fingerprint, options, image_digest,
                          image_bytes, image_shape)
             RETURNING created_at",
        )
        .bind(jobs.iter().map(|job| uuid(job.id)).collect::<Vec<_>>())
        .bind(jobs.iter().map(|job| job.owner.as_str()).collect::<Vec<_>>())
        .bind(keys)
        .bind(jobs.iter().map(fingerprint).collect::<Vec<_>>())
        .bind(jobs.iter().map(|job| job.options.as_str()).collect::<Vec<_>>())
        .bind(bytes(&digests))
        .bind(jobs.iter().map(|job| job.picture.bytes as i64).collect::<Vec<_>>())
        .bind(jobs.iter().map(|job| job.picture.shape_column()).collect::<Vec<_>>())
        .fetch_all(&mut **transaction)
        .await?;
    rows.first().ok_or(sqlx::Error::RowNotFound)?.try_get("created_at")
}
