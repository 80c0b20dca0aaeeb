//! The normals of a surface's vertices: the mean of the faces around each, weighted by area.
//!
//! Literature: Gouraud, "Continuous shading of curved surfaces", IEEE Transactions on Computers,
//! 1971. Only additions, multiplications, divisions and square roots are used, which every machine
//! rounds alike.

use super::Surface;

/// The unit normal of every vertex. Walls do not tilt the vertices that they share with the top, so
/// that the relief is lit up to its rim.
pub(super) fn vertex_normals(surface: &Surface<'_>) -> Vec<[f64; 3]> {
    let mut normals = vec![[0.0; 3]; surface.vertex_count()];
    let top_vertices = surface.mesh_vertex_count();
    let top_faces = surface.mesh.faces().len();
    for (index, face) in surface.faces().enumerate() {
        let normal = cross_product(face.map(|vertex| surface.position(vertex as usize)));
        for vertex in face {
            if index >= top_faces && (vertex as usize) < top_vertices {
                continue;
            }
            let sum = &mut normals[vertex as usize];
            sum.iter_mut().zip(normal).for_each(|(sum, part)| *sum += part);
        }
    }
    normals.iter_mut().for_each(|normal| *normal = unit(*normal));
    normals
}

/// A vector at right angles to a triangle, as long as twice its area.
pub(crate) fn cross_product([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let u = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let v = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

/// The vector of length 1 in the same direction; upwards where there is none.
pub(crate) fn unit([x, y, z]: [f64; 3]) -> [f64; 3] {
    let length = (x * x + y * y + z * z).sqrt();
    if length > 0.0 { [x / length, y / length, z / length] } else { [0.0, 0.0, 1.0] }
}
