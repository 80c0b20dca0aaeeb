//! Triangle-mesh models of images: the kernels.
//!
//! An image, a grid of integer samples, is approximated by a mesh of triangles whose vertices are
//! some of its lattice points and carry their samples; within each triangle every component is
//! interpolated linearly. Few vertices, well placed, give a picture close to the original. The
//! methods are those of "Effective Techniques for Generating Delaunay Mesh Models of Single- and
//! Multi-Component Images" (thesis, University of Victoria): sample points are picked by error
//! diffusion of a second-derivative density ([`Method::Med`]), and a mesh that starts with four
//! times as many is simplified by greedy point removal ([`Method::Mgprfs`]).
//!
//! Everything is deterministic: predicates are exact integers, errors are exact sums, and the
//! result does not depend on the machine. The crate does no input or output and has no global
//! state; a [`Control`] hears of progress and may cancel.
//!
//! ```
//! use pixmesh_meshing::{Image, Method, Target, mesh_image, rasterize};
//!
//! // A 64 by 64 picture of a bright disc, 8 bits, one component.
//! let disc = |x: i32, y: i32| if (x - 32).pow(2) + (y - 32).pow(2) < 400 { 230 } else { 20 };
//! let samples = (0..64).flat_map(|y| (0..64).map(move |x| disc(x, y))).collect();
//! let image = Image::from_bottom_up(64, 64, 8, vec![samples])?;
//!
//! let parameters = Method::Mgprfs.parameters(Target::Percent(4.0));
//! let model = mesh_image(&image, &parameters, &())?;
//! assert_eq!(model.mesh.points().len(), 163); // 4 % of 4096
//! assert!(model.fidelity.psnr_db() > 24.0);
//!
//! let rebuilt = rasterize(&model.mesh, &())?;
//! assert_eq!(rebuilt.width(), 64);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Modules
//!
//! ```text
//! image ─▶ density ─▶ points ─▶ triangulation ─▶ removal ─▶ refinement ─▶ model ─▶ quality
//!
//! points (greedy insertion), removal (largest error), refinement and model (progression)
//!     ─▶ dynamic_mesh ─▶ face_error ─▶ triangulation (holes, predicates) ─▶ image
//! ```
//!
//! The first line is the flow of data through `pipeline`, the others tell what the engines rest on.
//!
//! - `image`: samples, lattice points and the coordinate convention; `control`: progress and
//!   cancellation; `parallel`: work shared out to threads.
//! - `parameters`: what a caller chooses, its bounds, and the named [`Method`]s.
//! - `density`: second derivatives, significance, and the sampling [`Density`].
//! - `points`: initial sample points by error diffusion, on a grid, at random or by insertion.
//! - `triangulation`: preferred-directions Delaunay triangulation and exact predicates.
//! - `face_error`: the error of a triangle's interpolant against the image, by each metric.
//! - `dynamic_mesh`: a triangulation whose vertices move, enter and leave, with its faces' errors.
//! - `removal`: greedy point removal.
//! - `refinement`: vertices moved and exchanged; edges flipped and values fitted.
//! - `model`: the [`Mesh`], the picture rebuilt from it, its [`Progression`] and [`FlatColors`].
//! - `quality`: [`Fidelity`] and structural similarity.
//! - `search`, `pipeline`: all of it in order.

mod control;
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
mod quality;
mod refinement;
mod removal;
mod search;
mod triangulation;
#[cfg(test)]
mod tuning;

pub use control::{Cancelled, Control, OnThreads, Stage};
pub use density::Density;
pub use error::MeshingError;
pub use image::{Image, ImageError, MAX_SIDE, Point, Shape, ShapeMismatch};
pub use model::flat_color::FlatColors;
pub use model::mesh::{Mesh, MeshError};
pub use model::progression::{Progression, ProgressionError};
pub use model::rasterize::rasterize;
pub use parameters::{Method, ParameterError, Parameters, Target};
pub use pipeline::{Approximation, mesh_image};
pub use points::sample_points;
pub use quality::fidelity::Fidelity;
pub use quality::ssim::structural_similarity;
pub use removal::Removal;
pub use triangulation::predicates::{in_circle, orientation};
pub use triangulation::{Face, triangulate};
