//! Whether a mesh is a Delaunay triangulation of its points, by exact arithmetic of its own and by
//! the library spade.
//!
//! The faces turn counter-clockwise and their areas sum up to the rectangle, so that they cover it
//! without overlapping; the circle of every face is empty of the vertex beyond each of its edges,
//! which by Delaunay's lemma makes it empty of all; and every edge that spade's triangulation of the
//! same points has is one of the mesh's, but for diagonals of four points on one circle, of which
//! either may be chosen.

use pixmesh_meshing::{Mesh, Point};
use spade::{DelaunayTriangulation, Point2, Triangulation};
use std::collections::{HashMap, HashSet};

/// Checks a mesh.
///
/// # Errors
/// The first defect.
pub(super) fn check(mesh: &Mesh) -> Result<(), String> {
    check_cover(mesh)?;
    check_circles(mesh)?;
    check_against_spade(mesh)
}

fn check_cover(mesh: &Mesh) -> Result<(), String> {
    let mut area = 0;
    for &face in mesh.faces() {
        let [a, b, c] = mesh.corners(face);
        let twice = doubled_area(a, b, c);
        if twice <= 0 {
            return Err(format!("the face {face:?} does not turn counter-clockwise"));
        }
        area += twice;
    }
    let shape = mesh.shape();
    let rectangle = 2 * (shape.width as i128 - 1) * (shape.height as i128 - 1);
    if area == rectangle {
        return Ok(());
    }
    Err(format!("the faces have an area of {area}/2, the rectangle one of {rectangle}/2"))
}

fn check_circles(mesh: &Mesh) -> Result<(), String> {
    let point = |v: u32| mesh.points()[v as usize];
    let mut opposite = HashMap::new();
    for &[a, b, c] in mesh.faces() {
        for (from, to, apex) in [(a, b, c), (b, c, a), (c, a, b)] {
            if opposite.insert((from, to), apex).is_some() {
                return Err(format!("two faces are on one side of the edge {from} {to}"));
            }
        }
    }
    for (&(from, to), &apex) in &opposite {
        let Some(&beyond) = opposite.get(&(to, from)) else { continue };
        if in_circle(point(from), point(to), point(apex), point(beyond)) > 0 {
            return Err(format!("vertex {beyond} lies in the circle of {from} {to} {apex}"));
        }
    }
    Ok(())
}

fn check_against_spade(mesh: &Mesh) -> Result<(), String> {
    let points = mesh.points();
    let mut other = DelaunayTriangulation::<Point2<f64>>::new();
    let mut vertex_of = HashMap::new();
    for (v, point) in points.iter().enumerate() {
        let inserted = other.insert(Point2::new(f64::from(point.x), f64::from(point.y)));
        let handle = inserted.map_err(|error| format!("spade refuses a point: {error}"))?;
        vertex_of.insert(handle, v as u32);
    }
    if other.num_inner_faces() != mesh.faces().len() {
        let (ours, theirs) = (mesh.faces().len(), other.num_inner_faces());
        return Err(format!("the mesh has {ours} faces, spade's has {theirs}"));
    }
    let edges: HashSet<(u32, u32)> =
        mesh.faces().iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
    for edge in other.undirected_edges() {
        let directed = edge.as_directed();
        let [from, to] = directed.vertices().map(|vertex| vertex_of[&vertex.fix()]);
        let apexes = [directed, directed.rev()].map(|side| {
            side.opposite_vertex().map(|vertex| points[vertex_of[&vertex.fix()] as usize])
        });
        let is_ours = edges.contains(&(from, to)) || edges.contains(&(to, from));
        let [from, to] = [from, to].map(|v| points[v as usize]);
        let is_choice = matches!(apexes, [Some(left), Some(right)]
            if in_circle(from, to, left, right) == 0);
        if !is_ours && !is_choice {
            return Err(format!("spade has an edge from {from:?} to {to:?}, the mesh has not"));
        }
    }
    Ok(())
}

/// Twice the area of a triangle, positive when it turns counter-clockwise.
fn doubled_area(a: Point, b: Point, c: Point) -> i128 {
    let [bx, by] = from(a, b);
    let [cx, cy] = from(a, c);
    bx * cy - by * cx
}

/// Positive when `d` lies inside the circle of the counter-clockwise triangle `abc`, 0 on it.
fn in_circle(a: Point, b: Point, c: Point, d: Point) -> i128 {
    let rows = [a, b, c].map(|point| {
        let [x, y] = from(d, point);
        [x, y, x * x + y * y]
    });
    let [[ax, ay, az], [bx, by, bz], [cx, cy, cz]] = rows;
    ax * (by * cz - bz * cy) - ay * (bx * cz - bz * cx) + az * (bx * cy - by * cx)
}

fn from(origin: Point, point: Point) -> [i128; 2] {
    [i128::from(point.x) - i128::from(origin.x), i128::from(point.y) - i128::from(origin.y)]
}
