//! The pmesh writer.

use super::compact;
use super::{MAGIC, Predictor, RANK_BYTES, TERRAIN_VERSION, VERSION, append_terrain, predicted};
use crate::error::EncodeError;
use crate::leb128::{append, folded};
use crate::terrain::Terrain;
use crate::wanted::{Wanted, While, always};
use flate2::Compression;
use flate2::write::DeflateEncoder;
use pixmesh_meshing::alpha::{has_alpha, straighten_vectors};
use pixmesh_meshing::{Mesh, Point, Progression, Shape};
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
    write_pmesh_while(mesh, None, out, &always)
}

/// Writes a mesh as [`write_pmesh`] does, with what the samples of an elevation model mean, for as long
/// as it is wanted.
///
/// # Errors
/// As [`write_pmesh`], and [`EncodeError::Cancelled`] when it is no longer wanted.
pub fn write_pmesh_while(
    mesh: &Mesh,
    terrain: Option<&Terrain>,
    out: &mut impl Write,
    wanted: &Wanted<'_>,
) -> Result<(), EncodeError> {
    write_rounded_pmesh_while(mesh, 1.0, terrain, out, wanted)
}

/// Writes a mesh as [`write_pmesh`] does, its samples rounded to multiples of `step`, in sample values
/// and of 1 to 4096, and the differences of red, green and blue to those of 1.6 times that. A step of 1
/// rounds nothing. Photographs of 8 bits stay at the PSNR of their mesh or lose 0.2 dB with steps
/// that double with every 6 dB less: about 4 at 37 dB, 8 at 32, 14 at 28.
///
/// # Errors
/// As [`write_pmesh`].
///
/// ```
/// use pixmesh_codec::{Limits, read_pmesh, write_rounded_pmesh};
/// use pixmesh_meshing::{Mesh, Point, Shape};
/// let shape = Shape { width: 3, height: 2, component_count: 1, precision: 8 };
/// let corners = [(0, 0), (2, 0), (0, 1), (2, 1)].map(|(x, y)| Point::new(x, y));
/// let faces = vec![[0, 1, 3], [0, 3, 2]];
/// let mesh = Mesh::new(shape, corners.to_vec(), vec![0, 99, 0, 61], faces, &())?;
/// let mut bytes = Vec::new();
/// write_rounded_pmesh(&mesh, 8.0, &mut bytes)?;
/// assert_eq!(read_pmesh(&bytes, &Limits::default())?.samples(), [0, 96, 0, 64]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_rounded_pmesh(
    mesh: &Mesh,
    step: f64,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    write_rounded_pmesh_while(mesh, step, None, out, &always)
}

fn write_rounded_pmesh_while(
    mesh: &Mesh,
    step: f64,
    terrain: Option<&Terrain>,
    out: &mut impl Write,
    wanted: &Wanted<'_>,
) -> Result<(), EncodeError> {
    if !mesh.is_preferred_delaunay(&While(wanted))? {
        return Err(EncodeError::Connectivity { format: NAME });
    }
    let component_count = mesh.shape().component_count;
    components_of(component_count)?;
    let steps = compact::steps_of(step, component_count);
    let bytes = compact::written(mesh, &steps, terrain, wanted)?;
    Ok(out.write_all(&bytes)?)
}

/// The number of components as the header has it.
fn components_of(actual: usize) -> Result<u8, EncodeError> {
    let too_many = EncodeError::ComponentCount { format: NAME, actual, maximum: u8::MAX.into() };
    u8::try_from(actual).map_err(|_| too_many)
}

/// Writes a progression as pmesh, its order and squared errors kept: about seven bytes a vertex
/// more, before deflation. It keeps what the samples of an elevation model mean, too.
///
/// # Errors
/// When it has more than 255 components or too many vertices, and whatever `out` fails with.
pub fn write_progression(
    progression: &Progression,
    terrain: Option<&Terrain>,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let errors = progression.squared_errors();
    let shape = progression.shape();
    let mut samples = Cow::Borrowed(progression.samples());
    if has_alpha(shape.component_count) {
        let largest = u16::MAX >> (16 - shape.precision);
        straighten_vectors(samples.to_mut(), shape.component_count, largest);
    }
    write(shape, progression.points(), &samples, errors, terrain, out)
}

/// Writes header and stream of points in any order.
fn write(
    shape: Shape,
    points: &[Point],
    samples: &[u16],
    errors: &[u64],
    terrain: Option<&Terrain>,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let components = components_of(shape.component_count)?;
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_unstable_by_key(|&v| points[v]);
    let mut stream = gaps(shape, points, &order);
    append_samples(shape, points, samples, &order, &mut stream);
    for byte in 0..RANK_BYTES {
        stream.extend(order.iter().map(|&rank| (rank >> (8 * byte)) as u8));
    }
    append_errors(errors, &mut stream);
    let fits = |number: usize| {
        let (bytes, limit) = (number as u64, u32::MAX.into());
        u32::try_from(number).map_err(|_| EncodeError::TooLarge { format: NAME, bytes, limit })
    };
    let mut header = MAGIC.to_vec();
    let version = if terrain.is_some() { TERRAIN_VERSION } else { VERSION };
    header.extend([version, 1, shape.precision, components]);
    for number in [shape.width, shape.height, points.len(), stream.len()] {
        header.extend(fits(number)?.to_le_bytes());
    }
    if let Some(terrain) = terrain {
        append_terrain(terrain, &mut header);
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
