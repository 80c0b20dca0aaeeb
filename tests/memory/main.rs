//! The memory model of admission: the real program takes no more than it admits work for.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(dead_code, reason = "some of what the tests of the service share is not used here")]

mod admission;
#[path = "../service/client.rs"]
mod client;
mod idle;
#[path = "../service/pictures.rs"]
mod pictures;
#[path = "../service/server.rs"]
mod server;
mod slow_decoders;
