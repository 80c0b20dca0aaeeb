//! A quadratic model of the squared error around one vertex as a function of its displacement.
//!
//! A vertex moves by `d`, and the image's sample at its new position differs by `u` from the one
//! at its old position. In each face at the vertex the interpolant has the gradient `g`. At a
//! pixel of barycentric weight `w` (1 at the vertex, 0 on the opposite edge) the interpolant
//! changes by `w e` with `e = u - g d`. With the residual `r`, interpolant minus image, the
//! squared error changes by the sum over the pixels of `2 r w e + w^2 e^2`, as long as the pixels
//! keep their faces. The sums of `r w` and of `w^2` (about a sixth of the face's area) do not
//! depend on `d`: one scan of the star's pixels predicts the change for every displacement.
//!
//! Residuals are taken before rounding, where the numerators of the interpolant are a quarter of
//! a step too high (see [`Plane`]).
//!
//! The model is a second-order Taylor polynomial: it is most accurate for short moves. It ranks
//! candidate positions; the exact error decides on them. Rounded products of 16-bit samples are
//! good enough. As in [`squared`](crate::face_error::squared), all machines predict the same.

use crate::face_error::scan_conversion::{
    LANES, MAX_COMPONENTS, Pixels, Plane, ROWS, Sample, SmallFace,
};
use crate::image::Point;
use crate::triangulation::predicates::orientation;
use fearless_simd::{Simd, dispatch, f32x8, mask32x8, prelude::*};

pub(crate) trait ModelPixels {
    /// The model of the error around a vertex with this link, counter-clockwise, and a face after
    /// each of the first `face_count` neighbours. `None` when one of these faces is not small.
    fn model(&self, vertex: Point, link: &[Point], face_count: usize) -> Option<QuadraticModel>;

    /// The samples of one pixel; those of missing components mean nothing.
    fn samples_at(&self, p: Point) -> [f32; MAX_COMPONENTS];
}

impl<T: Sample> ModelPixels for Pixels<T> {
    fn model(&self, vertex: Point, link: &[Point], face_count: usize) -> Option<QuadraticModel> {
        match self.stride {
            1 => dispatch!(self.level, simd => self.fit::<_, 1>(simd, vertex, link, face_count)),
            2 => dispatch!(self.level, simd => self.fit::<_, 2>(simd, vertex, link, face_count)),
            _ => dispatch!(self.level, simd => self.fit::<_, 4>(simd, vertex, link, face_count)),
        }
    }

    fn samples_at(&self, p: Point) -> [f32; MAX_COMPONENTS] {
        let at = (p.y as usize * self.width + p.x as usize) * self.stride;
        let samples = &self.samples[at..at + MAX_COMPONENTS];
        std::array::from_fn(|c| samples[c].into())
    }
}

/// The model of one vertex: its coefficients, those of missing components 0.
#[derive(Clone, Copy, Debug)]
pub(crate) struct QuadraticModel {
    vertex: Point,
    before: [f32; MAX_COMPONENTS],
    /// Of the changes of the samples.
    samples: [f32; MAX_COMPONENTS],
    /// Of the squared changes of the samples.
    squares: [f32; MAX_COMPONENTS],
    /// Of the products of these changes with the displacement in columns and in rows.
    by_columns: [f32; MAX_COMPONENTS],
    by_rows: [f32; MAX_COMPONENTS],
    /// Of the displacement's columns, rows, squared columns, columns times rows, squared rows.
    displacement: [f32; 5],
}

impl QuadraticModel {
    /// The predicted change of the squared error by a move to a pixel of the samples `after`.
    #[inline]
    pub(crate) fn predicted_change(&self, to: Point, after: [f32; MAX_COMPONENTS]) -> f32 {
        let (x, y) = ((to.x - self.vertex.x) as f32, (to.y - self.vertex.y) as f32);
        let [columns, rows, xx, xy, yy] = self.displacement;
        let alone = columns * x + rows * y + xx * x * x + xy * x * y + yy * y * y;
        let with_samples = (0..MAX_COMPONENTS).map(|c| {
            let change = after[c] - self.before[c];
            let mixed = self.by_columns[c] * x + self.by_rows[c] * y;
            change * (self.samples[c] + self.squares[c] * change + mixed)
        });
        alone + with_samples.sum::<f32>()
    }
}

struct Sums<S: Simd> {
    /// First moments of the residuals; the same times the slope per column, and per row.
    moments: [f32x8<S>; 3],
    /// Sums of the squared weights; the same times both slopes, and times their three products.
    weights: [f32x8<S>; 6],
}

struct Weight<S: Simd> {
    at_a: f32x8<S>,
    per_column: f32,
    per_row: f32,
}

