//! Records are changed by compare-and-set: a change that finds a newer record is made again on that.

use super::Nats;
use super::stored::StoredJob;
use super::streams::record_name;
use super::table::{Expected, Put, Versioned};
use crate::queue::QueueError;
use crate::record::JobId;
use pixmesh_engine::Owner;

/// How often a change is made again on a newer record.
const TRIES: usize = 32;

/// What a change comes to.
pub(super) enum Step<T> {
    /// The changed record is to be stored.
    Store(T),
    /// There is nothing to change.
    Leave(T),
}

impl Nats {
    /// A job's record.
    pub(super) async fn record(
        &self,
        owner: &Owner,
        id: JobId,
    ) -> Result<Option<Versioned<StoredJob>>, QueueError> {
        self.streams.jobs.get(&record_name(owner, id)).await
    }

    /// Changes a job's record, beginning with the one that is known, and returns what came of it and
    /// the record as it is now; `None` when there is no such job.
    pub(super) async fn change<T: Send>(
        &self,
        owner: &Owner,
        id: JobId,
        mut known: Option<Versioned<StoredJob>>,
        apply: impl Fn(&mut StoredJob) -> Step<T> + Send + Sync,
    ) -> Result<Option<(T, Versioned<StoredJob>)>, QueueError> {
        let name = record_name(owner, id);
        for _ in 0..TRIES {
            let is_fresh = known.is_none();
            let found = match known.take() {
                Some(record) => Some(record),
                None => self.record(owner, id).await?,
            };
            let Some(Versioned { mut value, version }) = found else { return Ok(None) };
            match apply(&mut value) {
                // What is known may be old.
                Step::Leave(_) if !is_fresh => {}
                Step::Leave(result) => return Ok(Some((result, Versioned { value, version }))),
                Step::Store(result) => {
                    let expected = Expected::Version(version);
                    if let Put::Stored(version) =
                        self.streams.jobs.put(&name, &value, expected).await?
                    {
                        return Ok(Some((result, Versioned { value, version })));
                    }
                }
            }
        }
        Err(QueueError::Broker(format!("the record of job {id} changes without end")))
    }

    /// Changes a job's record if it is still the one given; `None` when it is not.
    pub(super) async fn change_version<T: Send>(
        &self,
        owner: &Owner,
        id: JobId,
        record: Versioned<StoredJob>,
        apply: impl FnOnce(&mut StoredJob) -> T + Send,
    ) -> Result<Option<(T, Versioned<StoredJob>)>, QueueError> {
        let Versioned { mut value, version } = record;
        let result = apply(&mut value);
        let expected = Expected::Version(version);
        let put = self.streams.jobs.put(&record_name(owner, id), &value, expected).await?;
        Ok(match put {
            Put::Stored(version) => Some((result, Versioned { value, version })),
            Put::Conflict => None,
        })
    }
}
