//! Triangle-mesh models of images.
//!
//! An image is approximated by a mesh of triangles whose vertices are some of its lattice points
//! and carry their samples; within each triangle every component is interpolated linearly.
//!
//! ```
//! use pixmesh_meshing::{Image, Method, Target, mesh_image, rasterize};
//!
//! // A bright disc of 8 bits; decoders give their rows from the top, too.
//! let disc = |x: i32, y: i32| if (x - 32).pow(2) + (y - 32).pow(2) < 400 { 230 } else { 20 };
//! let samples = (0..64).flat_map(|y| (0..64).map(move |x| disc(x, y))).collect();
//! let image = Image::from_top_down(64, 64, 8, vec![samples])?;
//!
//! let parameters = Method::Mgprfs.parameters(Target::Percent(4.0));
//! let made = mesh_image(&image, &parameters, &())?;
//! assert_eq!(made.mesh.points().len(), 163); // 4 % of 4096
//! assert!(made.fidelity.psnr_db() > 24.0);
//!
//! let rebuilt = rasterize(&made.mesh, &())?;
//! assert_eq!(rebuilt.width(), 64);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The result depends on the image, the parameters and the crate's version alone: predicates are
//! exact integers and errors exact sums. The crate does no input or output and keeps no global
//! state. A [`Control`] receives progress, cancels, and sets the number of threads.
//!
//! # Modules
//!
//! ```text
//! image ─▶ density ─▶ points ─▶ triangulation ─▶ removal ─▶ refinement ─▶ model ─▶ quality
//!
//! points (greedy insertion), refinement and model (progression)
//!     ─▶ dynamic_mesh ─▶ face_error ─▶ triangulation (holes, predicates) ─▶ image
//! ```
//!
//! The first line is the flow of data through `pipeline`, the others are dependencies.
//!
//! - [`alpha`]: premultiplied colours.
//! - `image`: samples, lattice points, the coordinate convention; `convert`: the crate `image`.
//! - `control`: reports and cancellation; `progress`: the reports of a whole run; `parallel`: work
//!   shared among threads.
//! - [`parameters`]: what a caller chooses, its bounds, and the named [`Method`]s.
//! - `density`: second derivatives, significance, and the sampling [`Density`].
//! - `points`: initial points by error diffusion, on a grid, at random, by insertion of a number of
//!   points or until a bound holds, or by error diffusion in a reduced picture.
//! - `triangulation`: preferred-directions Delaunay triangulation and exact predicates.
//! - `face_error`: the error of a triangle's interpolant against the image, by each metric and
//!   within a bound.
//! - `dynamic_mesh`: a triangulation with the errors of its faces, for vertices that move.
//! - `removal`: greedy point removal; `refinement`: vertices moved and exchanged, edges flipped.
//! - `model`: the [`Mesh`], its picture and surface, flat colours and what is seen of it, [`Buffers`] and
//!   [`Progression`].
//! - `quality`: [`Fidelity`] and structural similarity.
//! - `guide`, `search`, `pipeline`: all of it in order; `error`; `serialize`: serde.
//!
//! The [`glossary`] explains the terms.
//!
//! # Literature
//!
//! "Effective Techniques for Generating Delaunay Mesh Models of Single- and Multi-Component
//! Images" (thesis, University of Victoria) specifies the methods. Their parts are cited where they
//! are: Robert W. Floyd and Louis Steinberg, 1976 (error diffusion); Laurent Demaret and Armin
//! Iske, 2004 (greedy removal); Zhou Wang et al., 2004 (structural similarity).

pub mod alpha;
mod control;
#[cfg(feature = "image")]
mod convert;
mod density;
mod dynamic_mesh;
mod error;
mod face_error;
mod guide;
mod image;
mod model;
mod parallel;
pub mod parameters;
mod pipeline;
mod points;
mod progress;
mod quality;
mod refinement;
mod removal;
mod search;
#[cfg(feature = "serde")]
mod serialize;
mod triangulation;
#[cfg(test)]
mod tuning;

pub use control::{Cancelled, Control, OnThreads, Stage};
pub use density::Density;
pub use error::MeshingError;
pub use image::{Image, ImageError, MAX_POINTS, MAX_SIDE, Point, Shape, ShapeMismatch};
pub use model::buffers::Buffers;
pub use model::mesh::{Mesh, MeshError};
pub use model::progression::{Progression, ProgressionError};
pub use model::rasterize::rasterize;
pub use model::surface::visit_surface;
pub use parameters::{Method, ParameterError, Parameters, Target};
pub use pipeline::{Approximation, mesh_image};
pub use points::sample_points;
pub use quality::fidelity::Fidelity;
pub use quality::ssim::structural_similarity;
pub use removal::Removal;
pub use triangulation::predicates::{in_circle, orientation};
pub use triangulation::{Face, triangulate, triangulate_with};

#[cfg(doc)]
#[doc = include_str!("glossary.md")]
pub mod glossary {}

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
