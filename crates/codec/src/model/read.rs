//! The MODEL reader.
//!
//! Tokens structure the file; lines appear in errors only. Numbers of vertices and faces that the rest
//! of the file cannot hold are refused, so that memory stays within a small multiple of the file's
//! size. After an error in a vertex or face the tokens are read again to find its line.

use super::defect::{ModelDefect, ModelError};
use super::tokens::Tokens;
use crate::limits::Limits;
use crate::mesh_format::Format;
use crate::mesh_header::MeshHeader;
use crate::terrain::Terrain;
use crate::wanted::{Wanted, While, always};
use pixmesh_meshing::alpha::premultiply_vectors;
use pixmesh_meshing::{Face, ImageError, Mesh, MeshError, Point, Shape};

/// Samples per pixel that the limits allow: those of a picture with red, green, blue and alpha.
const SAMPLES_PER_PIXEL: u64 = 4;

/// Tokens before the numbers of vertices, faces and edges: the image's shape and the word `OFF`.
const COUNTS_TOKEN: usize = 5;

/// Tokens before the first vertex.
const VERTICES_TOKEN: usize = COUNTS_TOKEN + 3;

/// The words of the comment before the samples of the faces.
pub(super) const FACE_SAMPLES: &str = "face samples:";

/// Tokens of a face.
const FACE_TOKENS: usize = 4;

/// Reads a mesh from MODEL, and checks that it is one.
///
/// Any white space separates the fields, and comments run from `#` to the end of their line. The
/// number of edges must be that of vertices and faces less one, or 0 for "not counted". Comments
/// after the last face may give the faces colours, as [`write_model`](crate::write_model) does.
/// Where there is alpha the file's colours are straight, and the mesh's premultiplied.
///
/// # Errors
/// The first defect with its line: fields that are missing or no whole numbers, sizes over the
/// limits, numbers of vertices or faces that the file cannot hold, points outside or repeated,
/// samples over the precision's largest, corners missing, faces that are not counter-clockwise
/// triangles of existing vertices, that overlap or leave a gap, and whatever follows the last.
///
/// ```
/// use pixmesh_codec::{Limits, read_model};
///
/// let model = b"3 2 1 8 OFF 4 2 5  0 0 10  2 0 20  2 1 30  0 1 40  3 0 1 2  3 0 2 3";
/// assert_eq!(read_model(model, &Limits::default()).unwrap().faces().len(), 2);
///
/// let error = read_model(b"3 2 1 8\nOFF\n4 2 5\n0 0 256", &Limits::default()).unwrap_err();
/// assert_eq!(error.to_string(), "line 3: 4 vertices are announced, but the rest of the file \
///     holds 1 at the most");
/// ```
pub fn read_model(bytes: &[u8], limits: &Limits) -> Result<Mesh, ModelError> {
    read_model_while(bytes, limits, &always)
}

/// The most bytes that reading a MODEL of `length` bytes holds: the text itself, the mesh, whose
/// numbers are shorter than their texts, and the list of edges that its check sorts.
#[must_use]
pub fn read_model_bytes(length: u64) -> u64 {
    length.saturating_mul(4)
}

/// Reads a mesh as [`read_model`] does, for as long as it is wanted.
///
/// # Errors
/// As [`read_model`], and [`ModelDefect::Cancelled`] when it is no longer wanted.
pub fn read_model_while(
    bytes: &[u8],
    limits: &Limits,
    wanted: &Wanted<'_>,
) -> Result<Mesh, ModelError> {
    let mut tokens = Tokens::new(bytes, wanted);
    let shape = read_shape(&mut tokens, limits)?;
    read_keyword(&mut tokens)?;
    read_terrain(&mut tokens, shape)?;
    let (vertex_count, face_count) = read_counts(&mut tokens, shape)?;
    let (points, mut samples) = read_vertices(&mut tokens, shape, vertex_count)?;
    let faces = read_faces(&mut tokens, vertex_count, face_count)?;
    let mut face_samples = read_face_samples(&mut tokens, shape, face_count)?;
    for samples in [Some(&mut samples), face_samples.as_mut()].into_iter().flatten() {
        premultiply_vectors(samples, shape.component_count, u16::MAX >> (16 - shape.precision));
    }
    if let Some(token) = tokens.next() {
        return Err(token.malformed(&format!("'{}' follows the last face", token.quote())));
    }
    let mesh = Mesh::new(shape, points, samples, faces, &While(wanted));
    let mesh = mesh.and_then(|mesh| match face_samples {
        Some(samples) => mesh.with_face_samples(samples),
        None => Ok(mesh),
    });
    mesh.map_err(|defect| match defect {
        MeshError::Cancelled(cancelled) => tokens.error(cancelled.into()),
        defect => {
            let token = token_of(&defect, shape, vertex_count);
            line_of_token(bytes, token, wanted)
                .map_or_else(|error| error, |line| ModelError { line, defect: defect.into() })
        }
    })
}