impl<T: Sample> Pixels<T> {
    #[inline(always)]
    fn fit<S: Simd, const STRIDE: usize>(
        &self,
        simd: S,
        vertex: Point,
        link: &[Point],
        face_count: usize,
    ) -> Option<QuadraticModel> {
        let zero = f32x8::splat(simd, 0.0);
        let mut sums = Sums { moments: [zero; 3], weights: [zero; 6] };
        let ends = link.iter().skip(1).chain(&link[..1]);
        for (&b, &c) in link.iter().zip(ends).take(face_count) {
            let corners = [vertex, b, c];
            let face = SmallFace::new(corners)?;
            let plane = self.plane::<S, STRIDE>(simd, corners);
            let weight = Weight::new(&plane, corners);
            let moment = self.moment::<S, STRIDE>(&plane, &weight, &face);
            sums.add(&plane, moment, orientation(vertex, b, c) as f32 / 12.0);
        }
        Some(sums.model::<STRIDE>(vertex, self.samples_at(vertex)))
    }

    #[inline(always)]
    fn moment<S: Simd, const STRIDE: usize>(
        &self,
        plane: &Plane<S>,
        weight: &Weight<S>,
        face: &SmallFace,
    ) -> f32x8<S> {
        let mut sum = f32x8::splat(plane.simd, 0.0);
        for first_row in (0..face.rows).step_by(ROWS) {
            let rows = face.rows(plane.simd, first_row);
            let count = ROWS.min((face.rows - first_row) as usize);
            for (i, (&first, &points)) in
                rows.firsts.iter().zip(&rows.counts).take(count).enumerate()
            {
                let first = Point::new(first, face.bottom + 1 + first_row + i as i32);
                sum += self.moment_of_row::<S, STRIDE>(plane, weight, first, points);
            }
        }
        sum
    }

    #[inline(always)]
    fn moment_of_row<S: Simd, const STRIDE: usize>(
        &self,
        plane: &Plane<S>,
        weight: &Weight<S>,
        first: Point,
        mut points: i32,
    ) -> f32x8<S> {
        let ahead = (first.x - plane.a.x) as f32;
        let mut numerators = plane.row(first.y) + plane.per_column * ahead;
        let up = weight.per_row * (first.y - plane.a.y) as f32;
        let mut weights = weight.at_a + (weight.per_column * ahead + up);
        let mut at = (first.y as usize * self.width + first.x as usize) * STRIDE;
        let zero = f32x8::splat(plane.simd, 0.0);
        let (mut sum, points_per_vector) = (zero, LANES / STRIDE);
        while points > 0 {
            let values = numerators * plane.quarter_reciprocal;
            let samples = T::first(plane.simd, &self.samples[at..]);
            let counts: mask32x8<S> = plane.offsets.simd_lt(points);
            sum += counts.select((values - samples) * weights, zero);
            points -= points_per_vector as i32;
            at += LANES;
            numerators += plane.per_column * points_per_vector as f32;
            weights += weight.per_column * points_per_vector as f32;
        }
        sum
    }
}

impl<S: Simd> Weight<S> {
    #[inline(always)]
    fn new(plane: &Plane<S>, corners: [Point; 3]) -> Self {
        let [a, b, c] = corners;
        let double_area = orientation(a, b, c) as f32;
        let per_column = (b.y - c.y) as f32 / double_area;
        let per_row = (c.x - b.x) as f32 / double_area;
        Self { at_a: plane.offsets.to_float::<f32x8<S>>() * per_column + 1.0, per_column, per_row }
    }
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    fn add(&mut self, plane: &Plane<S>, moment: f32x8<S>, weight: f32) {
        let one = f32x8::splat(plane.simd, 1.0);
        let column = plane.per_column * plane.quarter_reciprocal;
        let row = plane.per_row * plane.quarter_reciprocal;
        let slopes = [one, column, row, column * column, column * row * 2.0, row * row];
        for (sum, slope) in self.moments.iter_mut().zip(slopes) {
            *sum += moment * slope;
        }
        for (sum, slope) in self.weights.iter_mut().zip(slopes) {
            *sum += slope * weight;
        }
    }

    /// The model. Slopes are the same in all lanes of a component; moments add up over the lanes.
    #[inline(always)]
    fn model<const STRIDE: usize>(
        self,
        vertex: Point,
        before: [f32; MAX_COMPONENTS],
    ) -> QuadraticModel {
        let [samples, by_column, by_row] = self.moments.map(|lanes| sums::<STRIDE>(lanes.into()));
        let [squares, columns, rows, xx, xy, yy] =
            self.weights.map(|lanes| firsts::<STRIDE>(lanes.into()));
        QuadraticModel {
            vertex,
            before,
            samples: samples.map(|sum| 2.0 * sum),
            squares,
            by_columns: columns.map(|slope| -2.0 * slope),
            by_rows: rows.map(|slope| -2.0 * slope),
            displacement: [
                by_column.map(|sum| -2.0 * sum),
                by_row.map(|sum| -2.0 * sum),
                xx,
                xy,
                yy,
            ]
            .map(|of_components| of_components.iter().sum()),
        }
    }
}

