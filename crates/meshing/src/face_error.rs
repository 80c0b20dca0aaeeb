//! The squared error of faces: how far their interpolants are from the picture.

use crate::face_rows::for_each_row;
use crate::image::Image;
use crate::interpolant::Interpolant;
use crate::mesh::Point;
use crate::predicates::orientation;

/// Computes squared errors of faces over vertices at lattice points of an image; keeps its memory
/// from one face to the next.
pub(crate) struct FaceErrors<'a> {
    image: &'a Image,
    interpolants: Vec<Interpolant>,
}

impl<'a> FaceErrors<'a> {
    pub(crate) fn new(image: &'a Image) -> Self {
        Self { image, interpolants: Vec::with_capacity(image.component_count()) }
    }

    /// Sum over the face's lattice points and all components of the squared differences between
    /// the rounded interpolant and the picture.
    pub(crate) fn squared_error(&mut self, corners: [Point; 3]) -> u64 {
        let Self { image, interpolants } = self;
        let width = image.width();
        let places = corners.map(|p| p.y as usize * width + p.x as usize);
        let double_area = orientation(corners[0], corners[1], corners[2]);
        let quarter_reciprocal = 0.25 / double_area as f64;
        interpolants.clear();
        interpolants.extend(image.components().iter().map(|samples| {
            let samples = places.map(|place| samples[place]);
            Interpolant::with_double_area(corners, samples, double_area, quarter_reciprocal)
        }));
        let mut sum = 0;
        for_each_row(corners, |y, first, end| {
            let points = y as usize * width + first as usize..y as usize * width + end as usize;
            for (interpolant, samples) in interpolants.iter().zip(image.components()) {
                sum += interpolant.squared_error(first, y, &samples[points.clone()]);
            }
        });
        sum
    }
}
