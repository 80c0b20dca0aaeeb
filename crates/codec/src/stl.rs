//! STL, out: binary, for printers.
//!
//! STL has neither colours nor units: printers take its numbers for millimetres. A solid is written,
//! the relief on a base, whose every edge belongs to two triangles, so that it is watertight.
//!
//! Literature: 3D Systems, "StereoLithography Interface Specification", 1989.

use crate::choices::LengthUnit;
use crate::error::EncodeError;
use crate::shown::Shown;
use crate::surface::{Geometry, Surface, cross_product, unit as unit_vector};
use std::io::{BufWriter, Write};

/// Bytes of the comment at the start, which must not begin with `solid`.
const COMMENT_BYTES: usize = 80;

/// Writes a mesh as the binary STL of a solid.
///
/// A geometry without a relief gets one of the luma, a tenth of the longer side high, and one
/// without a base gets that of [`Geometry::with_base`].
pub(crate) fn write_stl(
    mesh: &Shown<'_>,
    geometry: &Geometry,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let relief = Some(geometry.relief.unwrap_or_default());
    let unit = Some(geometry.unit.unwrap_or(LengthUnit::Millimetre));
    let geometry = Geometry { relief, unit, ..*geometry }.with_base(mesh.shape());
    let surface = Surface::new(mesh, &geometry)?;
    let triangles = surface.face_count();
    let (bytes, limit) = (84 + 50 * triangles as u64, 84 + 50 * u64::from(u32::MAX));
    let count = u32::try_from(triangles).map_err(|_| EncodeError::TooLarge {
        format: "STL",
        bytes,
        limit,
    })?;
    let mut out = BufWriter::new(out);
    let comment = format!("binary STL, lengths in {}", surface.unit());
    write!(out, "{comment:COMMENT_BYTES$}")?;
    out.write_all(&count.to_le_bytes())?;
    for face in surface.faces() {
        let corners = face.map(|vertex| surface.placed(vertex as usize));
        let [x, y, z] = unit_vector(cross_product(corners));
        for vector in [[x, y, z]].into_iter().chain(corners) {
            out.write_all(vector.map(|part| (part as f32).to_le_bytes()).as_flattened())?;
        }
        out.write_all(&[0; 2])?;
    }
    out.flush()?;
    Ok(())
}
