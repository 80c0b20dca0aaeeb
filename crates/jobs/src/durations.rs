//! The recent mean duration of attempts, by which the queued work is estimated in seconds.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// The weight of a new duration.
const WEIGHT: f64 = 0.1;

/// The exponentially weighted mean of durations.
#[derive(Debug, Default)]
pub struct Durations(Mutex<Option<f64>>);

impl Durations {
    /// Adds a duration.
    pub fn add(&self, duration: Duration) {
        let mut mean = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let new = duration.as_secs_f64();
        *mean = Some(mean.map_or(new, |mean| mean + WEIGHT * (new - mean)));
    }

    /// The mean in seconds; `None` before the first.
    #[must_use]
    pub fn mean_s(&self) -> Option<f64> {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_starts_with_the_first_and_follows_the_last() {
        let durations = Durations::default();
        assert_eq!(durations.mean_s(), None);
        durations.add(Duration::from_secs(10));
        assert_eq!(durations.mean_s(), Some(10.0));
        for _ in 0..100 {
            durations.add(Duration::from_secs(1));
        }
        assert!(durations.mean_s().is_some_and(|mean| (1.0..1.01).contains(&mean)));
    }
}
