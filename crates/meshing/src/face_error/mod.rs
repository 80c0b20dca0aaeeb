//! The error of faces: how far their rounded interpolants are from the image.
//!
//! An [`ErrorEvaluator`] holds what all threads share, a [`FaceErrors`] the memory of one thread.
//! The specification of an error is the [`scan_conversion`] of a face by one of the [`metrics`].
//! The squared error, which every method of the thesis uses, has two faster forms: a walk in
//! floating point here, and vectors for small faces. Tests tie both to sums pixel by pixel. Within a
//! [`bound`] on the error of every sample a face that breaks it counts as more than all others.

pub(crate) mod bound;
pub(crate) mod metrics;
pub(crate) mod quadratic_model;
pub(crate) mod scan_conversion;

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::face_error::bound::{BROKEN, Bound};
use crate::face_error::metrics::Run;
use crate::face_error::quadratic_model::ModelPixels;
use crate::face_error::scan_conversion::{Interpolant, Pixels, try_for_each_row};
use crate::image::{Image, Point};
use crate::parallel::in_parallel;
use crate::parameters::choices::ErrorMetric;
use fearless_simd::{Level, Simd, dispatch};

/// Faces measured between two polls, at most; large faces poll too.
const FACES_PER_PART: usize = 8192;

pub(crate) struct ErrorEvaluator<'a> {
    image: &'a Image,
    kind: Kind<'a>,
    level: Level,
    bound: Option<Bound<'a>>,
}

enum Kind<'a> {
    /// The squared error of at most four components of at most 8 bits.
    Squared(Pixels),
    /// The squared error of any other image.
    SquaredWide {
        model: Option<Pixels<u16>>,
    },
    ByPixel {
        metric: ErrorMetric,
        weights: Option<&'a [u8]>,
        model: Option<Pixels>,
    },
}

impl<'a> ErrorEvaluator<'a> {
    /// Evaluates errors by a metric, times the weight of each pixel where there are weights.
    pub(crate) fn new(
        image: &'a Image,
        metric: ErrorMetric,
        weights: Option<&'a [u8]>,
        poller: &mut Poller<'_>,
    ) -> Result<Self, Cancelled> {
        let kind = if weights.is_some() || !metric.is_squared_difference() {
            Kind::ByPixel { metric, weights, model: None }
        } else {
            Pixels::new(image, poller)?.map_or(Kind::SquaredWide { model: None }, Kind::Squared)
        };
        Ok(Self { image, kind, level: Level::new(), bound: None })
    }

    /// The same errors, but [`BROKEN`] for every face that breaks a bound.
    pub(crate) fn within(self, bound: Option<Bound<'a>>) -> Self {
        Self { bound, ..self }
    }

    /// The same with pixels for the quadratic model where the errors have no such pixels: for
    /// squared errors with weights, which the model ignores, and above 8 bits.
    pub(crate) fn with_model(mut self, poller: &mut Poller<'_>) -> Result<Self, Cancelled> {
        match &mut self.kind {
            Kind::SquaredWide { model } => *model = Pixels::new(self.image, poller)?,
            Kind::ByPixel { metric, weights: Some(_), model }
                if metric.is_squared_difference() || *metric == ErrorMetric::Ssim =>
            {
                *model = Pixels::new(self.image, poller)?;
            }
            Kind::Squared(_) | Kind::ByPixel { .. } => {}
        }
        Ok(self)
    }

    pub(crate) fn pixel_count(&self) -> usize {
        self.image.pixel_count()
    }

    /// Measures `count` faces on several threads, and gives their errors part by part in order to
    /// `use_part`. Polls report the number of faces measured before the part.
    pub(crate) fn for_each_part(
        &self,
        count: usize,
        corners: impl Fn(usize) -> [Point; 3],
        control: &dyn Control,
        mut use_part: impl FnMut(&[u64]),
    ) -> Result<(), Cancelled> {
        for first in (0..count).step_by(FACES_PER_PART) {
            control.poll(Stage::Measure, first, count)?;
            let faces: Vec<_> = (first..count).take(FACES_PER_PART).map(&corners).collect();
            let mut errors = vec![0; faces.len()];
            in_parallel(&faces, &mut errors, control, |faces, errors, control| {
                let poller = &mut Poller::new(control, Stage::Measure, first, count);
                let mut measured = Vec::with_capacity(faces.len());
                FaceErrors::new(self).errors_below(faces, u64::MAX, &mut measured, poller)?;
                errors.copy_from_slice(&measured);
                Ok(())
            })?;
            use_part(&errors);
        }
        Ok(())
    }
}

