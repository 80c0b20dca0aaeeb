//! Hostile and awkward inputs: one table, whose every row is an input made here and its answer.
//!
//! The table is written out in `docs/inputs.md`, which [`table`] compares with what is tested.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test that cannot go on has failed"
)]
#![allow(clippy::print_stdout, reason = "what was measured is printed")]
#![allow(dead_code, reason = "some of what the tests of the service share is not used here")]

mod awkward;
mod bombs;
#[path = "../service/client.rs"]
mod client;
mod containers;
mod corpora;
mod document;
mod faults;
#[path = "../service/keys.rs"]
mod keys;
mod lifecycle;
mod meshes;
mod model;
mod names;
mod parameters;
#[path = "../service/pictures.rs"]
mod pictures;
#[path = "../../crates/codec/tests/samples/mod.rs"]
mod samples;
#[path = "../service/server.rs"]
mod server;
mod table;
#[path = "../../fuzz/src/lib.rs"]
#[allow(unreachable_pub, reason = "a crate of its own for the fuzzer")]
mod targets;
mod transport;
