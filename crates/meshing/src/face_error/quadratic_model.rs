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
//! therefore good enough. Every machine predicts the same numbers: vectors have eight lanes
//! everywhere, and each lane does the same operations in the same order.

use crate::face_error::small_face::{LANES, Pixels};
use crate::face_error::small_face_plane::Plane;
use crate::face_error::small_face_rows::{Edges, ROWS};
use crate::face_error::small_face_samples::Sample;
use crate::image::Point;
use fearless_simd::{Simd, dispatch, f32x8, i32x8, mask32x8, prelude::*};

/// Components that the model reads at most.
const COMPONENTS: usize = 4;

/// The pixels that the model reads.
#[derive(Clone, Copy)]
pub(crate) enum ModelPixels<'a> {
    /// Samples of at most 8 bits.
    Bits8(&'a Pixels),
    /// Samples of more bits.
    Bits16(&'a Pixels<u16>),
}

impl ModelPixels<'_> {
    /// The model of the error around a vertex whose link is `link`, counter-clockwise, with one
    /// face between each of the first `face_count` neighbours and the next. `None` when one of
    /// these faces is not small.
    pub(crate) fn model(
        self,
        vertex: Point,
        link: &[Point],
        face_count: usize,
    ) -> Option<QuadraticModel> {
        match self {
            Self::Bits8(pixels) => pixels.model(vertex, link, face_count),
            Self::Bits16(pixels) => pixels.model(vertex, link, face_count),
        }
    }

    /// The predicted change of the squared error when the vertex moves between two pixels.
    pub(crate) fn predicted_change(self, model: &QuadraticModel, from: Point, to: Point) -> f32 {
        let [before, after] = match self {
            Self::Bits8(pixels) => [from, to].map(|p| pixels.samples_at(p)),
            Self::Bits16(pixels) => [from, to].map(|p| pixels.samples_at(p)),
        };
        model.change(before, after, (to.x - from.x) as f32, (to.y - from.y) as f32)
    }
}

/// The coefficients of the model; those of missing components are 0.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct QuadraticModel {
    /// Of the changes of the samples.
    samples: [f32; COMPONENTS],
    /// Of the displacement in columns and in rows.
    columns: f32,
    rows: f32,
    /// Of the squared changes of the samples.
    squares: [f32; COMPONENTS],
    /// Of the products of these changes with the displacement in columns and in rows.
    by_columns: [f32; COMPONENTS],
    by_rows: [f32; COMPONENTS],
    /// Of the displacement's squared columns, columns times rows, and squared rows.
    displacement: [f32; 3],
}

impl QuadraticModel {
    /// The change for a displacement of `x` columns and `y` rows.
    #[inline]
    fn change(&self, before: [f32; COMPONENTS], after: [f32; COMPONENTS], x: f32, y: f32) -> f32 {
        let [xx, xy, yy] = self.displacement;
        let alone = self.columns * x + self.rows * y + xx * x * x + xy * x * y + yy * y * y;
        let with_samples = (0..COMPONENTS).map(|c| {
            let change = after[c] - before[c];
            let mixed = self.by_columns[c] * x + self.by_rows[c] * y;
            change * (self.samples[c] + self.squares[c] * change + mixed)
        });
        alone + with_samples.sum::<f32>()
    }
}

/// The coefficients in lanes, while faces are added.
struct Sums<S: Simd> {
    /// First moments of the residuals, and these times the slopes of their faces.
    moment: f32x8<S>,
    moment_by_column: f32x8<S>,
    moment_by_row: f32x8<S>,
    /// Sums of the squared weights, and these times the slopes and their products.
    weight: f32,
    weight_by_column: f32x8<S>,
    weight_by_row: f32x8<S>,
    weight_by_products: [f32x8<S>; 3],
}

/// The barycentric weight of a face's first vertex, in lanes.
struct Weight<S: Simd> {
    at_a: f32x8<S>,
    per_column: f32,
    per_row: f32,
}

