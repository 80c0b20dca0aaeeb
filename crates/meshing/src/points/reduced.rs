//! The points of a large picture by error diffusion in a reduced one: for a mesh that is shown
//! before a better one arrives.
//!
//! Each block of pixels becomes one, its mean. The density of the reduced picture ignores noise and
//! texture that the mesh is too coarse to follow, and takes a fraction of the time. A point goes to
//! the pixel of its block where the picture around bends most, less how far the pixel is from the
//! mean: without the first points lie beside the edges that they are for, without the second on
//! noise.

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::density::Density;
use crate::image::Image;
use crate::parallel::in_row_bands;
use crate::parameters::{Parameters, Weights};
use crate::points::error_diffusion::diffuse_to_size;
use std::borrow::Cow;
use std::ops::Range;

/// The least pixels of a reduced picture for each point: with fewer the points lie worse than those
/// of error diffusion in the picture itself.
const PIXELS_PER_POINT: usize = 12;

/// The largest side of a block, for sums of 32 bits. Larger ones would save no time.
const MOST_FACTOR: usize = 64;

/// How many times the bend counts less than the distance from the mean.
const DISTANCE_WEIGHT: i32 = 4;

/// The difference in points that ends the search for a threshold: one part in this many, or more.
const TOLERANCE_PARTS: usize = 500;
const LEAST_TOLERANCE: usize = 10;

/// Marks about `size` of an image's lattice points, `1` at each chosen one, row 0 at the bottom.
pub(crate) fn diffuse_in_reduced(
    image: &Image,
    weights: Option<&Weights>,
    size: usize,
    control: &dyn Control,
) -> Result<Vec<u8>, Cancelled> {
    let factor = factor(image, size);
    let blocks = Blocks { width: image.width(), height: image.height(), factor };
    let reduced =
        if factor == 1 { Cow::Borrowed(image) } else { Cow::Owned(blocks.reduce(image, control)?) };
    let tolerance = (factor > 1).then(|| LEAST_TOLERANCE.max(size / TOLERANCE_PARTS));
    let parameters = Parameters::default().tolerance(tolerance);
    let mut density = Density::of_checked(&reduced, &parameters, control)?;
    if let Some(weights) = weights {
        weigh(&mut density, &blocks.means(weights.values(), control)?, control)?;
    }
    let chosen = diffuse_to_size(&density, size, &parameters, control)?;
    if factor == 1 { Ok(chosen) } else { blocks.marks(image, &reduced, &chosen, control) }
}

/// Multiplies a density by weights: it goes with the error of samples, weights with its square.
fn weigh(density: &mut Density, weights: &[u16], control: &dyn Control) -> Result<(), Cancelled> {
    let width = density.width;
    in_row_bands(&mut density.fields[0], width, control, |first_row, band, control| {
        let mut poller = Poller::new(control, Stage::Density, 1, 1);
        for (row, values) in (first_row..).zip(band.chunks_exact_mut(width)) {
            poller.step(width)?;
            for (value, &weight) in values.iter_mut().zip(&weights[row * width..]) {
                *value *= f64::from(weight).sqrt();
            }
        }
        Ok(())
    })
}

/// The side of the blocks that leaves enough pixels for so many points.
fn factor(image: &Image, size: usize) -> usize {
    let factor = (image.pixel_count() / (PIXELS_PER_POINT * size)).isqrt();
    factor.clamp(1, MOST_FACTOR.min(image.width().min(image.height()) / 2))
}

/// The blocks of a picture, those at the right and at the top smaller.
struct Blocks {
    width: usize,
    height: usize,
    factor: usize,
}

impl Blocks {
    /// The picture whose pixels are the means of blocks.
    fn reduce(&self, image: &Image, control: &dyn Control) -> Result<Image, Cancelled> {
        let components = image.components().iter();
        let planes: Result<_, _> = components.map(|plane| self.means(plane, control)).collect();
        let [columns, rows] = [self.width, self.height].map(|side| side.div_ceil(self.factor));
        Ok(Image::from_kernel(columns, rows, image.precision(), planes?))
    }

