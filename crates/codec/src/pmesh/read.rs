//! The pmesh reader.

use super::compact;
use super::error::PmeshError;
use super::{
    COMPACT_VERSION, FLAT_VERSION, HEADER_BYTES, MAGIC, NUMBER_BYTES, Predictor, RANK_BYTES,
    TERRAIN_VERSION, VERSION, is_pmesh, mean_of_corners, ordered_faces, predicted, read_terrain,
};
use crate::leb128::{take, unfolded};
use crate::limits::Limits;
use crate::mesh_format::Format;
use crate::mesh_header::MeshHeader;
use crate::wanted::{Wanted, While, always};
use flate2::read::DeflateDecoder;
use pixmesh_meshing::alpha::premultiply_vectors;
use pixmesh_meshing::{
    Cancelled, Face, Mesh, MeshError, Point, Progression, ProgressionError, Shape, triangulate_with,
};
use std::io::{self, Read};

/// Vertices between two polls of `wanted`.
const POLL_VERTICES: usize = 1 << 12;

/// Bytes of a gap at most.
const GAP_BYTES: usize = 6;

/// Reads a mesh from pmesh, vertices by row, then column, whether an order is kept or not.
///
/// # Errors
/// When the bytes are no pmesh, or one beyond the limits.
pub fn read_pmesh(bytes: &[u8], limits: &Limits) -> Result<Mesh, PmeshError> {
    read_pmesh_while(bytes, limits, &always)
}

/// Reads a mesh as [`read_pmesh`] does, for as long as it is wanted.
///
/// # Errors
/// As [`read_pmesh`], and [`PmeshError::Cancelled`] when it is no longer wanted.
pub fn read_pmesh_while(
    bytes: &[u8],
    limits: &Limits,
    wanted: &Wanted<'_>,
) -> Result<Mesh, PmeshError> {
    if is_compact(bytes) {
        return compact::read(bytes, limits, wanted);
    }
    let Contents { shape, points, mut samples, face_differences, .. } =
        read(bytes, limits, wanted)?;
    // Only points with the corners among them can be triangulated.
    let (right, top) = (shape.width as i32 - 1, shape.height as i32 - 1);
    for (x, y) in [(0, 0), (right, 0), (0, top), (right, top)] {
        if points.binary_search(&Point::new(x, y)).is_err() {
            return Err(MeshError::CornerMissing { x, y }.into());
        }
    }
    let faces = triangulate_with(&points, &While(wanted))?;
    let of_faces = face_differences.map(|differences| {
        read_face_samples(shape, &faces, &samples, &differences).ok_or(PmeshError::Stream)
    });
    premultiply(&mut samples, shape);
    let mesh = match Mesh::new(shape, points, samples, faces, &While(wanted)) {
        Err(MeshError::Cancelled(cancelled)) => return Err(cancelled.into()),
        made => made?,
    };
    match of_faces.transpose()? {
        Some(mut samples) => {
            premultiply(&mut samples, shape);
            Ok(mesh.with_face_samples(samples)?)
        }
        None => Ok(mesh),
    }
}

/// Straight colours, as the file has them, become those of a mesh.
fn premultiply(samples: &mut [u16], shape: Shape) {
    premultiply_vectors(samples, shape.component_count, u16::MAX >> (16 - shape.precision));
}

/// Reads a progression from pmesh.
///
/// # Errors
/// When the bytes are no pmesh, or one beyond the limits, or keep no order.
pub fn read_progression(bytes: &[u8], limits: &Limits) -> Result<Progression, PmeshError> {
    read_progression_while(bytes, limits, &always)
}

/// Reads a progression as [`read_progression`] does, for as long as it is wanted.
///
/// # Errors
/// As [`read_progression`], and [`PmeshError::Cancelled`] when it is no longer wanted.
pub fn read_progression_while(
    bytes: &[u8],
    limits: &Limits,
    wanted: &Wanted<'_>,
) -> Result<Progression, PmeshError> {
    if is_compact(bytes) {
        return probe_pmesh(bytes, limits).and(Err(PmeshError::NoOrder));
    }
    let Contents { shape, points, mut samples, order, .. } = read(bytes, limits, wanted)?;
    premultiply(&mut samples, shape);
    let Order { ranks, squared_errors } = order.ok_or(PmeshError::NoOrder)?;
    let count = shape.component_count;
    let mut order = vec![usize::MAX; points.len()];
    for (v, &rank) in ranks.iter().enumerate() {
        let place = order.get_mut(rank).ok_or(PmeshError::Stream)?;
        *place = v;
    }
    if order.contains(&usize::MAX) {
        return Err(PmeshError::Stream);
    }
    let ordered = order.iter().map(|&v| points[v]).collect();
    let values = order.iter().flat_map(|&v| &samples[v * count..][..count]).copied().collect();
    wanted()?;
    match Progression::from_parts(shape, ordered, values, squared_errors, &While(wanted)) {
        Err(ProgressionError::Cancelled(cancelled)) => Err(cancelled.into()),
        made => Ok(made?),
    }
}

