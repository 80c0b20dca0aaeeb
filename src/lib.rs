//! The service: pictures in, triangle meshes out, over HTTP.
//!
//! It adapts and never computes: `pixmesh_codec` reads and writes the bytes, `pixmesh_meshing`
//! makes the meshes, `pixmesh_engine` admits and runs the tasks, and `pixmesh_jobs` keeps those that
//! outlive the process. In reading order:
//!
//! | module | what |
//! |---|---|
//! | [`config`] | every setting: flag, environment variable, default and check |
//! | [`server`] | the two listeners, their timeouts, and the graceful stop |
//! | [`lifecycle`], [`service`] | whether the service takes requests; what the handlers share |
//! | [`routes`] | the route table, the order of the layers, one module per resource |
//! | [`extract`] | from a request to typed values: upload, accepted format, key, preference |
//! | [`access`] | keys, and how many requests each may send |
//! | [`problem`] | every refusal, as RFC 9457 has it |
//! | [`telemetry`] | the log and the metrics |
//! | [`doctor`] | whether the service would work here |
//! | [`health`] | asks a running service whether it is ready |
//! | [`data`] | copies and checks the data folder |
//! | [`operate`] | operates the jobs of a running service |
//!
//! A request flows one way: `extract::upload` receives it, the engine reads the picture's header and
//! says what the task costs, its scheduler gives a ticket, and a worker runs the task with it. What a
//! client can get wrong is refused before the scheduler, so that such an answer never waits for work.

#![cfg(feature = "service")]

pub mod access;
pub mod config;
pub mod data;
pub mod doctor;
pub mod extract;
pub mod health;
pub mod lifecycle;
pub mod operate;
pub mod problem;
pub mod routes;
pub mod server;
pub mod service;
pub mod telemetry;
