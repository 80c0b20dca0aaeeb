//! Many nodes with one queue: real processes of the program, real PostgreSQL servers, and an emulator of
//! the S3 protocol.
//!
//! `./test` installs what they need. Without it these tests fail.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(dead_code, reason = "some of what the tests of the service share is not used here")]

mod access;
mod certificates;
#[path = "../service/client.rs"]
mod client;
mod cluster;
mod database_faults;
mod document;
mod emulator;
mod ledger;
mod node;
mod nodes;
#[path = "../service/pictures.rs"]
mod pictures;
mod proxy;
mod scaling;
mod start;
mod stores;
#[path = "../clients/tools.rs"]
mod tools;
mod worker_faults;
