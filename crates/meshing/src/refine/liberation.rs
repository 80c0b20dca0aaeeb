//! Meshes beyond the model of the thesis: edges that are not Delaunay, values that are not the
//! picture's samples, and moves of vertices with both.
//!
//! Edge flips by the error of the approximation: Nira Dyn, David Levin and Samuel Rippa, "Data
//! dependent triangulations for piecewise linear interpolation", 1990.

use super::fitted_values::fit_values;
use super::valued_mesh::ValuedMesh;
use super::vertex_moves::{Freedom, VertexMoves};
use super::{PAYS, Part};
use crate::control::{Cancelled, Control, Stage};
use std::sync::atomic::AtomicUsize;

/// Rounds where vertices do not move.
const ROUNDS_WITHOUT_MOVES: usize = 4;

/// Rounds of moves for each level of effort.
const ROUNDS_PER_EFFORT: usize = 3;

/// Looks at each vertex in a round at most this often.
const PASSES: usize = 3;

/// Flips edges, fits values and, with an effort over 0, moves vertices, round after round until one
/// takes off less than a little of the error. No step raises the error.
///
/// # Errors
/// When the control cancels.
pub(crate) fn liberate(
    mesh: &mut ValuedMesh<'_>,
    freedom: Freedom,
    effort: u8,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let rounds = match effort {
        0 => ROUNDS_WITHOUT_MOVES,
        _ => ROUNDS_PER_EFFORT * usize::from(effort),
    };
    let mut moves = VertexMoves::new(mesh.triangulation.points.len(), freedom);
    for done in 0..rounds {
        let control = Part { control, done, count: rounds, reached: AtomicUsize::new(0) };
        control.poll(Stage::Refine, 0, 1)?;
        let before = mesh.total_error;
        if freedom.connectivity {
            mesh.flip_edges();
        }
        if freedom.values {
            fit_values(mesh, &control)?;
        }
        if effort > 0 {
            moves.restart();
            for _ in 0..PASSES {
                moves.pass(mesh, &control)?;
            }
        }
        if ((before - mesh.total_error) as f64) < PAYS * before as f64 {
            break;
        }
    }
    Ok(())
}
