//! The limits of the scheduler.

/// What the scheduler gives out.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Tasks that run at a time.
    pub workers: usize,
    /// Threads for all tasks together.
    pub threads: usize,
    /// Memory for all tasks and for answers that are not sent yet, in bytes.
    pub memory_bytes: u64,
    /// Seconds of work that may wait.
    pub queue_s: f64,
    /// Tasks of one key that run at a time.
    pub running_per_key: usize,
    /// Tasks of one key that may wait.
    pub queued_per_key: usize,
}
