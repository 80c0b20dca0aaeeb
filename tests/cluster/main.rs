//! Many nodes with one queue: real processes of the program, real servers of the broker, and an
//! emulator of the S3 protocol.
//!
//! `./test` installs what they need. Without it these tests say what they leave out, unless
//! `PIXMESH_REQUIRE_TOOLS` is set.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(clippy::print_stderr, reason = "what is left out must be said")]
#![allow(dead_code, reason = "some of what the tests of the service share is not used here")]

mod access;
mod certificates;
#[path = "../service/client.rs"]
mod client;
mod emulator;
mod faults;
mod ledger;
mod nats_server;
mod node;
mod nodes;
mod operator;
#[path = "../service/pictures.rs"]
mod pictures;
mod proxy;
mod scaling;
mod start;
mod stores;
#[path = "../clients/tools.rs"]
mod tools;