/// The error of a face, a whole number that depends on the positions of its vertices alone. A clone
/// measures the same errors on another thread. The pixels of a large face are steps of the poller.
/// A measure defines one of the two functions by which faces are measured.
pub(crate) trait FaceMeasure: Clone + Send + Sync {
    /// Sum of the errors of the lattice points of a counter-clockwise face.
    fn error(&mut self, corners: [Point; 3], poller: &mut Poller<'_>) -> Result<u64, Cancelled> {
        self.errors_below(&[corners], u64::MAX, &mut Vec::with_capacity(1), poller)
    }

    /// Measures faces in order until the sum of their errors reaches `limit`. Returns the sum,
    /// which is exact below the limit; the last error may be too low where the sum reaches it.
    fn errors_below(
        &mut self,
        faces: &[[Point; 3]],
        limit: u64,
        errors: &mut Vec<u64>,
        poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        let mut sum = 0;
        errors.clear();
        for &face in faces {
            let error = self.error(face, poller)?;
            errors.push(error);
            sum = error.saturating_add(sum);
            if sum >= limit {
                break;
            }
        }
        Ok(sum)
    }

    /// The pixels of the quadratic model, where it predicts changes of the error.
    fn model_pixels(&self) -> Option<&dyn ModelPixels> {
        None
    }

    /// The error without weights, whose changes the model predicts, of a face with some error.
    fn unweighted_error(
        &mut self,
        _corners: [Point; 3],
        error: u64,
        _poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        Ok(error)
    }
}

/// Computes errors of faces on one thread; keeps its memory from one face to the next.
#[derive(Clone)]
pub(crate) struct FaceErrors<'e> {
    evaluator: &'e ErrorEvaluator<'e>,
    interpolants: Vec<Interpolant>,
    approximations: Vec<Vec<u16>>,
}

impl<'e> FaceErrors<'e> {
    pub(crate) fn new(evaluator: &'e ErrorEvaluator<'e>) -> Self {
        let count = evaluator.image.component_count();
        Self {
            evaluator,
            interpolants: Vec::with_capacity(count),
            approximations: vec![Vec::new(); count],
        }
    }

    /// Whether the bound keeps the borders of holes.
    pub(crate) fn has_holes(&self) -> bool {
        self.evaluator.bound.is_some_and(|bound| bound.has_holes)
    }

    /// The error of a face with any values at its corners, one for each component.
    pub(crate) fn error_of_values(
        &mut self,
        corners: [Point; 3],
        values: [&[u16]; 3],
        poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        let values = |c: usize| values.map(|values| values[c]);
        if let Some(bound) = &self.evaluator.bound
            && !bound.is_kept(corners, values, poller)?
        {
            return Ok(BROKEN);
        }
        if self.evaluator.bound.is_some_and(|bound| bound.is_hole(corners)) {
            return Ok(0);
        }
        self.interpolate(corners, values);
        self.error_of_interpolants(corners, u64::MAX, poller)
    }

    /// The error of a face of any size; `limit` or more where it is not less.
    fn error_of_interpolants(
        &mut self,
        corners: [Point; 3],
        limit: u64,
        poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        let level = self.evaluator.level;
        match self.evaluator.kind {
            Kind::ByPixel { metric, weights, .. } => {
                self.error_by_pixel(metric, weights, corners, poller)
            }
            _ => dispatch!(level, simd => self.squared_error(simd, corners, limit, poller)),
        }
    }

    fn interpolate_image(&mut self, corners: [Point; 3]) {
        let image = self.evaluator.image;
        let pixels = corners.map(|p| p.y as usize * image.width() + p.x as usize);
        self.interpolate(corners, |c| pixels.map(|pixel| image.components()[c][pixel]));
    }

    fn interpolate(&mut self, corners: [Point; 3], values: impl Fn(usize) -> [u16; 3]) {
        let components = 0..self.evaluator.image.component_count();
        self.interpolants.clear();
        self.interpolants.extend(components.map(|c| Interpolant::new(corners, values(c))));
    }

    /// The squared error, row by row until it reaches `limit`.
    #[inline(always)]
    fn squared_error<S: Simd>(
        &self,
        _: S,
        corners: [Point; 3],
        limit: u64,
        poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        let (image, width) = (self.evaluator.image, self.evaluator.image.width());
        let mut sum = 0;
        try_for_each_row(
            corners,
            #[inline(always)]
            |y, first, end| {
                if sum >= limit {
                    return Ok(());
                }
                poller.step((end - first) as usize)?;
                let row = y as usize * width;
                let pixels = row + first as usize..row + end as usize;
                for (interpolant, samples) in self.interpolants.iter().zip(image.components()) {
                    sum += interpolant.squared_error(first, y, &samples[pixels.clone()]);
                }
                Ok(())
            },
        )?;
        Ok(sum)
    }