/// What a pmesh holds, vertices by row, then column.
struct Contents {
    shape: Shape,
    points: Vec<Point>,
    samples: Vec<u16>,
    order: Option<Order>,
    /// How the samples of the faces differ from those predicted.
    face_differences: Option<Vec<u8>>,
}

/// The order of importance.
struct Order {
    ranks: Vec<usize>,
    /// One for each size from 4 up.
    squared_errors: Vec<u64>,
}

/// Reads the header of a pmesh.
///
/// # Errors
/// When the bytes do not begin as a pmesh does, or announce one beyond the limits.
pub fn probe_pmesh(bytes: &[u8], limits: &Limits) -> Result<MeshHeader, PmeshError> {
    if is_compact(bytes) {
        return compact::probe(bytes, limits);
    }
    read_header(bytes, limits).map(|(header, ..)| header)
}

/// Whether the header is that of the compact version.
fn is_compact(bytes: &[u8]) -> bool {
    is_pmesh(bytes) && bytes.get(MAGIC.len()) == Some(&COMPACT_VERSION)
}

/// What the header says, the length of the stream once inflated, and the stream.
fn read_header<'a>(
    bytes: &'a [u8],
    limits: &Limits,
) -> Result<(MeshHeader, usize, &'a [u8]), PmeshError> {
    let (header, deflated) = bytes.split_at_checked(HEADER_BYTES).ok_or(PmeshError::Header)?;
    if header[..4] != MAGIC {
        return Err(PmeshError::Header);
    }
    let (version, ordered) = (header[4], header[5]);
    let is_flat = version == FLAT_VERSION;
    let orders = match version {
        VERSION => 0..=1,
        FLAT_VERSION => 0..=0,
        TERRAIN_VERSION => 1..=1,
        _ => return Err(PmeshError::Version(version)),
    };
    let number = |at: usize| {
        let bytes = [header[at], header[at + 1], header[at + 2], header[at + 3]];
        u32::from_le_bytes(bytes)
    };
    let (width, height) = limits.check(number(8).into(), number(12).into())?;
    let (precision, component_count) = (header[6], usize::from(header[7]));
    if !orders.contains(&ordered) || !(1..=16).contains(&precision) || component_count == 0 {
        return Err(PmeshError::Header);
    }
    let shape = Shape { width, height, component_count, precision };
    let (count, most) = (number(16) as usize, width * height);
    if !(4..=most).contains(&count) {
        return Err(PmeshError::VertexCount { count, most });
    }
    let (terrain, deflated) = match version {
        TERRAIN_VERSION => {
            read_terrain(shape, deflated).map(|(terrain, rest)| (Some(terrain), rest))?
        }
        _ => (None, deflated),
    };
    let (planes, is_ordered) = (planes_of(shape), ordered == 1);
    let ordering = if is_ordered { RANK_BYTES + NUMBER_BYTES } else { 0 };
    // A mesh has fewer than twice as many faces as vertices.
    let of_faces = if is_flat { 2 * planes } else { 0 };
    let length = number(20) as usize;
    if length > count * (GAP_BYTES + planes + ordering + of_faces) {
        return Err(PmeshError::Stream);
    }
    let format = if is_ordered { Format::Progression } else { Format::Pmesh };
    Ok((MeshHeader { format, shape, vertices: count, is_flat, terrain }, length, deflated))
}

/// Bytes of a vertex's samples.
fn planes_of(shape: Shape) -> usize {
    shape.component_count * if shape.precision > 8 { 2 } else { 1 }
}

fn read(bytes: &[u8], limits: &Limits, wanted: &Wanted<'_>) -> Result<Contents, PmeshError> {
    let (header, length, deflated) = read_header(bytes, limits)?;
    let MeshHeader { format, shape, vertices: count, is_flat, .. } = header;
    let stream = inflated(deflated, length, wanted)?;
    let (points, rest) = read_points(shape, count, &stream).ok_or(PmeshError::Stream)?;
    wanted()?;
    let (differences, rest) =
        rest.split_at_checked(count * planes_of(shape)).ok_or(PmeshError::Stream)?;
    let order = match format {
        Format::Progression => Some(read_order(count, rest).ok_or(PmeshError::Stream)?),
        _ if is_flat || rest.is_empty() => None,
        _ => return Err(PmeshError::Stream),
    };
    wanted()?;
    let samples = read_samples(shape, &points, differences, wanted)?;
    let face_differences = is_flat.then(|| rest.to_vec());
    Ok(Contents { shape, points, samples, order, face_differences })
}

