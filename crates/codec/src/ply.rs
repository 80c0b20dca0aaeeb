//! PLY, out: binary, with the vertices' colours.
//!
//! Positions are 32-bit floating-point numbers, colours sRGB of 8 bits with alpha where there is
//! some, faces lists of three 32-bit indices; all little-endian.
//!
//! Literature: Greg Turk, "The PLY Polygon File Format", 1994.

use crate::color::Colors;
use crate::error::EncodeError;
use crate::shown::Shown;
use crate::surface::{Geometry, Surface};
use pixmesh_meshing::alpha::has_alpha;
use std::io::{BufWriter, Write};

/// Writes a mesh as binary PLY.
pub(crate) fn write_ply(
    mesh: &Shown<'_>,
    geometry: &Geometry,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let surface = Surface::colored(mesh, geometry)?;
    let shown = surface.color_shape();
    let colors = Colors::new(shown.unwrap_or(mesh.shape()));
    let color_bytes = shown.map_or(0, |shown| if has_alpha(shown.component_count) { 4 } else { 3 });
    let mut out = BufWriter::new(out);
    write_header(&surface, color_bytes, &mut out)?;
    for (position, samples) in surface.placed_positions().zip(surface.samples()) {
        out.write_all(position.map(|length| (length as f32).to_le_bytes()).as_flattened())?;
        out.write_all(&colors.rgba(samples)[..color_bytes])?;
    }
    for face in surface.faces() {
        out.write_all(&[3])?;
        out.write_all(face.map(u32::to_le_bytes).as_flattened())?;
    }
    out.flush()?;
    Ok(())
}

fn write_header(
    surface: &Surface<'_>,
    color_bytes: usize,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    writeln!(out, "comment lengths in {}", surface.unit())?;
    writeln!(out, "element vertex {}", surface.vertex_count())?;
    for axis in ["x", "y", "z"] {
        writeln!(out, "property float {axis}")?;
    }
    for color in &["red", "green", "blue", "alpha"][..color_bytes] {
        writeln!(out, "property uchar {color}")?;
    }
    writeln!(out, "element face {}", surface.face_count())?;
    writeln!(out, "property list uchar int vertex_indices\nend_header")?;
    Ok(())
}
