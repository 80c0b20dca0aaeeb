//! From a mesh file to any other format and size: of a job's mesh, or of one that a client sends.

use super::encode::encode;
use super::{decode, texture};
use crate::context::Context;
use crate::error::EngineError;
use crate::params::Output;
use pixmesh_codec::{
    Encodable, Format, Limits, MeshFileError, MeshHeader, PmeshError, Terrain, Texture, probe_mesh,
    read_mesh_while, read_progression_while,
};
use pixmesh_meshing::parameters::Reconstruction;
use pixmesh_meshing::{Fidelity, Mesh, Progression, Shape, rasterize};

/// A mesh file, and what to make of it.
#[derive(Debug)]
pub struct Conversion<B> {
    /// MODEL, pmesh, or pmesh with the order of the vertices.
    pub file: B,
    /// The picture that glTF shows, if it shows one.
    pub shown: Option<Shown<B>>,
    /// Vertices of the mesh, which the order of the vertices must give; `None` for all.
    pub size: Option<usize>,
    /// The format to write.
    pub format: Format,
    /// How the mesh is written.
    pub output: Output,
    /// The mean squared error of the mesh of all vertices, where that is known.
    pub mse: Option<f64>,
}

/// A picture that glTF shows.
#[derive(Debug)]
pub enum Shown<B> {
    /// The file of a picture of the mesh's width and height.
    Picture(B),
    /// The bytes of a [`Texture`] that was stored.
    Texture(B),
}

/// A mesh as bytes, with what is known of it.
#[derive(Debug)]
pub struct Converted {
    /// The mesh in the format asked for.
    pub bytes: Vec<u8>,
    /// Vertices of the mesh.
    pub vertices: usize,
    /// Faces of the mesh.
    pub faces: usize,
    /// How close it is to the image; `None` where that is not known.
    pub fidelity: Option<Fidelity>,
}

/// Reads a mesh file, and writes the mesh, or the picture rebuilt from it, in a format.
///
/// # Errors
/// When the bytes are no mesh, the size or the format needs the order of the vertices and the file
/// does not keep it, the format cannot hold the result, or the context stops the work.
pub fn convert<B: AsRef<[u8]>>(
    conversion: Conversion<B>,
    limits: &Limits,
    context: &Context,
) -> Result<Converted, EngineError> {
    context.check()?;
    context.begin("decode");
    let Conversion { file, shown, size, format, output, mse } = conversion;
    let Source { mesh, progression, fidelity, terrain } =
        read(file, size, format, mse, limits, context)?;
    let shown = shown.filter(|_| output.shows_image(format));
    let texture = shown.map(|shown| shown.texture(mesh.shape(), limits, context)).transpose()?;
    let had_colors = mesh.face_samples().is_some();
    let mesh = rebuilt_by(mesh, output.reconstruction, context)?;
    let fidelity = fidelity.filter(|_| mesh.face_samples().is_some() == had_colors);
    let source = Encodable {
        fidelity: fidelity.as_ref(),
        progression: progression.as_ref(),
        ..Encodable::new(&mesh)
    };
    let bytes = encode(&source, format, &output.writing(texture.as_ref(), terrain), context)?;
    let (vertices, faces) = (mesh.points().len(), mesh.faces().len());
    Ok(Converted { bytes, vertices, faces, fidelity })
}

/// A mesh with what its file says of it.
struct Source {
    mesh: Mesh,
    progression: Option<Progression>,
    fidelity: Option<Fidelity>,
    terrain: Option<Terrain>,
}

fn read(
    file: impl AsRef<[u8]>,
    size: Option<usize>,
    format: Format,
    mse: Option<f64>,
    limits: &Limits,
    context: &Context,
) -> Result<Source, EngineError> {
    let bytes = file.as_ref();
    let MeshHeader { format: stored, vertices, terrain, .. } = probe_mesh(bytes, limits)?;
    let keeps_order = stored == Format::Progression;
    if !keeps_order && (size.is_some() || format == Format::Progression) {
        return Err(MeshFileError::from(PmeshError::NoOrder).into());
    }
    if !keeps_order {
        let mesh = read_mesh_while(bytes, limits, &|| context.check())?;
        let fidelity = mse.map(|mse| Fidelity::of_mse(mse, mesh.shape()));
        return Ok(Source { mesh, progression: None, fidelity, terrain });
    }
    let progression = read_progression_while(bytes, limits, &|| context.check());
    let progression = progression.map_err(MeshFileError::from)?;
    drop(file);
    let size = size.unwrap_or(vertices);
    let terrain = terrain.map(|terrain| terrain.of_size(size, vertices));
    let progression = progression.shortened(size)?;
    context.begin("triangulate");
    let mesh = progression.mesh(size, context)?;
    let fidelity = Some(progression.fidelity(size)?);
    Ok(Source { mesh, progression: Some(progression), fidelity, terrain })
}

impl<B: AsRef<[u8]>> Shown<B> {
    fn texture(
        self,
        shape: Shape,
        limits: &Limits,
        context: &Context,
    ) -> Result<Texture, EngineError> {
        let file = match self {
            Self::Texture(bytes) => return Ok(Texture::of_stored(bytes.as_ref().to_vec())),
            Self::Picture(file) => file,
        };
        let output = Output::default();
        let (image, _) = decode(file.as_ref(), output.reading(limits), 0, context)?;
        if (image.width(), image.height()) != (shape.width, shape.height) {
            return Err(EngineError::OtherSize {
                picture: (image.width(), image.height()),
                mesh: (shape.width, shape.height),
            });
        }
        texture(file.as_ref(), &image, context)
    }
}

/// The mesh whose picture is rebuilt in a way: linearly without colours of its faces; flat with the
/// best colour of each face for the picture that the mesh has.
fn rebuilt_by(
    mesh: Mesh,
    reconstruction: Option<Reconstruction>,
    context: &Context,
) -> Result<Mesh, EngineError> {
    match reconstruction {
        Some(Reconstruction::Linear) => Ok(mesh.without_face_samples()),
        Some(Reconstruction::Flat) if mesh.face_samples().is_none() => {
            let picture = rasterize(&mesh, context)?;
            Ok(mesh.with_flat_colors(&picture, context)?.0)
        }
        _ => Ok(mesh),
    }
}
