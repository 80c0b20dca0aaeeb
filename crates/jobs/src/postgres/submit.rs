//! Jobs come in.

use super::Node;
use super::database::Transaction;
use super::finish::{count_changes, give_up};
use super::row::{self, ms, select_record, uuid};
use crate::embedded::watchers::Changes;
use crate::queue::{QueueError, Submitted};
use crate::record::{JobId, Moment, NewJob, Record, State};
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use sqlx::Row;
use std::collections::{BTreeSet, HashMap};

/// How often jobs are tried whose words others give at the same moment.
const MOST_ROUNDS: usize = 4;

impl Node {
    /// Puts jobs among those that wait, unless there is a reason not to, in their order.
    pub(super) async fn submit(&self, jobs: &[NewJob]) -> Result<Vec<Submitted>, QueueError> {
        let mut answers: Vec<Option<Submitted>> = vec![None; jobs.len()];
        for _ in 0..MOST_ROUNDS {
            let open: Vec<usize> = (0..jobs.len()).filter(|&at| answers[at].is_none()).collect();
            if open.is_empty() {
                break;
            }
            let asked: Vec<&NewJob> = open.iter().map(|&at| &jobs[at]).collect();
            let round = self.database.retry(|| self.submit_round(&asked)).await?;
            open.into_iter().zip(round).for_each(|(at, answer)| answers[at] = answer);
        }
        let is_created = |answer: &Option<Submitted>| matches!(answer, Some(Submitted::Created(_)));
        if answers.iter().any(is_created) {
            self.notifications.send(Changes { jobs: Vec::new(), work: true });
        }
        let met = || {
            QueueError::Database(
                "other submissions with the same idempotency key are under way: try again".into(),
            )
        };
        answers.into_iter().map(|answer| answer.ok_or_else(met)).collect()
    }

    /// One transaction; `None` for a job whose word somebody else has just given.
    async fn submit_round(&self, jobs: &[&NewJob]) -> sqlx::Result<Vec<Option<Submitted>>> {
        let mut transaction = self.database.begin().await?;
        let mut answers = self.earlier(&mut transaction, jobs).await?;
        self.refuse_beyond_caps(&mut transaction, jobs, &mut answers).await?;
        let new: Vec<&NewJob> = jobs
            .iter()
            .zip(&answers)
            .filter(|(_, answer)| answer.is_none())
            .map(|(job, _)| *job)
            .collect();
        let created = insert(&mut transaction, &new).await?;
        let for_nothing = jobs.iter().zip(&answers).filter(|(_, answer)| {
            answer.as_ref().is_some_and(|answer| !matches!(answer, Submitted::Created(_)))
        });
        // Their blobs were stored for nothing.
        give_up(&mut transaction, for_nothing.map(|(job, _)| job.picture.digest).collect()).await?;
        for (job, answer) in jobs.iter().zip(&mut answers) {
            if let Some(at) = created.get(&job.id) {
                *answer = Some(Submitted::Created(waiting(job, *at)));
            }
        }
        count_changes(&mut transaction, created.len() as i64, 0).await?;
        transaction.commit().await?;
        Ok(answers)
    }

    /// What the same words were given for before; a job that is there itself was written by a
    /// transaction whose end was not heard of.
    async fn earlier(
        &self,
        transaction: &mut Transaction,
        jobs: &[&NewJob],
    ) -> sqlx::Result<Vec<Option<Submitted>>> {
        let (owners, keys): (Vec<&str>, Vec<&str>) = jobs
            .iter()
            .filter_map(|job| Some((job.owner.as_str(), job.idempotency_key.as_deref()?)))
            .unzip();
        if keys.is_empty() {
            return Ok(vec![None; jobs.len()]);
        }
        transaction.query(
            "UPDATE jobs SET idempotency_key = NULL FROM unnest($1::text[], $2::text[]) AS given (owner, idempotency_key)
             WHERE jobs.owner = given.owner AND jobs.idempotency_key = given.idempotency_key AND jobs.idempotency_key IS NOT NULL
               AND (jobs.created_at <= now() - $3 * interval '1 millisecond'
                    OR jobs.expires_at <= now())",
        )
        .bind(&owners)
        .bind(&keys)
        .bind(ms(self.terms.idempotency_ttl))
        .execute(&mut **transaction)
        .await?;
        let found = transaction
            .query(select_record!(
                ", idempotency_key, fingerprint FROM jobs WHERE idempotency_key IS NOT NULL
             AND (owner, idempotency_key) IN (SELECT * FROM unnest($1::text[], $2::text[]))"
            ))
            .bind(&owners)
            .bind(&keys)
            .fetch_all(&mut **transaction)
            .await?;
        let mut known = HashMap::new();
        for found in &found {
            let key = (row::owner(found)?, found.try_get::<String, _>("idempotency_key")?);
            known.insert(key, (row::record(found)?, row::digest(found, "fingerprint")?));
        }
        let earlier = |job: &&NewJob| {
            let key = (job.owner.clone(), job.idempotency_key.clone()?);
            let (record, fingerprint) = known.get(&key)?.clone();
            Some(if record.id == job.id {
                Submitted::Created(record)
            } else if fingerprint == job.fingerprint() {
                Submitted::Existing(record)
            } else {
                Submitted::KeyReused
            })
        };
        Ok(jobs.iter().map(earlier).collect())
    }

