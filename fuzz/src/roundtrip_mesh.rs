//! Small meshes of any samples: MODEL and pmesh read back as the same mesh.

use super::input::Input;
use super::read_model::LIMITS;
use super::triangulate::points;
use pixmesh_codec::{read_model, read_pmesh, write_model, write_pmesh};
use pixmesh_meshing::alpha::premultiply_vectors;
use pixmesh_meshing::{Mesh, Shape, triangulate};

/// Writes a mesh in both formats and reads it.
pub fn run(bytes: &[u8]) {
    let mut input = Input(bytes.get(..300.min(bytes.len())).unwrap_or_default());
    let (width, height) = (input.between(2, 20), input.between(2, 20));
    let (component_count, precision) = (input.between(1, 5), input.between(1, 16) as u8);
    let seed = usize::from(input.byte());
    let points = points(&mut input, width, height);
    let largest = (1_usize << precision) - 1;
    let sample = |i: usize| ((i * 40_503 + seed * 9973) >> 3 & largest) as u16;
    let mut samples: Vec<u16> = (0..points.len() * component_count).map(sample).collect();
    premultiply_vectors(&mut samples, component_count, largest as u16);
    let faces = triangulate(&points);
    let shape = Shape { width, height, component_count, precision };
    let mesh = Mesh::new(shape, points, samples, faces, &()).expect("a triangulation is a mesh");
    let mut written = Vec::new();
    write_model(&mesh, &mut written).expect("memory takes everything");
    assert_eq!(read_model(&written, &LIMITS).as_ref(), Ok(&mesh));
    written.clear();
    write_pmesh(&mesh, &mut written).expect("the faces are those of the points");
    assert_eq!(read_pmesh(&written, &LIMITS).expect("what was written is a pmesh"), mesh);
}
