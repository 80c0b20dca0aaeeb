//! Growth: for a while the mesh has more vertices than it may keep.
//!
//! The openings worth most are filled, all vertices around them find their new places, then the
//! cheapest vertices go. Where relocation and swaps are stuck, because no single vertex can gain by
//! moving, this goes over the hill. It may end higher than it began, and is undone then.

use crate::control::{Cancelled, Control, Stage};
use crate::dynamic_mesh::{FaceMeasure, MeasuredMesh};
use crate::refinement::insertion_candidates::Openings;
use crate::refinement::relocation::Relocation;
use crate::refinement::removal_costs::RemovalCosts;
use crate::removal::Removal;

/// In which faces a growing mesh looks for openings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Among {
    /// Those there at first: nearly as good, as the vertices find better places afterwards, and for a
    /// third of the time.
    First,
    /// Those that growth makes too.
    All,
}

/// Inserts up to `count` vertices, each at the best opening in one of the faces that are then
/// there, and tells how many.
///
/// # Errors
/// When the control cancels.
pub(crate) fn grow<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    (count, among): (usize, Among),
    relocation: &mut Relocation,
    control: &dyn Control,
) -> Result<usize, Cancelled> {
    let mut openings = Openings::find(mesh, count * 3, 0, control)?;
    for grown in 0..count {
        control.poll(Stage::Refine, 0, 1)?;
        let Some(opening) = openings.pop(mesh) else { return Ok(grown) };
        let vertex = mesh.add_vertex(opening.place, opening.slot);
        relocation.add(vertex);
        relocation.note(mesh.reached());
        openings.forget_fan(mesh);
        if among == Among::All {
            openings.look_into_fan(mesh, 0);
        }
    }
    Ok(count)
}

/// Removes `count` vertices, each time the cheapest, and tells which in order; `note` hears of the
/// vertices around each.
///
/// # Errors
/// When the control cancels.
pub(crate) fn shrink<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    count: usize,
    mut note: impl FnMut(&[u32]),
    control: &dyn Control,
) -> Result<Vec<Removal>, Cancelled> {
    let mut costs = RemovalCosts::new(mesh, control)?;
    let mut removals = Vec::with_capacity(count);
    while removals.len() < count {
        control.poll(Stage::Refine, 0, 1)?;
        let Some((change, vertex)) = costs.cheapest() else { break };
        costs.remove_cheapest();
        let point = mesh.triangulation.points[vertex as usize];
        mesh.remove(vertex);
        let around = mesh.left().to_vec();
        note(&around);
        costs.update(mesh, &around);
        removals.push(Removal { point, change });
    }
    Ok(removals)
}
