//! How long the broker may take to be there when a node starts: a cluster elects its leaders first.

use std::time::Duration;
use tokio::time::{Instant, sleep};

/// So long.
const TIME: Duration = Duration::from_secs(15);
/// The pause between two attempts.
const PAUSE: Duration = Duration::from_millis(500);

/// A start, during which the broker is asked again.
#[derive(Debug)]
pub(super) struct Start {
    until: Instant,
    pause: Duration,
}

impl Start {
    /// One that begins now.
    pub(super) fn begin() -> Self {
        Self::of(TIME, PAUSE)
    }

    fn of(time: Duration, pause: Duration) -> Self {
        Self { until: Instant::now() + time, pause }
    }

    /// Waits until the next attempt is due; `false`, at once, when there is no time for another.
    pub(super) async fn goes_on(&self) -> bool {
        if Instant::now() >= self.until {
            return false;
        }
        sleep(self.pause).await;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_start_goes_on_pause_by_pause_until_its_time_is_over() {
        let (time, pause) = (Duration::from_millis(500), Duration::from_millis(50));
        let (start, began) = (Start::of(time, pause), Instant::now());
        let mut attempts = 1;
        while start.goes_on().await {
            attempts += 1;
            assert!(began.elapsed() >= pause * (attempts - 1), "attempt {attempts}");
        }
        assert!(attempts >= 2 && began.elapsed() >= time);
        let ended = Instant::now();
        assert!(!start.goes_on().await);
        assert!(ended.elapsed() < pause, "nothing is waited for any more");
    }
}
