//! What a small move of a vertex will do to the squared error of the small faces around it, foreseen
//! from one look at their points.
//!
//! Let a vertex go from its place by `d`, and let `u` be by how much the picture's sample differs
//! there. Of each face at it the interpolant, which has the slope `g`, changes at a point of
//! barycentric weight `w` (1 at the vertex, 0 on the side opposite) by `w e` with `e = u - g d`. With
//! the differences `r` between interpolant and picture the squared error changes by the sum of
//! `2 r w e + w^2 e^2`, as long as the points keep their faces. Sums of `r w` and of `w^2`, of which
//! there is about a sixth of the area, serve all `d` at once, and the faces of a vertex together.
//!
//! Differences are taken before rounding, where numerators are a quarter of a step too high
//! ([`Plane`]).
//!
//! These are the first and second derivatives, so the nearer the place, the truer the forecast; it
//! says where to look, and what is true is measured there. So samples of 16 bits will do too, whose
//! products are rounded. It is the same on every machine: the lanes are eight everywhere, and each does
//! the same operations in the same order.

pub(crate) mod around;

use crate::face_error::small_face::{LANES, Pixels};
use crate::face_error::small_face_plane::Plane;
use crate::face_error::small_face_rows::{Edges, ROWS};
use crate::face_error::small_face_samples::Sample;
use crate::image::Point;
use around::Foreseen;
use fearless_simd::{Simd, dispatch, f32x8, i32x8, mask32x8, prelude::*};

/// The points of a picture by which moves are foreseen.
#[derive(Clone, Copy)]
pub(crate) enum Outlook<'a> {
    /// Of up to 8 bits.
    Bytes(&'a Pixels),
    /// Of more.
    Words(&'a Pixels<u16>),
}

impl Outlook<'_> {
    /// Foresees moves of a vertex at `place` whose neighbours are `ring`, counter-clockwise, with
    /// `face_count` faces between each and the next, to the places around; `None` when one of the faces
    /// is not small.
    pub(crate) fn foresee(
        self,
        place: Point,
        ring: &[Point],
        face_count: usize,
    ) -> Option<Foreseen> {
        match self {
            Self::Bytes(pixels) => pixels.foresee(place, ring, face_count),
            Self::Words(pixels) => pixels.foresee(place, ring, face_count),
        }
    }
}

/// Components that a picture of small faces has at most.
const COMPONENTS: usize = 4;

/// The coefficients of the change of the squared error, those of missing components 0.
#[derive(Clone, Copy, Debug, Default)]
struct MoveForecast {
    /// Of the differences of the samples.
    samples: [f32; COMPONENTS],
    /// Of the columns and the rows gone.
    columns: f32,
    rows: f32,
    /// Of the squared differences of the samples.
    squares: [f32; COMPONENTS],
    /// Of the products of those with columns and with rows.
    by_columns: [f32; COMPONENTS],
    by_rows: [f32; COMPONENTS],
    /// Of the squares and the product of columns and rows.
    of_way: [f32; 3],
}

/// The same as sums in lanes, while faces are added.
struct Sums<S: Simd> {
    /// Differences by weights, and these by the slopes of their faces.
    leaning: f32x8<S>,
    leaning_by_column: f32x8<S>,
    leaning_by_row: f32x8<S>,
    /// Squared weights, and these by the slopes and their products.
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
    fn foresee(&self, place: Point, ring: &[Point], face_count: usize) -> Option<Foreseen> {
        let forecast = self.forecast(place, ring, face_count)?;
        Some(self.foreseen_around(&forecast, place))
    }

    /// Foresees moves of a vertex at `place` whose neighbours are `ring`, counter-clockwise, with
    /// `face_count` faces between each and the next; `None` when one of them is not small.
    fn forecast(&self, place: Point, ring: &[Point], face_count: usize) -> Option<MoveForecast> {
        match self.stride {
            1 => {
                dispatch!(self.level, simd => self.forecast_by::<_, 1>(simd, place, ring, face_count))
            }
            2 => {
                dispatch!(self.level, simd => self.forecast_by::<_, 2>(simd, place, ring, face_count))
            }
            _ => {
                dispatch!(self.level, simd => self.forecast_by::<_, 4>(simd, place, ring, face_count))
            }
        }
    }

