//! Whether the service starts, takes requests or stops, and whether it still runs.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;

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

/// Stops a service.
#[derive(Clone, Debug, Default)]
pub struct Shutdown {
    /// Raised when the service stops: it takes no more requests, and lets those that run end.
    pub stop: CancellationToken,
    /// Raised when a stopping service waits for nothing any longer.
    pub cut: CancellationToken,
}

/// Where in its life the service is, as every thread sees it.
#[derive(Clone, Debug)]
pub struct Lifecycle(Arc<State>);

#[derive(Debug)]
struct State {
    is_ready: AtomicBool,
    stop: CancellationToken,
    began: Instant,
    /// Milliseconds from then to the last sign of life.
    last_beat_ms: AtomicU64,
}

impl Lifecycle {
    /// A service that starts, and stops when `stop` is raised.
    #[must_use]
    pub fn new(stop: CancellationToken) -> Self {
        let (is_ready, last_beat_ms) = (AtomicBool::new(false), AtomicU64::new(0));
        Self(Arc::new(State { is_ready, stop, began: Instant::now(), last_beat_ms }))
    }

    /// The stage now.
    #[must_use]
    pub fn stage(&self) -> Stage {
        match self.0.is_ready.load(Ordering::Acquire) {
            _ if self.0.stop.is_cancelled() => Stage::Stopping,
            true => Stage::Ready,
            false => Stage::Starting,
        }
    }

    /// The service takes requests from now on.
    pub(crate) fn set_ready(&self) {
        self.0.is_ready.store(true, Ordering::Release);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_of_the_public_listener_is_noticed() {
        let began = Instant::now().checked_sub(2 * LONGEST_SILENCE).unwrap();
        let (is_ready, stop) = (AtomicBool::new(true), CancellationToken::new());
        let state = State { is_ready, stop, began, last_beat_ms: AtomicU64::new(0) };
        let lifecycle = Lifecycle(Arc::new(state));
        assert!(!lifecycle.is_alive());
        lifecycle.beat();
        assert!(lifecycle.is_alive());
    }
}
