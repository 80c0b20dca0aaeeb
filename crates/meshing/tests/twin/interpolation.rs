//! The picture that a mesh models: which face a lattice point belongs to, and its value there as
//! an exact quotient.

use super::metric;
use super::triangulation::{Triangle, double_area};
use pixmesh_meshing::parameters::ErrorMetric;
use pixmesh_meshing::{Image, Mesh, Point};

/// The linear interpolant of three samples at `p`, rounded to the nearest integer, halves up.
pub(crate) fn value([a, b, c]: Triangle, z: [u16; 3], p: Point) -> i128 {
    let den = double_area(a, b, c);
    let weights = [double_area(p, b, c), double_area(a, p, c), double_area(a, b, p)];
    let num: i128 = weights.iter().zip(z).map(|(w, z)| w * i128::from(z)).sum();
    (2 * num + den).div_euclid(2 * den)
}

/// The components of the picture that a mesh models, each point in the face that owns it.
pub(crate) fn rasterise(mesh: &Mesh) -> Vec<Vec<u16>> {
    let triangles: Vec<Triangle> = mesh.faces().iter().map(|&f| mesh.corners(f)).collect();
    let shape = mesh.shape();
    let mut components = vec![Vec::new(); shape.component_count];
    for y in 0..shape.height as i32 {
        for x in 0..shape.width as i32 {
            let p = Point::new(x, y);
            let owner = owner(&triangles, p);
            for (c, samples) in components.iter_mut().enumerate() {
                let z = mesh.faces()[owner].map(|v| mesh.vertex_samples(v as usize)[c]);
                samples.push(match mesh.face_samples() {
                    Some(colors) => colors[owner * shape.component_count + c],
                    None => value(triangles[owner], z, p) as u16,
                });
            }
        }
    }
    components
}

/// The error of an image's approximation over faces that carry its samples, by a metric.
pub(crate) fn total_error(image: &Image, triangles: &[Triangle], metric: ErrorMetric) -> u64 {
    let width = image.width();
    let mut errors = vec![0u64; image.pixel_count()];
    for &triangle in triangles {
        for p in covered(triangle) {
            // Neighbours agree on the edge between them, so that the last one may have it.
            errors[p.y as usize * width + p.x as usize] = error_at(image, triangle, p, metric);
        }
    }
    errors.iter().sum()
}

/// The lattice points of a closed triangle.
fn covered(triangle: Triangle) -> impl Iterator<Item = Point> {
    let [a, b, c] = triangle;
    let columns = a.x.min(b.x).min(c.x)..=a.x.max(b.x).max(c.x);
    let rows = a.y.min(b.y).min(c.y)..=a.y.max(b.y).max(c.y);
    rows.flat_map(move |y| columns.clone().map(move |x| Point::new(x, y)))
        .filter(move |&p| sides(triangle, p).iter().all(|&side| side >= 0))
}

fn error_at(image: &Image, triangle: Triangle, p: Point, metric: ErrorMetric) -> u64 {
    let components = 0..image.component_count();
    let sample = |c: usize, q: Point| image.sample(c, q.x as usize, q.y as usize);
    let before: Vec<i128> = components.clone().map(|c| sample(c, p).into()).collect();
    let after = components.map(|c| value(triangle, triangle.map(|q| sample(c, q)), p)).collect();
    metric::error(metric, &before, &after)
}

/// At which side of each edge `p` lies: 0 on it, positive within.
fn sides([a, b, c]: Triangle, p: Point) -> [i128; 3] {
    [double_area(a, b, p), double_area(b, c, p), double_area(c, a, p)]
}

/// The face that the lattice point `p` belongs to.
pub(crate) fn owner(triangles: &[Triangle], p: Point) -> usize {
    let holds = |t: &Triangle| sides(*t, p).iter().all(|&side| side >= 0);
    let around: Vec<usize> = (0..triangles.len()).filter(|&t| holds(&triangles[t])).collect();
    let chosen = if around.iter().any(|&t| triangles[t].contains(&p)) {
        owner_of_vertex(triangles, &around, p)
    } else if let [only] = around[..]
        && !sides(triangles[only], p).contains(&0)
    {
        Some(only)
    } else {
        owner_inside_edge(triangles, &around, p)
    };
    chosen.expect("the faces cover the lattice")
}

/// Of the faces at an edge through `p`: below or above it when it is horizontal, else to its left
/// or right.
fn owner_inside_edge(triangles: &[Triangle], around: &[usize], p: Point) -> Option<usize> {
    let side = |t: usize| {
        let [a, b, c] = triangles[t];
        let [(from, to, third)] = [(a, b, c), (b, c, a), (c, a, b)]
            .into_iter()
            .filter(|&(from, to, _)| double_area(from, to, p) == 0)
            .collect::<Vec<_>>()[..]
        else {
            return None;
        };
        // Faces are to the left of their edges: a downward edge has its face at its right.
        let last = if from.y == to.y { third.y > p.y } else { from.y > to.y };
        Some((last, t))
    };
    around.iter().filter_map(|&t| side(t)).min().map(|(_, t)| t)
}

/// Of the faces at the vertex `p`: the one below (or above) the horizontal edge that ends there
/// from the left, else the one to the left, or to the right.
fn owner_of_vertex(triangles: &[Triangle], around: &[usize], p: Point) -> Option<usize> {
    let others = |t: usize| triangles[t].into_iter().filter(move |&q| q != p);
    let third = |t: usize| {
        let on_left = others(t).find(|q| q.y == p.y && q.x < p.x)?;
        others(t).find(|&q| q != on_left)
    };
    let at_edge = around.iter().filter_map(|&t| third(t).map(|q| (q.y > p.y, t))).min();
    let towards = |dx: i32| {
        let beside = Point::new(p.x + dx, p.y);
        around.iter().copied().find(|&t| opens(triangles[t], p, beside))
    };
    at_edge.map(|(_, t)| t).or_else(|| towards(-1)).or_else(|| towards(1))
}

/// Tells whether the ray from the corner `p` towards `beside` enters the triangle or runs along
/// an edge of it.
fn opens([a, b, c]: Triangle, p: Point, beside: Point) -> bool {
    let (next, last) = if a == p {
        (b, c)
    } else if b == p {
        (c, a)
    } else {
        (a, b)
    };
    double_area(p, next, beside) >= 0 && double_area(p, beside, last) >= 0
}
