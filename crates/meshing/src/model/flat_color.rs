//! The second reconstruction: one colour for each face, the one of least squared error.
//!
//! The best colour of a face is the mean of its samples, rounded to the nearest integer, halves up.
//! Running sums along each row give the sums over a face in a time proportional to its rows.

use crate::control::{Cancelled, Control, Poller, Stage, free};
use crate::error::MeshingError;
use crate::face_error::FaceMeasure;
use crate::face_error::scan_conversion::{for_each_row, try_for_each_row};
use crate::image::{Image, Point, ShapeMismatch};
use crate::model::mesh::Mesh;
use crate::parameters::choices::ErrorMetric;
use crate::quality::fidelity::Fidelity;

impl Mesh {
    /// Gives each face its best colour for an image of the mesh's shape; returns how close the
    /// picture of these colours is to the image. A face without pixels of its own has the colour of
    /// its first vertex.
    ///
    /// # Errors
    /// When the image has another shape than the mesh's, or the control cancels.
    ///
    /// ```
    /// use pixmesh_meshing::{Image, Method, Target, mesh_image};
    ///
    /// let image = Image::from_top_down(2, 2, 8, vec![vec![10, 10, 10, 90]])?;
    /// let mesh = mesh_image(&image, &Method::Med.parameters(Target::Size(4)), &())?.mesh;
    /// let (flat, fidelity) = mesh.with_flat_colors(&image, &())?;
    /// assert_eq!(flat.face_samples().map(|samples| samples.len()), Some(flat.faces().len()));
    /// assert_eq!(fidelity.squared_error, 80 * 80 / 2);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn with_flat_colors(
        self,
        image: &Image,
        control: &dyn Control,
    ) -> Result<(Self, Fidelity), MeshingError> {
        ShapeMismatch::check(image.shape(), self.shape())?;
        Ok(self.with_weighted_colors(image, None, control)?)
    }

    /// The same with weights where there are any.
    pub(crate) fn with_weighted_colors(
        self,
        image: &Image,
        weights: Option<&[u8]>,
        control: &dyn Control,
    ) -> Result<(Self, Fidelity), Cancelled> {
        let (count, width) = (image.component_count(), image.width());
        let mut poller = Poller::new(control, Stage::Rasterize, 0, self.faces().len());
        let mut colors = Vec::with_capacity(self.faces().len() * count);
        let mut squared_error = 0;
        for (f, &face) in self.faces().iter().enumerate() {
            let corners = self.corners(face);
            poller.done = f;
            for c in 0..count {
                let mut sum = Sum::default();
                try_for_each_row(corners, |y, first, end| {
                    poller.step((end - first) as usize)?;
                    let row = y as usize * width;
                    for i in row + first as usize..row + end as usize {
                        let weight = weights.map_or(1, |weights| weights[i].into());
                        sum.weights += weight;
                        sum.samples += u128::from(weight * u64::from(image.components()[c][i]));
                    }
                    Ok(())
                })?;
                let color = sum.mean().unwrap_or_else(|| self.vertex_samples(face[0] as usize)[c]);
                colors.push(color);
                poller.step(STEPS_PER_FACE)?;
                try_for_each_row(corners, |y, first, end| {
                    poller.step((end - first) as usize)?;
                    let square = |sample: &u16| u64::from(sample.abs_diff(color)).pow(2);
                    let row = &image.row(c, y as usize)[first as usize..end as usize];
                    squared_error += row.iter().map(square).sum::<u64>();
                    Ok(())
                })?;
            }
        }
        let fidelity = Fidelity::new(squared_error, image.shape());
        Ok((self.with_kernel_face_samples(colors), fidelity))
    }
}

const STEPS_PER_FACE: usize = 64;
/// Looking up the sums of a row in a large face costs as much as so many pixels.
const STEPS_PER_ROW: usize = 256;

/// Sums over the pixels of a face, each times the pixel's weight; exact for any face.
#[derive(Clone, Copy, Default)]
struct Sum {
    weights: u64,
    samples: u128,
    squares: u128,
}

