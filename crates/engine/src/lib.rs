//! Meshing tasks: decode an image, mesh it, write the mesh, within a budget of threads and memory.
//!
//! A picture's bytes in, a mesh's bytes out:
//!
//! ```
//! use pixmesh_engine::{Context, Format, Limits, ParameterSet, mesh};
//!
//! # let file = b"P5 4 4 255\n0123456789abcdef".to_vec();
//! let options = ParameterSet::of_query(Some("method=mgprfs&density=50"))?.finish()?;
//! let made = mesh(file.into(), &options, Format::Svg, &Limits::default(), &Context::default())?;
//! println!("{} vertices, {:.2} dB", made.vertices, made.psnr_db);
//! assert!(made.bytes.starts_with(b"<svg"));
//! # Ok::<(), pixmesh_engine::EngineError>(())
//! ```
//!
//! A server puts a scheduler before it: [`MeshTask`] says what a mesh costs, [`Scheduler::admit`] waits
//! for a worker and memory, and [`Workers::run`] runs the task on a thread of its own.
//!
//! | module | what |
//! |---|---|
//! | [`params`] | the parameters of a mesh: names, values, ranges, and their parser |
//! | [`task`] | what a task costs: memory at its peak, and effort |
//! | [`scheduler`] | fair shares of worker slots and memory; a queue measured in seconds |
//! | [`context`] | cancellation, deadline, progress and stage timings of one task |
//! | [`workers`] | the threads that run tasks |
//! | [`pipeline`] | decode, mesh, encode; convert, resize and compare |
//! | [`error`] | why a task is refused, stopped or failed |
//! | [`owner`], [`digest`], [`telemetry`] | whom a task is for; SHA-256; what is counted |
//!
//! `pipeline → context → scheduler → task → params → error`: no module uses one to its left. Nothing
//! here knows of HTTP or of stored jobs.

#![cfg_attr(
    not(feature = "scheduling"),
    allow(dead_code, unused_imports, reason = "what only the scheduler counts and weighs")
)]

pub mod context;
pub mod digest;
pub mod error;
pub mod owner;
pub mod params;
pub mod pipeline;
#[cfg(feature = "scheduling")]
pub mod scheduler;
pub mod task;
pub mod telemetry;
#[cfg(feature = "scheduling")]
pub mod workers;

pub use context::Context;
pub use error::{EngineError, InputError};
pub use owner::Owner;
pub use params::{MeshOptions, ParameterSet};
pub use pipeline::{Answer, mesh};
pub use pixmesh_codec::{Format, Limits};
#[cfg(feature = "scheduling")]
pub use scheduler::Scheduler;
pub use task::{MeshTask, Weighed};
#[cfg(feature = "scheduling")]
pub use workers::Workers;
