//! The mesh as the bytes of an answer.

use crate::extract::accept::Format;
use crate::extract::params::Output;
use crate::pool::Watch;
use crate::problem::Problem;
use pixmesh_codec::{
    EncodeError, GltfOptions, Shading, Texture, write_glb, write_gltf, write_json,
    write_model_with_comments, write_obj, write_ply, write_pmesh, write_png_while, write_pnm,
    write_progression, write_stl, write_svg,
};
use pixmesh_meshing::{Approximation, Fidelity, Image, Mesh, Progression, Shape, rasterize};
use std::borrow::Cow;
use std::io::{self, Write};

/// Room in bytes for what is in an answer whatever its size, such as the header of a file.
const FRAME: usize = 4096;

/// Bytes written from one look at the watch to the next: some tenth of a millisecond's work.
const POLL_BYTES: usize = 1 << 16;

/// The bytes of an answer that fail to be written as soon as nobody waits for them.
pub(super) struct Watched<'a> {
    bytes: Vec<u8>,
    /// How many there were at the last look at the watch.
    polled_at: usize,
    watch: &'a Watch,
}

impl Write for Watched<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.bytes.len() - self.polled_at >= POLL_BYTES {
            self.watch.check().map_err(io::Error::other)?;
            self.polled_at = self.bytes.len();
        }
        self.bytes.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// What is to be written, and how.
#[derive(Clone, Copy)]
pub(super) struct Writing<'a> {
    pub(super) format: Format,
    pub(super) output: &'a Output,
    /// The image to show in it.
    pub(super) texture: Option<&'a Texture>,
    /// What distinguishes the mesh from one of the thesis.
    pub(super) comments: &'a [&'a str],
    /// What is known of the mesh where it has just been made.
    pub(super) model: Option<&'a Approximation>,
    /// How close it is to the image, where that is known.
    pub(super) fidelity: Option<&'a Fidelity>,
    /// The order of its vertices, where it is known.
    pub(super) progression: Option<&'a Progression>,
}

/// The mesh, or the picture rebuilt from it, in a format.
pub(super) fn encode(
    mesh: &Mesh,
    writing: &Writing<'_>,
    watch: &Watch,
) -> Result<Vec<u8>, Problem> {
    let room = room(mesh, writing);
    let Writing { format, output, texture, comments, model, fidelity, progression } = *writing;
    let Output { geometry, compression, shading, png_compression, .. } = *output;
    let gltf = GltfOptions { geometry, compression, texture };
    match format {
        Format::Model => {
            encoded(room, watch, |bytes| write_model_with_comments(mesh, comments, bytes))
        }
        Format::Glb => encoded(room, watch, |bytes| write_glb(mesh, &gltf, bytes)),
        Format::Gltf => encoded(room, watch, |bytes| write_gltf(mesh, &gltf, bytes)),
        Format::Svg => encoded(room, watch, |bytes| write_svg(mesh, shading, bytes)),
        Format::Ply => encoded(room, watch, |bytes| write_ply(mesh, &geometry, bytes)),
        Format::Obj => encoded(room, watch, |bytes| write_obj(mesh, &geometry, bytes)),
        Format::Stl => encoded(room, watch, |bytes| write_stl(mesh, &geometry, bytes)),
        Format::Json => encoded(room, watch, |bytes| write_json(mesh, fidelity, &geometry, bytes)),
        Format::Pmesh => encoded(room, watch, |bytes| write_pmesh(mesh, bytes)),
        Format::Progression => {
            let without = EncodeError::NotOfPointsAlone { format: format.name() };
            let progression = progression.ok_or(without)?;
            encoded(room, watch, |bytes| write_progression(progression, bytes))
        }
        Format::Png => {
            let picture = picture(mesh, model, watch)?;
            encoded(room, watch, |bytes| {
                write_png_while(&picture, png_compression, bytes, &|| watch.check())
            })
        }
        Format::Pnm => {
            let picture = picture(mesh, model, watch)?;
            encoded(room, watch, |bytes| write_pnm(&picture, bytes))
        }
    }
}

/// The picture rebuilt from a mesh, or that of one colour for each face.
fn picture<'m>(
    mesh: &Mesh,
    model: Option<&'m Approximation>,
    watch: &Watch,
) -> Result<Cow<'m, Image>, Problem> {
    match model.and_then(|model| model.flat.as_ref()) {
        Some(flat) => Ok(Cow::Borrowed(&flat.picture)),
        None => Ok(Cow::Owned(rasterize(mesh, watch)?)),
    }
}

/// About the most bytes that an answer takes: one that must not be copied while it grows.
fn room(mesh: &Mesh, writing: &Writing<'_>) -> usize {
    let Shape { width, height, component_count, precision } = mesh.shape();
    let (vertices, faces) = (mesh.points().len(), mesh.faces().len());
    let picture = width * height * component_count * usize::from(precision).div_ceil(8);
    let texture = writing.texture.map_or(0, |texture| texture.bytes().len());
    let gltf = vertices * 32 + faces * 12 + texture;
    let bytes = match writing.format {
        Format::Model => vertices * (12 + 6 * component_count) + faces * 27,
        Format::Glb => gltf,
        Format::Gltf => gltf / 3 * 4,
        Format::Svg if writing.output.shading == Shading::Flat => faces * 70,
        Format::Svg => faces * 330 * component_count,
        Format::Ply => vertices * 16 + faces * 13,
        Format::Obj => vertices * 55 + faces * 24,
        Format::Stl => faces * 50,
        Format::Json => vertices * (40 + 6 * component_count) + faces * 24,
        Format::Pmesh | Format::Progression => vertices * (14 + 2 * component_count),
        // What does not compress becomes a little longer.
        Format::Png | Format::Pnm => picture + picture / 8,
    };
    bytes + FRAME
}

/// The bytes of an answer; it gives back the room that it did not need.
pub(super) fn encoded<E: Into<EncodeError>>(
    room: usize,
    watch: &Watch,
    write: impl FnOnce(&mut Watched<'_>) -> Result<(), E>,
) -> Result<Vec<u8>, Problem> {
    watch.begin("encode");
    let mut out = Watched { bytes: Vec::with_capacity(room), polled_at: 0, watch };
    let written = write(&mut out);
    watch.check()?;
    written.map_err(Into::into)?;
    let mut bytes = out.bytes;
    bytes.shrink_to_fit();
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    #[test]
    fn writing_stops_where_it_is_when_nobody_waits_any_more() {
        let watch = Watch::new(Instant::now() + Duration::from_secs(60));
        let mut written = 0;
        let refused = encoded(0, &watch, |out| -> io::Result<()> {
            for row in 0..100 {
                if row == 10 {
                    watch.cancel();
                }
                out.write_all(&[0; POLL_BYTES])?;
                written += 1;
            }
            Ok(())
        });
        assert!(refused.is_err());
        assert_eq!(written, 10);
    }
}
