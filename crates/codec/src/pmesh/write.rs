//! The pmesh writer.

use super::{
    FLAT_VERSION, MAGIC, Predictor, RANK_BYTES, VERSION, mean_of_corners, ordered_faces, predicted,
};
use crate::error::EncodeError;
use crate::leb128::{append, folded};
use crate::wanted::{Wanted, While, always};
use flate2::Compression;
use flate2::write::DeflateEncoder;
use pixmesh_meshing::alpha::{has_alpha, straighten_vectors};
use pixmesh_meshing::{Face, Mesh, Point, Progression, Shape};
use std::borrow::Cow;
use std::io::Write;

/// The format's name in errors.
const NAME: &str = "pmesh";

/// Writes a mesh as pmesh.
///
/// # Errors
/// [`EncodeError::Connectivity`] when its faces are not those of the preferred-directions Delaunay
/// triangulation; when it has more than 255 components or too many vertices; and whatever `out`
/// fails with.
pub fn write_pmesh(mesh: &Mesh, out: &mut impl Write) -> Result<(), EncodeError> {
    write_pmesh_while(mesh, out, &always)
}

/// Writes a mesh as [`write_pmesh`] does, for as long as it is wanted. Only the check of its faces
/// polls `wanted`.
///
/// # Errors
/// As [`write_pmesh`], and [`EncodeError::Cancelled`] when it is no longer wanted.
pub fn write_pmesh_while(
    mesh: &Mesh,
    out: &mut impl Write,
    wanted: &Wanted<'_>,
) -> Result<(), EncodeError> {
    if !mesh.is_preferred_delaunay(&While(wanted))? {
        return Err(EncodeError::Connectivity { format: NAME });
    }
    write(mesh.shape(), mesh.points(), &mesh.straight_samples(), Beside::Faces(mesh), out)
}

/// Writes a progression as pmesh, its order and squared errors kept: about seven bytes a vertex
/// more, before deflation.
///
/// # Errors
/// When it has more than 255 components or too many vertices, and whatever `out` fails with.
pub fn write_progression(
    progression: &Progression,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let errors = progression.squared_errors();
    let (shape, beside) = (progression.shape(), Beside::Order(errors));
    let mut samples = Cow::Borrowed(progression.samples());
    if has_alpha(shape.component_count) {
        let largest = u16::MAX >> (16 - shape.precision);
        straighten_vectors(samples.to_mut(), shape.component_count, largest);
    }
    write(shape, progression.points(), &samples, beside, out)
}

