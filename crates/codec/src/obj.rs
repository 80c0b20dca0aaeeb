//! Wavefront OBJ, out: positions with colours, and faces.
//!
//! A vertex line has `x y z`, then red, green and blue of 0 to 1, which most readers understand as
//! its colour; the format has no alpha. Indices count from 1. Where faces have colours, each has
//! three vertices of its own.
//!
//! Literature: Wavefront Technologies, "Object Files (.obj)", Advanced Visualizer manual, 1992; the
//! colours are an extension by use.

use crate::color::Colors;
use crate::error::EncodeError;
use crate::lines::Lines;
use crate::rounding::rounded_quotient;
use crate::shown::Shown;
use crate::surface::{Geometry, Surface};
use std::io::Write;

/// Writes a mesh as OBJ.
pub(crate) fn write_obj(
    mesh: &Shown<'_>,
    geometry: &Geometry,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let surface = Surface::colored(mesh, geometry)?;
    let shown = surface.color_shape();
    let colors = Colors::new(shown.unwrap_or(mesh.shape()));
    let mut lines = Lines::new(out);
    writeln!(lines, "# lengths in {}\no picture", surface.unit())?;
    for (position, samples) in surface.placed_positions().zip(surface.samples()) {
        lines.text("v");
        for length in position {
            lines.text(" ");
            lines.decimal(length);
        }
        let [red, green, blue, _] = colors.rgba(samples);
        let shown: &[u8] = if shown.is_some() { &[red, green, blue] } else { &[] };
        for &part in shown {
            lines.text(" ");
            // Four digits, from which readers recover the 8 bits.
            let fraction = rounded_quotient(10_000 * u64::from(part), 255);
            write!(lines, "{}.{:04}", fraction / 10_000, fraction % 10_000)?;
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
