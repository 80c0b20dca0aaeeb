//! A job comes in: its reference to the image, its record, its message.
//!
//! A submission with a word first leaves under the word all that it takes to complete it. Whoever
//! comes with the same word completes what is there, so that a submission that was cut off half-way
//! is one job all the same.

use super::Nats;
use super::read::unreadable;
use super::stored::StoredJob;
use super::streams::{owner_word, record_name, work_name};
use super::table::{Expected, Put, Versioned};
use crate::queue::{QueueError, Submitted};
use crate::record::{JobId, Moment, NewJob, Picture, PictureShape};
use async_nats::jetstream::message::PublishMessage;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use serde::{Deserialize, Serialize};

/// How often a word is looked at again that changes under one's eyes.
const TRIES: usize = 8;

/// How many jobs of an owner a consumer may not have counted yet: it hears of a message a moment
/// after whoever published it.
const JUST_CAME_IN: usize = 64;

/// What is kept under a word.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct StoredWord {
    fingerprint: String,
    until_ms: i64,
    job: String,
    order: String,
    image: String,
    image_bytes: u64,
    shape: PictureShape,
}

impl Nats {
    /// Puts a job among those that wait, unless there is a reason not to.
    pub(super) async fn submit_job(&self, job: NewJob) -> Result<Submitted, QueueError> {
        let submitted = match &job.idempotency_key {
            None => self.create(&job, None).await?,
            Some(word) => self.submit_with_word(&job, &word_name(&job.owner, word)).await?,
        };
        if !matches!(submitted, Submitted::Created(_)) {
            // Its blob was stored before, for nothing.
            self.give_up(&job.picture.digest.to_string()).await?;
        }
        Ok(submitted)
    }

    async fn submit_with_word(&self, job: &NewJob, name: &str) -> Result<Submitted, QueueError> {
        for _ in 0..TRIES {
            let expected = match self.streams.words.get_readable::<StoredWord>(name).await? {
                None => Expected::Nothing,
                Some(Versioned { value, version }) => {
                    // One that cannot be read is forgotten.
                    let known = value.filter(|word| word.until_ms > Moment::now().0);
                    if let Some(word) = known
                        && let Some(submitted) = self.again(job, name, &word).await?
                    {
                        return Ok(submitted);
                    }
                    Expected::Version(version)
                }
            };
            let word = StoredWord::of(job, self.terms.idempotency_ttl);
            if self.streams.words.put(name, &word, expected).await? == Put::Conflict {
                continue;
            }
            let submitted = self.create(job, Some(name.to_owned())).await?;
            if !matches!(submitted, Submitted::Created(_) | Submitted::Existing(_)) {
                self.streams.words.remove(name).await?;
            }
            return Ok(submitted);
        }
        Err(QueueError::Broker("a word for a submission changes without end".into()))
    }

    /// Leaves a word as a submission does that is cut off right after.
    #[cfg(test)]
    pub(super) async fn leave_word(&self, job: &NewJob) -> Result<Put, QueueError> {
        let name = word_name(&job.owner, job.idempotency_key.as_deref().unwrap_or_default());
        let word = StoredWord::of(job, self.terms.idempotency_ttl);
        self.streams.words.put(&name, &word, Expected::Nothing).await
    }

    /// What a repeated word stands for; `None` when its job is no longer there.
    async fn again(
        &self,
        job: &NewJob,
        name: &str,
        word: &StoredWord,
    ) -> Result<Option<Submitted>, QueueError> {
        if word.fingerprint != job.fingerprint().to_string() {
            return Ok(Some(Submitted::KeyReused));
        }
        let Some(first) = word.job(&job.owner) else { return Ok(None) };
        if let Some(record) = self.record(&first.owner, first.id).await? {
            // Its message may be missing, if whoever submitted it was cut off.
            if record.value.attempt() == 0 && !record.value.is_final() {
                self.send_to_work(&first.owner, first.id).await?;
            }
            let kept = record.value.record(first.id).filter(|_| !record.value.is_over());
            return Ok(kept.map(Submitted::Existing));
        }
        Ok(match self.create(&first, Some(name.to_owned())).await? {
            Submitted::Created(record) => Some(Submitted::Existing(record)),
            other => Some(other),
        })
    }

