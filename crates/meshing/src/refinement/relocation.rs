//! Relocation: each vertex in turn goes to the place nearby where the error is least.
//!
//! Coordinate descent on the places of the vertices. Moving a vertex is removal and insertion, so
//! the mesh stays the preferred-directions Delaunay triangulation of its points; every place is
//! scored by the true change of the error over the faces that change. A vertex is looked at again
//! only when the faces around it have changed since. Each move lowers the error, so the passes end.
//!
//! A thorough look tries every place of a window. A foresighted one tries the few that the
//! derivatives of the error promise most from, for a third of the time.

use crate::control::{Cancelled, Control, Stage};
use crate::dynamic_mesh::moves::{Choice, Moved};
use crate::dynamic_mesh::partition::{Cuts, Part, Partition};
use crate::dynamic_mesh::{FaceMeasure, MeasuredMesh};
use crate::image::Point;
use crate::parallel::share_out;
use crate::removal::vertex_order::tile_order;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Places that a foresighted look tries at most.
const PROMISING: usize = 3;

/// A place is tried when the error is foreseen to rise by less than this part of that of the faces
/// around: the forecast is rough where faces are of few points.
const DOUBT: f32 = 0.5;

/// A mesh of at least so many vertices is looked at in two patches: a smaller one is done before two
/// threads are.
const LEAST_PARTED: usize = 256;

/// Vertices of a patch of a mesh that has more than two: the smaller they are, the more vertices lie too
/// near to their edges.
const LEAST_PATCH: usize = 2048;

/// Where a mesh has a vertex for so many points at most, the few faces too large for a forecast lie in
/// areas without much error.
const DENSE: usize = 1024;

/// Looks at each vertex whose surroundings have changed, pass after pass.
#[derive(Clone)]
pub(crate) struct Relocation {
    /// Whether the surroundings of a vertex have changed since it was looked at.
    changed: Vec<bool>,
    /// Whether a vertex is still to be looked at in the pass at hand.
    is_due: Vec<bool>,
    /// The vertices tile by tile, as they were at first.
    order: Vec<u32>,
    /// Whether foresighted looks pass over vertices at faces too large for a forecast.
    passes_over_large: bool,
    /// What a foresighted look has found.
    promising: Vec<(f32, Point)>,
}

/// Which vertices a pass looks at, of a mesh that is large enough for patches. The others are left to
/// the passes that follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scope {
    /// Those well inside the patches.
    Inner,
    /// Those too that are well inside of patches cut askew to the first ones.
    Most,
    /// All; the last of them on one thread.
    All,
}

/// How to look for a better place for a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Look {
    /// The first that is better of the most promising places up to two columns and rows away; where
    /// none can be foreseen, the best of the 8 lattice points around, or none where few faces of the
    /// mesh are too large for that.
    Foresighted,
    /// The best of the 24 lattice points up to two columns and rows away.
    Thorough,
}

/// Columns and rows to go to the lattice points at most so many columns and rows away, nearer ones
/// first.
fn offsets(radius: i32) -> Vec<(i32, i32)> {
    let range = || -radius..=radius;
    let around = range().flat_map(|dy| range().map(move |dx| (dx, dy)));
    let squared = |(dx, dy): (i32, i32)| dx * dx + dy * dy;
    let mut offsets: Vec<(i32, i32)> = around.filter(|&offset| offset != (0, 0)).collect();
    offsets.sort_by_key(|&offset| (squared(offset), offset.1, offset.0));
    offsets
}

impl Relocation {
    /// Has every vertex looked at.
    pub(crate) fn new<M: FaceMeasure>(mesh: &MeasuredMesh<M>) -> Self {
        let points = &mesh.triangulation.points;
        let (width, height) = mesh.size();
        let (count, order) = (points.len(), tile_order(points, width, height));
        let changed = vec![true; count];
        Self {
            is_due: changed.clone(),
            changed,
            order,
            passes_over_large: mesh.has_model() && width * height <= DENSE * count,
            promising: Vec::new(),
        }
    }

    /// Has one more vertex, the next by number, looked at too.
    pub(crate) fn add(&mut self, vertex: u32) {
        self.changed.push(true);
        self.is_due.push(true);
        self.order.push(vertex);
    }

    /// Has every vertex looked at again, for another kind of look.
    pub(crate) fn restart(&mut self) {
        self.changed.fill(true);
    }

    /// Notes that the surroundings of vertices have changed.
    pub(crate) fn note(&mut self, vertices: &[u32]) {
        for &v in vertices {
            self.changed[v as usize] = true;
        }
    }