impl Sum {
    /// The mean sample, rounded to nearest, halves up; `None` without any weight.
    fn mean(self) -> Option<u16> {
        let weights = u128::from(self.weights);
        let mean = (2 * self.samples + weights).checked_div(2 * weights)?;
        u16::try_from(mean).ok()
    }

    fn squared_error(self, value: u16) -> u128 {
        let value = u128::from(value);
        // Not below 0, being a sum of squares.
        self.squares + u128::from(self.weights) * value * value - 2 * value * self.samples
    }
}

/// Running sums along each row: index `x` has the sums over the pixels left of column `x`.
pub(crate) struct RowSums {
    width: usize,
    weights: Option<Vec<u64>>,
    /// For each component the sums of samples and of their squares, times the weights.
    components: Vec<Vec<(u64, u64)>>,
    /// Bits by which the error of a face shrinks.
    shift: u32,
}

impl RowSums {
    /// The sums of an image, with weights where there are any. Reports the start of a stage.
    pub(crate) fn new(
        image: &Image,
        weights: Option<&[u8]>,
        stage: Stage,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let width = image.width();
        let weight = |i: usize| weights.map_or(1, |weights| u64::from(weights[i]));
        let mut poller = Poller::new(control, stage, 0, 1);
        let mut poll = || poller.step(width);
        let add_weight = |sum, i| sum + weight(i);
        let of_weights = weights
            .map(|weights| running_sums(weights.len(), width, 0, &mut poll, add_weight))
            .transpose()?;
        let mut components = Vec::with_capacity(image.component_count());
        for samples in image.components() {
            let add = |(sum, squares), i: usize| {
                let sample = u64::from(samples[i]);
                (sum + weight(i) * sample, squares + weight(i) * sample * sample)
            };
            components.push(running_sums(samples.len(), width, (0, 0), &mut poll, add)?);
        }
        let bits = weights.map_or(0, |_| ErrorMetric::MeanCompSe.weighted_shift(image.precision()));
        Ok(Self { width: width + 1, weights: of_weights, components, shift: bits })
    }

    pub(crate) fn free(self, control: &dyn Control) -> Result<(), Cancelled> {
        let poller = &mut Poller::new(control, Stage::Measure, 0, 1);
        self.components.into_iter().try_for_each(|sums| free(sums, poller))
    }

    fn of_face(&self, sums: &[(u64, u64)], corners: [Point; 3]) -> Sum {
        let mut total = Sum::default();
        for_each_row(corners, |y, first, end| {
            let row = y as usize * self.width;
            let (left, right) = (row + first as usize, row + end as usize);
            let pixels = (end - first) as u64;
            total.weights += self.weights.as_ref().map_or(pixels, |w| w[right] - w[left]);
            let (from, to) = (sums[left], sums[right]);
            total.samples += u128::from(to.0 - from.0);
            total.squares += u128::from(to.1 - from.1);
        });
        total
    }
}

/// Sums along each row of `count` pixels, from `zero` on; `add` adds one pixel.
fn running_sums<T: Copy>(
    count: usize,
    width: usize,
    zero: T,
    mut poll: impl FnMut() -> Result<(), Cancelled>,
    add: impl Fn(T, usize) -> T,
) -> Result<Vec<T>, Cancelled> {
    let mut sums = Vec::with_capacity(count / width * (width + 1));
    for row in (0..count).step_by(width) {
        poll()?;
        sums.push(zero);
        (row..row + width).for_each(|i| sums.push(add(sums[sums.len() - 1], i)));
    }
    Ok(sums)
}

