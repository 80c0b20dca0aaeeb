//! The compact version: points by a quadtree, samples rounded to steps and predicted from neighbours in
//! the triangulation, both by arithmetic coding with mixed contexts. docs/pmesh.md specifies it.

mod arithmetic;
mod mixing;
mod places;
mod samples;
mod values;

use super::error::PmeshError;
use super::{COMPACT_VERSION, MAGIC, append_terrain, ordered_faces, read_terrain};
use crate::error::EncodeError;
use crate::leb128::{append, take};
use crate::limits::Limits;
use crate::mesh_format::Format;
use crate::mesh_header::MeshHeader;
use crate::terrain::Terrain;
use crate::wanted::{Wanted, While};
use arithmetic::{Coder, Reader, Stop, Writer};
use pixmesh_meshing::alpha::premultiply_vectors;
use pixmesh_meshing::{Face, Mesh, MeshError, Point, Shape, triangulate_with};
use places::code_places;
use samples::{EXACT, numbers_of, samples_of};
use values::{Neighbour, Values};

/// Faces have samples of their own.
const FLAT: u8 = 1;

/// The text of an elevation model ends the header.
const TERRAIN: u8 = 2;

/// Bytes before the numbers of the header.
const FIXED_BYTES: usize = 8;

/// Bytes of a number in the header.
const NUMBER_BYTES: usize = 5;

pub(super) use samples::steps_of;

/// The largest step, in eighths.
const MOST_STEP: i64 = 1 << 19;

/// No face.
const NONE: usize = usize::MAX;

impl From<Stop> for PmeshError {
    fn from(stop: Stop) -> Self {
        match stop {
            Stop::Damaged => Self::Stream,
            Stop::Cancelled(cancelled) => Self::Cancelled(cancelled),
        }
    }
}

/// The bytes of a mesh whose faces are those of its points, with a step for each component in eighths:
/// [`EXACT`] loses nothing.
pub(super) fn written(
    mesh: &Mesh,
    steps: &[i64],
    terrain: Option<&Terrain>,
    wanted: &Wanted<'_>,
) -> Result<Vec<u8>, EncodeError> {
    let shape = mesh.shape();
    let components = steps.len();
    let of_faces = mesh.straight_face_samples();
    let mut bytes = MAGIC.to_vec();
    let flags =
        if of_faces.is_some() { FLAT } else { 0 } | if terrain.is_some() { TERRAIN } else { 0 };
    bytes.extend([COMPACT_VERSION, flags, shape.precision, components as u8]);
    for number in [shape.width, shape.height, mesh.points().len()] {
        append(number as u64, &mut bytes);
    }
    steps.iter().for_each(|&step| append(step as u64, &mut bytes));
    if let Some(terrain) = terrain {
        append_terrain(terrain, &mut bytes);
    }

    let mut order: Vec<usize> = (0..mesh.points().len()).collect();
    order.sort_unstable_by_key(|&v| mesh.points()[v]);
    let mut rank = vec![0; order.len()];
    order.iter().zip(0u32..).for_each(|(&v, number)| rank[v] = number);
    let points: Vec<Point> = order.iter().map(|&v| mesh.points()[v]).collect();
    let faces = ordered_faces(mesh.faces(), |v| rank[v as usize]);
    let of_vertices = numbers_of(&mesh.straight_samples(), steps);
    let of_vertices = reordered(&of_vertices, order.iter().copied(), components);
    let of_faces = of_faces.map(|samples| {
        reordered(&numbers_of(&samples, steps), faces.iter().map(|&(_, face)| face), components)
    });
    let faces: Vec<Face> = faces.into_iter().map(|(face, _)| face).collect();

    let mut writer = Writer::new(wanted);
    let coded = code_places(shape, points.len(), &points, &mut writer).and_then(|_| {
        let mut values = Values::new(components);
        code_vertices(&mut values, &points, &faces, &of_vertices, &mut writer)?;
        match &of_faces {
            Some(numbers) => code_faces(&mut values, points.len(), &faces, numbers, &mut writer),
            None => Ok(()),
        }
    });
    match coded {
        Err(Stop::Cancelled(cancelled)) => return Err(cancelled.into()),
        // A writer finds no damage in numbers of samples.
        Ok(()) | Err(Stop::Damaged) => bytes.extend(writer.finish()),
    }
    Ok(bytes)
}

/// The vectors of numbers in an order.
fn reordered(numbers: &[i32], order: impl Iterator<Item = usize>, components: usize) -> Vec<i32> {
    order.flat_map(|i| &numbers[i * components..][..components]).copied().collect()
}

/// Codes the numbers of all vertices; neighbours of each are the vertices before it that share an edge.
fn code_vertices<C: Coder>(
    values: &mut Values,
    points: &[Point],
    faces: &[Face],
    numbers: &[i32],
    coder: &mut C,
) -> Result<(), Stop> {
    let edges = || {
        let edges = faces.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        edges.map(|(p, q)| (p.max(q) as usize, p.min(q)))
    };
    // The neighbours of vertex v are before[from[v]..from[v + 1]], twice where an edge has two faces.
    let mut from = vec![0; points.len() + 1];
    edges().for_each(|(later, _)| from[later + 1] += 1);
    for vertex in 0..points.len() {
        from[vertex + 1] += from[vertex];
    }
    let mut before = vec![0; 3 * faces.len()];
    let mut next = from.clone();
    for (later, earlier) in edges() {
        before[next[later]] = earlier;
        next[later] += 1;
    }
    let neighbours = |node: usize, near: &mut Vec<Neighbour>| {
        near.extend(before[from[node]..from[node + 1]].iter().map(|&other| {
            let (p, q) = (points[node], points[other as usize]);
            let [dx, dy] = [p.x - q.x, p.y - q.y].map(i64::from);
            (dx * dx + dy * dy, other as usize)
        }));
    };
    values.code(points.len(), numbers, neighbours, coder)
}

