//! pmesh to a mesh, and to a progression.

use super::read_model::LIMITS;
use pixmesh_codec::{probe_pmesh, read_pmesh, read_progression, write_pmesh};

/// Reads a pmesh both ways, and the mesh once more.
pub fn run(bytes: &[u8]) {
    let probed = probe_pmesh(bytes, &LIMITS);
    let _ = read_progression(bytes, &LIMITS);
    let Ok(mesh) = read_pmesh(bytes, &LIMITS) else { return };
    let header = probed.expect("what is read has a header");
    assert_eq!((header.shape, header.vertices), (mesh.shape(), mesh.points().len()));
    let mut written = Vec::new();
    if write_pmesh(&mesh, &mut written).is_ok() {
        assert_eq!(read_pmesh(&written, &LIMITS).expect("what was written is a pmesh"), mesh);
    }
}
