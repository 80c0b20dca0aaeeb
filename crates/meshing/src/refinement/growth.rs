//! Growth: the mesh gets more vertices, relocates them, and loses as many again.
//!
//! This leaves a local minimum of relocation, where no single move lowers the error. If the error
//! is not lower at the end, all of it is undone.

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::dynamic_mesh::MeasuredMesh;
use crate::dynamic_mesh::patches::Cuts;
use crate::face_error::FaceMeasure;
use crate::refinement::batch_removal::remove_in_batches;
use crate::refinement::insertion_candidates::find_candidates;
use crate::refinement::relocation::{Relocation, Search};

/// Faces searched for insertion candidates, for each vertex to be inserted.
const FACES_PER_VERTEX: usize = 3;

/// Inserts `percent` of the vertices, relocates, removes as many, relocates; or undoes all of it.
pub(crate) fn grow_and_shrink<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    percent: usize,
    search: Search,
    relocation: &mut Relocation,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let (before, relocation_before) = (mesh.triangulation.copy(control)?, relocation.clone());
    // A predicted search leaves vertices at the boundaries of patches to the last pass.
    let (cuts, last_passes) = match search {
        Search::Predicted => (&[Cuts::Straight][..], 1),
        Search::Exhaustive => (&Cuts::BOTH[..], 2),
    };
    let count = (mesh.triangulation.vertex_count() * percent).div_ceil(100);
    let inserted = insert_best(mesh, count, relocation, control)?;
    relocation.pass(mesh, search, cuts, control)?;
    remove_in_batches(mesh, inserted, |neighbours| relocation.mark_outdated(neighbours), control)?;
    for _ in 0..last_passes {
        relocation.pass(mesh, search, &Cuts::BOTH, control)?;
    }
    if mesh.triangulation.total_error >= before.total_error {
        mesh.triangulation = before;
        *relocation = relocation_before;
    }
    Ok(())
}

fn insert_best<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    count: usize,
    relocation: &mut Relocation,
    control: &dyn Control,
) -> Result<usize, Cancelled> {
    let candidates = find_candidates(mesh, count * FACES_PER_VERTEX, control)?;
    let (mut inserted, mut poller) = (0, Poller::new(control, Stage::Refine, 0, 1));
    for candidate in candidates {
        poller.poll()?;
        if inserted == count {
            break;
        }
        if let Some(vertex) = candidate.insert(mesh, &mut poller)? {
            relocation.add(vertex);
            relocation.mark_outdated(mesh.new_link());
            inserted += 1;
        }
    }
    Ok(inserted)
}
