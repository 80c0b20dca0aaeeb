//! The squared error of small faces of pictures of up to 8 bits, all components at once.
//!
//! Eight samples lie side by side in the lanes of a vector: eight lattice points of one component,
//! four of two, two of three or four; [`Plane`] says why 32 bits are exact. Sums of squares are exact
//! below 2^24: they are taken out of the lanes before 257 points are in them.
//!
//! The vectors are those of the machine the program runs on, chosen as it runs; every lane does the
//! same operations in the same order on all of them (see `PERFORMANCE.md`).

use crate::face_error::face_rows::for_each_row;
use crate::face_error::small_face_plane::Plane;
use crate::face_error::small_face_rows::{Edges, LARGEST_EXTENT, ROWS, Rows};
use crate::face_error::small_face_samples::Sample;
use crate::image::{Image, Point};
use fearless_simd::{Level, Simd, dispatch, f32x8, i32x8, mask32x8, prelude::*};

/// Stands for the error of a face that is not small.
pub(crate) const TOO_LARGE: u64 = u64::MAX;

/// Samples side by side in a vector.
pub(crate) const LANES: usize = 8;

/// Samples read at each point.
pub(crate) const SAMPLES_READ: usize = 16;

/// Points whose squared differences a lane can sum up exactly: `256 * 255^2 < 2^24`.
const POINTS_PER_SUM: usize = 256;

/// A picture of up to four components, the samples of each point side by side, of 8 bits where errors
/// are measured on them.
pub(crate) struct Pixels<T = u8> {
    pub(crate) level: Level,
    pub(crate) width: usize,
    /// Samples of each point: 1, 2 or 4; the fourth of three components is 0.
    pub(crate) stride: usize,
    /// So many more than the points have that a vector can be read at each of them.
    pub(crate) samples: Vec<T>,
}

impl<T: Sample> Pixels<T> {
    /// The points of a picture; `None` when it has more components or bits.
    pub(crate) fn new(image: &Image) -> Option<Self> {
        if image.precision() > T::PRECISION || image.component_count() > 4 {
            return None;
        }
        let stride = image.component_count().next_power_of_two();
        let mut samples = vec![T::default(); image.pixel_count() * stride + SAMPLES_READ];
        for (c, component) in image.components().iter().enumerate() {
            let places = samples[c..].iter_mut().step_by(stride);
            places.zip(component).for_each(|(place, &sample)| *place = T::of(sample));
        }
        Some(Self { level: Level::new(), width: image.width(), stride, samples })
    }

    /// The samples of one point, again and again.
    #[inline(always)]
    pub(crate) fn repeat<S: Simd, const STRIDE: usize>(&self, simd: S, point: Point) -> f32x8<S> {
        let at = (point.y as usize * self.width + point.x as usize) * STRIDE;
        T::repeated::<S, STRIDE>(simd, &self.samples[at..])
    }
}

impl Pixels {
    /// The errors of counter-clockwise faces, [`TOO_LARGE`] for those that are: sums over the
    /// lattice points and components of the squared differences between the rounded interpolant and
    /// the picture.
    pub(crate) fn squared_errors(&self, faces: &[[Point; 3]], errors: &mut Vec<u64>) {
        errors.clear();
        match self.stride {
            1 => dispatch!(self.level, simd => self.squared_errors_by::<_, 1>(simd, faces, errors)),
            2 => dispatch!(self.level, simd => self.squared_errors_by::<_, 2>(simd, faces, errors)),
            _ => dispatch!(self.level, simd => self.squared_errors_by::<_, 4>(simd, faces, errors)),
        }
    }

    #[inline(always)]
    fn squared_errors_by<S: Simd, const STRIDE: usize>(
        &self,
        simd: S,
        faces: &[[Point; 3]],
        errors: &mut Vec<u64>,
    ) {
        for &face in faces {
            errors.push(self.squared_error::<S, STRIDE>(simd, face));
        }
    }

    /// Adds the same to `errors` until their sum reaches `limit` or one face is not small.
    pub(crate) fn squared_errors_below(
        &self,
        faces: &[[Point; 3]],
        limit: u64,
        errors: &mut Vec<u64>,
    ) {
        match self.stride {
            1 => dispatch!(self.level, simd => self.below_by::<_, 1>(simd, faces, limit, errors)),
            2 => dispatch!(self.level, simd => self.below_by::<_, 2>(simd, faces, limit, errors)),
            _ => dispatch!(self.level, simd => self.below_by::<_, 4>(simd, faces, limit, errors)),
        }
    }

    #[inline(always)]
    fn below_by<S: Simd, const STRIDE: usize>(
        &self,
        simd: S,
        faces: &[[Point; 3]],
        limit: u64,
        errors: &mut Vec<u64>,
    ) {
        let mut sum = 0u64;
        for &face in faces {
            let error = self.squared_error::<S, STRIDE>(simd, face);
            errors.push(error);
            // One that is too large reaches any limit.
            sum = sum.saturating_add(error);
            if sum >= limit {
                return;
            }
        }
    }

