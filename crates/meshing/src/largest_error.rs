//! Simplification that no lattice point's error may go beyond.
//!
//! The order of greedy removal does not depend on where it ends, so the removals are made once
//! without a bound and then followed on a mesh that knows which of its faces break it: the first
//! removal that makes one is the first that is not made.

use crate::control::Stage;
use crate::control::{Cancelled, Control};
use crate::face_rows::for_each_row;
use crate::image::Image;
use crate::interpolant::Interpolant;
use crate::mesh::{Face, Point};
use crate::refine::measured_mesh::{FaceMeasure, MeasuredMesh};
use crate::simplify::Removal;

/// How many of `removals`, in order, can be made on the mesh of an image before a sample of the
/// approximation differs from the image's by more than `most`.
///
/// # Errors
/// When the control cancels.
pub(crate) fn removals_within(
    image: &Image,
    points: Vec<Point>,
    faces: &[Face],
    removals: &[Removal],
    most: u16,
    control: &dyn Control,
) -> Result<usize, Cancelled> {
    let size = (image.width(), image.height());
    let places: Vec<Point> = removals.iter().map(|removal| removal.point).collect();
    let numbers: Vec<usize> =
        places.iter().filter_map(|place| points.binary_search(place).ok()).collect();
    let mut mesh = MeasuredMesh::new(points, faces, size, Breaches { image, most });
    for (made, &vertex) in numbers.iter().enumerate() {
        control.poll(Stage::Measure, made, numbers.len())?;
        if mesh.total_error() > 0 {
            return Ok(made);
        }
        let (change, _) = mesh.remove(vertex as u32);
        if change > 0 {
            return Ok(made);
        }
    }
    Ok(numbers.len())
}

/// Counts the faces that hold a sample of too large an error.
struct Breaches<'a> {
    image: &'a Image,
    most: u16,
}

impl FaceMeasure for Breaches<'_> {
    /// 1 for a face that breaks the bound, 0 for one that keeps it.
    fn error(&mut self, corners: [Point; 3]) -> u64 {
        let image = self.image;
        let mut approximation = Vec::new();
        let mut breaks = false;
        for (c, _) in image.components().iter().enumerate() {
            let samples = corners.map(|p| image.sample(c, p.x as usize, p.y as usize));
            let interpolant = Interpolant::new(corners, samples);
            for_each_row(corners, |y, first, end| {
                let original = &image.row(c, y as usize)[first as usize..end as usize];
                approximation.resize(original.len(), 0);
                interpolant.fill(first, y, &mut approximation);
                let mut pairs = original.iter().zip(&approximation);
                breaks |= pairs.any(|(a, b)| a.abs_diff(*b) > self.most);
            });
        }
        breaks.into()
    }

    fn another(&self) -> Self {
        Self { ..*self }
    }
}
