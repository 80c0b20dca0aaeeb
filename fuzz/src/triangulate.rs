//! Points of a small grid, where most are cocircular or in a line, against flipping every edge.

use super::input::Input;
use super::twin::triangulation::{triangles_of, triangulate as by_flipping};
use pixmesh_meshing::{Point, triangulate};
use std::collections::BTreeSet;

/// The most columns and rows.
const MOST: usize = 12;

/// Points with the corners of their rectangle, each once, by row and column.
pub(crate) fn points(input: &mut Input<'_>, width: usize, height: usize) -> Vec<Point> {
    let point = |x: usize, y: usize| Point::new(x as i32, y as i32);
    let (right, top) = (width - 1, height - 1);
    let corners = [(0, 0), (right, 0), (0, top), (right, top)];
    let mut found: BTreeSet<Point> = corners.into_iter().map(|(x, y)| point(x, y)).collect();
    while !input.is_empty() {
        found.insert(point(input.between(0, right), input.between(0, top)));
    }
    found.into_iter().collect()
}

/// Triangulates points in order and out of it.
pub fn run(bytes: &[u8]) {
    let mut input = Input(bytes.get(..200.min(bytes.len())).unwrap_or_default());
    let (width, height) = (input.between(2, MOST), input.between(2, MOST));
    let points = points(&mut input, width, height);
    let expected = by_flipping(&points);
    assert_eq!(triangles_of(&points, &triangulate(&points)), expected);
    let mut reversed = points;
    reversed.reverse();
    // Points that come again belong to nothing.
    reversed.extend_from_within(..1);
    assert_eq!(triangles_of(&reversed, &triangulate(&reversed)), expected);
}
