//! How long jobs took here of late, by which the work that waits is told in seconds.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// How much a new duration counts beside those before it.
const WEIGHT: f64 = 0.1;

/// The mean of durations, in which later ones count more.
#[derive(Debug, Default)]
pub struct Durations(Mutex<Option<f64>>);

impl Durations {
    /// Counts a duration.
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
    fn the_mean_begins_with_the_first_and_follows_the_later_ones() {
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