/// The samples of the faces of a mesh whose vertices are in order; `None` when there are too few
/// differences, or too many.
fn read_face_samples(
    shape: Shape,
    faces: &[Face],
    vertices: &[u16],
    differences: &[u8],
) -> Option<Vec<u16>> {
    let Shape { component_count, precision, .. } = shape;
    let (face_count, modulus) = (faces.len(), 1i64 << precision);
    let planes_each = if precision > 8 { 2 } else { 1 };
    if differences.len() != face_count * component_count * planes_each {
        return None;
    }
    let mut samples = vec![0; face_count * component_count];
    for (number, (corners, face)) in ordered_faces(faces, |v| v).into_iter().enumerate() {
        for c in 0..component_count {
            let byte = |plane: usize| {
                u64::from(differences[(c * planes_each + plane) * face_count + number])
            };
            let folded = if planes_each == 2 { byte(0) | byte(1) << 8 } else { byte(0) };
            let expected =
                mean_of_corners(corners.map(|v| vertices[v as usize * component_count + c]));
            let sum = i64::from(expected) + unfolded(folded);
            samples[face * component_count + c] = sum.rem_euclid(modulus) as u16;
        }
    }
    Some(samples)
}

/// The stream, which must have this length.
fn inflated(deflated: &[u8], length: usize, wanted: &Wanted<'_>) -> Result<Vec<u8>, PmeshError> {
    let mut stream = Vec::new();
    let bytes = PolledBytes { rest: deflated, wanted };
    let mut inflate = DeflateDecoder::new(bytes).take(length as u64 + 1);
    let read = inflate.read_to_end(&mut stream);
    // A cancellation that the reader saw is reported as such.
    wanted()?;
    if read.is_err() || stream.len() != length {
        return Err(PmeshError::Stream);
    }
    Ok(stream)
}

/// A reader that fails once its bytes are no longer wanted.
struct PolledBytes<'a> {
    rest: &'a [u8],
    wanted: &'a Wanted<'a>,
}

impl Read for PolledBytes<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        (self.wanted)().map_err(io::Error::other)?;
        self.rest.read(buffer)
    }
}

/// Ranks and squared errors; `None` when the stream ends early or goes on.
fn read_order(count: usize, stream: &[u8]) -> Option<Order> {
    let (ranks, mut stream) = stream.split_at_checked(count * RANK_BYTES)?;
    let rank = |v: usize| {
        (0..RANK_BYTES)
            .fold(0, |rank, byte| rank | usize::from(ranks[byte * count + v]) << (8 * byte))
    };
    let ranks = (0..count).map(rank).collect();
    let mut squared_errors = Vec::with_capacity(count);
    let mut error = take(&mut stream, NUMBER_BYTES)?;
    squared_errors.push(error);
    for _ in 4..count {
        error = error.wrapping_sub(unfolded(take(&mut stream, NUMBER_BYTES)?) as u64);
        squared_errors.push(error);
    }
    stream.is_empty().then_some(Order { ranks, squared_errors })
}

/// The points, and the rest of the stream; `None` when it ends early or leaves the image.
fn read_points(shape: Shape, count: usize, mut stream: &[u8]) -> Option<(Vec<Point>, &[u8])> {
    let mut points = Vec::with_capacity(count.min(stream.len()));
    let mut next = 0u64;
    for _ in 0..count {
        let place = next + take(&mut stream, GAP_BYTES)?;
        if place >= shape.width as u64 * shape.height as u64 {
            return None;
        }
        let (x, y) = (place % shape.width as u64, place / shape.width as u64);
        points.push(Point::new(x as i32, y as i32));
        next = place + 1;
    }
    Some((points, stream))
}

/// The samples of points in order, vertex by vertex.
fn read_samples(
    shape: Shape,
    points: &[Point],
    differences: &[u8],
    wanted: &Wanted<'_>,
) -> Result<Vec<u16>, Cancelled> {
    let (count, modulus) = (shape.component_count, 1u32 << shape.precision);
    let planes_each = if shape.precision > 8 { 2 } else { 1 };
    let mut predictor = Predictor::new(shape, points.len());
    let mut samples: Vec<u16> = Vec::with_capacity(points.len() * count);
    for (v, &point) in points.iter().enumerate() {
        if v.is_multiple_of(POLL_VERTICES) {
            wanted()?;
        }
        let nearest = predictor.predict(point, v);
        for c in 0..count {
            let byte =
                |plane: usize| u32::from(differences[(c * planes_each + plane) * points.len() + v]);
            let folded = if planes_each == 2 { byte(0) | byte(1) << 8 } else { byte(0) };
            let nearest = nearest.map_or(&[][..], |n| &samples[n * count..][..count]);
            let first = if c == 0 { 0 } else { samples[v * count] };
            let expected = predicted(c, nearest, first, modulus);
            let sum = i64::from(expected) + unfolded(folded.into());
            samples.push(sum.rem_euclid(modulus.into()) as u16);
        }
    }
    Ok(samples)
}
