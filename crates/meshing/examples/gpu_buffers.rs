//! Makes the buffers that a GPU draws a picture's mesh from.
//!
//! `cargo run --release --example gpu_buffers -- photo.jpg vertices.bin indices.bin` writes 24
//! bytes a vertex (`Float32x3` position, `Unorm8x4` colour, `Float32x2` texture coordinates) and
//! `Uint32` indices, all little-endian.

use pixmesh_meshing::{Buffers, Image, Method, Target, mesh_image};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, vertex_file, index_file] = &arguments[..] else {
        return Err("usage: gpu_buffers INPUT VERTICES INDICES".into());
    };
    let image = Image::try_from(&image::open(input)?)?;
    let made = mesh_image(&image, &Method::Mgprfs.parameters(Target::Percent(2.0)), &())?;
    let buffers = Buffers::new(&made.mesh);
    let mut vertices = Vec::new();
    for ((position, color), uv) in buffers.positions.iter().zip(&buffers.colors).zip(&buffers.uvs) {
        vertices.extend(position.iter().flat_map(|part| part.to_le_bytes()));
        vertices.extend(color);
        vertices.extend(uv.iter().flat_map(|part| part.to_le_bytes()));
    }
    std::fs::write(vertex_file, vertices)?;
    let indices: Vec<u8> = buffers.indices.iter().flat_map(|index| index.to_le_bytes()).collect();
    Ok(std::fs::write(index_file, indices)?)
}
