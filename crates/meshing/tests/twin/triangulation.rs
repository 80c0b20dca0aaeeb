//! The preferred-directions Delaunay triangulation by flipping the edges of any triangulation,
//! cocircular points decided by the angles that the description names.

use pixmesh_meshing::{Face, Point};
use std::cmp::Ordering;

/// The corners of a face, counter-clockwise.
pub(crate) type Triangle = [Point; 3];

/// No face lies to the left of this directed edge.
const NONE: usize = usize::MAX;

/// Twice the signed area of `abc`.
pub(crate) fn double_area(a: Point, b: Point, c: Point) -> i128 {
    let (abx, aby) = between(a, b);
    let (acx, acy) = between(a, c);
    abx * acy - aby * acx
}

/// Positive when `d` lies inside the circle through the counter-clockwise `abc`, 0 on it.
pub(crate) fn circle_sign(a: Point, b: Point, c: Point, d: Point) -> i128 {
    let lifted = |p| {
        let (x, y) = between(d, p);
        (x, y, x * x + y * y)
    };
    let (a, b, c) = (lifted(a), lifted(b), lifted(c));
    a.0 * (b.1 * c.2 - c.1 * b.2) - a.1 * (b.0 * c.2 - c.0 * b.2) + a.2 * (b.0 * c.1 - c.0 * b.1)
}

/// Tells whether the diagonal `pq` of a cocircular quadrilateral is preferred to `rs`: it makes
/// the smaller angle with (1, 0), at a tie with (1, 1).
pub(crate) fn is_preferred(p: Point, q: Point, r: Point, s: Point) -> bool {
    let (u, v) = (between(p, q), between(r, s));
    let first = smaller_angle(u, v, (1, 0));
    first.then(smaller_angle(u, v, (1, 1))) == Ordering::Less
}

/// Compares the angles that two undirected lines make with a third: `Less` when `u` makes the
/// smaller one, that is, has the larger squared cosine.
fn smaller_angle(u: (i128, i128), v: (i128, i128), d: (i128, i128)) -> Ordering {
    let dot = |a: (i128, i128), b: (i128, i128)| a.0 * b.0 + a.1 * b.1;
    let (ud, vd) = (dot(u, d), dot(v, d));
    (vd * vd * dot(u, u)).cmp(&(ud * ud * dot(v, v)))
}

fn between(from: Point, to: Point) -> (i128, i128) {
    (i128::from(to.x) - i128::from(from.x), i128::from(to.y) - i128::from(from.y))
}

/// The triangulation of distinct points, the corners of whose bounding rectangle are among them.
/// Each face begins with its first corner by row, then column; the faces are in ascending order.
pub(crate) fn triangulate(points: &[Point]) -> Vec<Triangle> {
    let mut faces = any_triangulation(points);
    flip_all(points, &mut faces);
    let corners = |face: &[usize; 3]| in_order(face.map(|v| points[v]));
    let mut triangles: Vec<Triangle> = faces.iter().map(corners).collect();
    triangles.sort_unstable();
    triangles
}

/// The faces of index triples as the corners they name, in the order of [`triangulate`].
pub(crate) fn triangles_of(points: &[Point], faces: &[Face]) -> Vec<Triangle> {
    let corners = |face: &Face| in_order(face.map(|v| points[v as usize]));
    let mut triangles: Vec<Triangle> = faces.iter().map(corners).collect();
    triangles.sort_unstable();
    triangles
}

fn in_order([a, b, c]: Triangle) -> Triangle {
    [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap_or([a, b, c])
}

/// Splits the rectangle in two and then every face that a point lies in or on the edge of.
fn any_triangulation(points: &[Point]) -> Vec<[usize; 3]> {
    let [sw, se, nw, ne] = rectangle(points);
    let mut faces = vec![[sw, se, ne], [sw, ne, nw]];
    for p in (0..points.len()).filter(|p| ![sw, se, nw, ne].contains(p)) {
        let area = |a: usize, b: usize| double_area(points[a], points[b], points[p]);
        let edges = |[a, b, c]: [usize; 3]| [(a, b), (b, c), (c, a)];
        let holds_p = |face: &[usize; 3]| edges(*face).iter().all(|&(a, b)| area(a, b) >= 0);
        let (split, mut kept): (Vec<_>, Vec<_>) = faces.into_iter().partition(holds_p);
        let sides = split.into_iter().flat_map(edges).filter(|&(a, b)| area(a, b) > 0);
        kept.extend(sides.map(|(a, b)| [a, b, p]));
        faces = kept;
    }
    faces
}

/// Indices of the corners of the points' bounding rectangle.
fn rectangle(points: &[Point]) -> [usize; 4] {
    let right = points.iter().map(|p| p.x).max().unwrap_or(0);
    let top = points.iter().map(|p| p.y).max().unwrap_or(0);
    [(0, 0), (right, 0), (0, top), (right, top)].map(|(x, y)| {
        let corner = points.iter().position(|&p| p == Point::new(x, y));
        corner.expect("the corners of the rectangle are among the points")
    })
}

/// Flips edges until each is Delaunay and, of cocircular points, preferred.
fn flip_all(points: &[Point], faces: &mut [[usize; 3]]) {
    let count = points.len();
    let mut face_left_of = vec![NONE; count * count];
    let note = |table: &mut Vec<usize>, f: usize, [a, b, c]: [usize; 3]| {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            table[from * count + to] = f;
        }
    };
    for (f, &face) in faces.iter().enumerate() {
        note(&mut face_left_of, f, face);
    }
    let mut flipped = true;
    while flipped {
        flipped = false;
        for f in 0..faces.len() {
            for corner in 0..3 {
                let (a, b, c) = rotated(faces[f], corner);
                let g = face_left_of[b * count + a];
                if g == NONE {
                    continue;
                }
                let d = faces[g].into_iter().find(|v| ![a, b].contains(v)).unwrap_or(a);
                let [pa, pb, pc, pd] = [a, b, c, d].map(|v| points[v]);
                if is_to_flip(pa, pb, pc, pd) {
                    face_left_of[a * count + b] = NONE;
                    face_left_of[b * count + a] = NONE;
                    (faces[f], faces[g]) = ([a, d, c], [d, b, c]);
                    note(&mut face_left_of, f, faces[f]);
                    note(&mut face_left_of, g, faces[g]);
                    flipped = true;
                }
            }
        }
    }
}

fn rotated(face: [usize; 3], corner: usize) -> (usize, usize, usize) {
    (face[corner], face[(corner + 1) % 3], face[(corner + 2) % 3])
}

/// Tells whether the edge `ab` of the faces `abc` and `bad` is the wrong diagonal.
pub(crate) fn is_to_flip(a: Point, b: Point, c: Point, d: Point) -> bool {
    match circle_sign(a, b, c, d).cmp(&0) {
        Ordering::Greater => true,
        Ordering::Less => false,
        Ordering::Equal => is_preferred(c, d, a, b),
    }
}
