//! The pictures that are sent: each another one, so that no answer is one that was made before.

use crate::driver::{Request, request};
use crate::pictures;
use pixmesh_codec::{Limits, decode, write_model};
use pixmesh_meshing::{Image, Parameters, mesh_image};

/// The query of the work that capacity is measured with.
pub(crate) const QUERY: &str = "density=2";

/// A picture with edges, curves and texture, 8 bits RGB, as PNG; different for each seed.
pub(crate) fn picture(width: usize, height: usize, seed: usize) -> Vec<u8> {
    let discs: Vec<[usize; 4]> = (0..12)
        .map(|n| {
            let mix = |k: usize| {
                let word = (seed * 977 + n * 131 + k * 17 + 1).wrapping_mul(2_654_435_761);
                (word >> 7) % 1000
            };
            [mix(1) * width / 1000, mix(2) * height / 1000, mix(3) * width / 6000 + 2, mix(4) % 160]
        })
        .collect();
    let sample = |c: usize, x: usize, y: usize| {
        let inside = |[x0, y0, radius, _]: &&[usize; 4]| {
            x.abs_diff(*x0).pow(2) + y.abs_diff(*y0).pow(2) < radius.pow(2)
        };
        let base = discs.iter().rev().find(inside).map_or(40, |disc| disc[3]);
        let texture = (x * 7 + y * 13 + c * 5 + x * y / 64) % 11;
        (base + (x * 40 / width) + (y * 30 / height) + texture + 10 * c).min(255) as u16
    };
    let plane = |c: usize| (0..width * height).map(|i| sample(c, i % width, i / width)).collect();
    pictures::png(&Image::from_top_down(width, height, 8, (0..3).map(plane).collect()).unwrap())
}

/// A picture of about so many pixels, four to three.
pub(crate) fn picture_of(megapixels: f64, seed: usize) -> Vec<u8> {
    let height = (megapixels * 1e6 * 0.75).sqrt().round() as usize;
    picture(height * 4 / 3, height, seed)
}

/// Some different requests for meshes.
pub(crate) struct Work(Vec<Request>);

impl Work {
    /// Requests with a query for so many different pictures.
    pub(crate) fn new(class: &'static str, megapixels: f64, query: &str, count: usize) -> Self {
        let target = format!("/v1/meshes?{query}");
        let make = |seed| request(class, "POST", &target, &picture_of(megapixels, seed));
        Self((0..count).map(make).collect())
    }

    /// The requests of several kinds of work, in turns.
    pub(crate) fn all(kinds: &[Self]) -> Self {
        let longest = kinds.iter().map(|kind| kind.0.len()).max().unwrap_or(0);
        Self((0..longest).flat_map(|n| kinds.iter().map(move |kind| kind.request(n))).collect())
    }

    /// The work that capacity is measured with: a fifth of a megapixel.
    pub(crate) fn usual() -> Self {
        Self::new("usual", 0.2, QUERY, 16)
    }

    pub(crate) fn request(&self, number: usize) -> Request {
        self.0[number % self.0.len()].clone()
    }
}

/// Meshes a picture as the service does, in this process and without one.
pub(crate) fn mesh_alone(picture: &[u8], parameters: &Parameters) {
    let image = decode(picture, &Limits::default()).unwrap();
    let model = mesh_image(&image, parameters, &()).unwrap();
    let mut text = Vec::new();
    write_model(&model.mesh, &mut text).unwrap();
    assert!(!text.is_empty());
}
