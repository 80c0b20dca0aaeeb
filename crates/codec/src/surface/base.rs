//! The base that closes a mesh to a solid: where its walls stand, and what lies beneath.

use crate::shown::Shown;
use std::collections::HashSet;

/// The walls and the bottom of a solid.
#[derive(Clone)]
pub(super) struct Base {
    /// The vertices that the base reaches down from.
    pub(super) vertices: Vec<u32>,
    /// Where walls stand: pairs of indices of `vertices`, the mesh at their left.
    pub(super) edges: Vec<[u32; 2]>,
    /// Whether the bottom is a rectangle, a fan around its middle; else it has the mesh's faces.
    pub(super) is_rectangle: bool,
}

impl Base {
    pub(super) fn new(mesh: &Shown<'_>) -> Self {
        if mesh.is_whole {
            let vertices = boundary(mesh);
            let count = vertices.len() as u32;
            let edges = (0..count).map(|i| [i, (i + 1) % count]).collect();
            return Self { vertices, edges, is_rectangle: true };
        }
        let directed = || mesh.faces().iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let all: HashSet<[u32; 2]> = directed().collect();
        let edges = directed().filter(|&[from, to]| !all.contains(&[to, from])).collect();
        let vertices = (0..mesh.points().len() as u32).collect();
        Self { vertices, edges, is_rectangle: false }
    }
}

/// The vertices on the rectangle's four sides, counter-clockwise from the lower left corner.
///
/// A mesh covers its rectangle without a gap, so that two neighbours on a side share an edge.
fn boundary(mesh: &Shown<'_>) -> Vec<u32> {
    let shape = mesh.shape();
    let (right, top) = (shape.width as i64 - 1, shape.height as i64 - 1);
    let around = |x: i64, y: i64| {
        if y == 0 {
            Some(x)
        } else if x == right {
            Some(right + y)
        } else if y == top {
            Some(right + top + (right - x))
        } else if x == 0 {
            Some(2 * right + top + (top - y))
        } else {
            None
        }
    };
    let places = mesh.points().iter().enumerate();
    let on_sides = places.filter_map(|(vertex, point)| {
        Some((around(point.x.into(), point.y.into())?, vertex as u32))
    });
    let mut rim: Vec<(i64, u32)> = on_sides.collect();
    rim.sort_unstable();
    rim.into_iter().map(|(_, vertex)| vertex).collect()
}
