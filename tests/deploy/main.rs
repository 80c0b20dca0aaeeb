//! What runs the service elsewhere: image, manifests, dashboard, alerts, and the limits of containers.
//!
//! `./test` installs the programs of others that check them. Without these the tests
//! fail. `deploy/container/verify` builds the image and runs it.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(dead_code, reason = "some of what the tests of the service share is not used here")]

#[path = "../service/client.rs"]
mod client;
mod control_groups;
mod manifests;
mod monitoring;
#[path = "../service/pictures.rs"]
mod pictures;
mod release;
#[path = "../service/server.rs"]
mod server;
#[path = "../clients/tools.rs"]
mod tools;

/// A program that `./test` installs for these tests.
fn python_tool(name: &str) -> String {
    format!("tests/deploy/.venv/bin/{name}")
}

/// The text of a file in the checkout.
#[track_caller]
fn read(path: &str) -> String {
    std::fs::read_to_string(tools::checkout(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}
