//! Writing a mesh in any format.

use crate::choices::{Compression, PngCompression, Shading};
use crate::error::EncodeError;
use crate::gltf::{Texture, write_glb, write_gltf};
use crate::json::write_json;
use crate::mesh_format::Format;
use crate::model::write_model_with_comments;
use crate::obj::write_obj;
use crate::ply::write_ply;
use crate::pmesh::{write_pmesh_while, write_progression};
use crate::png::write_png_while;
use crate::pnm::write_pnm;
use crate::quantized_mesh::write_quantized_mesh;
use crate::shown::Shown;
use crate::stl::write_stl;
use crate::surface::Geometry;
use crate::svg::write_svg;
use crate::terrain::Terrain;
use crate::wanted::{Wanted, While};
use pixmesh_meshing::{Approximation, Fidelity, Mesh, Progression, Shape, rasterize};
use std::io::Write;

/// Bytes of a file beside its vertices and faces, at most.
const FRAME: usize = 4096;

/// What [`encode`] writes: a mesh, and what some formats show beside it.
#[derive(Clone, Copy, Debug)]
pub struct Encodable<'a> {
    /// The mesh.
    pub mesh: &'a Mesh,
    /// Comment lines of MODEL, see [`model_comments`](crate::model_comments).
    pub comments: &'a [&'a str],
    /// The error of the mesh, which JSON states.
    pub fidelity: Option<&'a Fidelity>,
    /// The order of the vertices, which [`Format::Progression`] needs.
    pub progression: Option<&'a Progression>,
}

impl<'a> Encodable<'a> {
    /// A mesh alone.
    #[must_use]
    pub fn new(mesh: &'a Mesh) -> Self {
        Self { mesh, comments: &[], fidelity: None, progression: None }
    }
}

impl<'a> From<&'a Approximation> for Encodable<'a> {
    /// A mesh that was made of an image, with its error.
    fn from(made: &'a Approximation) -> Self {
        Self { fidelity: Some(&made.fidelity), ..Self::new(&made.mesh) }
    }
}

/// Choices that formats leave open.
#[derive(Clone, Copy, Debug, Default)]
pub struct EncodeOptions<'a> {
    /// How the mesh lies in space, in the formats of three dimensions.
    pub geometry: Geometry,
    /// How glTF stores vertices and indices.
    pub compression: Compression,
    /// The picture that glTF embeds.
    pub texture: Option<&'a Texture>,
    /// How SVG fills triangles.
    pub shading: Shading,
    /// Whether faces that show nothing are left out, by the formats that need not cover the
    /// picture's rectangle: all but MODEL, pmesh, and pictures.
    pub cut: bool,
    /// What the heights of an elevation model mean, which MODEL and pmesh keep, and whether it has
    /// holes, which the other formats but pictures leave out.
    pub terrain: Option<Terrain>,
    /// How much time a PNG may take.
    pub png_compression: PngCompression,
}

/// Writes a mesh in a format, for as long as the file is wanted.
///
/// Only the PNG, the rebuilt picture, the colours of glTF and pmesh poll `wanted`; the other formats stop
/// when `out` fails.
///
/// # Errors
/// When the format cannot hold the mesh, writing fails, or the file is no longer wanted.
pub fn encode(
    source: &Encodable<'_>,
    format: Format,
    options: &EncodeOptions<'_>,
    out: &mut impl Write,
    wanted: &Wanted<'_>,
) -> Result<(), EncodeError> {
    let Encodable { mesh, comments, fidelity, progression, .. } = *source;
    let EncodeOptions { geometry, shading, cut, terrain, .. } = *options;
    let has_holes = terrain.is_some_and(|terrain| terrain.has_holes);
    let shown = || Shown::new(mesh, cut, has_holes);
    match format {
        Format::Model => {
            let terrain = terrain.map(|terrain| terrain.to_string());
            let comments: Vec<&str> = comments.iter().copied().chain(terrain.as_deref()).collect();
            Ok(write_model_with_comments(mesh, &comments, out)?)
        }
        Format::Glb => write_glb(&shown(), options, out, wanted),
        Format::Gltf => write_gltf(&shown(), options, out, wanted),
        Format::Svg => write_svg(&shown(), shading, out),
        Format::Ply => write_ply(&shown(), &geometry, out),
        Format::Obj => write_obj(&shown(), &geometry, out),
        Format::Stl => write_stl(&shown(), &geometry, out),
        Format::Json => write_json(&shown(), fidelity, &geometry, out),
        Format::Terrain => write_quantized_mesh(&shown(), terrain.as_ref(), out),
        Format::Pmesh => write_pmesh_while(mesh, terrain.as_ref(), out, wanted),
        Format::Progression => match progression {
            Some(progression) => write_progression(progression, terrain.as_ref(), out),
            None => Err(EncodeError::NotOfPointsAlone { format: format.name() }),
        },
        Format::Png => {
            let picture = rasterize(mesh, &While(wanted))?;
            write_png_while(&picture, options.png_compression, out, wanted)
        }
        Format::Pnm => write_pnm(&rasterize(mesh, &While(wanted))?, out),
    }
}