/// What a pmesh keeps beside vertices.
#[derive(Clone, Copy)]
enum Beside<'a> {
    /// The samples of the faces of this mesh, if there are any.
    Faces(&'a Mesh),
    /// The order of the points, and the squared errors of all sizes.
    Order(&'a [u64]),
}

/// Writes header and stream of points in any order.
fn write(
    shape: Shape,
    points: &[Point],
    samples: &[u16],
    beside: Beside<'_>,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let actual = shape.component_count;
    let too_many = EncodeError::ComponentCount { format: NAME, actual, maximum: u8::MAX.into() };
    let components = u8::try_from(actual).map_err(|_| too_many)?;
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_unstable_by_key(|&v| points[v]);
    let mut stream = gaps(shape, points, &order);
    append_samples(shape, points, samples, &order, &mut stream);
    let (mut version, mut is_ordered) = (VERSION, 0);
    match beside {
        Beside::Order(errors) => {
            is_ordered = 1;
            for byte in 0..RANK_BYTES {
                stream.extend(order.iter().map(|&rank| (rank >> (8 * byte)) as u8));
            }
            append_errors(errors, &mut stream);
        }
        Beside::Faces(mesh) => {
            if let Some(of_faces) = mesh.straight_face_samples() {
                version = FLAT_VERSION;
                append_face_samples(mesh, samples, &of_faces, &order, &mut stream);
            }
        }
    }
    let fits = |number: usize| {
        let (bytes, limit) = (number as u64, u32::MAX.into());
        u32::try_from(number).map_err(|_| EncodeError::TooLarge { format: NAME, bytes, limit })
    };
    let mut header = MAGIC.to_vec();
    header.extend([version, is_ordered, shape.precision, components]);
    for number in [shape.width, shape.height, points.len(), stream.len()] {
        header.extend(fits(number)?.to_le_bytes());
    }
    out.write_all(&header)?;
    let mut deflate = DeflateEncoder::new(out, Compression::best());
    deflate.write_all(&stream)?;
    deflate.finish()?;
    Ok(())
}

/// The numbers of lattice points skipped before each vertex.
fn gaps(shape: Shape, points: &[Point], order: &[usize]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(2 * order.len());
    let mut next = 0;
    for &v in order {
        let place = points[v].y as u64 * shape.width as u64 + points[v].x as u64;
        append(place - next, &mut bytes);
        next = place + 1;
    }
    bytes
}

/// Appends the first error, and by how much each one is less than the one before it.
fn append_errors(errors: &[u64], stream: &mut Vec<u8>) {
    append(errors.first().copied().unwrap_or(0), stream);
    for pair in errors.windows(2) {
        append(folded(pair[0].wrapping_sub(pair[1]) as i64), stream);
    }
}

/// Appends how the samples differ from those predicted, component by component.
fn append_samples(
    shape: Shape,
    points: &[Point],
    samples: &[u16],
    order: &[usize],
    stream: &mut Vec<u8>,
) {
    let (count, modulus) = (shape.component_count, 1u32 << shape.precision);
    let of = |v: usize| &samples[v * count..][..count];
    let mut predictor = Predictor::new(shape, order.len());
    let mut differences = vec![Vec::with_capacity(order.len()); count];
    for (number, &v) in order.iter().enumerate() {
        let nearest = predictor.predict(points[v], number).map_or(&[][..], |n| of(order[n]));
        for (c, differences) in differences.iter_mut().enumerate() {
            let expected = predicted(c, nearest, of(v)[0], modulus);
            differences.push(difference(of(v)[c], expected, modulus));
        }
    }
    append_planes(&differences, shape, stream);
}

/// Appends how the samples of the faces differ from the means of their vertices, component by
/// component.
fn append_face_samples(
    mesh: &Mesh,
    vertices: &[u16],
    samples: &[u16],
    order: &[usize],
    stream: &mut Vec<u8>,
) {
    let shape = mesh.shape();
    let (count, modulus) = (shape.component_count, 1u32 << shape.precision);
    let mut numbers = vec![0; order.len()];
    order.iter().zip(0..).for_each(|(&v, number)| numbers[v] = number);
    let faces = ordered_faces(mesh.faces(), |v| numbers[v as usize]);
    let of_component = |c: usize| {
        let difference = |&(_, face): &(Face, usize)| {
            let corners = mesh.faces()[face].map(|v| vertices[v as usize * count + c]);
            difference(samples[face * count + c], mean_of_corners(corners), modulus)
        };
        faces.iter().map(difference).collect()
    };
    append_planes(&(0..count).map(of_component).collect::<Vec<_>>(), shape, stream);
}

/// How a sample differs from the one expected, the shorter way around, folded.
fn difference(sample: u16, expected: u32, modulus: u32) -> u64 {
    let difference = (u32::from(sample) + modulus - expected) % modulus;
    let wrapped = if difference < modulus / 2 { 0 } else { i64::from(modulus) };
    folded(i64::from(difference) - wrapped)
}

/// Appends the differences of each component: of more than 8 bits first the low bytes.
fn append_planes(components: &[Vec<u64>], shape: Shape, stream: &mut Vec<u8>) {
    for differences in components {
        stream.extend(differences.iter().map(|&difference| difference as u8));
        if shape.precision > 8 {
            stream.extend(differences.iter().map(|&difference| (difference >> 8) as u8));
        }
    }
}
