//! How long jobs take, as the node that last did some has told all others: so every node knows how
//! much work waits, also one that does none, and one that has just started.

use super::Nats;
use super::table::Expected;
use crate::queue::QueueError;
use std::sync::{Mutex, PoisonError};

/// The name under which it is told.
const NAME: &str = "turn.pace";

/// What this node has told.
#[derive(Debug, Default)]
pub(super) struct Pace {
    told_s: Mutex<Option<f64>>,
}

impl Pace {
    /// Whether this is no news.
    fn is_told(&self, mean_s: f64) -> bool {
        *self.told_s.lock().unwrap_or_else(PoisonError::into_inner) == Some(mean_s)
    }

    fn note(&self, mean_s: f64) {
        *self.told_s.lock().unwrap_or_else(PoisonError::into_inner) = Some(mean_s);
    }
}

impl Nats {
    /// Tells the mean of this node's jobs, where it has changed, and returns what was told last.
    pub(super) async fn share_mean(&self, own_s: Option<f64>) -> Result<Option<f64>, QueueError> {
        if let Some(own_s) = own_s.filter(|own_s| !self.pace.is_told(*own_s)) {
            self.streams.blobs.put(NAME, &own_s, Expected::Anything).await?;
            self.pace.note(own_s);
            return Ok(Some(own_s));
        }
        let told = self.streams.blobs.get_readable::<f64>(NAME).await?;
        Ok(told.and_then(|told| told.value).filter(|mean_s| mean_s.is_finite()))
    }
}
