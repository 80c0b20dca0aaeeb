//! Tasks that wait for a change of a job, or for a job to claim.

use crate::record::JobId;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::{Notify, watch};
use tokio::time::timeout;

/// All waiting tasks of this process.
#[derive(Debug, Default)]
pub struct Watchers {
    jobs: Mutex<HashMap<JobId, watch::Sender<()>>>,
    work: Notify,
}

/// Receives the changes of one job.
#[derive(Debug)]
pub(crate) struct Subscription {
    watchers: Arc<Watchers>,
    job: JobId,
    receiver: Option<watch::Receiver<()>>,
}

/// What a commit changed.
#[derive(Debug, Default)]
pub(crate) struct Changes {
    pub(crate) jobs: Vec<JobId>,
    /// There may be a job to claim.
    pub(crate) work: bool,
}

impl Watchers {
    /// Receives the changes of a job from now on.
    pub(crate) fn subscribe(self: &Arc<Self>, job: JobId) -> Subscription {
        let receiver = self.jobs().entry(job).or_default().subscribe();
        Subscription { watchers: Arc::clone(self), job, receiver: Some(receiver) }
    }

    /// Waits until there may be a job to claim, at most for `longest`.
    pub(crate) async fn work(&self, longest: Duration) {
        let _ = timeout(longest, self.work.notified()).await;
    }

    /// Wakes the tasks that wait for these changes.
    pub(crate) fn notify(&self, changes: &Changes) {
        let jobs = self.jobs();
        for sender in changes.jobs.iter().filter_map(|job| jobs.get(job)) {
            sender.send_replace(());
        }
        drop(jobs);
        if changes.work {
            self.work.notify_one();
        }
    }

    /// Wakes every waiting task.
    pub(crate) fn notify_all(&self) {
        self.jobs().values().for_each(|sender| sender.send_replace(()));
        self.notify_work();
    }

    /// Wakes a task that waits for a job to claim.
    pub(crate) fn notify_work(&self) {
        self.work.notify_one();
    }

    fn jobs(&self) -> MutexGuard<'_, HashMap<JobId, watch::Sender<()>>> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Subscription {
    /// Waits for a change since the last call, at most for `longest`.
    pub(crate) async fn changed(&mut self, longest: Duration) {
        if let Some(receiver) = &mut self.receiver {
            let _ = timeout(longest, receiver.changed()).await;
        }
    }
}

impl Drop for Subscription {
    /// The last subscription to a job removes its entry.
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
    use std::time::Instant;

    const SHORT: Duration = Duration::from_millis(10);
    const LONG: Duration = Duration::from_mins(1);

    #[tokio::test]
    async fn each_change_wakes_once_and_the_last_subscription_removes_its_entry() {
        let (watchers, began) = (Arc::new(Watchers::default()), Instant::now());
        let job = JobId::new();
        let (mut first, second) = (watchers.subscribe(job), watchers.subscribe(job));
        watchers.notify(&Changes { jobs: vec![job, JobId::new()], work: true });
        first.changed(LONG).await;
        watchers.work(LONG).await;
        assert!(began.elapsed() < LONG, "both waits end at the notification");
        assert!(timeout(SHORT, first.changed(LONG)).await.is_err());
        assert!(timeout(SHORT, watchers.work(LONG)).await.is_err());
        watchers.notify(&Changes { jobs: vec![job], work: false });
        assert!(timeout(SHORT, watchers.work(LONG)).await.is_err());
        drop(first);
        assert_eq!(watchers.jobs().len(), 1);
        drop(second);
        assert!(watchers.jobs().is_empty());
    }
}
