//! Clients in other languages, the commands of the documents, and a tool that tries what the OpenAPI
//! document promises.
//!
//! `./test` installs what they need. Without it these tests fail.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(dead_code, reason = "some of what the tests of the service share is not used here")]

mod browser;
#[path = "../service/client.rs"]
mod client;
mod documents;
#[path = "../service/keys.rs"]
mod keys;
#[path = "../service/pictures.rs"]
mod pictures;
mod promises;
mod scripts;
#[path = "../service/server.rs"]
mod server;
mod tools;
