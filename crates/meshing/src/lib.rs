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
//! use pixmesh_meshing::{Image, Method, Target, Unattended, generate, rasterize};
//!
//! // A 64 by 64 picture of a bright disc, 8 bits, one component.
//! let disc = |x: i32, y: i32| if (x - 32).pow(2) + (y - 32).pow(2) < 400 { 230 } else { 20 };
//! let samples = (0..64).flat_map(|y| (0..64).map(move |x| disc(x, y))).collect();
//! let image = Image::new(64, 64, 8, vec![samples])?;
//!
//! let parameters = Method::Mgprfs.parameters(Target::Density(4.0));
//! let model = generate(&image, &parameters, &Unattended)?;
//! assert_eq!(model.mesh.points().len(), 163); // 4 % of 4096
//! assert!(model.fidelity.psnr_db() > 24.0);
//!
//! let rebuilt = rasterize(&model.mesh, &Unattended)?;
//! assert_eq!(rebuilt.width(), 64);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! In reading order: [`Image`] states the coordinate convention; `filter` and `significance`, for
//! the thesis's own filter `second_derivatives`, give the [`Density`]; `threshold_search`,
//! `floyd_steinberg` and `error_diffusion` choose [`sample_points`] of it; `predicates`
//! ([`orientation`], [`in_circle`]) and [`triangulate`] connect them. `simplify` removes points, in
//! the order of `removal_queue`, from the `star`s of all vertices, numbered in `tile_order`: for
//! each one `removal` fills its `hole`, remembered in `hole_memory`, and asks `face_error` for the
//! errors of the new faces, which `error_metric` defines and `face_rows`, `interpolant`,
//! `small_face` (with its rows, planes and samples) and `flat_areas` compute; where neighbours are few,
//! `small_removal` does the same in less time. `tiled_removal` is the same tile by tile, for large
//! images. [`rasterize`] rebuilds the picture, [`Fidelity`] and
//! [`structural_similarity`] say how close it is; [`generate`] is all of it in order, as
//! [`Parameters`] say, whose values are in `choices` and whose named sets, the methods, in
//! [`Method`]. Where the [`Control`] allows several threads, `parallel` shares out what is
//! independent and `foresight` prepares removals ahead of their turn.
//!
//! `search` makes meshes of several sizes where a quality is asked for, and `largest_error` follows
//! removals up to the first that breaks a bound. `refine` goes beyond the thesis: it moves the
//! vertices that are left, where `small_face_forecast` promises a gain. Other ways: [`FlatColors`] gives each face one colour, `greedy_insertion`
//! chooses points in a moment, [`Progression`] holds every size of a mesh, and `sensitivity` says which points
//! matter to the structural similarity.

mod choices;
mod control;
mod density;
mod error_diffusion;
mod error_metric;
mod face_error;
mod face_rows;
mod filter;
mod flat_areas;
mod flat_color;
mod floyd_steinberg;
mod foresight;
mod generate;
mod greedy_insertion;
mod hole;
mod hole_memory;
mod image;
mod interpolant;
mod largest_error;
mod luma;
mod mesh;
mod method;
mod metrics;
mod parallel;
mod parameters;
mod predicates;
mod progressive;
mod rasterize;
mod refine;
mod removal;
mod removal_queue;
mod sample_points;
mod search;
mod second_derivatives;
mod sensitivity;
mod significance;
mod simplify;
mod small_face;
mod small_face_forecast;
mod small_face_plane;
mod small_face_rows;
mod small_face_samples;
mod small_removal;
mod ssim;
mod star;
mod threshold_search;
mod tile_order;
mod tiled_removal;
mod triangulation;
mod weighted_error;

pub use choices::{
    Boundary, Connectivity, ErrorMetric, Generator, Meshed, Parallel, Policy, PscTie,
    Reconstruction, Scan, Smoothing, SmoothingDirection, Startup, Values,
};
pub use control::{Cancelled, Control, OnThreads, Stage, Unattended};
pub use density::Density;
pub use flat_color::FlatColors;
pub use generate::{GenerateError, Model, generate};
pub use image::{Image, ImageError, MAX_SIDE};
pub use mesh::{Face, Mesh, MeshError, Point, Shape};
pub use method::Method;
pub use metrics::{Fidelity, ShapeMismatch};
pub use parameters::{
    ErrorBound, InitialSize, MAX_DENSITY, MAX_GAMMA, MAX_MEAN_ERROR, MAX_PSNR_DB,
    MAX_SMOOTHING_ORDER, MIN_DENSITY, MIN_SIZE, ParameterError, Parameters, Plan, Target,
};
pub use predicates::{in_circle, orientation};
pub use progressive::{Progression, ProgressionError};
pub use rasterize::rasterize;
pub use refine::schedule::MAX_EFFORT;
pub use sample_points::sample_points;
pub use simplify::Removal;
pub use ssim::structural_similarity;
pub use triangulation::triangulate;