    /// The change of the squared error foreseen for a move from one place to another.
    #[inline]
    fn foreseen(&self, forecast: &MoveForecast, from: Point, to: Point) -> f32 {
        let at = |p: Point| (p.y as usize * self.width + p.x as usize) * self.stride;
        let [before, after] = [from, to].map(|p| &self.samples[at(p)..at(p) + COMPONENTS]);
        let (x, y) = ((to.x - from.x) as f32, (to.y - from.y) as f32);
        let [xx, xy, yy] = forecast.of_way;
        let way = forecast.columns * x + forecast.rows * y + xx * x * x + xy * x * y + yy * y * y;
        let mut terms = [0.0; COMPONENTS];
        for (c, term) in terms.iter_mut().enumerate() {
            let difference = after[c].into() - before[c].into();
            let with_way = forecast.by_columns[c] * x + forecast.by_rows[c] * y;
            *term =
                difference * (forecast.samples[c] + forecast.squares[c] * difference + with_way);
        }
        way + terms.iter().sum::<f32>()
    }

    #[inline(always)]
    fn forecast_by<S: Simd, const STRIDE: usize>(
        &self,
        simd: S,
        place: Point,
        ring: &[Point],
        face_count: usize,
    ) -> Option<MoveForecast> {
        let offsets = i32x8::simd_from(simd, std::array::from_fn(|lane| (lane / STRIDE) as i32));
        let at_place = self.repeat::<S, STRIDE>(simd, place);
        let mut sums = Sums::new(simd);
        let ends = ring.iter().skip(1).chain(&ring[..1]);
        for (&b, &c) in ring.iter().zip(ends).take(face_count) {
            let (corners, edges) = ([place, b, c], Edges::new([place, b, c])?);
            let at_b = self.repeat::<S, STRIDE>(simd, b);
            let at_c = self.repeat::<S, STRIDE>(simd, c);
            let plane = Plane::new(simd, corners, [at_place, at_b, at_c], offsets);
            let ((bx, by), (cx, cy)) =
                ((b.x - place.x, b.y - place.y), (c.x - place.x, c.y - place.y));
            let double_area = (bx * cy - by * cx) as f32;
            let weight = Weight::new(&plane, (bx - cx, by - cy), double_area);
            let leaning = self.leaning::<S, STRIDE>(&plane, &weight, &edges);
            sums.add(&plane, leaning, double_area / 12.0);
        }
        Some(sums.forecast::<STRIDE>())
    }

    /// The sum over a face's points of the differences by the weights.
    #[inline(always)]
    fn leaning<S: Simd, const STRIDE: usize>(
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
                let ahead = (first - plane.a.x) as f32;
                let numerators = plane.row(y) + plane.per_column * ahead;
                let up = weight.per_row * (y - plane.a.y) as f32;
                let weights = weight.at_a + (weight.per_column * ahead + up);
                let at = (y as usize * self.width + first as usize) * STRIDE;
                sum += self.leaning_of_row::<S, STRIDE>(
                    plane,
                    (numerators, weights, weight.per_column),
                    at,
                    points,
                );
            }
        }
        sum
    }

    /// The same over a row of so many points from the sample `at` on.
    #[inline(always)]
    fn leaning_of_row<S: Simd, const STRIDE: usize>(
        &self,
        plane: &Plane<S>,
        (mut numerators, mut weights, weight_per_column): (f32x8<S>, f32x8<S>, f32),
        mut at: usize,
        mut points: i32,
    ) -> f32x8<S> {
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
            weights += weight_per_column * points_per_vector as f32;
        }
        sum
    }
}