impl<T: Sample> Pixels<T> {
    fn model(&self, vertex: Point, link: &[Point], face_count: usize) -> Option<QuadraticModel> {
        match self.stride {
            1 => {
                dispatch!(self.level, simd => self.model_by::<_, 1>(simd, vertex, link, face_count))
            }
            2 => {
                dispatch!(self.level, simd => self.model_by::<_, 2>(simd, vertex, link, face_count))
            }
            _ => {
                dispatch!(self.level, simd => self.model_by::<_, 4>(simd, vertex, link, face_count))
            }
        }
    }

    #[inline(always)]
    fn model_by<S: Simd, const STRIDE: usize>(
        &self,
        simd: S,
        vertex: Point,
        link: &[Point],
        face_count: usize,
    ) -> Option<QuadraticModel> {
        let offsets = i32x8::simd_from(simd, std::array::from_fn(|lane| (lane / STRIDE) as i32));
        let at_vertex = self.repeat::<S, STRIDE>(simd, vertex);
        let mut sums = Sums::new(simd);
        let ends = link.iter().skip(1).chain(&link[..1]);
        for (&b, &c) in link.iter().zip(ends).take(face_count) {
            let (corners, edges) = ([vertex, b, c], Edges::new([vertex, b, c])?);
            let at_b = self.repeat::<S, STRIDE>(simd, b);
            let at_c = self.repeat::<S, STRIDE>(simd, c);
            let plane = Plane::new(simd, corners, [at_vertex, at_b, at_c], offsets);
            let weight = Weight::new(&plane, corners);
            let moment = self.moment::<S, STRIDE>(&plane, &weight, &edges);
            sums.add(&plane, moment, double_area(corners) / 12.0);
        }
        Some(sums.model::<STRIDE>())
    }

    /// The sum over a face's pixels of the residuals times the weights.
    #[inline(always)]
    fn moment<S: Simd, const STRIDE: usize>(
        &self,
        plane: &Plane<S>,
        weight: &Weight<S>,
        edges: &Edges,
    ) -> f32x8<S> {
        let mut sum = f32x8::splat(plane.simd, 0.0);
        for first_row in (0..edges.rows).step_by(ROWS) {
            let rows = edges.rows(plane.simd, first_row);
            let count = ROWS.min((edges.rows - first_row) as usize);
            let from = edges.bottom + 1 + first_row;
            for (y, (&first, &points)) in
                (from..).zip(rows.firsts.iter().zip(&rows.counts).take(count))
            {
                sum += self.moment_of_row::<S, STRIDE>(plane, weight, Point::new(first, y), points);
            }
        }
        sum
    }

    /// The same sum over `points` pixels of a row from `first` on.
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

    /// The samples of one pixel; those of missing components mean nothing.
    #[inline]
    fn samples_at(&self, p: Point) -> [f32; COMPONENTS] {
        let at = (p.y as usize * self.width + p.x as usize) * self.stride;
        let samples = &self.samples[at..at + COMPONENTS];
        std::array::from_fn(|c| samples[c].into())
    }
}

/// Twice the area of a small face.
#[inline(always)]
fn double_area([a, b, c]: [Point; 3]) -> f32 {
    ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)) as f32
}

