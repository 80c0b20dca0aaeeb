//! The studio: its types against the OpenAPI document, and the page in a browser against the real
//! service.
//!
//! `./test` installs what they need. Without it these tests fail.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(clippy::print_stdout, reason = "what was measured must be said")]
#![allow(dead_code, reason = "some of what the tests of the service share is not used here")]

#[path = "../service/client.rs"]
mod client;
#[path = "../service/keys.rs"]
mod keys;
mod page;
mod relay;
#[path = "../service/server.rs"]
mod server;
#[path = "../clients/tools.rs"]
mod tools;
mod types;
