//! Quantized-mesh 1.0, out: a tile of terrain for Cesium, with normals.
//!
//! Columns, rows and heights are numbers from 0 to 32767 between those of the tile's borders, as
//! differences from vertex to vertex; the triangles name new vertices in their order. A tile has no
//! word for where it lies: whoever shows it must know. This one covers the rectangle from the middle of
//! the lower left pixel to that of the upper right one.
//!
//! Literature: Cesium, "quantized-mesh-1.0 terrain format", 2020; the normals: Zina H. Cigolle et al.,
//! "A survey of efficient representations for independent unit vectors", 2014; the point that is
//! below the horizon when all of the tile is: Kevin Ring and Patrick Cozzi, "Horizon culling", 2013.

use crate::error::EncodeError;
use crate::shown::Shown;
use crate::surface::{cross_product, unit};
use crate::terrain::Terrain;
use pixmesh_meshing::{Face, Point};
use pixmesh_terrain::{HALF_AXES, earth_centered};
use std::io::Write;

/// The largest number of a coordinate.
const MOST: f64 = 32_767.0;

/// The most vertices whose indices have 16 bits.
const MOST_OF_SHORT_INDICES: usize = 1 << 16;

/// The extension with a normal of two bytes for each vertex.
const NORMALS: u8 = 1;

/// The horizon's point of a tile so large that it is never below the horizon lies at least so many
/// radii away.
const FAR: f64 = 1e6;

/// Writes the part of a mesh of an elevation model that is shown.
///
/// # Errors
/// When the mesh is not that of an elevation model in degrees of WGS 84, or writing fails.
pub(crate) fn write_quantized_mesh(
    mesh: &Shown<'_>,
    terrain: Option<&Terrain>,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let terrain = terrain.ok_or(EncodeError::NotInDegrees)?;
    let [west, south, east, north] = terrain.degrees().ok_or(EncodeError::NotInDegrees)?;
    // Vertices in the order in which the triangles name them first.
    let order: Vec<usize> = (0..mesh.faces().len()).collect();
    let mesh = &mesh.with_faces(&order, |face| face);
    let corner = Point::new(terrain.width as i32 - 1, terrain.height as i32 - 1);
    let heights = heights(mesh, terrain);
    let along = |from: f64, to: f64, at: i32, last: i32| {
        from + (to - from) * f64::from(at) / f64::from(last)
    };
    let position = |(&point, &height): (&Point, &f64)| {
        let longitude = along(west, east, point.x, corner.x);
        earth_centered([longitude, along(south, north, point.y, corner.y), height])
    };
    let positions: Vec<[f64; 3]> = mesh.points().iter().zip(&heights).map(position).collect();
    let range = range_of(&heights);
    let middle = [(west + east) / 2.0, (south + north) / 2.0, f64::midpoint(range[0], range[1])];
    out.write_all(&header(earth_centered(middle), &positions, range))?;
    out.write_all(&vertices(mesh, corner, &heights, range))?;
    out.write_all(&indices(mesh, corner))?;
    let normals = normals(&positions, mesh.faces());
    let normals: Vec<u8> = normals.into_iter().flat_map(octahedral).collect();
    out.write_all(&[NORMALS])?;
    out.write_all(&(normals.len() as u32).to_le_bytes())?;
    Ok(out.write_all(&normals)?)
}

/// The heights of the vertices in metres.
fn heights(mesh: &Shown<'_>, terrain: &Terrain) -> Vec<f64> {
    let samples = (0..mesh.points().len()).map(|v| mesh.vertex_samples(v)[0]);
    samples.map(|sample| terrain.steps.height(sample.into()) * terrain.unit).collect()
}

/// The least and the largest height, as the file has them: the nearest 32-bit numbers that enclose all
/// heights.
fn range_of(heights: &[f64]) -> [f64; 2] {
    let least = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let most = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (low, high) = (least as f32, most as f32);
    let low = if f64::from(low) > least { low.next_down() } else { low };
    let high = if f64::from(high) < most { high.next_up() } else { high };
    [low.into(), high.into()]
}

