//! A small landscape: a balloon over hills at dusk, and a lake.

use pixmesh_meshing::{Image, ImageError};

const WIDTH: usize = 384;
const HEIGHT: usize = 256;

/// Samples along each side of a pixel, for smooth outlines.
const SAMPLES: usize = 4;

type Colour = [f64; 3];

/// Renders the landscape, 384 by 256, three components of 8 bits.
pub(crate) fn balloon_over_hills() -> Result<Image, ImageError> {
    let mut components = vec![vec![0; WIDTH * HEIGHT]; 3];
    for i in 0..WIDTH * HEIGHT {
        let colour = pixel((i % WIDTH) as f64, (i / WIDTH) as f64);
        for (component, sample) in components.iter_mut().zip(colour) {
            component[i] = (sample.clamp(0.0, 255.0) + 0.5) as u16;
        }
    }
    Image::from_bottom_up(WIDTH, HEIGHT, 8, components)
}

/// The mean colour of a pixel.
fn pixel(x: f64, y: f64) -> Colour {
    let offset = |i: usize| (i as f64 + 0.5) / SAMPLES as f64;
    let mut sum = [0.0; 3];
    for i in 0..SAMPLES * SAMPLES {
        let colour = scene(x + offset(i % SAMPLES), y + offset(i / SAMPLES));
        sum = [0, 1, 2].map(|c| sum[c] + colour[c]);
    }
    sum.map(|component| component / (SAMPLES * SAMPLES) as f64)
}

/// The colour at a place; y grows upwards.
fn scene(x: f64, y: f64) -> Colour {
    const SHORE: f64 = 58.0;
    if y < SHORE + 3.0 * wave(x, 97.0) { lake(x, y, SHORE) } else { land(x, y) }
}

/// What stands above the water.
fn land(x: f64, y: f64) -> Colour {
    if let Some(colour) = balloon(x, y) {
        return colour;
    }
    let near = 78.0 + 22.0 * wave(x + 40.0, 260.0) + 5.0 * wave(x, 61.0);
    let far = 112.0 + 26.0 * wave(x - 90.0, 330.0) + 9.0 * wave(x, 83.0) + 3.0 * wave(x, 29.0);
    if y < near {
        blend([30.0, 52.0, 44.0], [62.0, 92.0, 58.0], (y - 40.0) / 60.0)
    } else if y < far {
        blend([70.0, 84.0, 110.0], [120.0, 110.0, 128.0], (y - 70.0) / 70.0)
    } else {
        sky(x, y)
    }
}

/// The evening sky and its sun.
fn sky(x: f64, y: f64) -> Colour {
    let air = blend([252.0, 186.0, 120.0], [64.0, 92.0, 158.0], (y - 90.0) / 150.0);
    let distance = ((x - 96.0) * (x - 96.0) + (y - 142.0) * (y - 142.0)).sqrt();
    if distance < 21.0 {
        return [255.0, 240.0, 200.0];
    }
    let glow = 26.0 / (distance + 5.0);
    blend(air, [255.0, 222.0, 160.0], glow * glow)
}

/// The water: the land upside down, darker, in ripples.
fn lake(x: f64, y: f64, shore: f64) -> Colour {
    let depth = shore - y;
    let ripple = 2.2 * wave(x + 5.0 * depth, 70.0) * wave(depth, 9.0);
    let mirrored = land(x + ripple, shore + 1.4 * depth + 6.0);
    blend(mirrored, [34.0, 50.0, 84.0], 0.38 + depth / 160.0)
}

/// The balloon with its gores and basket, where it covers the place.
fn balloon(x: f64, y: f64) -> Option<Colour> {
    let (dx, dy) = ((x - 268.0) / 44.0, (y - 186.0) / 48.0);
    let distance = dx * dx + dy * dy;
    if distance < 1.0 {
        let across = dx / (1.0 - dy * dy).max(1e-6).sqrt();
        let gore = ((across * 3.5 + 10.5).floor() as i64) % 2 == 0;
        let colour = if gore { [214.0, 54.0, 48.0] } else { [246.0, 226.0, 190.0] };
        let light = 0.55 + 0.45 * (1.0 - distance).sqrt() - 0.28 * dx + 0.12 * dy;
        return Some(colour.map(|component| component * light));
    }
    let (bx, by) = (x - 268.0, y - 122.0);
    if bx.abs() < 8.0 && by.abs() < 6.0 {
        return Some(blend([96.0, 62.0, 34.0], [150.0, 104.0, 60.0], (by + 6.0) / 12.0));
    }
    let rope = (bx.abs() - 7.0 - (by - 6.0) * 0.55).abs() < 0.8 && by > 0.0 && by < 26.0;
    rope.then_some([80.0, 56.0, 40.0])
}

/// A smooth wave of period `period` between -1 and 1, made of parabolas.
fn wave(x: f64, period: f64) -> f64 {
    let phase = x / period - (x / period).floor();
    let half = if phase < 0.5 { phase } else { phase - 0.5 };
    let arch = 16.0 * half * (0.5 - half);
    if phase < 0.5 { arch } else { -arch }
}

/// Mixes two colours: the first at 0, the second at 1.
fn blend(from: Colour, to: Colour, share: f64) -> Colour {
    let share = share.clamp(0.0, 1.0);
    [0, 1, 2].map(|c| from[c] + (to[c] - from[c]) * share)
}
