//! JSON, out: counts, errors and arrays, for clients on the web.
//!
//! Arrays are flat, so that clients copy them into typed arrays: `positions` holds `x, y, z` of
//! each vertex, `samples` the components of each vertex at the image's precision, `colors` red,
//! green, blue and alpha of each vertex as sRGB of 0 to 255, `triangles` three indices of each face.
//! Where faces have colours, `face_samples` and `face_colors` hold those of the faces that show the
//! picture, which come before those of a base.

use crate::color::Colors;
use crate::error::EncodeError;
use crate::lines::Lines;
use crate::shown::Shown;
use crate::surface::{Geometry, Surface};
use pixmesh_meshing::{Fidelity, Shape};
use std::io::{self, Write};

/// Writes a mesh as one JSON object. The PSNR of a perfect copy, which is infinite, is `null`, as
/// are both errors of a mesh whose fidelity is not known.
pub(crate) fn write_json(
    mesh: &Shown<'_>,
    fidelity: Option<&Fidelity>,
    geometry: &Geometry,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let surface = Surface::new(mesh, geometry)?;
    let mut lines = Lines::new(out);
    let Shape { width, height, component_count, precision } = mesh.shape();
    let (vertices, faces, unit) = (surface.vertex_count(), surface.face_count(), surface.unit());
    write!(lines, "{{\"width\":{width},\"height\":{height},\"components\":{component_count}")?;
    write!(lines, ",\"precision\":{precision},\"vertices\":{vertices},\"faces\":{faces}")?;
    put_number(",\"mse\":", fidelity.map(Fidelity::mse), &mut lines);
    put_number(",\"psnr_db\":", fidelity.map(Fidelity::psnr_db), &mut lines);
    write!(lines, ",\"unit\":\"{unit}\"")?;
    put_array(",\"positions\":[", surface.placed_positions(), &mut lines, Lines::decimal)?;
    let samples = surface.samples().map(|samples| samples.iter().copied());
    put_array(",\"samples\":[", samples, &mut lines, Lines::integer)?;
    let palette = Colors::new(mesh.shape());
    let colors = surface.samples().map(|samples| palette.rgba(samples));
    put_array(",\"colors\":[", colors, &mut lines, Lines::integer)?;
    put_array(",\"triangles\":[", surface.faces(), &mut lines, Lines::integer)?;
    if let Some(samples) = mesh.face_samples() {
        let of_faces = || samples.chunks_exact(component_count);
        let samples = of_faces().map(|samples| samples.iter().copied());
        put_array(",\"face_samples\":[", samples, &mut lines, Lines::integer)?;
        let colors = of_faces().map(|samples| palette.rgba(samples));
        put_array(",\"face_colors\":[", colors, &mut lines, Lines::integer)?;
    }
    lines.end("}\n")?;
    lines.flush()?;
    Ok(())
}

/// Appends a number, `null` where it is not known or not finite.
fn put_number<W: Write>(name: &str, number: Option<f64>, lines: &mut Lines<'_, W>) {
    lines.text(name);
    match number.filter(|number| number.is_finite()) {
        Some(number) => lines.decimal(number),
        None => lines.text("null"),
    }
}

/// Appends records one after the other, their numbers between commas.
fn put_array<'a, W: Write, R: IntoIterator>(
    name: &str,
    records: impl Iterator<Item = R>,
    lines: &mut Lines<'a, W>,
    put: impl Fn(&mut Lines<'a, W>, R::Item),
) -> io::Result<()> {
    lines.text(name);
    let mut separator = "";
    for record in records {
        for number in record {
            lines.text(separator);
            put(lines, number);
            separator = ",";
        }
        lines.end("")?;
    }
    lines.end("]")
}
