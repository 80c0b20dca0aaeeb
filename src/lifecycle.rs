//! Whether the service starts, takes requests or stops.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// Where in its life the service is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Not listening yet.
    Starting,
    /// Taking requests.
    Ready,
    /// Taking no more.
    Stopping,
}

/// Where in its life the service is, as every thread sees it.
#[derive(Clone, Debug, Default)]
pub struct Lifecycle(Arc<AtomicU8>);

impl Lifecycle {
    /// The stage now.
    #[must_use]
    pub fn stage(&self) -> Stage {
        match self.0.load(Ordering::Acquire) {
            0 => Stage::Starting,
            1 => Stage::Ready,
            _ => Stage::Stopping,
        }
    }

    /// Enters a stage.
    pub(crate) fn enter(&self, stage: Stage) {
        self.0.store(stage as u8, Ordering::Release);
    }
}
