//! The crate against its description: invariants of every mesh, and equality with the slow second
//! implementation in `twin` on small pictures, where degenerate cases are common.

// Helpers of tests may fail as tests do.
#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used)]

#[path = "../twin/mod.rs"]
mod twin;

mod control_and_limits;
mod density_and_points;
mod equivalences;
mod few_features;
mod greedy_removal;
mod holes;
mod mesh_invariants;
mod pictures;
mod preferred_directions;
mod refinement;
mod thin_and_dense;
mod threads;
