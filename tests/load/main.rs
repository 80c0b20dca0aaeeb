//! Service levels under load: the real program, alone on the machine as far as these tests go.
//!
//! Figures depend on what else the machine does. Each level is measured a few times, and one
//! measurement must reach it; `cargo bench --bench service` measures at length.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(dead_code, reason = "some of what the tests of the service share is not used here")]

#[path = "../service/client.rs"]
mod client;
mod fairness;
#[path = "../service/keys.rs"]
mod keys;
mod levels;
mod memory;
#[path = "../service/pictures.rs"]
mod pictures;
mod saturation;
#[path = "../service/server.rs"]
mod server;
mod slow_decoders;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Keeps the tests of this program from disturbing each other.
fn alone() -> MutexGuard<'static, ()> {
    static MACHINE: Mutex<()> = Mutex::new(());
    MACHINE.lock().unwrap_or_else(PoisonError::into_inner)
}
