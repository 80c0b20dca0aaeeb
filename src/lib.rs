//! The service: pictures in, triangle meshes out, over HTTP.
//!
//! It adapts and never computes: `pixmesh_codec` reads and writes the bytes, `pixmesh_meshing`
//! makes the meshes. In reading order:
//!
//! | module | what |
//! |---|---|
//! | [`config`] | every setting: flag, environment variable, default and check |
//! | [`server`] | the two listeners, their timeouts, and the graceful stop |
//! | [`routes`] | the route table, the order of the layers, one module per resource |
//! | [`extract`] | from a request to typed values: upload, parameters, accepted format |
//! | [`access`] | keys, and how many requests each may send |
//! | [`admission`] | what may run now, what waits, and what is turned away at once |
//! | [`pool`] | the threads that run tasks, with deadline and cancellation |
//! | [`pipeline`] | from an upload to the bytes of the answer |
//! | [`jobs`] | work that is kept until it is done, whatever happens to the process |
//! | [`digest`] | SHA-256, by which blobs and answers are named |
//! | [`problem`] | every refusal, as RFC 9457 has it |
//! | [`telemetry`] | the log and the metrics |
//! | [`doctor`] | whether the service would work here |
//! | [`health`] | asks a running service whether it is ready |
//!
//! A request flows one way: `extract::upload` receives it, the codec probes the picture's header,
//! [`admission`] gives a ticket, and [`pool`] runs [`pipeline`] with it. What a client can get wrong
//! is refused before admission, so that such an answer never waits for work.

pub mod access;
pub mod admission;
pub mod config;
pub mod digest;
pub mod doctor;
pub mod extract;
pub mod health;
pub mod jobs;
pub mod pipeline;
pub mod pool;
pub mod problem;
pub mod routes;
pub mod server;
pub mod telemetry;
