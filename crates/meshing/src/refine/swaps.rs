//! Swaps: the cheapest vertices go where they are of most use.
//!
//! Relocation reaches places nearby only. A swap takes out the vertex whose removal raises the
//! error least and inserts it in one of the worst faces, at the place that lowers the error most
//! among a few; it stays where both together, computed one after the other on the mesh as it then
//! is, lower the error. Otherwise the vertex goes back, which restores the mesh exactly.

use super::measured_mesh::{FaceMeasure, MeasuredMesh};
use super::openings::{Opening, Openings};
use super::relocation::Relocation;
use super::removal_costs::RemovalCosts;
use crate::control::{Cancelled, Control, Stage};

/// Swaps that fail one after the other before a round of them ends.
const MOST_FAILURES: usize = 32;

/// Swaps vertices with openings in `face_count` of the worst faces while that lowers the error.
///
/// # Errors
/// When the control cancels.
pub(crate) fn swap_vertices<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    face_count: usize,
    relocation: &mut Relocation,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let mut costs = RemovalCosts::new(mesh, control)?;
    let Some((least, _)) = costs.cheapest() else { return Ok(()) };
    let mut openings = Openings::find(mesh, face_count, least, control)?;
    let mut failed = 0;
    while let (Some(opening), Some((cost, vertex))) = (openings.pop(mesh), costs.cheapest()) {
        control.poll(Stage::Refine, 0, 1)?;
        if opening.gain <= cost || failed == MOST_FAILURES {
            break;
        }
        let swapped = swap(mesh, vertex, opening);
        openings.forget_fan(mesh);
        if !swapped {
            failed += 1;
            continue;
        }
        failed = 0;
        let around = [mesh.left(), mesh.reached(), &[vertex]].concat();
        relocation.note(&around);
        costs.update(mesh, &around);
        openings.look_into_fan(mesh, cost);
    }
    Ok(())
}

/// Moves a vertex to an opening if that lowers the error; else it stays where it is.
fn swap<M: FaceMeasure>(mesh: &mut MeasuredMesh<M>, vertex: u32, opening: Opening) -> bool {
    let from = mesh.triangulation.points[vertex as usize];
    let (cost, slot) = mesh.remove(vertex);
    let pays = mesh.insertion_change(opening.place, slot, -cost).is_some();
    mesh.insert(vertex, if pays { opening.place } else { from }, slot);
    pays
}
