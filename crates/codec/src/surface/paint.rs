//! The colours that a surface shows instead of the picture's: shaded by a light, or by height.
//!
//! Literature: Horn, "Hill shading and the reflectance map", Proceedings of the IEEE 69(1), 1981.

use super::{Relief, Surface};
use crate::choices::Coloring;
use pixmesh_meshing::Shape;

/// Towards the light: from the upper left, 45 degrees above the plane.
const LIGHT: [f64; 3] = [-0.5, 0.5, std::f64::consts::FRAC_1_SQRT_2];

/// The share of the light that comes from everywhere.
const AMBIENT: f64 = 0.15;

/// Red, green and blue from the lowest height to the highest, evenly spaced.
const RAMP: [[f64; 3]; 5] = [
    [42.0, 113.0, 72.0],
    [166.0, 194.0, 116.0],
    [226.0, 208.0, 151.0],
    [150.0, 106.0, 74.0],
    [250.0, 250.0, 250.0],
];

/// The shape of painted colours: sRGB of 8 bits.
pub(super) const fn shape(of: Shape) -> Shape {
    Shape { component_count: 3, precision: 8, ..of }
}

/// The colours of all vertices where they are not those of the picture.
pub(super) fn painted(surface: &Surface<'_>) -> Option<Vec<u16>> {
    let shape = surface.mesh.shape();
    let geometry = &surface.geometry;
    match geometry.color {
        Coloring::Hillshade => Some(hillshade(surface)),
        Coloring::Ramp => Some(by_height(surface, ramp)),
        // Elevations fill a small part of 16 bits, and would be black.
        Coloring::Image
            if geometry.relief.is_some() && shape.component_count == 1 && shape.precision > 8 =>
        {
            Some(by_height(surface, |share| [255.0 * share; 3]))
        }
        Coloring::Image | Coloring::None => None,
    }
}

/// The light that each vertex reflects. A flat mesh is shaded as its relief would be.
fn hillshade(surface: &Surface<'_>) -> Vec<u16> {
    let relief = Some(surface.geometry.relief.unwrap_or_default());
    let shaded =
        Surface { geometry: super::Geometry { relief, ..surface.geometry }, ..surface.bare() };
    let gray = |normal: [f64; 3]| {
        let cosine: f64 = normal.iter().zip(LIGHT).map(|(part, light)| part * light).sum();
        rounded(255.0 * (AMBIENT + (1.0 - AMBIENT) * cosine.max(0.0)))
    };
    shaded.normals().into_iter().flat_map(|normal| [gray(normal); 3]).collect()
}

/// A colour for each vertex by its place between the lowest and the highest, 0 to 1.
fn by_height(surface: &Surface<'_>, color: impl Fn(f64) -> [f64; 3]) -> Vec<u16> {
    let Relief { source, .. } = surface.geometry.relief.unwrap_or_default();
    let level = |vertex| {
        let samples = surface.mesh.vertex_samples(surface.origin(vertex));
        super::geometry::steps(samples, source, surface.mesh.shape())
    };
    let levels: Vec<u32> = (0..surface.vertex_count()).map(level).collect();
    let least = levels.iter().copied().min().unwrap_or_default();
    let range = f64::from(levels.iter().copied().max().unwrap_or_default() - least);
    let share = |level: u32| if range > 0.0 { f64::from(level - least) / range } else { 0.5 };
    levels.into_iter().flat_map(|level| color(share(level)).map(rounded)).collect()
}

fn ramp(share: f64) -> [f64; 3] {
    let place = share * (RAMP.len() - 1) as f64;
    let below = (place as usize).min(RAMP.len() - 2);
    let [low, high] = [RAMP[below], RAMP[below + 1]];
    let between = place - below as f64;
    std::array::from_fn(|part| low[part] + between * (high[part] - low[part]))
}

/// The nearest whole number, halves up.
fn rounded(value: f64) -> u16 {
    (value + 0.5) as u16
}
