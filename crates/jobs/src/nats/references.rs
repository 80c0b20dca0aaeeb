//! Which jobs have which blobs.
//!
//! A reference is written before the record of the job that has the blob, and taken away after the
//! job has ended or is gone. What is cut off in between leaves a reference too many, never one too
//! few, and is found by a sweep.

use super::Nats;
use super::stored::StoredJob;
use super::streams::owner_word;
use super::table::Expected;
use crate::queue::QueueError;
use crate::record::JobId;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;

impl Nats {
    /// A job has a blob.
    pub(super) async fn refer(
        &self,
        blob: &str,
        owner: &Owner,
        id: JobId,
    ) -> Result<(), QueueError> {
        let (name, owner) = (format!("ref.{blob}.{id}"), owner_word(owner));
        self.streams.blobs.put(&name, &owner, Expected::Anything).await.map(|_| ())
    }

    /// A job has a blob no more.
    pub(super) async fn release(&self, blob: &str, id: JobId) -> Result<(), QueueError> {
        self.streams.blobs.remove(&format!("ref.{blob}.{id}")).await?;
        self.give_up(blob).await
    }

    /// A blob may be one that no job has.
    pub(super) async fn give_up(&self, blob: &str) -> Result<(), QueueError> {
        let name = format!("free.{blob}");
        self.streams.blobs.put(&name, &(), Expected::Anything).await.map(|_| ())
    }

    /// The same for several.
    pub(super) async fn give_up_all(
        &self,
        blobs: impl IntoIterator<Item = &str>,
    ) -> Result<(), QueueError> {
        for blob in blobs {
            self.give_up(blob).await?;
        }
        Ok(())
    }

    /// A job that has ended needs its image no more.
    pub(super) async fn let_go(&self, id: JobId, job: &StoredJob) -> Result<(), QueueError> {
        self.release(job.image(), id).await
    }

    /// Whether a job has the blob.
    pub(super) async fn is_referenced(&self, blob: Digest) -> Result<bool, QueueError> {
        self.streams.blobs.has(&format!("ref.{blob}.*")).await
    }
}
