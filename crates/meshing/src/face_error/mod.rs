//! The error of faces: how far their interpolants are from the picture.

pub(crate) mod face_rows;
pub(crate) mod flat_areas;
pub(crate) mod interpolant;
pub(crate) mod metrics;
pub(crate) mod quadratic_model;
pub(crate) mod small_face;
pub(crate) mod small_face_plane;
pub(crate) mod small_face_rows;
pub(crate) mod small_face_samples;
pub(crate) mod weighted;

use crate::face_error::face_rows::for_each_row;
use crate::face_error::flat_areas::FlatAreas;
use crate::face_error::interpolant::Interpolant;
use crate::face_error::metrics::Metric;
use crate::face_error::quadratic_model::ModelPixels;
use crate::face_error::small_face::{Pixels, TOO_LARGE};
use crate::face_error::weighted::weighted_error;
use crate::image::{Image, Point};
use crate::parameters::choices::ErrorMetric;
use crate::triangulation::predicates::orientation;
use fearless_simd::{Level, Simd, dispatch};

/// What faces are measured against: an image, its tables and a metric.
pub(crate) struct Measure<'a> {
    image: &'a Image,
    /// `None` for the squared error, which has paths of its own.
    metric: Option<&'static dyn Metric>,
    pixels: Option<Pixels>,
    flat: Option<FlatAreas>,
    level: Level,
    /// How much each point matters, where that differs.
    weights: Option<&'a [u8]>,
    /// The pixels of the quadratic model where errors are weighted.
    model_8_bits: Option<Pixels>,
    /// The same where samples have more than 8 bits.
    model_16_bits: Option<Pixels<u16>>,
}

impl<'a> Measure<'a> {
    /// Errors of approximations of `image` by a metric, for many more faces than cover it once.
    pub(crate) fn new(image: &'a Image, metric: ErrorMetric, weights: Option<&'a [u8]>) -> Self {
        if weights.is_some() {
            // Weighted errors have no tables.
            return Self { weights, pixels: None, ..Self::for_few(image, metric) };
        }
        Self { flat: FlatAreas::new(image), ..Self::for_few(image, metric) }
    }

    /// The same without weights and without the tables that only many faces are worth.
    pub(crate) fn for_few(image: &'a Image, metric: ErrorMetric) -> Self {
        let is_squared = metric.is_squared_difference();
        Self {
            image,
            metric: (!is_squared).then(|| metric.metric()),
            pixels: if is_squared { Pixels::new(image) } else { None },
            flat: None,
            level: Level::new(),
            weights: None,
            model_8_bits: None,
            model_16_bits: None,
        }
    }

    /// The same as [`new`](Self::new), with the pixels of the quadratic model, which knows no
    /// weights.
    pub(crate) fn with_model(
        image: &'a Image,
        metric: ErrorMetric,
        weights: Option<&'a [u8]>,
    ) -> Self {
        let measure = Self::new(image, metric, weights);
        if weights.is_some() {
            return Self { model_8_bits: Pixels::new(image), ..measure };
        }
        let is_wide = measure.metric.is_none() && measure.pixels.is_none();
        Self { model_16_bits: is_wide.then(|| Pixels::new(image)).flatten(), ..measure }
    }
}

/// Computes errors of faces over vertices at lattice points of an image; keeps its memory from one
/// face to the next.
pub(crate) struct FaceErrors<'m> {
    measure: &'m Measure<'m>,
    interpolants: Vec<Interpolant>,
    /// One row of approximations for each component.
    approximations: Vec<Vec<u16>>,
    /// The error of a face that is small.
    small: Vec<u64>,
}

impl<'m> FaceErrors<'m> {
    pub(crate) fn new(measure: &'m Measure<'m>) -> Self {
        let count = measure.image.component_count();
        Self {
            measure,
            interpolants: Vec::with_capacity(count),
            approximations: vec![Vec::new(); count],
            small: Vec::new(),
        }
    }

    /// Another one that measures against the same.
    pub(crate) fn another(&self) -> Self {
        Self::new(self.measure)
    }

