//! Wavefront OBJ, out: positions with colours, and faces.
//!
//! A vertex line has `x y z`, then red, green and blue of 0 to 1, which most readers understand as
//! its colour; alpha cannot be told. Indices count from 1.
//!
//! Literature: Wavefront Technologies, "Object Files (.obj)", Advanced Visualizer manual, 1992; the
//! colours are an extension by use.

use crate::color::Colors;
use crate::error::EncodeError;
use crate::lines::Lines;
use crate::surface::{Geometry, Surface};
use pixmesh_meshing::Mesh;
use std::io::Write;

/// Writes a mesh as OBJ.
///
/// # Errors
/// [`EncodeError::NoSuchComponent`] for a relief that cannot be, and whatever `out` fails with.
pub fn write_obj(
    mesh: &Mesh,
    geometry: &Geometry,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let surface = Surface::new(mesh, geometry)?;
    let colors = Colors::new(mesh.shape());
    let mut lines = Lines::new(out);
    lines.text("# lengths in ");
    lines.end(surface.geometry().unit.name())?;
    lines.end("\no picture\n")?;
    for (vertex, position) in surface.positions().enumerate() {
        lines.text("v");
        for length in position {
            lines.text(" ");
            lines.decimal(length);
        }
        let [red, green, blue, _] = colors.rgba(mesh.vertex_samples(surface.origin(vertex)));
        for part in [red, green, blue] {
            lines.text(" ");
            put_fraction(part, &mut lines);
        }
        lines.end("\n")?;
    }
    for face in surface.faces() {
        lines.text("f");
        for index in face {
            lines.text(" ");
            lines.integer(index + 1);
        }
        lines.end("\n")?;
    }
    lines.flush()?;
    Ok(())
}

/// Appends `part / 255` with four digits, from which the 8 bits can be had back.
fn put_fraction<W: Write>(part: u8, lines: &mut Lines<'_, W>) {
    let thousandths = (u32::from(part) * 20_000 + 255) / 510;
    lines.integer(thousandths / 10_000);
    lines.text(".");
    let digits = thousandths % 10_000;
    for place in [1000, 100, 10, 1] {
        lines.integer(digits / place % 10);
    }
}