    /// Looks once at each vertex whose surroundings have changed, as far as they are in the scope, and
    /// tells how many there were: first at those well inside the patches of a large mesh, patch by patch
    /// on all threads, then in the same way at those inside of patches that are cut askew to the first
    /// ones, then at the others. What comes of it does not depend on the threads.
    pub(crate) fn pass<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        (look, scope): (Look, Scope),
        control: &dyn Control,
    ) -> Result<usize, Cancelled> {
        let halvings = halvings(mesh.vertex_count());
        let mut looked_at = 0;
        if halvings > 0 {
            looked_at = self.look_in_patches(mesh, look, (Cuts::Straight, halvings), control)?;
            if scope != Scope::Inner {
                looked_at +=
                    self.look_in_patches(mesh, look, (Cuts::Diagonal, halvings), control)?;
            }
        }
        if halvings == 0 || scope == Scope::All {
            let count = self.order.len();
            let poll = |i| control.poll(Stage::Refine, 2 * count + i, 3 * count);
            looked_at += self.look_in_order(mesh, look, &poll)?;
        }
        self.is_due.fill(true);
        Ok(looked_at)
    }

    /// Looks at the vertices inside of patches that are due, and has the others still to be looked at.
    fn look_in_patches<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        look: Look,
        (cuts, halvings): (Cuts, u32),
        control: &dyn Control,
    ) -> Result<usize, Cancelled> {
        let partition = Partition::new(&mesh.triangulation, cuts, halvings);
        let due = self.order.iter().copied().filter(|&v| self.is_due[v as usize]);
        let orders = partition.in_parts(due);
        let mut patches: Vec<Option<(MeasuredMesh<M>, Self, usize)>> = Vec::new();
        patches.resize_with(orders.len(), || None);
        let count = self.order.len();
        let (total, done) = (3 * count, AtomicUsize::new(cuts as usize * count));
        let work = |(number, (slot, order)): (usize, (&mut Option<_>, _)),
                    control: &dyn Control| {
            let poll = |i| control.poll(Stage::Refine, done.load(Ordering::Relaxed) + i, total);
            let (mut patch, is_inner) = mesh.patch(&partition, number as u32);
            let mut relocation = self.of_part(&partition.parts[number], order, &is_inner);
            let looked_at = relocation.look_in_order(&mut patch, look, &poll)?;
            done.fetch_add(relocation.order.len(), Ordering::Relaxed);
            *slot = Some((patch, relocation, looked_at));
            Ok(())
        };
        share_out(patches.iter_mut().zip(orders).enumerate(), control, work)?;
        let (before, mut all_looked_at) = (mesh.total_error(), 0);
        for (part, patch) in partition.parts.iter().zip(patches) {
            let Some((patch, relocation, looked_at)) = patch else { return Err(Cancelled) };
            mesh.put_in(part, &patch, before);
            for (number, &v) in part.vertices.iter().enumerate() {
                self.changed[v as usize] = relocation.changed[number];
                self.is_due[v as usize] = relocation.is_due[number];
            }
            all_looked_at += looked_at;
        }
        Ok(all_looked_at)
    }

    /// What is known of the vertices of a part, of which those inside are to be looked at in `order`.
    fn of_part(&self, part: &Part, mut order: Vec<u32>, is_inner: &[bool]) -> Self {
        order.retain(|&number| is_inner[number as usize]);
        Self {
            changed: part.vertices.iter().map(|&v| self.changed[v as usize]).collect(),
            is_due: part.vertices.iter().map(|&v| self.is_due[v as usize]).collect(),
            order,
            passes_over_large: self.passes_over_large,
            promising: Vec::new(),
        }
    }

    /// Looks once at each vertex whose surroundings have changed and which is due, and tells how many
    /// there were. Those that can't be moved for the fence of a patch remain due.
    fn look_in_order<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        look: Look,
        poll: &dyn Fn(usize) -> Result<(), Cancelled>,
    ) -> Result<usize, Cancelled> {
        let (near, window, mut looked_at) = (offsets(1), offsets(2), 0);
        for i in 0..self.order.len() {
            let vertex = self.order[i];
            if !std::mem::take(&mut self.is_due[vertex as usize])
                || !self.changed[vertex as usize]
                || !mesh.is_movable(vertex)
            {
                continue;
            }
            poll(i)?;
            let moved = match look {
                Look::Foresighted => self.follow_forecast(mesh, vertex, &near, &window),
                Look::Thorough => move_to_best(mesh, vertex, &window),
            };
            match moved {
                Moved::Yes => {
                    self.note(mesh.left());
                    self.note(mesh.reached());
                }
                Moved::No => self.changed[vertex as usize] = false,
                Moved::Fenced => self.is_due[vertex as usize] = true,
            }
            looked_at += usize::from(moved != Moved::Fenced);
        }
        Ok(looked_at)
    }

    /// Moves a vertex to the first of the promising places that is better than its own.
    fn follow_forecast<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        vertex: u32,
        near: &[(i32, i32)],
        window: &[(i32, i32)],
    ) -> Moved {
        if !mesh.look_at(vertex) {
            return Moved::Fenced;
        }
        if !mesh.find_candidates(window, PROMISING, DOUBT, &mut self.promising) {
            return if self.passes_over_large {
                Moved::No
            } else {
                move_to_best(mesh, vertex, near)
            };
        }
        if self.promising.is_empty() {
            return Moved::No;
        }
        let places = self.promising.iter().map(|&(_, place)| place);
        mesh.move_vertex(places, Choice::First)
    }
}

/// How often a mesh of so many vertices is halved to make patches.
fn halvings(vertex_count: usize) -> u32 {
    let patches = (vertex_count / LEAST_PATCH).checked_ilog2().unwrap_or(0);
    patches.max(u32::from(vertex_count >= LEAST_PARTED))
}

/// Moves a vertex to the best place of those around it, if one is better than its own.
fn move_to_best<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    vertex: u32,
    offsets: &[(i32, i32)],
) -> Moved {
    let from = mesh.triangulation.points[vertex as usize];
    let places = offsets.iter().map(|&(dx, dy)| Point::new(from.x + dx, from.y + dy));
    if mesh.look_at(vertex) { mesh.move_vertex(places, Choice::Best) } else { Moved::Fenced }
}

#[cfg(test)]
mod tests;
