//! Squared errors by how much each lattice point matters.

use crate::face_rows::for_each_row;
use crate::image::Image;
use crate::interpolant::Interpolant;
use crate::mesh::Point;

/// The sum over a face's lattice points of the squared differences, summed over the components,
/// times the point's weight; in units of the square of what 8 bits can tell apart, so that no sum
/// overflows.
pub(crate) fn weighted_error(image: &Image, weights: &[u8], corners: [Point; 3]) -> u64 {
    let shift = 2 * image.precision().saturating_sub(8);
    let (mut total, mut approximation) = (0, Vec::new());
    for c in 0..image.component_count() {
        let samples = corners.map(|p| image.sample(c, p.x as usize, p.y as usize));
        let interpolant = Interpolant::new(corners, samples);
        for_each_row(corners, |y, first, end| {
            let columns = first as usize..end as usize;
            let original = &image.row(c, y as usize)[columns.clone()];
            let weights = &weights[y as usize * image.width()..][columns];
            approximation.resize(original.len(), 0u16);
            interpolant.fill(first, y, &mut approximation);
            let points = original.iter().zip(&approximation).zip(weights);
            let error = |((a, b), &weight): ((&u16, &u16), &u8)| {
                u64::from(a.abs_diff(*b)).pow(2) * u64::from(weight)
            };
            total += points.map(error).sum::<u64>() >> shift;
        });
    }
    total
}
