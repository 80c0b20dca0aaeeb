//! Refinement of a mesh that keeps a bound: rounds that improve it and then remove what has become
//! superfluous.
//!
//! Flips, fitted values and moves lower the squared error, and none breaks the bound. That leaves
//! room within the bound for the removal of further vertices. Where faces need not be Delaunay, the
//! hole of a removed vertex gets the triangles of least error among all that keep the bound, found
//! by dynamic programming over the parts of its boundary (G. T. Klincsek, "Minimal triangulations of
//! polygonal domains", 1980).

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::dynamic_mesh::half_edges::{Link, SortedMesh};
use crate::face_error::bound::BROKEN;
use crate::refinement::progress::begin_step;
use crate::refinement::unconstrained::moves::{Freedom, VertexMoves};
use crate::refinement::unconstrained::valued_mesh::ValuedMesh;
use crate::removal::queue::{Entry, RemovalQueue};
use crate::triangulation::hole::{HoleFiller, HoleTriangle};

const ROUNDS_PER_EFFORT: usize = 4;
const PASSES: usize = 3;

/// Rounds end when one removes less than one vertex in this many.
const LEAST_REMOVED: usize = 500;

/// The most neighbours of a vertex whose hole gets the triangles of least error.
const MOST_PROGRAMMED: usize = 10;

/// Stands for the change of a vertex whose removal would break the bound.
const WAITS: i64 = i64::MAX;

/// Removes vertices of a mesh within a bound, in rounds that make room for more. Without an effort
/// vertices stay where they are.
pub(crate) fn refine_within(
    mesh: &mut ValuedMesh<'_>,
    freedom: Freedom,
    effort: u8,
    control: &dyn Control,
) -> Result<SortedMesh, Cancelled> {
    let rounds = ROUNDS_PER_EFFORT * usize::from(effort).max(1);
    let count = mesh.triangulation.points.len();
    let mut moves = match effort {
        0 => VertexMoves::of_values(count, freedom),
        _ => VertexMoves::new(count, freedom),
    };
    // Vertices at the borders of holes must not move.
    let passes = (effort > 0 || freedom.values) && !mesh.errors.has_holes();
    let mut removal = BoundedRemoval { freedom, ..BoundedRemoval::default() };
    for done in 0..rounds {
        let progress = begin_step(control, done, rounds + 1)?;
        moves.is_outdated.fill(true);
        for _ in 0..PASSES {
            if freedom.connectivity {
                mesh.flip_edges(&progress)?;
            }
            if passes {
                moves.pass(mesh, &progress)?;
            }
        }
        let count = mesh.triangulation.vertex_count();
        let removed = removal.remove_all(mesh, &progress)?;
        if removed * LEAST_REMOVED < count {
            break;
        }
    }
    mesh.triangulation.sorted(&begin_step(control, rounds, rounds + 1)?)
}

#[derive(Default)]
struct BoundedRemoval {
    freedom: Freedom,
    star: Link,
    filler: HoleFiller,
    /// The least error of the part of a hole between two vertices of its boundary, and the vertex
    /// that makes a triangle with them.
    parts: Vec<(u64, u32)>,
    fill: Vec<HoleTriangle>,
    errors: Vec<u64>,
}

impl BoundedRemoval {
    /// Removes the vertex whose removal raises the error least among those that keep the bound, again
    /// and again, until there is none. Returns how many.
    fn remove_all(
        &mut self,
        mesh: &mut ValuedMesh<'_>,
        control: &dyn Control,
    ) -> Result<usize, Cancelled> {
        let count = mesh.triangulation.points.len() as u32;
        let poller = &mut Poller::new(control, Stage::Refine, 0, 1);
        let mut queue = RemovalQueue::with_capacity(0..count);
        for vertex in 0..count {
            poller.poll()?;
            if !mesh.triangulation.is_movable(vertex) {
                continue;
            }
            let change = self.change(mesh, vertex, poller)?;
            queue.push(Entry { change, rank: vertex, vertex });
        }
        queue.order(poller)?;
        let mut removed = 0;
        while let Some(Entry { change, vertex, .. }) = queue.first()
            && change < WAITS
        {
            poller.poll()?;
            queue.remove_first();
            self.change(mesh, vertex, poller)?;
            mesh.triangulation.remove(vertex, &mut self.star, &self.fill, &self.errors);
            removed += 1;
            for neighbour in self.star.vertices.clone() {
                if mesh.triangulation.is_movable(neighbour) {
                    let change = self.change(mesh, neighbour, poller)?;
                    queue.change(neighbour, change);
                }
            }
        }
        Ok(removed)
    }

    /// Fills the hole of a vertex, and returns by how much its removal would raise the error.
    fn change(
        &mut self,
        mesh: &mut ValuedMesh<'_>,
        vertex: u32,
        poller: &mut Poller<'_>,
    ) -> Result<i64, Cancelled> {
        mesh.triangulation.star(vertex, &mut self.star);
        let before = mesh.triangulation.error_of(&self.star.triangles);
        let after = if !self.freedom.connectivity {
            self.fill_as_delaunay(mesh, poller)?
        } else if self.star.vertices.len() <= MOST_PROGRAMMED {
            self.fill_with_least_error(mesh, poller)?
        } else {
            BROKEN
        };
        Ok(if after >= BROKEN { WAITS } else { after as i64 - before as i64 })
    }

    fn fill_as_delaunay(
        &mut self,
        mesh: &mut ValuedMesh<'_>,
        poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        let corners = self.star.vertices.iter().map(|&v| mesh.triangulation.points[v as usize]);
        self.filler.fill(&corners.collect::<Vec<_>>());
        self.fill.clone_from(&self.filler.triangles);
        self.errors.clear();
        let mut sum = 0;
        for triangle in &self.fill {
            let face = triangle.map(|i| self.star.vertices[i as usize]);
            let error = mesh.error_of(face, poller)?;
            self.errors.push(error);
            sum += error;
            if error >= BROKEN {
                return Ok(BROKEN);
            }
        }
        Ok(sum)
    }

    fn fill_with_least_error(
        &mut self,
        mesh: &mut ValuedMesh<'_>,
        poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        let Self { star, parts, fill, errors, .. } = self;
        let count = star.vertices.len();
        parts.clear();
        parts.resize(count * count, (0, 0));
        for length in 2..count {
            for first in 0..count - length {
                let last = first + length;
                let mut best = (BROKEN, 0);
                for third in first + 1..last {
                    let rest = parts[first * count + third].0 + parts[third * count + last].0;
                    if rest >= best.0 {
                        continue;
                    }
                    let face = [first, third, last].map(|i| star.vertices[i]);
                    if mesh.is_face(face) {
                        let error = rest + mesh.error_of(face, poller)?;
                        best = best.min((error, third as u32));
                    }
                }
                parts[first * count + last] = best;
            }
        }
        let least = parts[count - 1].0;
        if least >= BROKEN {
            return Ok(BROKEN);
        }
        fill.clear();
        errors.clear();
        let mut open = vec![(0, count - 1)];
        while let Some((first, last)) = open.pop() {
            if last - first < 2 {
                continue;
            }
            let (error, third) = parts[first * count + last];
            let third = third as usize;
            let rest = parts[first * count + third].0 + parts[third * count + last].0;
            fill.push([first, third, last].map(|i| i as u32));
            errors.push(error - rest);
            open.extend([(third, last), (first, third)]);
        }
        Ok(least)
    }
}