/// About the most bytes that [`encode`] writes: the capacity of a buffer that need not grow.
#[must_use]
pub fn estimated_bytes(mesh: &Mesh, format: Format, options: &EncodeOptions<'_>) -> usize {
    let (vertices, faces) = (mesh.points().len(), mesh.faces().len());
    let Shape { width, height, component_count, precision } = mesh.shape();
    let picture = width * height * component_count * usize::from(precision).div_ceil(8);
    let texture = options.texture.map_or(0, |texture| texture.bytes.len());
    let beside = match format {
        Format::Glb => texture,
        Format::Gltf => texture / 3 * 4,
        // Noise that does not compress becomes a little longer.
        Format::Png | Format::Pnm => picture + picture / 8,
        _ => 0,
    };
    let [vertex, face, _] = bytes_of(format, options.shading, component_count);
    let colored_face = if mesh.face_samples().is_some() {
        bytes_of_colored_face(format, component_count)
    } else {
        0
    };
    vertices * vertex + faces * (face + colored_face) + beside + FRAME
}

impl Format {
    /// The most bytes that writing a mesh of `component_count` components allocates per vertex with its
    /// two faces: the file and working memory. 0 for pictures, whose memory depends on their size.
    /// Faces with colours of their own need more.
    #[must_use]
    pub fn bytes_per_vertex(self, component_count: usize, has_face_samples: bool) -> u64 {
        let [vertex, face, work] = bytes_of(self, Shading::Gradient, component_count);
        let colored_face =
            if has_face_samples { bytes_of_colored_face(self, component_count) } else { 0 };
        // Six vertices with colours, two faces each with three, take the place of one.
        let work = if has_face_samples && self.repeats_vertices() { 6 * work } else { work };
        (vertex + 2 * (face + colored_face) + work) as u64
    }

    /// Whether each face has three vertices of its own where the faces have colours.
    fn repeats_vertices(self) -> bool {
        matches!(self, Self::Glb | Self::Gltf | Self::Ply | Self::Obj)
    }
}

/// Bytes that each face with a colour of its own adds to the file.
fn bytes_of_colored_face(format: Format, component_count: usize) -> usize {
    let [vertex, ..] = bytes_of(format, Shading::Flat, component_count);
    match format {
        _ if format.repeats_vertices() => 3 * vertex,
        Format::Model => 3 + 6 * component_count,
        Format::Json => 16 + 6 * component_count,
        // Its numbers twice, beside how they differ, its neighbours and its place.
        Format::Pmesh => 132 + 18 * component_count,
        _ => 0,
    }
}

/// Bytes of the file per vertex, of the file per face, and of working memory per vertex.
fn bytes_of(format: Format, shading: Shading, component_count: usize) -> [usize; 3] {
    match format {
        Format::Model => [12 + 6 * component_count, 27, 0],
        // The buffer grows beside its faces, and compression puts the mesh into another order first.
        Format::Glb => [32, 12, 464],
        Format::Gltf => [43, 16, 445],
        Format::Svg if shading == Shading::Flat => [0, 70, 10],
        Format::Svg => [0, 330 * component_count, 150 + 40 * component_count],
        // Painted vertices have a normal, a colour and a level while they are painted.
        Format::Ply => [16, 13, 46],
        Format::Obj => [55, 24, 51],
        Format::Stl => [0, 50, 0],
        Format::Json => [40 + 6 * component_count, 24, 42],
        // Positions, normals and heights are kept beside the vertices in another order.
        Format::Terrain => [12, 12, 150],
        // Order, neighbours, numbers and how they differ.
        Format::Pmesh => [12 + 2 * component_count, 0, 160 + 20 * component_count],
        Format::Progression => [14 + 2 * component_count, 0, 136 + 6 * component_count],
        Format::Png | Format::Pnm => [0, 0, 0],
    }
}