/// Reads the shape of a MODEL's image, and checks it and the numbers of vertices and faces against
/// the limits and the rest of the file, which is not looked at.
///
/// # Errors
/// As [`read_model`], for what comes before the first vertex.
///
/// ```
/// use pixmesh_codec::{Limits, probe_model};
///
/// let header = probe_model(b"2 2 1 8 OFF 0 0 0", &Limits::default()).unwrap();
/// assert_eq!((header.shape.width, header.shape.height), (2, 2));
/// assert!(probe_model(b"20000 20000 1 8 OFF 4 2 5", &Limits::default()).is_err());
/// ```
pub fn probe_model(bytes: &[u8], limits: &Limits) -> Result<MeshHeader, ModelError> {
    let mut tokens = Tokens::new(bytes, &always);
    let shape = read_shape(&mut tokens, limits)?;
    read_keyword(&mut tokens)?;
    let terrain = read_terrain(&mut tokens, shape)?;
    let (vertices, _) = read_counts(&mut tokens, shape)?;
    Ok(MeshHeader { format: Format::Model, shape, vertices, is_flat: true, terrain })
}

/// Reads what the comments after the word `OFF` say of an elevation model.
fn read_terrain(tokens: &mut Tokens<'_>, shape: Shape) -> Result<Option<Terrain>, ModelError> {
    let mut terrain = None;
    while let Some(comment) = tokens.comment()? {
        if let Some(read) = Terrain::of_text(comment.rest(), shape) {
            let damaged = |defect| comment.error(ModelDefect::Malformed(defect));
            terrain = Some(read.map_err(damaged)?);
        }
    }
    Ok(terrain)
}

/// Reads width, height, number of components and precision, and checks them against the limits.
fn read_shape(tokens: &mut Tokens<'_>, limits: &Limits) -> Result<Shape, ModelError> {
    let first = tokens.clone().expect("the width")?;
    let width = tokens.number("the width", 1, u64::MAX)?;
    let height = tokens.number("the height", 1, u64::MAX)?;
    let (width, height) =
        limits.check(width, height).map_err(|error| first.error(ModelDefect::Size(error)))?;
    let third = tokens.clone().expect("the number of components")?;
    let component_count = tokens.number("the number of components", 1, u64::MAX)?;
    let samples = (width as u64 * height as u64).saturating_mul(component_count);
    let limit = limits.max_pixels.saturating_mul(SAMPLES_PER_PIXEL);
    if samples > limit {
        return Err(third.error(ModelDefect::TooManySamples { component_count, samples, limit }));
    }
    let precision = tokens.number("the precision", 1, 16)? as u8;
    Ok(Shape { width, height, component_count: component_count as usize, precision })
}

/// Reads the word `OFF`.
fn read_keyword(tokens: &mut Tokens<'_>) -> Result<(), ModelError> {
    let token = tokens.expect("the word OFF")?;
    if token.text == b"OFF" { Ok(()) } else { Err(token.unexpected("the word OFF")) }
}

/// Reads the numbers of vertices, faces and edges. Returns the first two, which the rest of the file
/// is long enough to hold.
fn read_counts(tokens: &mut Tokens<'_>, shape: Shape) -> Result<(usize, usize), ModelError> {
    let first = tokens.clone().expect("the number of vertices")?;
    let vertices = tokens.number("the number of vertices", 0, u64::MAX)?;
    let second = tokens.clone().expect("the number of faces")?;
    let faces = tokens.number("the number of faces", 0, u64::MAX)?;
    let third = tokens.clone().expect("the number of edges")?;
    let edges = tokens.number("the number of edges", 0, u64::MAX)?;
    let vertex_tokens = 2_u64.saturating_add(shape.component_count as u64);
    let (what, maximum) = ("vertices", most_records(tokens, vertex_tokens));
    if vertices > maximum {
        return Err(first.error(ModelDefect::TooMany { what, count: vertices, maximum }));
    }
    let (what, maximum) = ("faces", most_records(tokens, FACE_TOKENS as u64));
    if faces > maximum {
        return Err(second.error(ModelDefect::TooMany { what, count: faces, maximum }));
    }
    let expected = (vertices + faces).saturating_sub(1);
    if edges != 0 && edges != expected {
        return Err(third.malformed(&format!(
            "{edges} edges are announced, but {vertices} vertices and {faces} faces have {expected}"
        )));
    }
    Ok((vertices as usize, faces as usize))
}

/// The most records of `record_tokens` tokens that the rest of the file can hold: each token takes a
/// character and white space before it.
fn most_records(tokens: &Tokens<'_>, record_tokens: u64) -> u64 {
    tokens.remaining() as u64 / record_tokens.saturating_mul(2)
}