impl<S: Simd> Weight<S> {
    /// The weight of the first vertex of a face, given the way from its third to its second one.
    #[inline(always)]
    fn new(plane: &Plane<S>, (columns, rows): (i32, i32), double_area: f32) -> Self {
        let (per_column, per_row) = (rows as f32 / double_area, -columns as f32 / double_area);
        Self { at_a: plane.offsets.to_float::<f32x8<S>>() * per_column + 1.0, per_column, per_row }
    }
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        let zero = f32x8::splat(simd, 0.0);
        Self {
            leaning: zero,
            leaning_by_column: zero,
            leaning_by_row: zero,
            weight: 0.0,
            weight_by_column: zero,
            weight_by_row: zero,
            weight_by_products: [zero; 3],
        }
    }

    /// Adds a face.
    #[inline(always)]
    fn add(&mut self, plane: &Plane<S>, leaning: f32x8<S>, weight: f32) {
        let column = plane.per_column * plane.quarter_reciprocal;
        let row = plane.per_row * plane.quarter_reciprocal;
        self.leaning += leaning;
        self.leaning_by_column += leaning * column;
        self.leaning_by_row += leaning * row;
        self.weight += weight;
        self.weight_by_column += column * weight;
        self.weight_by_row += row * weight;
        let products = [column * column, column * row * 2.0, row * row];
        for (sum, product) in self.weight_by_products.iter_mut().zip(products) {
            *sum += product * weight;
        }
    }

    /// The coefficients; slopes are the same in all lanes of a component, sums are to be added up.
    #[inline(always)]
    fn forecast<const STRIDE: usize>(self) -> MoveForecast {
        let [xx, xy, yy] = self.weight_by_products;
        let of_way = [xx.into(), xy.into(), yy.into()];
        MoveForecast {
            samples: sums::<STRIDE>(self.leaning.into()).map(|sum| 2.0 * sum),
            columns: -2.0 * total(sums::<STRIDE>(self.leaning_by_column.into())),
            rows: -2.0 * total(sums::<STRIDE>(self.leaning_by_row.into())),
            squares: firsts::<STRIDE>([self.weight; LANES]),
            by_columns: firsts::<STRIDE>(self.weight_by_column.into()).map(|slope| -2.0 * slope),
            by_rows: firsts::<STRIDE>(self.weight_by_row.into()).map(|slope| -2.0 * slope),
            of_way: of_way.map(|lanes| total(firsts::<STRIDE>(lanes))),
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

    /// What the first lines of this file say, point by point.
    fn foreseen_point_by_point(image: &Image, place: Point, ring: &[Point], to: Point) -> f64 {
        let mut change = 0.0;
        for i in 0..ring.len() {
            let corners = [place, ring[i], ring[(i + 1) % ring.len()]];
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
        fn the_forecast_is_what_its_definition_gives_point_by_point(
            reach in prop::array::uniform8(1i32..14),
            (dx, dy) in (-2i32..=2, -2i32..=2),
            (component_count, bits) in (1usize..=4, prop::sample::select(&[8u8, 16][..])),
            seed in 0usize..1000,
        ) {
            // A star around the middle, away from column 0 and row 0.
            let plane = |c: usize| {
                let sample = |i: usize| ((i + seed) * 40_503 + c * 9_973) >> 5 & 0xffff;
                (0..32 * 32).map(|i| (sample(i) >> (16 - bits)) as u16).collect()
            };
            let image = Image::from_bottom_up(32, 32, bits, (0..component_count).map(plane).collect()).unwrap();
            let ways = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];
            let place = Point::new(16, 16);
            let ring: Vec<Point> = ways
                .iter()
                .zip(reach)
                .map(|((x, y), far)| Point::new(16 + x * far, 16 + y * far))
                .collect();
            let to = Point::new(16 + dx, 16 + dy);
            let words = Pixels::<u16>::new(&image).unwrap();
            let foreseen = Outlook::Words(&words).foresee(place, &ring, ring.len()).unwrap();
            let found = f64::from(foreseen.change((dx, dy)));
            let expected = foreseen_point_by_point(&image, place, &ring, to);
            let size = f64::from(1u32 << bits).powi(2) * 32.0;
            prop_assert!((found - expected).abs() < 1e-4 * size, "{found} for {expected}");
            let bytes = Pixels::<u8>::new(&image);
            prop_assert_eq!(bytes.is_some(), bits == 8);
            if let Some(bytes) = bytes {
                let again = Outlook::Bytes(&bytes).foresee(place, &ring, ring.len()).unwrap();
                prop_assert_eq!(f64::from(again.change((dx, dy))), found);
            }
        }
    }

    #[test]
    fn faces_that_are_not_small_have_no_forecast() {
        let image = Image::from_bottom_up(80, 80, 8, vec![vec![7; 6400]]).unwrap();
        let pixels = Pixels::<u8>::new(&image).unwrap();
        let ring = [(79, 2), (2, 79), (1, 1)].map(|(x, y)| Point::new(x, y));
        assert!(pixels.forecast(Point::new(20, 20), &ring, 3).is_none());
    }
}