    /// Sums over each face's lattice points of the error of the rounded interpolant.
    pub(crate) fn errors(&mut self, faces: &[[Point; 3]], errors: &mut Vec<u64>) {
        if self.measure.flat.is_some() {
            errors.clear();
            errors.extend(faces.iter().map(|&face| self.error(face)));
            return;
        }
        match &self.measure.pixels {
            Some(pixels) => pixels.squared_errors(faces, errors),
            None => {
                errors.clear();
                errors.resize(faces.len(), TOO_LARGE);
            }
        }
        for (error, &face) in errors.iter_mut().zip(faces) {
            if *error == TOO_LARGE {
                *error = self.error_of_any(face, u64::MAX);
            }
        }
    }

    /// The same for one face.
    pub(crate) fn error(&mut self, corners: [Point; 3]) -> u64 {
        self.error_below(corners, u64::MAX)
    }

    /// The same where it is less than `limit`; otherwise `limit` or more, which is known sooner.
    fn error_below(&mut self, corners: [Point; 3], limit: u64) -> u64 {
        if self.measure.flat.as_ref().is_some_and(|areas| areas.is_flat(corners)) {
            return 0;
        }
        if let Some(pixels) = &self.measure.pixels {
            pixels.squared_errors(&[corners], &mut self.small);
            if self.small[0] != TOO_LARGE {
                return self.small[0];
            }
        }
        self.error_of_any(corners, limit)
    }

    /// The errors of faces in order as long as their sum is less than `limit`, and the sum; where it
    /// reaches the limit, that or more.
    pub(crate) fn errors_below(
        &mut self,
        faces: &[[Point; 3]],
        limit: u64,
        errors: &mut Vec<u64>,
    ) -> u64 {
        let (mut sum, measure) = (0, self.measure);
        errors.clear();
        while errors.len() < faces.len() && sum < limit {
            let first = errors.len();
            match &measure.pixels {
                Some(pixels) if measure.flat.is_none() => {
                    pixels.squared_errors_below(&faces[first..], limit - sum, errors);
                }
                _ => errors.push(self.error_below(faces[first], limit - sum)),
            }
            if errors.last() == Some(&TOO_LARGE) {
                errors.pop();
                let below = limit - sum - errors[first..].iter().sum::<u64>();
                errors.push(self.error_of_any(faces[errors.len()], below));
            }
            sum += errors[first..].iter().sum::<u64>();
        }
        sum
    }