/// Reads the vertices' places and samples.
fn read_vertices(
    tokens: &mut Tokens<'_>,
    shape: Shape,
    count: usize,
) -> Result<(Vec<Point>, Vec<u16>), ModelError> {
    let mut points = Vec::with_capacity(count);
    let mut samples = Vec::with_capacity(count * shape.component_count);
    let (right, top) = (shape.width as u64 - 1, shape.height as u64 - 1);
    let largest = u64::from(u16::MAX >> (16 - shape.precision));
    for _ in 0..count {
        let x = tokens.number("the vertex's x", 0, right)?;
        let y = tokens.number("the vertex's y", 0, top)?;
        points.push(Point::new(x as i32, y as i32));
        for _ in 0..shape.component_count {
            samples.push(tokens.number("the vertex's sample", 0, largest)? as u16);
        }
    }
    Ok((points, samples))
}

/// Reads the faces: each the number 3, then three indices of vertices.
fn read_faces(
    tokens: &mut Tokens<'_>,
    vertex_count: usize,
    face_count: usize,
) -> Result<Vec<Face>, ModelError> {
    let mut faces = Vec::with_capacity(face_count);
    for _ in 0..face_count {
        let field = "the face's number of corners";
        let corners = tokens.expect(field)?;
        if corners.integer(field)? != Some(3) {
            let found = corners.quote();
            let defect = format!("the face has {found} corners where only triangles are allowed");
            return Err(corners.malformed(&defect));
        }
        let mut face = [0; 3];
        for index in &mut face {
            *index = read_index(tokens, vertex_count)?;
        }
        faces.push(face);
    }
    Ok(faces)
}

/// Reads the samples of the faces from the comments after the last face, if they are there: a title
/// and a comment for each face.
fn read_face_samples(
    tokens: &mut Tokens<'_>,
    shape: Shape,
    face_count: usize,
) -> Result<Option<Vec<u16>>, ModelError> {
    let largest = u64::from(u16::MAX >> (16 - shape.precision));
    while let Some(mut title) = tokens.comment()? {
        if !FACE_SAMPLES
            .split(' ')
            .all(|word| title.next().is_some_and(|t| t.text == word.as_bytes()))
        {
            continue;
        }
        let count = face_count as u64;
        title.number("the number of faces with samples", count, count)?;
        let mut samples = Vec::new();
        for face in 0..face_count {
            let missing = || format!("the comment with the samples of face {face} is missing");
            let comment = tokens.comment()?;
            let mut numbers =
                comment.ok_or_else(|| tokens.error(ModelDefect::Malformed(missing())))?;
            for _ in 0..shape.component_count {
                samples.push(numbers.number("the face's sample", 0, largest)? as u16);
            }
            if let Some(token) = numbers.next() {
                return Err(token.malformed("the face has more samples than the image components"));
            }
        }
        return Ok(Some(samples));
    }
    Ok(None)
}

/// Reads the index of one of `count` vertices.
fn read_index(tokens: &mut Tokens<'_>, count: usize) -> Result<u32, ModelError> {
    let field = "the index of a vertex";
    let token = tokens.expect(field)?;
    let index = token.integer(field)?.filter(|&index| index < count as u64);
    index
        .and_then(|index| u32::try_from(index).ok())
        .ok_or_else(|| token.error(ModelDefect::IndexOutOfRange { found: token.quote(), count }))
}

/// Number of the token at which a mesh's defect is to be reported: the first of the vertex or face
/// at fault, else of the counts.
fn token_of(defect: &MeshError, shape: Shape, vertex_count: usize) -> usize {
    let vertex_tokens = 2 + shape.component_count;
    match *defect {
        MeshError::PointOutside { vertex, .. }
        | MeshError::PointRepeated { vertex, .. }
        | MeshError::SampleRange { vertex, .. }
        | MeshError::VertexUnused { vertex } => VERTICES_TOKEN + vertex * vertex_tokens,
        MeshError::IndexOutOfRange { face, .. }
        | MeshError::FaceDegenerate { face }
        | MeshError::FaceClockwise { face }
        | MeshError::FacesOverlap { face, .. }
        | MeshError::Gap { face, .. } => {
            VERTICES_TOKEN + vertex_count * vertex_tokens + face * FACE_TOKENS
        }
        MeshError::Shape(ImageError::Precision(_)) => 3,
        MeshError::Shape(_) => 0,
        _ => COUNTS_TOKEN,
    }
}

/// The line of a token, counted from 0.
///
/// # Errors
/// [`ModelDefect::Cancelled`] when the file is no longer wanted.
fn line_of_token(bytes: &[u8], number: usize, wanted: &Wanted<'_>) -> Result<usize, ModelError> {
    let mut tokens = Tokens::new(bytes, wanted);
    for _ in 0..number {
        tokens.expect("a token")?;
    }
    Ok(tokens.next().map_or(1, |token| token.line))
}