/// Codes the numbers of all faces, nodes after the vertices; neighbours of each are its vertices and the
/// faces before it that share an edge, all at the distance 1.
fn code_faces<C: Coder>(
    values: &mut Values,
    vertex_count: usize,
    faces: &[Face],
    numbers: &[i32],
    coder: &mut C,
) -> Result<(), Stop> {
    let before = faces_before(faces);
    let neighbours = |node: usize, near: &mut Vec<Neighbour>| {
        let face = node - vertex_count;
        near.extend(faces[face].map(|vertex| (1, vertex as usize)));
        let others = before[face].into_iter().filter(|&other| other != NONE);
        near.extend(others.map(|other| (1, vertex_count + other)));
    };
    values.code(faces.len(), numbers, neighbours, coder)
}

/// The faces that share an edge with each face and come before it.
fn faces_before(faces: &[Face]) -> Vec<[usize; 3]> {
    let mut edges = Vec::with_capacity(3 * faces.len());
    for (face, &[a, b, c]) in faces.iter().enumerate() {
        for (side, (p, q)) in [(a, b), (b, c), (c, a)].into_iter().enumerate() {
            edges.push((p.min(q), p.max(q), face, side));
        }
    }
    edges.sort_unstable();
    let mut before = vec![[NONE; 3]; faces.len()];
    for pair in edges.windows(2) {
        if (pair[0].0, pair[0].1) == (pair[1].0, pair[1].1) {
            before[pair[1].2][pair[1].3] = pair[0].2;
        }
    }
    before
}

/// What the header says.
struct Header {
    header: MeshHeader,
    steps: Vec<i64>,
}

/// Reads the header.
pub(super) fn probe(bytes: &[u8], limits: &Limits) -> Result<MeshHeader, PmeshError> {
    read_header(bytes, limits).map(|(Header { header, .. }, _)| header)
}

fn read_header<'a>(bytes: &'a [u8], limits: &Limits) -> Result<(Header, &'a [u8]), PmeshError> {
    let (fixed, mut rest) = bytes.split_at_checked(FIXED_BYTES).ok_or(PmeshError::Header)?;
    let (flags, precision, component_count) = (fixed[5], fixed[6], usize::from(fixed[7]));
    if flags > FLAT | TERRAIN || !(1..=16).contains(&precision) || component_count == 0 {
        return Err(PmeshError::Header);
    }
    let mut number = || take(&mut rest, NUMBER_BYTES).ok_or(PmeshError::Header);
    let (width, height) = (number()?, number()?);
    let (width, height) = limits.check(width, height)?;
    let (count, most) = (usize::try_from(number()?).unwrap_or(usize::MAX), width * height);
    if !(4..=most).contains(&count) {
        return Err(PmeshError::VertexCount { count, most });
    }
    let mut step = || match number()? as i64 {
        step @ EXACT..=MOST_STEP => Ok(step),
        _ => Err(PmeshError::Header),
    };
    let steps = (0..component_count).map(|_| step()).collect::<Result<_, _>>()?;
    let shape = Shape { width, height, component_count, precision };
    let (terrain, rest) = match flags & TERRAIN {
        0 => (None, rest),
        _ => read_terrain(shape, rest).map(|(terrain, rest)| (Some(terrain), rest))?,
    };
    let (format, is_flat) = (Format::Pmesh, flags & FLAT != 0);
    let header = MeshHeader { format, shape, vertices: count, is_flat, terrain };
    Ok((Header { header, steps }, rest))
}

/// Reads a mesh.
pub(super) fn read(bytes: &[u8], limits: &Limits, wanted: &Wanted<'_>) -> Result<Mesh, PmeshError> {
    let (Header { header, steps }, stream) = read_header(bytes, limits)?;
    let MeshHeader { shape, vertices, is_flat, .. } = header;
    let mut reader = Reader::new(stream, wanted);
    let points = code_places(shape, vertices, &[], &mut reader)?;
    let faces = triangulate_with(&points, &While(wanted))?;
    let mut values = Values::new(shape.component_count);
    code_vertices(&mut values, &points, &faces, &[], &mut reader)?;
    let ordered = if is_flat { ordered_faces(&faces, |v| v) } else { Vec::new() };
    let corners: Vec<Face> = ordered.iter().map(|&(face, _)| face).collect();
    if is_flat {
        code_faces(&mut values, vertices, &corners, &[], &mut reader)?;
    }
    reader.finish()?;
    let largest = u16::MAX >> (16 - shape.precision);
    let mut samples = samples_of(&values.numbers, &steps, largest);
    premultiply_vectors(&mut samples, shape.component_count, largest);
    let of_faces = samples.split_off(vertices * shape.component_count);
    let mesh = match Mesh::new(shape, points, samples, faces, &While(wanted)) {
        Err(MeshError::Cancelled(cancelled)) => return Err(cancelled.into()),
        made => made?,
    };
    if !is_flat {
        return Ok(mesh);
    }
    let mut by_face = vec![0; of_faces.len()];
    let vectors = of_faces.chunks_exact(shape.component_count);
    for (vector, &(_, face)) in vectors.zip(&ordered) {
        by_face[face * shape.component_count..][..vector.len()].copy_from_slice(vector);
    }
    Ok(mesh.with_face_samples(by_face)?)
}
