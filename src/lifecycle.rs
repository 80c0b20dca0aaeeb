//! Whether the service starts, takes requests or stops, and whether it still runs.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// How long the runtime of the public listener may show no sign of life.
const LONGEST_SILENCE: Duration = Duration::from_secs(5);

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
#[derive(Clone, Debug)]
pub struct Lifecycle(Arc<State>);

#[derive(Debug)]
struct State {
    stage: AtomicU8,
    began: Instant,
    /// Milliseconds from then to the last sign of life.
    last_beat_ms: AtomicU64,
}

impl Default for Lifecycle {
    fn default() -> Self {
        let (stage, last_beat_ms) = (AtomicU8::new(0), AtomicU64::new(0));
        Self(Arc::new(State { stage, began: Instant::now(), last_beat_ms }))
    }
}

impl Lifecycle {
    /// The stage now.
    #[must_use]
    pub fn stage(&self) -> Stage {
        match self.0.stage.load(Ordering::Acquire) {
            0 => Stage::Starting,
            1 => Stage::Ready,
            _ => Stage::Stopping,
        }
    }

    /// Enters a stage.
    pub(crate) fn enter(&self, stage: Stage) {
        self.0.stage.store(stage as u8, Ordering::Release);
    }

    /// Shows that the runtime of the public listener runs.
    pub(crate) fn beat(&self) {
        let now = self.0.began.elapsed().as_millis() as u64;
        self.0.last_beat_ms.store(now, Ordering::Release);
    }

    /// Whether it has run lately.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        let last = Duration::from_millis(self.0.last_beat_ms.load(Ordering::Acquire));
        self.0.began.elapsed().saturating_sub(last) < LONGEST_SILENCE
    }
}