    fn means<T: Copy + Into<u32> + Sync>(
        &self,
        plane: &[T],
        control: &dyn Control,
    ) -> Result<Vec<u16>, Cancelled> {
        let &Self { width, height, factor } = self;
        let columns = width.div_ceil(factor);
        let mut means = vec![0; columns * height.div_ceil(factor)];
        in_row_bands(&mut means, columns, control, |first_row, band, control| {
            let mut poller = Poller::new(control, Stage::Density, 0, 1);
            let mut sums = vec![0; width];
            for (row, means) in (first_row..).zip(band.chunks_exact_mut(columns)) {
                let rows = self.of(row, height);
                sums.fill(0);
                for samples in rows.clone().map(|y| &plane[y * width..][..width]) {
                    poller.step(width)?;
                    sums.iter_mut().zip(samples).for_each(|(sum, &sample)| *sum += sample.into());
                }
                for (mean, sums) in means.iter_mut().zip(sums.chunks(factor)) {
                    let count = (rows.len() * sums.len()) as u32;
                    *mean = ((sums.iter().sum::<u32>() + count / 2) / count) as u16;
                }
            }
            Ok(())
        })?;
        Ok(means)
    }

    /// The columns, or rows, of a picture's side that those of a block are.
    fn of(&self, index: usize, side: usize) -> Range<usize> {
        index * self.factor..((index + 1) * self.factor).min(side)
    }

    /// Marks a pixel in each chosen block.
    fn marks(
        &self,
        image: &Image,
        reduced: &Image,
        chosen: &[u8],
        control: &dyn Control,
    ) -> Result<Vec<u8>, Cancelled> {
        let (row_of_blocks, columns) = (self.width * self.factor, reduced.width());
        let mut marks = vec![0; image.pixel_count()];
        in_row_bands(&mut marks, row_of_blocks, control, |first_row, band, control| {
            let mut poller = Poller::new(control, Stage::Diffuse, 1, 1);
            for (row, marks) in (first_row..).zip(band.chunks_mut(row_of_blocks)) {
                poller.step(columns)?;
                let chosen = &chosen[row * columns..][..columns];
                for column in (0..columns).filter(|&column| chosen[column] != 0) {
                    poller.step(self.factor * self.factor)?;
                    let (x, y) = self.best_pixel(image, reduced, (column, row));
                    marks[(y - row * self.factor) * self.width + x] = 1;
                }
            }
            Ok(())
        })?;
        Ok(marks)
    }

