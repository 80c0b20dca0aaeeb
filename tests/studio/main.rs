//! The studio: its types against the OpenAPI document, and the page in a browser against the real
//! service.
//!
//! `./test` installs what they need. Without it these tests say what they leave out, unless
//! `PIXMESH_REQUIRE_TOOLS` is set.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(clippy::print_stderr, reason = "what is left out must be said")]
#![allow(clippy::print_stdout, reason = "and what was measured")]
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
