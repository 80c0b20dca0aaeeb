//! The PNM writer: raw graymaps (P5), raw pixmaps (P6), and PAM (P7) where there is alpha.
//!
//! Samples are written as they are, with maxval `2^precision - 1`.

use crate::error::EncodeError;
use crate::interleave::interleave_row;
use pixmesh_meshing::Image;
use std::io::Write;

/// Writes an image of 1 or 3 components as PGM or PPM, one of 2 or 4 as PAM with alpha.
///
/// Samples take one byte, or two with the more significant first where the precision is over 8.
///
/// # Errors
/// [`EncodeError::ComponentCount`] for more than four components, and whatever `out` fails with.
pub fn write_pnm(image: &Image, out: &mut impl Write) -> Result<(), EncodeError> {
    let (width, height, maxval) = (image.width(), image.height(), image.max_sample());
    match image.component_count() {
        1 => write!(out, "P5\n{width} {height}\n{maxval}\n")?,
        3 => write!(out, "P6\n{width} {height}\n{maxval}\n")?,
        2 => write_pam_header(image, "GRAYSCALE_ALPHA", out)?,
        4 => write_pam_header(image, "RGB_ALPHA", out)?,
        actual => return Err(EncodeError::ComponentCount { format: "PNM", actual, maximum: 4 }),
    }
    let bytes_per_sample = if maxval > 255 { 2 } else { 1 };
    let mut bytes = Vec::new();
    for y in (0..height).rev() {
        interleave_row(
            image,
            y,
            image.component_count(),
            bytes_per_sample,
            |sample| sample,
            &mut bytes,
        );
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// Writes the header of a PAM whose tuples are of type `kind`.
fn write_pam_header(image: &Image, kind: &str, out: &mut impl Write) -> Result<(), EncodeError> {
    let (width, height, maxval) = (image.width(), image.height(), image.max_sample());
    let depth = image.component_count();
    write!(
        out,
        "P7\nWIDTH {width}\nHEIGHT {height}\nDEPTH {depth}\nMAXVAL {maxval}\nTUPLTYPE {kind}\nENDHDR\n"
    )?;
    Ok(())
}