    /// The error of a small face.
    #[inline(always)]
    fn squared_error<S: Simd, const STRIDE: usize>(&self, simd: S, corners: [Point; 3]) -> u64 {
        let Some(edges) = Edges::new(corners) else { return TOO_LARGE };
        let mut sum = Sum {
            plane: Plane::new(
                simd,
                corners,
                // In a closure for `map` it would not always be compiled for the machine's vectors.
                [
                    self.repeat::<S, STRIDE>(simd, corners[0]),
                    self.repeat::<S, STRIDE>(simd, corners[1]),
                    self.repeat::<S, STRIDE>(simd, corners[2]),
                ],
                i32x8::simd_from(simd, std::array::from_fn(|lane| (lane / STRIDE) as i32)),
            ),
            lanes: f32x8::splat(simd, 0.0),
            total: 0,
        };
        let vectors_per_row = edges.columns as usize * STRIDE / LANES + 1;
        let mut rows_summed = 0;
        if edges.left == 0 || edges.bottom == 0 {
            return sum.of_border_face::<STRIDE>(self, corners, vectors_per_row);
        }
        for first_row in (0..edges.rows).step_by(ROWS) {
            let rows = edges.rows(simd, first_row);
            let count = ROWS.min((edges.rows - first_row) as usize);
            // A row has 32 vectors at most, so there is room for eight rows at least.
            if (rows_summed + count) * vectors_per_row > POINTS_PER_SUM {
                sum.empty();
                rows_summed = 0;
            }
            rows_summed += count;
            sum.add_rows::<STRIDE>(self, edges.bottom + 1 + first_row, &rows, count);
        }
        sum.empty();
        sum.total
    }
}

/// A sum of squared differences over the rows of a face.
struct Sum<S: Simd> {
    plane: Plane<S>,
    lanes: f32x8<S>,
    /// What has been taken out of the lanes.
    total: u64,
}

impl<S: Simd> Sum<S> {
    /// The sum over a face whose rows are to be walked one by one.
    #[inline(always)]
    fn of_border_face<const STRIDE: usize>(
        mut self,
        pixels: &Pixels,
        corners: [Point; 3],
        vectors_per_row: usize,
    ) -> u64 {
        let mut rows = [(0, 0, 0); LARGEST_EXTENT as usize + 1];
        let mut count = 0;
        for_each_row(corners, |y, first, end| {
            rows[count] = (y, first, end);
            count += 1;
        });
        for (i, &(y, first, end)) in rows[..count].iter().enumerate() {
            if i % (POINTS_PER_SUM / vectors_per_row) == 0 {
                self.empty();
            }
            let ahead = (first - self.plane.a.x) as f32;
            let numerators = self.plane.row(y) + self.plane.per_column * ahead;
            let at = (y as usize * pixels.width + first as usize) * STRIDE;
            self.add_row::<STRIDE>(numerators, &pixels.samples[at..], end - first);
        }
        self.empty();
        self.total
    }

    /// Adds the squared differences in some rows from row `y` on.
    #[inline(always)]
    fn add_rows<const STRIDE: usize>(
        &mut self,
        pixels: &Pixels,
        y: i32,
        rows: &Rows,
        count: usize,
    ) {
        let mut numerators = self.plane.row(y);
        let mut start = y as usize * pixels.width;
        for (&first, &points) in rows.firsts.iter().zip(&rows.counts).take(count) {
            let ahead = (first - self.plane.a.x) as f32;
            let numerators_from_first = numerators + self.plane.per_column * ahead;
            self.add_row::<STRIDE>(
                numerators_from_first,
                &pixels.samples[(start + first as usize) * STRIDE..],
                points,
            );
            numerators += self.plane.per_row;
            start += pixels.width;
        }
    }

    /// Adds the squared differences of the first points of `bytes`.
    #[inline(always)]
    fn add_row<const STRIDE: usize>(
        &mut self,
        mut numerators: f32x8<S>,
        bytes: &[u8],
        mut points: i32,
    ) {
        let plane = &self.plane;
        let mut at = 0;
        loop {
            let values = plane.rounded(numerators);
            let samples = u8::first(plane.simd, &bytes[at..]);
            let counts: mask32x8<S> = plane.offsets.simd_lt(points);
            let differences = counts.select(values - samples, f32x8::splat(plane.simd, 0.0));
            self.lanes += differences * differences;
            points -= (LANES / STRIDE) as i32;
            if points <= 0 {
                return;
            }
            at += LANES;
            numerators += plane.per_column * (LANES / STRIDE) as f32;
        }
    }

    /// Takes the sum out of the lanes.
    #[inline(always)]
    fn empty(&mut self) {
        let lanes: [i32; LANES] = self.lanes.to_int::<i32x8<S>>().into();
        self.total += lanes.iter().sum::<i32>() as u64;
        self.lanes = f32x8::splat(self.plane.simd, 0.0);
    }
}
