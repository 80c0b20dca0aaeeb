//! MODEL to a mesh.

use pixmesh_codec::{
    Encodable, EncodeOptions, Format, Geometry, Limits, Terrain, encode, probe_model, read_model,
    write_model,
};
use pixmesh_meshing::{Mesh, rasterize};

pub(crate) const LIMITS: Limits = Limits { max_pixels: 1 << 14, max_side: 1024 };

/// Reads a MODEL, and what was read once more.
pub fn run(bytes: &[u8]) {
    let probed = probe_model(bytes, &LIMITS);
    let Ok(mesh) = read_model(bytes, &LIMITS) else { return };
    let header = probed.expect("what is read has a header");
    let mut written = Vec::new();
    write_model(&mesh, &mut written).expect("memory takes everything");
    assert_eq!(read_model(&written, &LIMITS).expect("what was written is a MODEL"), mesh);
    let picture = rasterize(&mesh, &()).expect("nobody cancels");
    assert_eq!((picture.width(), picture.height()), (mesh.shape().width, mesh.shape().height));
    if let Some(terrain) = header.terrain {
        write_terrain(&mesh, terrain);
    }
}

/// Writes the mesh of an elevation model, which MODEL keeps.
fn write_terrain(mesh: &Mesh, terrain: Terrain) {
    let geometry = terrain.geometry(Geometry::default());
    let options = EncodeOptions { geometry, terrain: Some(terrain), ..EncodeOptions::default() };
    let written = |format| {
        let mut bytes = Vec::new();
        let wanted = || Ok(());
        encode(&Encodable::new(mesh), format, &options, &mut bytes, &wanted).map(|()| bytes)
    };
    let model = written(Format::Model).expect("memory takes everything");
    let kept = probe_model(&model, &LIMITS).expect("what was written has a header").terrain;
    assert_eq!(kept, Some(terrain));
    let _ = [Format::Glb, Format::Terrain, Format::Pmesh].map(written);
}