#[inline(always)]
fn sums<const STRIDE: usize>(lanes: [f32; LANES]) -> [f32; MAX_COMPONENTS] {
    let mut sums = [0.0; MAX_COMPONENTS];
    for (lane, value) in lanes.into_iter().enumerate() {
        sums[lane % STRIDE] += value;
    }
    sums
}

#[inline(always)]
fn firsts<const STRIDE: usize>(lanes: [f32; LANES]) -> [f32; MAX_COMPONENTS] {
    let mut firsts = [0.0; MAX_COMPONENTS];
    firsts[..STRIDE].copy_from_slice(&lanes[..STRIDE]);
    firsts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::poller;
    use crate::face_error::scan_conversion::for_each_row;
    use crate::image::Image;
    use proptest::prelude::*;

    /// The change of the module's first paragraph, pixel by pixel.
    fn change_by_definition(image: &Image, vertex: Point, link: &[Point], to: Point) -> f64 {
        let mut change = 0.0;
        for i in 0..link.len() {
            let corners = [vertex, link[i], link[(i + 1) % link.len()]];
            let double_area = orientation(corners[0], corners[1], corners[2]) as f64;
            let weights = |p: Point| {
                let opposite = |a: usize, b: usize| orientation(corners[a], corners[b], p) as f64;
                [opposite(1, 2), opposite(2, 0), opposite(0, 1)].map(|area| area / double_area)
            };
            for c in 0..image.component_count() {
                let sample = |p: Point| f64::from(image.sample(c, p.x as usize, p.y as usize));
                let value = |p: Point| {
                    weights(p).iter().zip(corners).map(|(w, p)| w * sample(p)).sum::<f64>()
                };
                let e = sample(to) - value(to);
                change += double_area / 12.0 * e * e;
                for_each_row(corners, |y, first, end| {
                    for x in first..end {
                        let p = Point::new(x, y);
                        let difference = value(p) + 0.25 / double_area - sample(p);
                        change += 2.0 * difference * weights(p)[0] * e;
                    }
                });
            }
        }
        change
    }

    proptest! {
        #[test]
        fn predicts_the_change_of_its_definition(
            reach in prop::array::uniform8(1i32..14),
            (dx, dy) in (-2i32..=2, -2i32..=2),
            (component_count, bits) in (1usize..=4, prop::sample::select(&[8u8, 16][..])),
            seed in 0usize..1000,
        ) {
            // A star in the middle, away from column 0 and row 0.
            let plane = |c: usize| {
                let sample = |i: usize| ((i + seed) * 40_503 + c * 9_973) >> 5 & 0xffff;
                (0..32 * 32).map(|i| (sample(i) >> (16 - bits)) as u16).collect()
            };
            let components = (0..component_count).map(plane).collect();
            let image = Image::from_bottom_up(32, 32, bits, components).unwrap();
            let directions = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];
            let vertex = Point::new(16, 16);
            let link: Vec<Point> = directions
                .iter()
                .zip(reach)
                .map(|((x, y), distance)| Point::new(16 + x * distance, 16 + y * distance))
                .collect();
            let to = Point::new(16 + dx, 16 + dy);
            let wide = Pixels::<u16>::new(&image, &mut poller()).unwrap().unwrap();
            let predicted = |pixels: &dyn ModelPixels| {
                let model = pixels.model(vertex, &link, link.len()).unwrap();
                model.predicted_change(to, pixels.samples_at(to))
            };
            let found = predicted(&wide);
            let expected = change_by_definition(&image, vertex, &link, to);
            let tolerance = 1e-4 * f64::from(1u32 << bits).powi(2) * 32.0;
            prop_assert!((f64::from(found) - expected).abs() < tolerance, "{found}, {expected}");
            if bits == 8 {
                let narrow = Pixels::<u8>::new(&image, &mut poller()).unwrap().unwrap();
                prop_assert_eq!(predicted(&narrow), found);
            }
        }
    }

    #[test]
    fn large_faces_have_no_model() {
        let image = Image::from_bottom_up(80, 80, 8, vec![vec![7; 6400]]).unwrap();
        let pixels = Pixels::<u8>::new(&image, &mut poller()).unwrap().unwrap();
        let link = [(79, 2), (2, 79), (1, 1)].map(|(x, y)| Point::new(x, y));
        assert!(pixels.model(Point::new(20, 20), &link, 3).is_none());
    }
}
