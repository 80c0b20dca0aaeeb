//! The boundary of a mesh: the vertices on the rectangle's four sides, in order.

use pixmesh_meshing::Mesh;

/// The boundary's vertices, counter-clockwise from the lower left corner.
///
/// A mesh covers its rectangle without a gap, so that two neighbours on a side share an edge.
pub(super) fn boundary(mesh: &Mesh) -> Vec<u32> {
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
