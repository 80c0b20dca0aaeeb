//! Relocation: each vertex in turn moves to the position nearby where the error is least.
//!
//! This is coordinate descent on the positions of the vertices. A move is a removal and an
//! insertion, so the mesh stays the preferred-directions Delaunay triangulation of its points. Each
//! move lowers the measured error, and a pass visits only vertices whose faces have changed since
//! their last visit. In a large mesh it visits most vertices patch by patch, on all threads.

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::dynamic_mesh::MeasuredMesh;
use crate::dynamic_mesh::half_edges::DynamicTriangulation;
use crate::dynamic_mesh::moves::{Acceptance, Outcome};
use crate::dynamic_mesh::patches::{Cuts, Partition, PatchIndices};
use crate::face_error::FaceMeasure;
use crate::image::Point;
use crate::parallel::share_out;
use crate::removal::tile_order::tile_order;
use crate::triangulation::NONE;
use std::sync::atomic::{AtomicUsize, Ordering};

const CANDIDATES: usize = 3;
/// A predicted search tries positions with a predicted rise of the error below this part of the
/// error of the vertex's faces: predictions are rough for faces of some ten pixels.
const TOLERANCE: f32 = 0.5;
/// Least number of vertices of a mesh that is divided into patches.
const LEAST_DIVIDED: usize = 256;
/// Least number of vertices of a patch where there are more than two: the smaller the patches, the
/// more vertices are at their boundaries.
const LEAST_PATCH: usize = 2048;
/// Pixels per vertex up to which a predicted search skips vertices without prediction: their faces
/// are large there because the picture has no detail.
const DENSE: usize = 1024;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Search {
    /// Tries the best-predicted positions of a 5 x 5 window and takes the first that lowers the
    /// error. Without a prediction, tries the 8 neighbours, or skips the vertex in dense meshes.
    Predicted,
    /// Tries all positions of a 5 x 5 window and takes the best.
    Exhaustive,
}

#[derive(Clone)]
pub(crate) struct Relocation {
    /// Whether the faces of each vertex have changed since its last visit.
    pub(super) is_outdated: Vec<bool>,
    /// Whether the current pass has yet to visit each vertex.
    is_pending: Vec<bool>,
    /// The vertices tile by tile, by their first positions.
    order: Vec<u32>,
    skips_unpredicted: bool,
    candidates: Vec<(f32, Point)>,
}

impl Relocation {
    pub(crate) fn new<M: FaceMeasure>(
        mesh: &MeasuredMesh<M>,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let (points, (width, height)) = (&mesh.triangulation.points, mesh.triangulation.size());
        let count = points.len();
        let poller = &mut Poller::new(control, Stage::Refine, 0, 1);
        Ok(Self {
            is_outdated: vec![true; count],
            is_pending: vec![true; count],
            order: tile_order(points, (width, height), poller)?,
            skips_unpredicted: mesh.has_model() && width * height <= DENSE * count,
            candidates: Vec::new(),
        })
    }

    pub(crate) fn add(&mut self, vertex: u32) {
        self.is_outdated.push(true);
        self.is_pending.push(true);
        self.order.push(vertex);
    }

    pub(crate) fn mark_outdated(&mut self, vertices: &[u32]) {
        for &v in vertices {
            self.is_outdated[v as usize] = true;
        }
    }