    /// The pixels of the quadratic model, where one predicts the squared error of small faces.
    pub(crate) fn model_pixels(&self) -> Option<ModelPixels<'_>> {
        let Measure { pixels, model_8_bits, model_16_bits, .. } = self.measure;
        let narrow = pixels.as_ref().or(model_8_bits.as_ref()).map(ModelPixels::Bits8);
        narrow.or(model_16_bits.as_ref().map(ModelPixels::Bits16))
    }

    /// Tells whether some points matter more than others.
    pub(crate) fn is_weighted(&self) -> bool {
        self.measure.weights.is_some()
    }

    /// The error of a face of any size, where it is less than `limit`.
    fn error_of_any(&mut self, corners: [Point; 3], limit: u64) -> u64 {
        if let Some(weights) = self.measure.weights {
            return weighted_error(self.measure.image, weights, corners);
        }
        self.prepare(corners);
        match self.measure.metric {
            None => self.squared_error(corners, limit),
            Some(metric) => self.error_by(metric, corners),
        }
    }

    /// Sets the interpolants of a face.
    fn prepare(&mut self, corners: [Point; 3]) {
        let double_area = orientation(corners[0], corners[1], corners[2]);
        let width = self.measure.image.width();
        let places = corners.map(|p| p.y as usize * width + p.x as usize);
        let quarter_reciprocal = 0.25 / double_area as f64;
        self.interpolants.clear();
        self.interpolants.extend(self.measure.image.components().iter().map(|samples| {
            let samples = places.map(|place| samples[place]);
            Interpolant::with_double_area(corners, samples, double_area, quarter_reciprocal)
        }));
    }

    /// Sum over points and components of the squared differences, row by row until it reaches `limit`.
    fn squared_error(&self, corners: [Point; 3], limit: u64) -> u64 {
        dispatch!(self.measure.level, simd => self.squared_error_by(simd, corners, limit))
    }

    #[inline(always)]
    fn squared_error_by<S: Simd>(&self, _: S, corners: [Point; 3], limit: u64) -> u64 {
        let (image, width) = (self.measure.image, self.measure.image.width());
        let mut sum = 0;
        for_each_row(
            corners,
            #[inline(always)]
            |y, first, end| {
                if sum >= limit {
                    return;
                }
                let points = y as usize * width + first as usize..y as usize * width + end as usize;
                for (interpolant, samples) in self.interpolants.iter().zip(image.components()) {
                    sum += interpolant.squared_error(first, y, &samples[points.clone()]);
                }
            },
        );
        sum
    }

    /// Sum over points of another metric.
    fn error_by(&mut self, metric: &dyn Metric, corners: [Point; 3]) -> u64 {
        let Self { measure: Measure { image, .. }, interpolants, approximations, .. } = self;
        let mut sum = 0;
        for_each_row(corners, |y, first, end| {
            let columns = first as usize..end as usize;
            for (interpolant, row) in interpolants.iter().zip(approximations.iter_mut()) {
                row.resize(columns.len(), 0);
                interpolant.fill(first, y, row);
            }
            let components = 0..image.component_count();
            let original: Vec<&[u16]> =
                components.map(|c| &image.row(c, y as usize)[columns.clone()]).collect();
            sum += metric.error(&original, approximations);
        });
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A picture of scattered samples of all values.
    fn picture(side: usize, component_count: usize, precision: u8) -> Image {
        let plane = |c: usize| {
            let sample = |i: usize| ((i * 40_503 + c * 9_973 + i / side * 31) >> 3) as u16;
            (0..side * side).map(|i| sample(i) >> (16 - precision)).collect()
        };
        let components = (0..component_count).map(plane).collect();
        Image::from_bottom_up(side, side, precision, components).unwrap()
    }

    proptest! {
        #[test]
        fn small_faces_are_measured_as_all_others_are(
            places in prop::array::uniform6(0i32..90),
            scale in 1i32..8,
            (component_count, precision) in (1usize..5, 1u8..9),
        ) {
            let image = picture(90, component_count, precision);
            let measure = Measure::new(&image, ErrorMetric::MeanCompSe, None);
            let mut errors = FaceErrors::new(&measure);
            let mut corners = [0, 2, 4].map(|i| Point::new(places[i] / scale, places[i + 1] / scale));
            if orientation(corners[0], corners[1], corners[2]) < 0 {
                corners.swap(1, 2);
            }
            if orientation(corners[0], corners[1], corners[2]) > 0 {
                prop_assert_eq!(errors.error(corners), errors.error_of_any(corners, u64::MAX));
            }
        }

        #[test]
        fn an_error_below_the_limit_is_exact_and_any_other_reaches_it(
            places in prop::array::uniform6(0i32..90),
            (component_count, precision) in (1usize..5, 7u8..10),
            part in 0u64..200,
        ) {
            let image = picture(90, component_count, precision);
            let measure = Measure::new(&image, ErrorMetric::MeanCompSe, None);
            let mut errors = FaceErrors::new(&measure);
            let mut corners = [0, 2, 4].map(|i| Point::new(places[i], places[i + 1]));
            if orientation(corners[0], corners[1], corners[2]) < 0 {
                corners.swap(1, 2);
            }
            if orientation(corners[0], corners[1], corners[2]) > 0 {
                let error = errors.error(corners);
                let limit = error * part / 100;
                let below = errors.error_below(corners, limit);
                let is_right = if error < limit { below == error } else { below >= limit };
                prop_assert!(is_right, "{} below {}, told {}", error, limit, below);
            }
        }
    }

    proptest! {
        #[test]
        fn errors_of_faces_are_told_in_order_until_their_sum_reaches_the_limit(
            places in prop::collection::vec((0i32..90, 0i32..90), 3..24),
            (component_count, precision, flat) in (1usize..6, 7u8..10, prop::bool::ANY),
            part in 0u64..150,
        ) {
            let image = if flat {
                let samples = (0..90 * 90).map(|i| if i % 90 < 70 { 5 } else { i as u16 % 64 });
                Image::from_bottom_up(90, 90, precision, vec![samples.collect(); component_count]).unwrap()
            } else {
                picture(90, component_count, precision)
            };
            let measure = Measure::new(&image, ErrorMetric::MeanCompSe, None);
            prop_assert_eq!(measure.flat.is_some(), flat);
            let mut of_faces = FaceErrors::new(&measure);
            let mut faces: Vec<[Point; 3]> = Vec::new();
            for places in places.chunks_exact(3) {
                let [a, b, c] = [0, 1, 2].map(|i| Point::new(places[i].0, places[i].1));
                match orientation(a, b, c) {
                    0 => {}
                    1.. => faces.push([a, b, c]),
                    _ => faces.push([a, c, b]),
                }
            }
            let alone: Vec<u64> = faces.iter().map(|&face| of_faces.error(face)).collect();
            let all = alone.iter().sum::<u64>();
            let mut errors = vec![7];
            prop_assert_eq!(of_faces.errors_below(&faces, u64::MAX, &mut errors), all);
            prop_assert_eq!(&errors, &alone);
            let limit = all * part / 100;
            let sum = of_faces.errors_below(&faces, limit, &mut errors);
            let told = errors.len();
            prop_assert_eq!(sum, errors.iter().sum::<u64>());
            prop_assert_eq!(sum < limit, told == faces.len() && all < limit);
            // All but the last of those told are below the limit, and exact.
            let exact = if sum < limit { told } else { told.saturating_sub(1) };
            prop_assert_eq!(&errors[..exact], &alone[..exact]);
            prop_assert!(alone[..exact].iter().sum::<u64>() < limit.max(1));
            if sum >= limit && told > 0 {
                prop_assert!(alone[..told].iter().sum::<u64>() >= limit);
            }
        }
    }

    #[test]
    fn models_squared_errors_of_four_components_and_weighted_8_bits() {
        let model_bits = |component_count, precision, is_weighted: bool, metric| {
            let image = picture(8, component_count, precision);
            let weights = is_weighted.then_some(&[3u8; 64][..]);
            let measure = Measure::with_model(&image, metric, weights);
            match FaceErrors::new(&measure).model_pixels() {
                None => 0,
                Some(ModelPixels::Bits8(_)) => 8,
                Some(ModelPixels::Bits16(_)) => 16,
            }
        };
        let squared = ErrorMetric::MeanCompSe;
        assert_eq!(model_bits(1, 8, false, squared), 8);
        assert_eq!(model_bits(4, 8, true, squared), 8);
        assert_eq!(model_bits(1, 9, false, squared), 16);
        assert_eq!(model_bits(4, 16, false, squared), 16);
        assert_eq!(model_bits(1, 9, true, squared), 0);
        assert_eq!(model_bits(5, 8, false, squared), 0);
        assert_eq!(model_bits(3, 9, false, ErrorMetric::MeanCompAe), 0);
        // Without a model nothing is kept for it.
        let image = picture(8, 1, 9);
        let measure = Measure::new(&image, squared, None);
        assert!(FaceErrors::new(&measure).model_pixels().is_none());
    }

    #[test]
    fn the_largest_errors_of_the_largest_small_faces_are_exact() {
        // Black and white corners, and the opposite everywhere else.
        let side = 65;
        let samples = |white: &dyn Fn(usize) -> bool| {
            (0..side * side).map(|i| if white(i) { 255 } else { 0 }).collect::<Vec<u16>>()
        };
        // Inside, and at the borders where rows are walked one by one.
        for (pattern, (x, y)) in
            (0..8).flat_map(|pattern| [(1, 1), (0, 1), (1, 0), (0, 0)].map(|at| (pattern, at)))
        {
            let corners = [(x, y), (x + 63, y), (x + 63, y + 63)].map(|(x, y)| y * side + x);
            let places = corners.map(|i| Point::new((i % side) as i32, (i / side) as i32));
            let at_corner = |i: usize| corners.iter().position(|&corner| corner == i);
            let white = |i: usize| {
                at_corner(i).map_or(pattern % 2 == 0, |corner| pattern >> corner & 1 == 1)
            };
            let components =
                vec![samples(&white), samples(&|i| !white(i)), samples(&|i| i % 3 == 0)];
            let image = Image::from_bottom_up(side, side, 8, components).unwrap();
            let measure = Measure::new(&image, ErrorMetric::MeanCompSe, None);
            let mut small = Vec::new();
            measure.pixels.as_ref().unwrap().squared_errors(&[places], &mut small);
            assert_eq!(small, [FaceErrors::new(&measure).error_of_any(places, u64::MAX)]);
        }
    }
}
