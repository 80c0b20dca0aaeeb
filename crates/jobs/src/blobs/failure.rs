//! The errors of stores.

use crate::queue::QueueError;
use std::error::Error;
use std::io::{self, ErrorKind};

/// The error of the queue for an error of a store, by the system's error among its causes.
pub(super) fn failure(error: &object_store::Error) -> QueueError {
    let mut causes = std::iter::successors(Some(error as &dyn Error), |&error| error.source());
    let kind = causes.find_map(|cause| cause.downcast_ref::<io::Error>()).map(io::Error::kind);
    match kind {
        Some(ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge) => {
            QueueError::StorageFull(error.to_string())
        }
        _ => QueueError::Storage(error.to_string()),
    }
}
