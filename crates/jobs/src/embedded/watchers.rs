//! Who waits for a change of a job, or for work.

use crate::record::JobId;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, watch};

/// Everybody who waits.
#[derive(Debug, Default)]
pub(crate) struct Watchers {
    jobs: Mutex<HashMap<JobId, watch::Sender<()>>>,
    work: Notify,
}

/// Hears of the changes of one job.
#[derive(Debug)]
pub(crate) struct Subscription {
    watchers: Arc<Watchers>,
    job: JobId,
    receiver: Option<watch::Receiver<()>>,
}

/// What a commit changed, for those who wait.
#[derive(Debug, Default)]
pub(crate) struct Changes {
    /// These jobs.
    pub(crate) jobs: Vec<JobId>,
    /// There may be something to claim.
    pub(crate) work: bool,
}

impl Watchers {
    /// Hears of a job's changes from now on.
    pub(crate) fn subscribe(self: &Arc<Self>, job: JobId) -> Subscription {
        let receiver = self.jobs().entry(job).or_default().subscribe();
        Subscription { watchers: Arc::clone(self), job, receiver: Some(receiver) }
    }

    /// Waits until there may be something to claim.
    pub(crate) async fn work(&self) {
        self.work.notified().await;
    }

    /// Tells those who wait what was committed.
    pub(crate) fn tell(&self, changes: &Changes) {
        let jobs = self.jobs();
        for sender in changes.jobs.iter().filter_map(|job| jobs.get(job)) {
            sender.send_replace(());
        }
        drop(jobs);
        if changes.work {
            self.work.notify_one();
        }
    }

    /// Has everybody look who waits.
    pub(crate) fn tell_all(&self) {
        self.jobs().values().for_each(|sender| sender.send_replace(()));
        self.work.notify_one();
    }

    fn jobs(&self) -> MutexGuard<'_, HashMap<JobId, watch::Sender<()>>> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Subscription {
    /// Waits for a change after the last one heard of.
    pub(crate) async fn changed(&mut self) {
        if let Some(receiver) = &mut self.receiver {
            let _ = receiver.changed().await;
        }
    }
}

impl Drop for Subscription {
    /// The last one who waits for a job leaves nothing behind.
    fn drop(&mut self) {
        let mut jobs = self.watchers.jobs();
        self.receiver = None;
        if jobs.get(&self.job).is_some_and(|sender| sender.receiver_count() == 0) {
            jobs.remove(&self.job);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;
    use tokio::time::timeout;

    #[tokio::test]
    async fn changes_are_heard_of_and_nothing_is_left_behind() {
        let watchers = Arc::new(Watchers::default());
        let job = JobId::new();
        let (mut first, second) = (watchers.subscribe(job), watchers.subscribe(job));
        watchers.tell(&Changes { jobs: vec![job, JobId::new()], work: true });
        first.changed().await;
        watchers.work().await;
        // Each is heard of once.
        let moment = Duration::from_millis(10);
        assert!(timeout(moment, first.changed()).await.is_err());
        assert!(timeout(moment, watchers.work()).await.is_err());
        watchers.tell(&Changes { jobs: vec![job], work: false });
        assert!(timeout(moment, watchers.work()).await.is_err());
        drop(first);
        assert_eq!(watchers.jobs().len(), 1);
        drop(second);
        assert!(watchers.jobs().is_empty());
    }
}