    /// The best pixel of a block for a point, the first of several.
    fn best_pixel(
        &self,
        image: &Image,
        reduced: &Image,
        (column, row): (usize, usize),
    ) -> (usize, usize) {
        let (columns, last) = (self.of(column, self.width), self.width - 1);
        let mut best = (i32::MIN, (0, 0));
        for y in self.of(row, self.height) {
            let mut scores = [0; MOST_FACTOR];
            for c in 0..image.component_count() {
                let mean = i32::from(reduced.sample(c, column, row));
                let row_at = |by| image.row(c, y.saturating_add_signed(by).min(self.height - 1));
                let [below_2, below, row, above, above_2] = [-2, -1, 0, 1, 2].map(row_at);
                for (score, x) in scores.iter_mut().zip(columns.clone()) {
                    let beside = |by| row[x.saturating_add_signed(by).min(last)];
                    let sum = |four: [u16; 4]| four.map(i32::from).iter().sum::<i32>();
                    let near = sum([beside(-1), beside(1), below[x], above[x]]);
                    let far = sum([beside(-2), beside(2), below_2[x], above_2[x]]);
                    let distance = (i32::from(row[x]) - mean).abs();
                    *score += (near - far).abs() - DISTANCE_WEIGHT * distance;
                }
            }
            for (score, x) in scores.into_iter().zip(columns.clone()) {
                if score > best.0 {
                    best = (score, (x, y));
                }
            }
        }
        best.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::Recorder;
    use crate::parameters::{Method, Target};
    use crate::pipeline::mesh_image;

    /// A picture above the size up to which points are inserted: discs and stripes on a slope, with
    /// some noise.
    fn large_picture() -> Image {
        let (width, height) = (1300, 1100);
        let sample = |i: usize| {
            let (x, y) = (i % width, i / width);
            let is_disc = (x % 300).abs_diff(150).pow(2) + (y % 260).abs_diff(130).pow(2) < 9000;
            let is_stripe = (x + 2 * y) % 400 < 40;
            let noise = ((i * 40_503) >> 7) % 5;
            let color = match (is_disc, is_stripe) {
                (true, _) => 190,
                (_, true) => 90,
                _ => 20 + 60 * x / width,
            };
            (color + noise) as u16
        };
        let samples = (0..width * height).map(sample).collect();
        Image::from_bottom_up(width, height, 8, vec![samples]).unwrap()
    }

    #[test]
    fn preview_of_large_picture_is_not_worse_than_med() {
        let image = large_picture();
        for percent in [0.1, 0.5, 2.0] {
            let made = |method: Method| {
                let parameters = method.parameters(Target::Percent(percent));
                mesh_image(&image, &parameters, &()).unwrap()
            };
            let (preview, med) = (made(Method::Preview), made(Method::Med));
            let [size, of_med] = [&preview, &med].map(|made| made.mesh.points().len());
            assert!(size.abs_diff(of_med) <= 20 + size / 500, "{percent} %: {size} of {of_med}");
            let [db, least] = [&preview, &med].map(|made| made.fidelity.psnr_db());
            assert!(db >= least, "{percent} %: {db} dB, MED {least} dB");
        }
    }

    #[test]
    fn picture_for_many_points_is_not_reduced() {
        let image = large_picture();
        let mesh = |method: Method| {
            mesh_image(&image, &method.parameters(Target::Percent(3.0)), &()).unwrap().mesh
        };
        assert!(mesh(Method::Preview) == mesh(Method::Med));
    }

    #[test]
    fn weights_gather_points() {
        let image = large_picture();
        let (width, height) = (image.width(), image.height());
        let weights = (0..width * height).map(|i| if i % width < width / 2 { 255 } else { 0 });
        let weights = Weights::from_bottom_up(width, height, weights.collect()).unwrap();
        for size in [2000, 40_000] {
            let marks = diffuse_in_reduced(&image, Some(&weights), size, &()).unwrap();
            let count = |marks: &[u8]| marks.iter().filter(|&&mark| mark != 0).count();
            let at_left: usize = marks.chunks(width).map(|row| count(&row[..width / 2])).sum();
            let all = count(&marks);
            assert!(all.abs_diff(size) <= 80 && at_left * 50 > all * 49, "{at_left} of {all}");
        }
    }

    #[test]
    fn few_points_allow_larger_blocks() {
        let image = large_picture();
        let of = |percent| factor(&image, image.pixel_count() * percent / 1000);
        assert_eq!([1, 5, 20, 21, 1000].map(of), [9, 4, 2, 1, 1]);
        assert_eq!(factor(&image, 4), 64);
        let samples = vec![0; 3 * 500_000];
        let narrow = Image::from_bottom_up(500_000, 3, 8, vec![samples]).unwrap();
        assert_eq!(factor(&narrow, 4), 1);
    }

    #[test]
    fn pixels_of_reduced_picture_are_means_of_blocks() {
        let samples = vec![1, 3, 10, 5, 8, 20, 7, 7, 4];
        let image = Image::from_bottom_up(3, 3, 8, vec![samples]).unwrap();
        let reduced = Blocks { width: 3, height: 3, factor: 2 }.reduce(&image, &()).unwrap();
        assert_eq!((reduced.width(), reduced.height()), (2, 2));
        assert_eq!(reduced.components()[0], [4, 15, 7, 4]);
    }

    #[test]
    fn points_lie_beside_edges_and_not_on_noise() {
        // Dark up to column 5, bright from column 6 on; one pixel is noise.
        let mut samples: Vec<u16> = (0..96).map(|i| if i % 12 < 6 { 40 } else { 80 }).collect();
        samples[2 * 12 + 5] = 90;
        let image = Image::from_bottom_up(12, 8, 8, vec![samples]).unwrap();
        let blocks = Blocks { width: 12, height: 8, factor: 4 };
        let reduced = blocks.reduce(&image, &()).unwrap();
        let (x, y) = blocks.best_pixel(&image, &reduced, (1, 1));
        assert!((5..=6).contains(&x) && (4..8).contains(&y), "{x} {y}");
        assert_ne!(blocks.best_pixel(&image, &reduced, (1, 0)), (5, 2));
        assert_eq!(blocks.best_pixel(&image, &reduced, (0, 1)), (0, 4));
    }

    #[test]
    fn cancels_at_any_poll() {
        let image = large_picture();
        let recorder = Recorder::default();
        diffuse_in_reduced(&image, None, 2000, &recorder).unwrap();
        for poll in 0..recorder.reports().len() {
            let control = Recorder::cancelling_at(poll);
            assert_eq!(diffuse_in_reduced(&image, None, 2000, &control), Err(Cancelled));
        }
    }
}