    /// Stores a job, unless there is no room.
    async fn create(&self, job: &NewJob, word: Option<String>) -> Result<Submitted, QueueError> {
        if let Some(full) = self.full(&job.owner).await? {
            return Ok(full);
        }
        let (name, stored) = (record_name(&job.owner, job.id), StoredJob::new(job, word));
        let image = job.picture.digest.to_string();
        let (refers, put) = tokio::join!(
            self.refer(&image, &job.owner, job.id),
            self.streams.jobs.put(&name, &stored, Expected::Nothing)
        );
        refers?;
        if put? == Put::Conflict {
            // Somebody has completed the submission in the meantime.
            let record = self.record(&job.owner, job.id).await?;
            let record = record.and_then(|record| record.value.record(job.id));
            return record.map(Submitted::Existing).ok_or_else(|| unreadable(job.id));
        }
        if self.send_to_work(&job.owner, job.id).await? == Put::Conflict {
            self.streams.jobs.remove(&name).await?;
            self.release(&image, job.id).await?;
            return Ok(Submitted::QueueFull { limit: self.terms.caps.queued });
        }
        stored.record(job.id).map(Submitted::Created).ok_or_else(|| unreadable(job.id))
    }

    /// Puts the message of a job into the stream of work, if it is not there, and calls workers.
    /// [`Put::Conflict`] when the stream is full.
    pub(super) async fn send_to_work(&self, owner: &Owner, id: JobId) -> Result<Put, QueueError> {
        self.owners.consumer(owner).await?;
        let message = PublishMessage::build().message_id(id.to_string());
        let put = match self.streams.work.publish(&work_name(owner, id), message).await {
            Err(QueueError::BrokerFull(text)) if text.contains("per subject") => Put::Stored(0),
            Err(QueueError::BrokerFull(text)) if text.contains("maximum messages") => Put::Conflict,
            put => put?,
        };
        self.call_to_work(owner).await;
        Ok(put)
    }

    /// Why there is no room for another job of an owner.
    async fn full(&self, owner: &Owner) -> Result<Option<Submitted>, QueueError> {
        let caps = &self.terms.caps;
        let limit = caps.queued_of(owner);
        let (of_all, of_owner) = tokio::join!(self.waiting(), self.waiting_of(owner, limit));
        if of_all? >= caps.queued {
            return Ok(Some(Submitted::QueueFull { limit: caps.queued }));
        }
        Ok((of_owner? >= limit).then_some(Submitted::OwnerFull { limit }))
    }

    /// How many jobs of an owner wait, exactly where that is near the limit; nobody in particular has
    /// none, since only all jobs together are bounded there.
    async fn waiting_of(&self, owner: &Owner, limit: usize) -> Result<usize, QueueError> {
        if !owner.is_key() {
            return Ok(0);
        }
        let info = self.owners.info(owner).await?;
        let counted = info.num_pending as usize;
        if !may_be_full(counted, limit) {
            return Ok(counted);
        }
        let unfinished = self.streams.work.names(&format!("work.{}.*", owner_word(owner))).await?;
        Ok(unfinished.len().saturating_sub(info.num_ack_pending))
    }

    /// How many jobs wait; as many as there are, where that is few enough.
    async fn waiting(&self) -> Result<usize, QueueError> {
        let info = self.streams.work.stream().get_info().await;
        let info = info.map_err(|error| {
            super::broker::failure("the stream of work cannot be asked", &error)
        })?;
        let unfinished = info.state.messages as usize;
        if unfinished < self.terms.caps.queued {
            return Ok(unfinished);
        }
        Ok(unfinished.saturating_sub(self.running().await?))
    }
}

/// Whether as many may wait as may, of whom a consumer has counted so many.
fn may_be_full(counted: usize, limit: usize) -> bool {
    counted.saturating_add(JUST_CAME_IN) >= limit
}

impl StoredWord {
    fn of(job: &NewJob, ttl: std::time::Duration) -> Self {
        let kept_ms = i64::try_from(ttl.as_millis()).unwrap_or(i64::MAX);
        Self {
            fingerprint: job.fingerprint().to_string(),
            until_ms: Moment::now().0.saturating_add(kept_ms),
            job: job.id.to_string(),
            order: job.order.clone(),
            image: job.picture.digest.to_string(),
            image_bytes: job.picture.bytes,
            shape: job.picture.shape,
        }
    }

    /// The job as it was first submitted.
    fn job(&self, owner: &Owner) -> Option<NewJob> {
        let digest = self.image.parse().ok()?;
        Some(NewJob {
            id: JobId::parse(&self.job)?,
            owner: owner.clone(),
            order: self.order.clone(),
            picture: Picture { digest, bytes: self.image_bytes, shape: self.shape },
            idempotency_key: None,
        })
    }
}

/// The name under which a client's word is kept: of the word only its digest, whatever is in it.
fn word_name(owner: &Owner, word: &str) -> String {
    format!("word.{}", Digest::of_texts(&[owner.as_str(), word]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_owner_s_jobs_are_counted_anew_where_those_that_just_came_in_may_be_the_last() {
        for (counted, limit, is_near) in
            [(0, 2, true), (0, 65, false), (935, 1000, false), (936, 1000, true), (9, 9, true)]
        {
            assert_eq!(may_be_full(counted, limit), is_near, "{counted} of {limit}");
        }
    }
}
