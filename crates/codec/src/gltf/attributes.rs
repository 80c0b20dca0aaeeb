//! The bytes of a mesh's vertices: positions, normals, colours and places on the texture.
//!
//! As floating-point numbers they are in the file's unit. As 16-bit integers they are the picture's
//! own: `x` and `y` are columns and rows, and `z` is 0 to 65535 over the range of depths; the node
//! scales them. Normals of integers are those of the unscaled surface, as its readers expect.

use super::document::{FLOAT, SHORT, UNSIGNED_SHORT};
use super::linear_light::fitted;
use super::srgb::to_u16;
use crate::color::rgba;
use crate::rounding::rounded_quotient;
use crate::surface::{Surface, unit};
use crate::wanted::Wanted;
use pixmesh_meshing::{Cancelled, Shape};

/// One attribute of all vertices.
pub(super) struct Attribute {
    pub(super) name: &'static str,
    pub(super) kind: &'static str,
    pub(super) component_type: u32,
    pub(super) normalized: bool,
    /// Bytes from one vertex to the next, a multiple of four.
    pub(super) stride: usize,
    /// The least and largest of each component, where the format requires them.
    pub(super) bounds: Option<[[f32; 3]; 2]>,
    pub(super) bytes: Vec<u8>,
}

/// How integers become lengths.
#[derive(Clone, Copy)]
pub(super) struct Lattice {
    /// The length of one step in `x`, `y` and `z`.
    pub(super) scale: [f64; 3],
    /// The `z` of 0.
    pub(super) bottom: f64,
}

impl Lattice {
    /// The lattice of a surface; `None` where 16 bits do not hold its columns and rows.
    pub(super) fn of(surface: &Surface<'_>) -> Option<Self> {
        let shape = surface.mesh.shape();
        if shape.width.max(shape.height) > 1 << 16 {
            return None;
        }
        let [column, row] = surface.geometry.steps();
        let [bottom, top] = surface.depth_range();
        let step = if top > bottom { (top - bottom) / f64::from(u16::MAX) } else { 1.0 };
        Some(Self { scale: [column, row, step], bottom })
    }

    /// The place of a position, rounded to the nearest.
    fn place(&self, [x, y, z]: [f64; 3]) -> [u16; 3] {
        let steps = |length: f64, step: f64| (length / step + 0.5) as u16;
        let [scale_x, scale_y, scale_z] = self.scale;
        [steps(x, scale_x), steps(y, scale_y), steps(z - self.bottom, scale_z)]
    }
}

/// Positions, as integers on a lattice or as floating-point numbers.
pub(super) fn positions(surface: &Surface<'_>, lattice: Option<Lattice>) -> Attribute {
    let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    let mut bytes = Vec::with_capacity(surface.vertex_count() * 12);
    for position in surface.positions() {
        let stored = match lattice {
            Some(lattice) => {
                let [x, y, z] = lattice.place(position);
                bytes.extend_from_slice([x, y, z, 0].map(u16::to_le_bytes).as_flattened());
                [x, y, z].map(f32::from)
            }
            None => {
                let position = position.map(|length| length as f32);
                bytes.extend_from_slice(position.map(f32::to_le_bytes).as_flattened());
                position
            }
        };
        let [least, largest] = &mut bounds;
        least.iter_mut().zip(stored).for_each(|(least, part)| *least = least.min(part));
        largest.iter_mut().zip(stored).for_each(|(largest, part)| *largest = largest.max(part));
    }
    let (component_type, stride) =
        if lattice.is_some() { (UNSIGNED_SHORT, 8) } else { (FLOAT, 12) };
    let (name, kind, bounds) = ("POSITION", "VEC3", Some(bounds));
    Attribute { name, kind, component_type, normalized: false, stride, bounds, bytes }
}

/// Unit normals.
pub(super) fn normals(surface: &Surface<'_>, lattice: Option<Lattice>) -> Attribute {
    let mut bytes = Vec::with_capacity(surface.vertex_count() * 12);
    for [x, y, z] in surface.normals() {
        match lattice {
            Some(Lattice { scale, .. }) => {
                // Readers multiply with the inverse of the scale.
                let [x, y, z] = unit([x * scale[0], y * scale[1], z * scale[2]]).map(signed_16);
                bytes.extend_from_slice([x, y, z, 0].map(i16::to_le_bytes).as_flattened());
            }
            None => {
                let normal = [x as f32, y as f32, z as f32];
                bytes.extend_from_slice(normal.map(f32::to_le_bytes).as_flattened());
            }
        }
    }
    let normalized = lattice.is_some();
    let (component_type, stride) = if normalized { (SHORT, 8) } else { (FLOAT, 12) };
    let (name, kind, bounds) = ("NORMAL", "VEC3", None);
    Attribute { name, kind, component_type, normalized, stride, bounds, bytes }
}

/// Linear red, green, blue and alpha of 16 bits: with 8 bits dark gradients would show bands.
pub(super) fn colors(
    surface: &Surface<'_>,
    shape: Shape,
    wanted: &Wanted<'_>,
) -> Result<Attribute, Cancelled> {
    let largest = u64::from(u16::MAX >> (16 - shape.precision));
    let alpha = |sample: u16| rounded_quotient(u64::from(sample) * 65535, largest) as u16;
    let mut bytes = Vec::with_capacity(surface.vertex_count() * 8);
    for (samples, light) in surface.samples().zip(fitted(surface, shape, wanted)?) {
        let [.., alpha] = rgba(samples, |_| 0, alpha, u16::MAX);
        let [red, green, blue] = light.map(to_u16);
        let color = [red, green, blue, alpha];
        bytes.extend_from_slice(color.map(u16::to_le_bytes).as_flattened());
    }
    let (name, kind, bounds) = ("COLOR_0", "VEC4", None);
    let component_type = UNSIGNED_SHORT;
    Ok(Attribute { name, kind, component_type, normalized: true, stride: 8, bounds, bytes })
}

/// Places on the picture, `v` down: a lattice point is the middle of its pixel.
pub(super) fn texture_places(surface: &Surface<'_>, normalized: bool) -> Attribute {
    let shape = surface.mesh.shape();
    let (width, height) = (shape.width as f64, shape.height as f64);
    let mut bytes = Vec::with_capacity(surface.vertex_count() * 8);
    for vertex in 0..surface.vertex_count() {
        let point = surface.mesh.points()[surface.origin(vertex)];
        let (x, y) = (f64::from(point.x), f64::from(point.y));
        let place = [(x + 0.5) / width, (height - 0.5 - y) / height];
        if normalized {
            let place = place.map(|part| (part * f64::from(u16::MAX) + 0.5) as u16);
            bytes.extend_from_slice(place.map(u16::to_le_bytes).as_flattened());
        } else {
            let place = place.map(|part| part as f32);
            bytes.extend_from_slice(place.map(f32::to_le_bytes).as_flattened());
        }
    }
    let (component_type, stride) = if normalized { (UNSIGNED_SHORT, 4) } else { (FLOAT, 8) };
    let (name, kind, bounds) = ("TEXCOORD_0", "VEC2", None);
    Attribute { name, kind, component_type, normalized, stride, bounds, bytes }
}

/// A number of -1 to 1 as a normalised 16-bit integer, rounded to the nearest.
fn signed_16(part: f64) -> i16 {
    let scaled = part * f64::from(i16::MAX);
    if scaled < 0.0 { (scaled - 0.5) as i16 } else { (scaled + 0.5) as i16 }
}
