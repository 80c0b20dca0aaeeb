//! Black-box tests: the service over real sockets, in this process or as a program of its own, and
//! pictures made here.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod access;
mod client;
mod comparisons;
mod contract;
mod conversions;
mod durability;
mod events;
mod formats;
mod in_process;
mod jobs;
mod kept_images;
mod keys;
mod lifecycle;
mod load;
mod operating;
mod operators;
mod output;
mod ownership;
mod parameters;
mod pictures;
mod presets;
mod program;
mod rejected_pictures;
mod server;
mod sizes;
mod terrain;
mod transport;
mod uploads;
mod weights;
