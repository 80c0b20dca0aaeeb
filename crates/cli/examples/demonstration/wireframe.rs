//! The edges of a mesh over its picture, which is enlarged and paled.

use pixmesh_meshing::{Image, ImageError, Mesh, Point};

/// How much of an edge's ink covers a pixel that it passes through the middle of.
const INK: f64 = 0.85;

/// Draws every edge of the mesh over the picture, `scale` times enlarged.
pub(crate) fn draw(picture: &Image, mesh: &Mesh, scale: usize) -> Result<Image, ImageError> {
    let (width, height) = (picture.width() * scale, picture.height() * scale);
    let mut ink = vec![0.0; width * height];
    for &face in mesh.faces() {
        let [a, b, c] = mesh.corners(face);
        for (from, to) in [(a, b), (b, c), (c, a)] {
            draw_line(&mut ink, width, place(from, scale), place(to, scale));
        }
    }
    let paled = |sample: u16| 0.45 * f64::from(sample) + 0.55 * 255.0;
    let components = (0..picture.component_count()).map(|c| {
        let pixel = |i: usize| {
            let sample = picture.sample(c, i % width / scale, i / width / scale);
            (paled(sample) * (1.0 - INK * ink[i]) + 0.5) as u16
        };
        (0..width * height).map(pixel).collect()
    });
    Image::from_bottom_up(width, height, picture.precision(), components.collect())
}

/// The middle of a lattice point's enlarged square.
fn place(point: Point, scale: usize) -> (f64, f64) {
    let middle = |at: i32| (f64::from(at) + 0.5) * scale as f64 - 0.5;
    (middle(point.x), middle(point.y))
}

/// Inks a line one pixel wide: each step along its longer axis shares its ink between two pixels.
fn draw_line(ink: &mut [f64], width: usize, from: (f64, f64), to: (f64, f64)) {
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    let steps = dx.abs().max(dy.abs());
    let height = ink.len() / width;
    for step in 0..=steps as usize {
        let (x, y) = (from.0 + dx * step as f64 / steps, from.1 + dy * step as f64 / steps);
        let (left, lower) = (x.floor(), y.floor());
        for (i, j) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let share = (1.0 - (x - left - i).abs()) * (1.0 - (y - lower - j).abs());
            let column = ((left + i) as usize).min(width - 1);
            let row = ((lower + j) as usize).min(height - 1);
            let pixel = &mut ink[row * width + column];
            *pixel = pixel.max(share);
        }
    }
}