    /// Says of which jobs there are too many. An owner's jobs are counted behind the owner's door; those
    /// of all owners, as far as they are committed.
    async fn refuse_beyond_caps(
        &self,
        transaction: &mut Transaction,
        jobs: &[&NewJob],
        answers: &mut [Option<Submitted>],
    ) -> sqlx::Result<()> {
        let caps = self.terms.caps;
        let keys: BTreeSet<&Owner> = jobs
            .iter()
            .zip(&*answers)
            .filter(|(job, answer)| answer.is_none() && job.owner.is_key())
            .map(|(job, _)| &job.owner)
            .collect();
        let mut of_owner = queued_of(transaction, &keys, caps.queued_per_owner).await?;
        let mut of_all: i64 = transaction
            .query_scalar("SELECT COALESCE(SUM(queued), 0)::bigint FROM job_counts")
            .fetch_one(&mut **transaction)
            .await?;
        for (job, answer) in jobs.iter().zip(answers).filter(|(_, answer)| answer.is_none()) {
            if of_all >= caps.queued as i64 {
                *answer = Some(Submitted::QueueFull { limit: caps.queued });
                continue;
            }
            if let Some(queued) = of_owner.get_mut(job.owner.as_str()) {
                if *queued >= caps.queued_per_owner as i64 {
                    *answer = Some(Submitted::OwnerFull { limit: caps.queued_per_owner });
                    continue;
                }
                *queued += 1;
            }
            of_all += 1;
        }
        Ok(())
    }
}

/// How many jobs of each owner wait, up to a number, behind doors that stay locked until the end of the
/// transaction.
async fn queued_of(
    transaction: &mut Transaction,
    keys: &BTreeSet<&Owner>,
    most: usize,
) -> sqlx::Result<HashMap<String, i64>> {
    if keys.is_empty() {
        return Ok(HashMap::new());
    }
    let owners: Vec<&str> = keys.iter().map(|owner| owner.as_str()).collect();
    for sql in [
        "INSERT INTO owner_locks SELECT owner, purpose FROM unnest($1::text[]) AS owners (owner),
                                                   (VALUES (0), (1)) AS both_purposes (purpose)
         ORDER BY owner, purpose ON CONFLICT DO NOTHING",
        "SELECT owner FROM owner_locks WHERE owner = ANY ($1) AND purpose = 0 ORDER BY owner FOR UPDATE",
    ] {
        transaction.query(sql).bind(&owners).execute(&mut **transaction).await?;
    }
    let counted = transaction
        .query_as(
            "SELECT owner, (SELECT count(*) FROM (SELECT 1 FROM jobs
                         WHERE state = 0 AND jobs.owner = owners.owner LIMIT $2) AS waiting)
         FROM unnest($1::text[]) AS owners (owner)",
        )
        .bind(&owners)
        .bind(most as i64)
        .fetch_all(&mut **transaction)
        .await?;
    Ok(counted.into_iter().collect())
}

/// Writes jobs down, and says when; those are left out that are there, or whose words are.
async fn insert(
    transaction: &mut Transaction,
    jobs: &[&NewJob],
) -> sqlx::Result<HashMap<JobId, Moment>> {
    let column = |value: fn(&NewJob) -> &str| jobs.iter().map(|job| value(job)).collect::<Vec<_>>();
    let shape = |job: &&NewJob| serde_json::to_string(&job.picture.shape).unwrap_or_default();
    let fingerprint =
        |job: &&NewJob| job.idempotency_key.as_ref().map(|_| job.fingerprint().as_bytes().to_vec());
    let digests: Vec<&[u8]> =
        jobs.iter().map(|job| job.picture.digest.as_bytes().as_slice()).collect();
    let created = transaction.query(
        "INSERT INTO jobs (id, owner, state, attempt, fence, cancel_requested, idempotency_key, fingerprint, order_query,
                           image_digest, image_bytes, image_shape, created_at, revision, history)
         SELECT id, owner, 0, 0, 0, false, idempotency_key, fingerprint, order_query, image_digest, image_bytes, image_shape,
                now(), 1, ARRAY[1, (extract(epoch FROM now()) * 1000)::bigint, 0, 0]
         FROM unnest($1::uuid[], $2::text[], $3::text[], $4::text[], $5::bytea[], $6::bigint[],
                     $7::text[], $8::bytea[])
              AS new (id, owner, idempotency_key, order_query, image_digest, image_bytes, image_shape, fingerprint)
         ON CONFLICT DO NOTHING RETURNING id, created_at",
    )
    .bind(jobs.iter().map(|job| uuid(job.id)).collect::<Vec<_>>())
    .bind(column(|job| job.owner.as_str()))
    .bind(jobs.iter().map(|job| job.idempotency_key.as_deref()).collect::<Vec<_>>())
    .bind(column(|job| &job.order))
    .bind(digests)
    .bind(jobs.iter().map(|job| job.picture.bytes as i64).collect::<Vec<_>>())
    .bind(jobs.iter().map(shape).collect::<Vec<_>>())
    .bind(jobs.iter().map(fingerprint).collect::<Vec<_>>())
    .fetch_all(&mut **transaction)
    .await?;
    created.iter().map(|row| Ok((row::id(row)?, row.try_get("created_at")?))).collect()
}

/// A job that has just come in.
fn waiting(job: &NewJob, created: Moment) -> Record {
    Record {
        id: job.id,
        owner: job.owner.clone(),
        state: State::Queued,
        attempt: 0,
        order: job.order.clone(),
        picture: job.picture,
        progress: None,
        mesh: None,
        problem: None,
        created,
        started: None,
        finished: None,
        expires: None,
        revision: 1,
    }
}

/// Blobs are about to be stored, for jobs that may never come.
pub(super) async fn expect(node: &Node, blobs: &[Digest]) -> Result<Vec<()>, QueueError> {
    let note = || async {
        let mut transaction = node.database.begin().await?;
        give_up(&mut transaction, blobs.iter().copied().collect()).await?;
        transaction.commit().await
    };
    node.database.retry(note).await?;
    Ok(vec![(); blobs.len()])
}
