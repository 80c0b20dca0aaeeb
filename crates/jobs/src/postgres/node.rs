//! What the operations of a node share.

use super::database::Database;
use super::leases::HeldLeases;
use super::notifications::Notifications;
use crate::queue::Terms;
use crate::watchers::Watchers;
use std::sync::{Arc, Mutex};

/// A node that uses the database. Its operations are in modules of their own.
#[derive(Debug)]
pub(super) struct Node {
    pub(super) terms: Terms,
    pub(super) database: Arc<Database>,
    pub(super) watchers: Arc<Watchers>,
    pub(super) notifications: Notifications,
    pub(super) leases: HeldLeases,
    /// The owner with whom the next claim starts.
    pub(super) next_owner: Mutex<String>,
    /// The mean duration that this node shared last.
    pub(super) shared_mean_s: Mutex<Option<f64>>,
}