    /// The error by any metric. With weights and more than 8 bits the sum over the face is exact in
    /// 128 bits and shrinks once, at the end.
    fn error_by_pixel(
        &mut self,
        metric: ErrorMetric,
        weights: Option<&[u8]>,
        corners: [Point; 3],
        poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        let Self { evaluator: ErrorEvaluator { image, .. }, interpolants, approximations, .. } =
            self;
        let mut sum = 0u128;
        try_for_each_row(corners, |y, first, end| {
            poller.step((end - first) as usize)?;
            for (interpolant, row) in interpolants.iter().zip(approximations.iter_mut()) {
                row.resize((end - first) as usize, 0);
                interpolant.fill(first, y, row);
            }
            let row = y as usize * image.width();
            let pixels = row + first as usize..row + end as usize;
            let weights = weights.map(|weights| &weights[pixels.clone()]);
            sum += u128::from(metric.error(&Run { image, pixels, weights }, approximations));
            Ok(())
        })?;
        let shift = weights.map_or(0, |_| metric.weighted_shift(image.precision()));
        Ok((sum >> shift) as u64)
    }

    /// Appends the errors of faces, whatever the bound, until their sum reaches `limit`; returns it.
    fn append_errors(
        &mut self,
        faces: &[[Point; 3]],
        limit: u64,
        errors: &mut Vec<u64>,
        poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        let (evaluator, mut sum, before) = (self.evaluator, 0, errors.len());
        while sum < limit
            && let Some(&face) = faces.get(errors.len() - before)
        {
            if let Kind::Squared(pixels) = &evaluator.kind {
                let count = errors.len();
                sum += pixels.errors(&faces[count - before..], limit - sum, errors);
                if errors.len() > count {
                    continue;
                }
            }
            self.interpolate_image(face);
            let error = self.error_of_interpolants(face, limit - sum, poller)?;
            errors.push(error);
            sum += error;
        }
        Ok(sum)
    }
}

