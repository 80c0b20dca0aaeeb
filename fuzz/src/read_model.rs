//! MODEL to a mesh.

use pixmesh_codec::{Limits, probe_model, read_model, write_model};
use pixmesh_meshing::rasterize;

pub(crate) const LIMITS: Limits = Limits { max_pixels: 1 << 14, max_side: 1024 };

/// Reads a MODEL, and what was read once more.
pub fn run(bytes: &[u8]) {
    let probed = probe_model(bytes, &LIMITS);
    let Ok(mesh) = read_model(bytes, &LIMITS) else { return };
    probed.expect("what is read has a header");
    let mut written = Vec::new();
    write_model(&mesh, &mut written).expect("memory takes everything");
    assert_eq!(read_model(&written, &LIMITS).expect("what was written is a MODEL"), mesh);
    let picture = rasterize(&mesh, &()).expect("nobody cancels");
    assert_eq!((picture.width(), picture.height()), (mesh.shape().width, mesh.shape().height));
}
