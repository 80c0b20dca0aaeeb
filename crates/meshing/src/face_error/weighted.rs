//! Squared errors by how much each lattice point matters.

use crate::face_error::face_rows::for_each_row;
use crate::face_error::interpolant::Interpolant;
use crate::image::{Image, Point};

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_point_counts_by_its_weight_and_wide_samples_in_units_of_8_bits() {
        let (width, height) = (7, 5);
        let corners = [(0, 0), (6, 1), (2, 4)].map(|(x, y)| Point::new(x, y));
        for precision in [5, 8, 12] {
            let maximum = (1 << precision) - 1;
            let plane = |c: usize| {
                (0..width * height).map(|i| ((i * i * 977 + c * 331) % maximum) as u16).collect()
            };
            let image =
                Image::from_bottom_up(width, height, precision, vec![plane(1), plane(2)]).unwrap();
            let weights: Vec<u8> = (0..width * height).map(|i| (i * 29 % 256) as u8).collect();
            let (mut expected, unit) =
                (0, if precision > 8 { 1 << (2 * (precision - 8)) } else { 1 });
            for c in 0..2 {
                let samples = corners.map(|p| image.sample(c, p.x as usize, p.y as usize));
                let interpolant = Interpolant::new(corners, samples);
                for_each_row(corners, |y, first, end| {
                    let mut row = 0;
                    for x in first..end {
                        let mut value = [0];
                        interpolant.fill(x, y, &mut value);
                        let sample = image.sample(c, x as usize, y as usize);
                        let weight = weights[y as usize * width + x as usize];
                        row += u64::from(sample.abs_diff(value[0])).pow(2) * u64::from(weight);
                    }
                    expected += row / unit;
                });
            }
            assert!(expected > 0);
            assert_eq!(weighted_error(&image, &weights, corners), expected, "{precision} bits");
        }
    }
}