impl FaceMeasure for &RowSums {
    fn error(&mut self, corners: [Point; 3], poller: &mut Poller<'_>) -> Result<u64, Cancelled> {
        let [first, second, third] = corners.map(|corner| corner.y);
        let rows = first.max(second).max(third) - first.min(second).min(third);
        poller.step(rows as usize * STEPS_PER_ROW)?;
        let sums = self.components.iter().map(|sums| self.of_face(sums, corners));
        let errors = sums.map(|sum| sum.mean().map_or(0, |value| sum.squared_error(value)));
        Ok((errors.sum::<u128>() >> self.shift) as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::{Recorder, poller};
    use crate::face_error::scan_conversion::for_each_row;
    use crate::image::corner_points;
    use crate::model::rasterize::rasterize;
    use crate::triangulation::{Face, triangulate};
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    #[test]
    fn polls_within_large_faces() {
        let image = Image::from_bottom_up(2000, 1000, 8, vec![vec![9; 2_000_000]]).unwrap();
        let (mesh, recorder) = (mesh_of(&image, &[]), Recorder::default());
        mesh.with_flat_colors(&image, &recorder).unwrap();
        // Once for the sums along rows, once for the colours.
        let count = recorder.reports().len();
        assert!(count > 2 * 2_000_000 / 70_000, "{count} polls");
    }

    /// A mesh of the corners and other points, which carries the image's samples.
    fn mesh_of(image: &Image, inner: &[(usize, usize)]) -> Mesh {
        let (width, height) = (image.width(), image.height());
        let inner = inner.iter().map(|&(x, y)| Point::new((x % width) as i32, (y % height) as i32));
        let points: BTreeSet<Point> = inner.chain(corner_points(width, height)).collect();
        let points: Vec<Point> = points.into_iter().collect();
        let sample = |p: &Point| {
            let (x, y) = (p.x as usize, p.y as usize);
            (0..image.component_count()).map(move |c| image.sample(c, x, y)).collect::<Vec<u16>>()
        };
        let samples = points.iter().flat_map(sample).collect();
        let faces: Vec<Face> = triangulate(&points);
        Mesh::new(image.shape(), points, samples, faces, &()).unwrap()
    }

    proptest! {
        #[test]
        fn colors_have_the_least_weighted_error(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(any::<u16>(), 162),
            weights in prop::option::of(prop::collection::vec(0u8..3, 64)),
            inner in prop::collection::vec((0usize..9, 0usize..9), 0..9),
        ) {
            let count = width * height;
            let components = vec![samples[..count].to_vec(), samples[81..81 + count].to_vec()];
            let image = Image::from_bottom_up(width, height, 16, components).unwrap();
            let weights = weights.as_ref().map(|weights| &weights[..count]);
            let mesh = mesh_of(&image, &inner);
            let (mesh, fidelity) = mesh.with_weighted_colors(&image, weights, &()).unwrap();
            let picture = rasterize(&mesh, &()).unwrap();
            prop_assert_eq!(Fidelity::between(&image, &picture, &()).unwrap(), fidelity);
            let colors = mesh.face_samples().unwrap();
            let sums = RowSums::new(&image, weights, Stage::Refine, &()).unwrap();
            for (f, &face) in mesh.faces().iter().enumerate() {
                let (corners, mut error) = (mesh.corners(face), 0);
                for c in 0..2 {
                    let mut owned: Vec<(u64, u16)> = Vec::new();
                    for_each_row(corners, |y, first, end| {
                        for x in first as usize..end as usize {
                            let pixel = y as usize * width + x;
                            let weight = weights.map_or(1, |weights| weights[pixel].into());
                            owned.push((weight, image.sample(c, x, y as usize)));
                        }
                    });
                    let color = colors[2 * f + c];
                    let error_of = |color: u16| {
                        let squared = |&(weight, s): &(u64, u16)| {
                            weight * u64::from(s.abs_diff(color)).pow(2)
                        };
                        owned.iter().map(squared).sum::<u64>()
                    };
                    if owned.iter().all(|&(weight, _)| weight == 0) {
                        prop_assert_eq!(color, mesh.vertex_samples(face[0] as usize)[c]);
                        continue;
                    }
                    for other in [color.saturating_sub(1), color.saturating_add(1)] {
                        prop_assert!(error_of(color) <= error_of(other));
                    }
                    error += error_of(color);
                }
                // With weights the sums of 16 bits come in units of those of 8 bits.
                let unit = if weights.is_some() { 1 << 16 } else { 1 };
                prop_assert_eq!((&sums).error(corners, &mut poller()), Ok(error / unit));
            }
        }
    }
}