fn header(center: [f64; 3], positions: &[[f64; 3]], range: [f64; 2]) -> Vec<u8> {
    let bound = |pick: fn(f64, f64) -> f64| -> [f64; 3] {
        std::array::from_fn(|i| positions.iter().map(|p| p[i]).reduce(pick).unwrap_or_default())
    };
    let (low, high) = (bound(f64::min), bound(f64::max));
    let middle: [f64; 3] = std::array::from_fn(|i| f64::midpoint(low[i], high[i]));
    let radius = positions.iter().map(|&p| length(difference(p, middle))).fold(0.0, f64::max);
    let mut bytes = Vec::with_capacity(88);
    let doubles = |values: &[f64], bytes: &mut Vec<u8>| {
        bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    };
    doubles(&center, &mut bytes);
    bytes.extend(range.iter().flat_map(|&height| (height as f32).to_le_bytes()));
    doubles(&middle, &mut bytes);
    doubles(&[radius], &mut bytes);
    doubles(&occluded_with(center, positions), &mut bytes);
    bytes
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn length(vector: [f64; 3]) -> f64 {
    vector.iter().map(|part| part * part).sum::<f64>().sqrt()
}

/// The point in the direction of `center`, in half axes of the ellipsoid, that is below the horizon
/// when all positions are.
fn occluded_with(center: [f64; 3], positions: &[[f64; 3]]) -> [f64; 3] {
    let scaled = |place: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| place[i] / HALF_AXES[i]) };
    let direction = unit(scaled(center));
    let magnitude = |&position: &[f64; 3]| {
        let place = scaled(position);
        let distance = length(place).max(1.0);
        let towards = unit(place);
        let cosine: f64 = towards.iter().zip(direction).map(|(a, b)| a * b).sum();
        let sine = length(cross_product([[0.0; 3], towards, direction]));
        let reciprocal = (cosine - sine * (distance * distance - 1.0).sqrt()) / distance;
        if reciprocal > 1.0 / FAR { 1.0 / reciprocal } else { FAR }
    };
    let most = positions.iter().map(magnitude).fold(1.0, f64::max);
    direction.map(|part| part * most)
}

/// The number of vertices, and of each coordinate the differences from vertex to vertex, whose signs
/// alternate: 0, -1, 1, -2, and so on.
fn vertices(mesh: &Shown<'_>, corner: Point, heights: &[f64], [least, most]: [f64; 2]) -> Vec<u8> {
    let count = mesh.points().len();
    let quantized =
        |at: f64, range: f64| if range > 0.0 { (at / range * MOST).round() } else { 0.0 };
    let columns = mesh.points().iter().map(|p| quantized(p.x.into(), corner.x.into()));
    let rows = mesh.points().iter().map(|p| quantized(p.y.into(), corner.y.into()));
    let heights = heights.iter().map(|height| quantized(height - least, most - least));
    let mut bytes = (count as u32).to_le_bytes().to_vec();
    bytes.reserve(6 * count);
    let mut last = 0;
    for (i, number) in columns.chain(rows).chain(heights).enumerate() {
        let before = if i % count == 0 { 0 } else { last };
        last = number as i32;
        let difference = last - before;
        bytes.extend((((difference << 1) ^ (difference >> 31)) as u16).to_le_bytes());
    }
    bytes
}

/// The triangles, and the vertices at the borders in the west, south, east and north.
fn indices(mesh: &Shown<'_>, corner: Point) -> Vec<u8> {
    let (points, count) = (mesh.points(), mesh.points().len());
    let width = if count > MOST_OF_SHORT_INDICES { 4 } else { 2 };
    // Indices lie at a multiple of their width, behind 92 bytes and 6 for each vertex.
    let mut bytes = vec![0; (6 * count) % width];
    let put = |number: u32, bytes: &mut Vec<u8>| bytes.extend(&number.to_le_bytes()[..width]);
    bytes.extend((mesh.faces().len() as u32).to_le_bytes());
    let mut next = 0;
    for &index in mesh.faces().as_flattened() {
        // How far it is below the vertices that are named already.
        put(next - index, &mut bytes);
        next += u32::from(index == next);
    }
    let borders: [(Coordinate, i32, Coordinate); 4] = [
        (|p| p.x, 0, |p| p.y),
        (|p| p.y, 0, |p| p.x),
        (|p| p.x, corner.x, |p| p.y),
        (|p| p.y, corner.y, |p| p.x),
    ];
    for (across, border, along) in borders {
        let mut vertices: Vec<u32> = (0..count as u32).collect();
        vertices.retain(|&v| across(points[v as usize]) == border);
        vertices.sort_unstable_by_key(|&v| along(points[v as usize]));
        bytes.extend((vertices.len() as u32).to_le_bytes());
        vertices.into_iter().for_each(|vertex| put(vertex, &mut bytes));
    }
    bytes
}

/// The column or the row of a point.
type Coordinate = fn(Point) -> i32;

/// The unit normal of each vertex: the mean of its triangles', weighted by area.
fn normals(positions: &[[f64; 3]], faces: &[Face]) -> Vec<[f64; 3]> {
    let mut normals = vec![[0.0; 3]; positions.len()];
    for face in faces {
        let product = cross_product(face.map(|v| positions[v as usize]));
        for &v in face {
            normals[v as usize].iter_mut().zip(product).for_each(|(sum, part)| *sum += part);
        }
    }
    normals.into_iter().map(unit).collect()
}

/// A unit vector on the faces of an octahedron, its lower half folded out.
fn octahedral([x, y, z]: [f64; 3]) -> [u8; 2] {
    let sum = x.abs() + y.abs() + z.abs();
    let (x, y) = (x / sum, y / sum);
    let fold = |value: f64, other: f64| (1.0 - other.abs()).copysign(value);
    let [x, y] = if z < 0.0 { [fold(x, y), fold(y, x)] } else { [x, y] };
    [x, y].map(|value| ((value * 0.5 + 0.5) * 255.0).round() as u8)
}
