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
mod memory;
#[path = "../service/pictures.rs"]
mod pictures;
#[path = "../service/server.rs"]
mod server;
