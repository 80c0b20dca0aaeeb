//! Records that cannot be read. They are left as they are, for whoever can read them: an operator,
//! or a newer version of the program. No worker is given them again, they can be deleted, and they
//! are gone in their time like others.

use super::Nats;
use super::read::StoredEnd;
use super::records::Step;
use super::stored::StoredJob;
use super::streams::{gone_name, record_name, reference_of, work_name};
use super::table::{Expected, Versioned};
use crate::queue::QueueError;
use crate::record::JobId;
use pixmesh_engine::Owner;

impl Nats {
    /// A job's record; one that cannot be read is as good as none.
    pub(super) async fn readable_record(
        &self,
        owner: &Owner,
        id: JobId,
    ) -> Result<Option<Versioned<StoredJob>>, QueueError> {
        none_if_damaged(id, self.record(owner, id).await)
    }

    /// Changes the record of a job that this process has, beginning with the one that is known; one
    /// that cannot be read is lost to it.
    pub(super) async fn change_held<T: Send>(
        &self,
        owner: &Owner,
        id: JobId,
        known: Versioned<StoredJob>,
        apply: impl Fn(&mut StoredJob) -> Step<T> + Send + Sync,
    ) -> Result<Option<(T, Versioned<StoredJob>)>, QueueError> {
        none_if_damaged(id, self.change(owner, id, Some(known), apply).await)
    }

    /// Leaves nothing of a job whose record cannot be read. Its blobs are known by the references
    /// to them; its word is not known, and whoever comes with that submits the job anew.
    pub(super) async fn delete_damaged(&self, owner: &Owner, id: JobId) -> Result<(), QueueError> {
        self.streams.work.take_away(&work_name(owner, id)).await?;
        self.streams.jobs.remove(&record_name(owner, id)).await?;
        for name in self.streams.blobs.names(&format!("ref.*.{id}")).await? {
            if let Some((blob, id)) = reference_of(&name) {
                self.release(blob, id).await?;
            }
        }
        Ok(())
    }

    /// Keeps of a job whose record cannot be read nothing but that it was.
    pub(super) async fn expire_damaged(&self, owner: &Owner, id: JobId) -> Result<(), QueueError> {
        let end = StoredEnd::after(self.terms.gone_ttl);
        self.streams.gone.put(&gone_name(owner, id), &end, Expected::Anything).await?;
        self.delete_damaged(owner, id).await
    }
}

/// Says that a record cannot be read, and goes on without it.
fn none_if_damaged<T>(
    id: JobId,
    found: Result<Option<T>, QueueError>,
) -> Result<Option<T>, QueueError> {
    match found {
        Err(QueueError::Damaged(error)) => {
            tracing::error!(job = %id, error, "a job's record cannot be read");
            Ok(None)
        }
        found => found,
    }
}
