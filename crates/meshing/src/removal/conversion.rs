//! A triangulation as the stars of its vertices, and what is left of them as a mesh.

use crate::control::{Cancelled, Poller, collect};
use crate::image::Point;
use crate::removal::star::{AllStars, Star, Stars, Vertices};
use crate::triangulation::{Face, NONE, Triangulation, next, previous};
use std::collections::HashMap;
use std::iter::repeat_n;

const STEPS_PER_STAR: usize = 8;

/// The stars of a triangulation with these errors of its triangles; vertex `v` is `ranks[v]` there.
pub(crate) fn stars_of(
    triangulation: &Triangulation,
    vertices: Vertices,
    errors: &[u64],
    poller: &mut Poller<'_>,
) -> Result<AllStars, Cancelled> {
    let Triangulation { origins, twins, .. } = triangulation;
    let numbers = inverse(&vertices.ranks, poller)?;
    let outgoing = outgoing_half_edges(triangulation, poller)?;
    let mut records = Vec::with_capacity(vertices.ranks.len());
    let mut spilled = Vec::new();
    let mut star = Star::default();
    for ranks in vertices.ranks.chunks(1 << vertices.digits) {
        let mut spilled_in_tile = HashMap::new();
        for &rank in ranks {
            poller.step(STEPS_PER_STAR)?;
            star.neighbours.clear();
            star.errors.clear();
            let first = outgoing[rank as usize];
            let mut spoke = first;
            loop {
                star.neighbours.push(numbers[origins[next(spoke) as usize] as usize]);
                star.errors.push(errors[spoke as usize / 3]);
                let incoming = previous(spoke);
                spoke = twins[incoming as usize];
                if spoke == NONE {
                    star.neighbours.push(numbers[origins[incoming as usize] as usize]);
                    star.errors.push(0);
                }
                if spoke == NONE || spoke == first {
                    break;
                }
            }
            let packed = star.pack();
            let vertex = records.len() as u32;
            spilled_in_tile.extend(packed.spilled.map(|star| (vertex, *star)));
            records.push(packed.record);
        }
        spilled.push(spilled_in_tile);
    }
    Ok(AllStars { vertices, records, spilled })
}

/// A half-edge that begins at each vertex; on the border the one with no twin, from which turning
/// counter-clockwise meets every triangle.
fn outgoing_half_edges(
    triangulation: &Triangulation,
    poller: &mut Poller<'_>,
) -> Result<Vec<u32>, Cancelled> {
    let mut outgoing = collect(repeat_n(NONE, triangulation.points.len()), || poller.poll())?;
    let half_edges = triangulation.origins.iter().zip(&triangulation.twins);
    for (h, (&origin, &twin)) in (0..).zip(half_edges) {
        poller.step(1)?;
        let out = &mut outgoing[origin as usize];
        if *out == NONE || twin == NONE {
            *out = h;
        }
    }
    Ok(outgoing)
}

/// The points and faces of the vertices that remain: points by row, then column; faces
/// counter-clockwise, each from its smallest vertex, in ascending order.
pub(crate) fn mesh_of(
    stars: &Stars<'_>,
    poller: &mut Poller<'_>,
) -> Result<(Vec<Point>, Vec<Face>), Cancelled> {
    let (mut in_order, mut points) = (Vec::new(), Vec::new());
    let mut numbers = vec![0; stars.vertices.ranks.len()];
    for vertex in inverse(&stars.vertices.ranks, poller)? {
        poller.step(1)?;
        if !stars.is_removed(vertex) {
            numbers[vertex as usize] = points.len() as u32;
            in_order.push(vertex);
            points.push(stars.point(vertex));
        }
    }
    let mut faces = Vec::with_capacity(2 * in_order.len());
    for vertex in in_order {
        poller.step(STEPS_PER_STAR)?;
        add_faces(stars, vertex, &numbers, &mut faces);
    }
    Ok((points, faces))
}

/// Adds the faces of which a vertex is the one of the smallest number, in ascending order.
fn add_faces(stars: &Stars<'_>, vertex: u32, numbers: &[u32], faces: &mut Vec<Face>) {
    let neighbours = stars.neighbours(vertex);
    let number = numbers[vertex as usize];
    let start = faces.len();
    for (i, &neighbour) in neighbours.iter().enumerate() {
        let is_last = i + 1 == neighbours.len();
        if is_last && stars.is_on_border(vertex) {
            continue;
        }
        let next = neighbours[if is_last { 0 } else { i + 1 }];
        let (second, third) = (numbers[neighbour as usize], numbers[next as usize]);
        if number < second && number < third {
            faces.push([number, second, third]);
        }
    }
    faces[start..].sort_unstable();
}

fn inverse(ranks: &[u32], poller: &mut Poller<'_>) -> Result<Vec<u32>, Cancelled> {
    let mut vertices = vec![0; ranks.len()];
    for (vertex, &rank) in (0..).zip(ranks) {
        poller.step(1)?;
        vertices[rank as usize] = vertex;
    }
    Ok(vertices)
}
