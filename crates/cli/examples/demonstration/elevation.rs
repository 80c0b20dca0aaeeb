//! Mountains of our own: ridged noise in octaves, 16 bits a sample.

use pixmesh_meshing::{Image, ImageError};

const WIDTH: usize = 384;
const HEIGHT: usize = 256;
/// Pixels between the lattice points of the largest octave.
const LARGEST: f64 = 128.0;
const OCTAVES: u32 = 7;
/// Pixels from the origin, about which the octaves are turned.
const FAR: f64 = 1000.0;
const SEED: u32 = 11;
/// Directions of unit length.
const GRADIENTS: [(f64, f64); 12] = [
    (1.0, 0.0),
    (0.8, 0.6),
    (0.6, 0.8),
    (0.0, 1.0),
    (-0.6, 0.8),
    (-0.8, 0.6),
    (-1.0, 0.0),
    (-0.8, -0.6),
    (-0.6, -0.8),
    (0.0, -1.0),
    (0.6, -0.8),
    (0.8, -0.6),
];

/// Elevations in steps of one 65535th of their range.
pub(crate) fn mountains() -> Result<Image, ImageError> {
    let heights: Vec<f64> =
        (0..WIDTH * HEIGHT).map(|i| height((i % WIDTH) as f64, (i / WIDTH) as f64)).collect();
    let lowest = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let highest = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let level = |height: &f64| ((height - lowest) / (highest - lowest) * 65535.0) as u16;
    Image::from_bottom_up(WIDTH, HEIGHT, 16, vec![heights.iter().map(level).collect()])
}

/// Ridges where the noise of an octave changes its sign; finer ones are rougher on high ground. Each octave
/// is turned, so that no lattice shows.
fn height(x: f64, y: f64) -> f64 {
    let (mut x, mut y) = ((x + FAR) / LARGEST, (y + FAR) / LARGEST);
    let (mut sum, mut amplitude, mut weight) = (0.0, 1.0, 1.0);
    for octave in 0..OCTAVES {
        let ridge = (1.0 - 1.6 * noise(x, y, octave).abs()).max(0.0);
        sum += amplitude * ridge * ridge * weight;
        weight = (1.5 * ridge).min(1.0);
        amplitude *= 0.46;
        (x, y) = (2.0 * (0.8 * x - 0.6 * y), 2.0 * (0.6 * x + 0.8 * y));
    }
    sum
}

/// Smooth noise between -1 and 1, whose gradients at the points of a lattice are random.
fn noise(x: f64, y: f64, octave: u32) -> f64 {
    let (column, row) = (x.floor(), y.floor());
    let smooth = |t: f64| t * t * t * (t * (6.0 * t - 15.0) + 10.0);
    let (dx, dy) = (x - column, y - row);
    let at = |i: f64, j: f64| {
        let (gx, gy) = GRADIENTS[random(column + i, row + j, octave) as usize % GRADIENTS.len()];
        gx * (dx - i) + gy * (dy - j)
    };
    let between = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let across = |j: f64| between(at(0.0, j), at(1.0, j), smooth(dx));
    between(across(0.0), across(1.0), smooth(dy))
}

fn random(column: f64, row: f64, octave: u32) -> u32 {
    let mut hash = (column as i32 as u32).wrapping_mul(0x9E37_79B1)
        ^ (row as i32 as u32).wrapping_mul(0x85EB_CA77)
        ^ octave.wrapping_add(SEED).wrapping_mul(0xC2B2_AE3D);
    for multiplier in [0x2C1B_3C6D, 0x297A_2D39] {
        hash = (hash ^ (hash >> 15)).wrapping_mul(multiplier);
    }
    hash ^ (hash >> 16)
}