impl<S: Simd> Weight<S> {
    #[inline(always)]
    fn new(plane: &Plane<S>, corners: [Point; 3]) -> Self {
        let [_, b, c] = corners;
        let per_column = (b.y - c.y) as f32 / double_area(corners);
        let per_row = -((b.x - c.x) as f32) / double_area(corners);
        Self { at_a: plane.offsets.to_float::<f32x8<S>>() * per_column + 1.0, per_column, per_row }
    }
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        let zero = f32x8::splat(simd, 0.0);
        Self {
            moment: zero,
            moment_by_column: zero,
            moment_by_row: zero,
            weight: 0.0,
            weight_by_column: zero,
            weight_by_row: zero,
            weight_by_products: [zero; 3],
        }
    }

    /// Adds a face.
    #[inline(always)]
    fn add(&mut self, plane: &Plane<S>, moment: f32x8<S>, weight: f32) {
        let column = plane.per_column * plane.quarter_reciprocal;
        let row = plane.per_row * plane.quarter_reciprocal;
        self.moment += moment;
        self.moment_by_column += moment * column;
        self.moment_by_row += moment * row;
        self.weight += weight;
        self.weight_by_column += column * weight;
        self.weight_by_row += row * weight;
        let products = [column * column, column * row * 2.0, row * row];
        for (sum, product) in self.weight_by_products.iter_mut().zip(products) {
            *sum += product * weight;
        }
    }

    /// The model. Slopes are the same in all lanes of a component; sums add up over the lanes.
    #[inline(always)]
    fn model<const STRIDE: usize>(self) -> QuadraticModel {
        let [xx, xy, yy] = self.weight_by_products;
        let displacement = [xx.into(), xy.into(), yy.into()];
        QuadraticModel {
            samples: sums::<STRIDE>(self.moment.into()).map(|sum| 2.0 * sum),
            columns: -2.0 * total(sums::<STRIDE>(self.moment_by_column.into())),
            rows: -2.0 * total(sums::<STRIDE>(self.moment_by_row.into())),
            squares: firsts::<STRIDE>([self.weight; LANES]),
            by_columns: firsts::<STRIDE>(self.weight_by_column.into()).map(|slope| -2.0 * slope),
            by_rows: firsts::<STRIDE>(self.weight_by_row.into()).map(|slope| -2.0 * slope),
            displacement: displacement.map(|lanes| total(firsts::<STRIDE>(lanes))),
        }
    }
}

/// The sum of the lanes of each component.
#[inline(always)]
fn sums<const STRIDE: usize>(lanes: [f32; LANES]) -> [f32; COMPONENTS] {
    let mut sums = [0.0; COMPONENTS];
    for (lane, value) in lanes.into_iter().enumerate() {
        sums[lane % STRIDE] += value;
    }
    sums
}

/// The first lane of each component.
#[inline(always)]
fn firsts<const STRIDE: usize>(lanes: [f32; LANES]) -> [f32; COMPONENTS] {
    let mut firsts = [0.0; COMPONENTS];
    firsts[..STRIDE].copy_from_slice(&lanes[..STRIDE]);
    firsts
}

/// The sum over the components.
#[inline(always)]
fn total(values: [f32; COMPONENTS]) -> f32 {
    values.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::face_error::face_rows::for_each_row;
    use crate::image::Image;
    use crate::triangulation::predicates::orientation;
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
            let image = Image::from_bottom_up(32, 32, bits, (0..component_count).map(plane).collect()).unwrap();
            let directions = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];
            let vertex = Point::new(16, 16);
            let link: Vec<Point> = directions
                .iter()
                .zip(reach)
                .map(|((x, y), distance)| Point::new(16 + x * distance, 16 + y * distance))
                .collect();
            let to = Point::new(16 + dx, 16 + dy);
            let wide = Pixels::<u16>::new(&image).unwrap();
            let predicted = |pixels: ModelPixels<'_>| {
                let model = pixels.model(vertex, &link, link.len()).unwrap();
                pixels.predicted_change(&model, vertex, to)
            };
            let found = predicted(ModelPixels::Bits16(&wide));
            let expected = change_by_definition(&image, vertex, &link, to);
            let tolerance = 1e-4 * f64::from(1u32 << bits).powi(2) * 32.0;
            prop_assert!((f64::from(found) - expected).abs() < tolerance, "{found}, {expected}");
            if bits == 8 {
                let narrow = Pixels::<u8>::new(&image).unwrap();
                prop_assert_eq!(predicted(ModelPixels::Bits8(&narrow)), found);
            }
        }
    }

    #[test]
    fn large_faces_have_no_model() {
        let image = Image::from_bottom_up(80, 80, 8, vec![vec![7; 6400]]).unwrap();
        let pixels = Pixels::<u8>::new(&image).unwrap();
        let link = [(79, 2), (2, 79), (1, 1)].map(|(x, y)| Point::new(x, y));
        assert!(pixels.model(Point::new(20, 20), &link, 3).is_none());
    }
}
