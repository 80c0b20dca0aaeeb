//! A triangulation as the stars of its vertices, and what is left of them as a mesh.

use crate::control::{Cancelled, POINTS_PER_POLL, collect};
use crate::image::Point;
use crate::removal::star::{AllStars, Star, Stars, Vertices};
use crate::triangulation::{Face, NONE, Triangulation, next, previous};
use std::collections::HashMap;
use std::iter::repeat_n;

/// Vertices whose faces are listed between two polls of the control.
const VERTICES_PER_POLL: usize = 8192;

/// The stars of a triangulation's vertices, of which vertex `v` is `vertices.ranks[v]`, with the
/// errors of its triangles.
pub(crate) fn stars_of(
    triangulation: &Triangulation,
    vertices: Vertices,
    errors: &[u64],
    poll: impl Fn() -> Result<(), Cancelled>,
) -> Result<AllStars, Cancelled> {
    let Triangulation { origins, twins, .. } = triangulation;
    let numbers = inverse(&vertices.ranks, &poll)?;
    let outgoing = outgoing_half_edges(triangulation, &poll)?;
    let tile_count = vertices.ranks.len().div_ceil(1 << vertices.digits);
    let mut spilled: Vec<HashMap<u32, Star>> = vec![HashMap::new(); tile_count];
    let mut star = Star::default();
    let star_of = |(number, &rank): (usize, &u32)| {
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
        let tile = number >> vertices.digits;
        spilled[tile].extend(packed.spilled.map(|star| (number as u32, *star)));
        packed.record
    };
    let records = collect(vertices.ranks.iter().enumerate().map(star_of), poll)?;
    Ok(AllStars { vertices, records, spilled })
}

/// A half-edge that begins at each vertex; on the border the one with no twin, from which turning
/// counter-clockwise meets every triangle.
fn outgoing_half_edges(
    triangulation: &Triangulation,
    poll: impl Fn() -> Result<(), Cancelled>,
) -> Result<Vec<u32>, Cancelled> {
    let mut outgoing = collect(repeat_n(NONE, triangulation.points.len()), &poll)?;
    let half_edges = triangulation.origins.iter().zip(&triangulation.twins);
    for (h, (&origin, &twin)) in half_edges.enumerate() {
        if h % POINTS_PER_POLL == 0 {
            poll()?;
        }
        let out = &mut outgoing[origin as usize];
        if *out == NONE || twin == NONE {
            *out = h as u32;
        }
    }
    Ok(outgoing)
}

/// The points and faces of the vertices that remain: points by row, then column; faces
/// counter-clockwise, each from its smallest vertex, in ascending order.
pub(crate) fn mesh_of(
    stars: &Stars<'_>,
    poll: impl Fn() -> Result<(), Cancelled>,
) -> Result<(Vec<Point>, Vec<Face>), Cancelled> {
    let in_order = inverse(&stars.vertices.ranks, &poll)?;
    let mut numbers = vec![0; in_order.len()];
    let mut points = Vec::new();
    for vertices in in_order.chunks(POINTS_PER_POLL) {
        poll()?;
        for &vertex in vertices.iter().filter(|&&vertex| !stars.is_removed(vertex)) {
            numbers[vertex as usize] = points.len() as u32;
            points.push(stars.point(vertex));
        }
    }
    let mut faces = Vec::with_capacity(2 * points.len());
    for vertices in in_order.chunks(VERTICES_PER_POLL) {
        poll()?;
        for &vertex in vertices.iter().filter(|&&vertex| !stars.is_removed(vertex)) {
            add_faces(stars, vertex, &numbers, &mut faces);
        }
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

/// For each rank the vertex that has it.
fn inverse(ranks: &[u32], poll: impl Fn() -> Result<(), Cancelled>) -> Result<Vec<u32>, Cancelled> {
    let mut vertices = vec![0; ranks.len()];
    for (chunk, ranks) in ranks.chunks(POINTS_PER_POLL).enumerate() {
        poll()?;
        for (vertex, &rank) in ((chunk * POINTS_PER_POLL) as u32..).zip(ranks) {
            vertices[rank as usize] = vertex;
        }
    }
    Ok(vertices)
}