    /// Visits each outdated vertex inside a patch once, in one partition for each of `cuts`. Then
    /// an exhaustive search visits all others, on one thread. A small mesh has no patches: all
    /// vertices are visited. The result does not depend on the number of threads.
    pub(crate) fn pass<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        search: Search,
        cuts: &[Cuts],
        control: &dyn Control,
    ) -> Result<(), Cancelled> {
        let halvings = halvings(mesh.triangulation.vertex_count());
        if halvings > 0 {
            for &cuts in cuts {
                let partition = Partition::new(&mesh.triangulation, cuts, halvings, control)?;
                let first = if cuts == Cuts::Straight { 0 } else { partition.patches.len() };
                self.visit_patches(mesh, search, &partition, first, control)?;
            }
        }
        if halvings == 0 || search == Search::Exhaustive {
            self.visit_in_order(mesh, search, control)?;
        }
        self.is_pending.fill(true);
        Ok(())
    }

    /// Visits the pending vertices inside patches. Polls report `done` patches and more.
    fn visit_patches<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        search: Search,
        partition: &Partition,
        done: usize,
        control: &dyn Control,
    ) -> Result<(), Cancelled> {
        let pending = self.order.iter().copied().filter(|&v| self.is_pending[v as usize]);
        let orders = partition.by_patch(pending);
        let (count, done) = (orders.len(), AtomicUsize::new(done));
        let mut visited: Vec<Option<(MeasuredMesh<M>, Self)>> = Vec::new();
        visited.resize_with(count, || None);
        let visit = |(number, (result, order)): (usize, (&mut Option<_>, _)),
                     control: &dyn Control| {
            control.poll(Stage::Refine, done.fetch_add(1, Ordering::Relaxed), 2 * count)?;
            let mut patch = mesh.patch(partition, number);
            let mut own = self.of_patch(&partition.patches[number], &patch.triangulation, order);
            own.visit_in_order(&mut patch, search, control)?;
            *result = Some((patch, own));
            Ok(())
        };
        share_out(visited.iter_mut().zip(orders).enumerate(), control, visit)?;
        for (indices, result) in partition.patches.iter().zip(visited) {
            control.poll(Stage::Refine, 0, 1)?;
            let (patch, own) = result.ok_or(Cancelled)?;
            mesh.triangulation.put_patch(indices, &patch.triangulation);
            for (i, &v) in indices.vertices.iter().enumerate() {
                self.is_outdated[v as usize] = own.is_outdated[i];
                self.is_pending[v as usize] = own.is_pending[i];
            }
        }
        Ok(())
    }

    /// The state of a patch, to visit those vertices in `order` that are in its mesh.
    fn of_patch(
        &self,
        indices: &PatchIndices,
        patch: &DynamicTriangulation,
        mut order: Vec<u32>,
    ) -> Self {
        order.retain(|&v| patch.outgoing[v as usize] != NONE);
        let of_patch =
            |whole: &[bool]| indices.vertices.iter().map(|&v| whole[v as usize]).collect();
        Self {
            is_outdated: of_patch(&self.is_outdated),
            is_pending: of_patch(&self.is_pending),
            order,
            skips_unpredicted: self.skips_unpredicted,
            candidates: Vec::new(),
        }
    }

    /// Visits the pending vertices in order. Those that a patch boundary holds stay pending.
    fn visit_in_order<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        search: Search,
        control: &dyn Control,
    ) -> Result<(), Cancelled> {
        let (near, far) = (window(1), window(2));
        let poller = &mut Poller::new(control, Stage::Refine, 0, 1);
        for i in 0..self.order.len() {
            let vertex = self.order[i];
            if !std::mem::take(&mut self.is_pending[vertex as usize])
                || !self.is_outdated[vertex as usize]
                || !mesh.triangulation.is_movable(vertex)
            {
                continue;
            }
            poller.poll()?;
            let outcome = match search {
                _ if !mesh.begin_move(vertex) => Outcome::LeavesPatch,
                Search::Predicted => self.move_as_predicted(mesh, vertex, &near, &far, poller)?,
                Search::Exhaustive => move_to_best(mesh, vertex, &far, poller)?,
            };
            match outcome {
                Outcome::Moved => {
                    self.mark_outdated(mesh.link());
                    self.mark_outdated(mesh.new_link());
                }
                Outcome::Stayed => self.is_outdated[vertex as usize] = false,
                Outcome::LeavesPatch => self.is_pending[vertex as usize] = true,
            }
        }
        Ok(())
    }

    fn move_as_predicted<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        vertex: u32,
        near: &[(i32, i32)],
        far: &[(i32, i32)],
        poller: &mut Poller<'_>,
    ) -> Result<Outcome, Cancelled> {
        let candidates = &mut self.candidates;
        let is_predicted = mesh.find_candidates(far, CANDIDATES, TOLERANCE, candidates, poller)?;
        if !is_predicted && !self.skips_unpredicted {
            return move_to_best(mesh, vertex, near, poller);
        }
        if self.candidates.is_empty() {
            return Ok(Outcome::Stayed);
        }
        let positions = self.candidates.iter().map(|&(_, position)| position);
        mesh.move_vertex(positions, Acceptance::First, poller)
    }
}

fn move_to_best<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    vertex: u32,
    offsets: &[(i32, i32)],
    poller: &mut Poller<'_>,
) -> Result<Outcome, Cancelled> {
    let from = mesh.triangulation.points[vertex as usize];
    let positions = offsets.iter().map(|&(dx, dy)| Point::new(from.x + dx, from.y + dy));
    mesh.move_vertex(positions, Acceptance::Best, poller)
}

/// The offsets in columns and rows to all points of a square window but its centre, the nearest
/// first, then by row, then by column.
pub(super) fn window(radius: i32) -> Vec<(i32, i32)> {
    let side = || -radius..=radius;
    let mut offsets: Vec<(i32, i32)> =
        side().flat_map(|dy| side().map(move |dx| (dx, dy))).collect();
    offsets.retain(|&offset| offset != (0, 0));
    offsets.sort_by_key(|&(dx, dy)| (dx * dx + dy * dy, dy, dx));
    offsets
}

/// How often a mesh of this many vertices is halved to make patches.
fn halvings(vertex_count: usize) -> u32 {
    let patches = (vertex_count / LEAST_PATCH).checked_ilog2().unwrap_or(0);
    patches.max(u32::from(vertex_count >= LEAST_DIVIDED))
}

#[cfg(test)]
mod tests;