impl FaceMeasure for FaceErrors<'_> {
    fn errors_below(
        &mut self,
        faces: &[[Point; 3]],
        limit: u64,
        errors: &mut Vec<u64>,
        poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        errors.clear();
        let Some(bound) = self.evaluator.bound else {
            return self.append_errors(faces, limit, errors, poller);
        };
        let mut sum = 0;
        for &face in faces {
            let is_kept = bound.is_kept_by_samples(face, poller)?;
            sum += if is_kept && bound.is_hole(face) {
                errors.push(0);
                0
            } else if is_kept {
                self.append_errors(&[face], limit - sum, errors, poller)?
            } else {
                errors.push(BROKEN);
                BROKEN
            };
            sum = sum.min(BROKEN);
            if sum >= limit {
                break;
            }
        }
        Ok(sum)
    }

    fn model_pixels(&self) -> Option<&dyn ModelPixels> {
        match &self.evaluator.kind {
            Kind::Squared(pixels) => Some(pixels),
            Kind::SquaredWide { model } => model.as_ref().map(|pixels| pixels as _),
            Kind::ByPixel { model, .. } => model.as_ref().map(|pixels| pixels as _),
        }
    }

    fn unweighted_error(
        &mut self,
        corners: [Point; 3],
        error: u64,
        poller: &mut Poller<'_>,
    ) -> Result<u64, Cancelled> {
        if !matches!(self.evaluator.kind, Kind::ByPixel { model: Some(_), .. }) {
            return Ok(error);
        }
        self.interpolate_image(corners);
        let level = self.evaluator.level;
        dispatch!(level, simd => self.squared_error(simd, corners, u64::MAX, poller))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::control::POINTS_PER_POLL;
    use crate::control::tests::{Recorder, poller};
    use crate::face_error::scan_conversion::for_each_row;
    use crate::triangulation::predicates::orientation;
    use proptest::prelude::*;

    /// What measures faces of an image by the squared error.
    pub(crate) fn evaluator_of(image: &Image) -> ErrorEvaluator<'_> {
        ErrorEvaluator::new(image, ErrorMetric::MeanCompSe, None, &mut poller()).unwrap()
    }

    /// An image of scattered samples of all values.
    fn scattered(side: usize, component_count: usize, precision: u8) -> Image {
        let plane = |c: usize| {
            let sample = |i: usize| ((i * 40_503 + c * 9_973 + i / side * 31) >> 3) as u16;
            (0..side * side).map(|i| sample(i) >> (16 - precision)).collect()
        };
        let components = (0..component_count).map(plane).collect();
        Image::from_bottom_up(side, side, precision, components).unwrap()
    }

    /// The counter-clockwise face of three points; `None` where they are on a line.
    fn face([a, b, c]: [(i32, i32); 3]) -> Option<[Point; 3]> {
        let [a, b, c] = [a, b, c].map(|(x, y)| Point::new(x, y));
        match orientation(a, b, c) {
            0 => None,
            1.. => Some([a, b, c]),
            _ => Some([a, c, b]),
        }
    }

    /// The weighted squared error of a face, pixel by pixel.
    fn squared_error(image: &Image, corners: [Point; 3], weight: impl Fn(usize) -> u64) -> u128 {
        let mut sum = 0;
        for component in image.components() {
            let samples = corners.map(|p| component[p.y as usize * image.width() + p.x as usize]);
            let interpolant = Interpolant::new(corners, samples);
            for_each_row(corners, |y, first, end| {
                for x in first..end {
                    let (mut value, pixel) = ([0], y as usize * image.width() + x as usize);
                    interpolant.fill(x, y, &mut value);
                    let error = u128::from(component[pixel].abs_diff(value[0])).pow(2);
                    sum += error * u128::from(weight(pixel));
                }
            });
        }
        sum
    }

    #[test]
    fn large_faces_poll_for_each_65536_pixels() {
        let side = 1000;
        let corners = [Point::new(0, 0), Point::new(999, 0), Point::new(0, 999)];
        let weights = vec![1; side * side];
        for (precision, metric, weights) in [
            (8, ErrorMetric::MeanCompSe, None),
            (9, ErrorMetric::MeanCompSe, None),
            (8, ErrorMetric::YcbcrVecAe, None),
            (8, ErrorMetric::Ssim, Some(&weights[..])),
        ] {
            let image = scattered(side, 3, precision);
            let evaluator = ErrorEvaluator::new(&image, metric, weights, &mut poller()).unwrap();
            let error = |recorder: &Recorder| {
                let poller = &mut Poller::new(recorder, Stage::Measure, 0, 1);
                FaceErrors::new(&evaluator).error(corners, poller)
            };
            let recorder = Recorder::default();
            error(&recorder).unwrap();
            let polls = recorder.reports().len();
            assert!(polls >= side * side / 2 / POINTS_PER_POLL, "{metric}: {polls} polls");
            assert_eq!(error(&Recorder::cancelling_at(polls - 1)), Err(Cancelled));
        }
    }

    proptest! {
        #[test]
        fn small_faces_have_the_error_of_large_ones(
            corners in prop::array::uniform3((0i32..90, 0i32..90)),
            scale in 1i32..8,
            (component_count, precision) in (1usize..6, 1u8..10),
        ) {
            let image = scattered(90, component_count, precision);
            let evaluator = evaluator_of(&image);
            let mut errors = FaceErrors::new(&evaluator);
            if let Some(corners) = face(corners.map(|(x, y)| (x / scale, y / scale))) {
                let error = errors.error(corners, &mut poller()).unwrap();
                errors.interpolate_image(corners);
                let of_any = errors.error_of_interpolants(corners, u64::MAX, &mut poller());
                prop_assert_eq!(of_any, Ok(error));
                prop_assert_eq!(u128::from(error), squared_error(&image, corners, |_| 1));
            }
        }

        #[test]
        fn errors_are_exact_until_their_sum_reaches_the_limit(
            corners in prop::collection::vec(prop::array::uniform3((0i32..90, 0i32..90)), 1..8),
            (component_count, precision, is_flat) in (1usize..6, 7u8..10, any::<bool>()),
            percent in 0u64..150,
        ) {
            let mut image = scattered(90, component_count, precision);
            if is_flat {
                let samples = (0..90 * 90).map(|i| if i % 90 < 70 { 5 } else { i as u16 % 64 });
                image = image.with_components(vec![samples.collect(); component_count]);
            }
            let evaluator = evaluator_of(&image);
            let mut of_faces = FaceErrors::new(&evaluator);
            let faces: Vec<[Point; 3]> = corners.into_iter().filter_map(face).collect();
            let exact = faces.iter().map(|&face| of_faces.error(face, &mut poller()));
            let exact: Vec<u64> = exact.collect::<Result<_, _>>().unwrap();
            let total = exact.iter().sum::<u64>();
            let mut errors = vec![7];
            of_faces.errors_below(&faces, u64::MAX, &mut errors, &mut poller()).unwrap();
            prop_assert_eq!(&errors, &exact);
            let limit = total * percent / 100;
            let sum = of_faces.errors_below(&faces, limit, &mut errors, &mut poller()).unwrap();
            let count = errors.len();
            prop_assert_eq!(sum, errors.iter().sum::<u64>());
            prop_assert_eq!(sum < limit, total < limit);
            if sum < limit {
                prop_assert_eq!(&errors, &exact);
            } else if count > 0 {
                prop_assert_eq!(&errors[..count - 1], &exact[..count - 1]);
                prop_assert!(exact[..count - 1].iter().sum::<u64>() < limit);
                prop_assert!(errors[count - 1] <= exact[count - 1]);
            }
        }
    }

    #[test]
    fn largest_errors_of_small_faces_are_exact() {
        // Corners of each pattern of black and white, and the opposite everywhere else.
        let side = 65;
        for (pattern, (x, y)) in
            (0..8).flat_map(|pattern| [(1, 1), (0, 1), (1, 0), (0, 0)].map(|at| (pattern, at)))
        {
            let corners = face([(x, y), (x + 63, y), (x + 63, y + 63)]).unwrap();
            let white = |i: usize| {
                let corner = corners.iter().position(|p| p.y as usize * side + p.x as usize == i);
                corner.map_or(pattern % 2 == 0, |corner| pattern >> corner & 1 == 1)
            };
            let plane = |is_white: &dyn Fn(usize) -> bool| {
                (0..side * side).map(|i| if is_white(i) { 255 } else { 0 }).collect::<Vec<u16>>()
            };
            let components = vec![plane(&white), plane(&|i| !white(i)), plane(&|i| i % 3 == 0)];
            let image = Image::from_bottom_up(side, side, 8, components).unwrap();
            let (pixels, mut errors) =
                (Pixels::new(&image, &mut poller()).unwrap().unwrap(), Vec::new());
            pixels.errors(&[corners], u64::MAX, &mut errors);
            let expected = squared_error(&image, corners, |_| 1);
            assert_eq!(
                errors.iter().map(|&error| u128::from(error)).collect::<Vec<_>>(),
                [expected]
            );
        }
    }

    #[test]
    fn weights_multiply_the_errors_of_pixels() {
        let corners = face([(0, 0), (6, 1), (2, 5)]).unwrap();
        let weights: Vec<u8> = (0..64).map(|i| (i * 29 % 256) as u8).collect();
        for precision in [5, 8, 9, 12, 16] {
            let image = scattered(8, 2, precision);
            let error = |metric, weights: Option<&[u8]>| {
                let evaluator =
                    ErrorEvaluator::new(&image, metric, weights, &mut poller()).unwrap();
                FaceErrors::new(&evaluator).error(corners, &mut poller()).unwrap()
            };
            let exact = squared_error(&image, corners, |pixel| weights[pixel].into());
            assert!(exact > 0);
            let unit = 1 << (2 * precision.saturating_sub(8));
            for metric in [ErrorMetric::MeanCompSe, ErrorMetric::Ssim] {
                assert_eq!(u128::from(error(metric, Some(&weights))), exact / unit);
            }
            for &metric in ErrorMetric::ALL {
                let equal = u128::from(error(metric, Some(&[5; 64])));
                let unit = 1 << metric.weighted_shift(precision);
                assert_eq!(equal, 5 * u128::from(error(metric, None)) / unit, "{metric}");
            }
        }
    }

    #[test]
    fn models_squared_errors_of_up_to_four_components() {
        let has_model = |component_count, precision, is_weighted: bool, metric| {
            let image = scattered(8, component_count, precision);
            let weights = is_weighted.then_some(&[3; 64][..]);
            let evaluator = ErrorEvaluator::new(&image, metric, weights, &mut poller())
                .unwrap()
                .with_model(&mut poller())
                .unwrap();
            FaceErrors::new(&evaluator).model_pixels().is_some()
        };
        let squared = ErrorMetric::MeanCompSe;
        assert!(has_model(1, 8, false, squared) && has_model(4, 8, true, squared));
        assert!(has_model(4, 16, false, squared));
        assert!(!has_model(1, 9, true, squared) && !has_model(5, 8, false, squared));
        assert!(!has_model(3, 8, true, ErrorMetric::LumaSe));
        assert!(!has_model(3, 9, false, ErrorMetric::MeanCompAe));
    }
}
