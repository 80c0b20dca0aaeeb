//! Which node sweeps: one at a time.
//!
//! The one that does leaves a mark at each sweep. Another takes over when it finds the same mark
//! twice. No clocks are compared, and two that sweep at the same time do no harm.

use super::table::{Expected, Put, Table};
use crate::queue::QueueError;
use tokio::sync::Mutex;

/// The name of the mark.
const MARK: &str = "turn.sweep";

/// The mark that this node saw or left last.
#[derive(Debug, Default)]
pub(super) struct Turn {
    seen: Mutex<Option<u64>>,
}

impl Turn {
    /// Whether this node is to sweep now.
    pub(super) async fn is_ours(&self, table: &Table) -> Result<bool, QueueError> {
        let mut seen = self.seen.lock().await;
        let mark = table.get_readable::<()>(MARK).await?.map(|mark| mark.version);
        let expected = match mark {
            None => Expected::Nothing,
            Some(version) if *seen == Some(version) => Expected::Version(version),
            other => {
                *seen = other;
                return Ok(false);
            }
        };
        match table.put(MARK, &(), expected).await? {
            Put::Stored(version) => {
                *seen = Some(version);
                Ok(true)
            }
            Put::Conflict => Ok(false),
        }
    }
}
