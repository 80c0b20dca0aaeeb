//! The scan conversion of a face: the pixels that it owns, its interpolant at each of them, and the
//! squared differences from an image.
//!
//! A pixel inside a face belongs to it. A pixel on a horizontal edge belongs to the face below, one
//! on another edge to the face at its left. A vertex at the right end of a horizontal edge belongs
//! to the face below that edge, any other vertex to the face at its left. Where no such face
//! exists, the face above or at the right owns the pixel. The same rule in other words: every
//! pixel moves a little to the left and much less downwards. A face owns the pixels of the rows
//! `(ymin, ymax]` in the columns `(left, right]`, and in column 0 and row 0 those on its border
//! too. So each pixel of the image belongs to exactly one face of a mesh.
//!
//! Let `den` be twice the face's area. At a pixel the interpolant is a fraction `num / den`, where
//! `num` is an integer, linear in `x` and `y`. The nearest integer, halves up, is
//! `floor((2 num + den) / (2 den))`. Floating point computes the fraction `(4 num + 1) / (4 den)`
//! instead and rounds it to nearest: a quarter of a step above `num / den`, it rounds halves up and
//! stays at least `1 / (4 den)` away from every tie, far more than the error of two roundings,
//! `2^16 * 2^-52`, as long as `den < 2^33`. Larger faces divide.
//!
//! Each step has two forms, and tests tie them.
//!
//! | step | specification, for all faces | for small faces, in the lanes of vectors |
//! |---|---|---|
//! | pixels | [`for_each_row`] | [`SmallFace`], eight rows at a time |
//! | interpolant | [`Interpolant`] | [`Plane`], over samples of up to 8 bits |
//! | squared error | [`Interpolant::squared_error`] | [`Pixels::errors`], all components at once |
//!
//! The program chooses the vector instructions of its machine as it runs; on all of them each lane
//! does the same operations in the same order.

use crate::control::{Cancelled, POINTS_PER_POLL, Poller};
use crate::image::{Image, Point};
use crate::triangulation::predicates::orientation;
use fearless_simd::{Level, Simd, dispatch, f32x8, i32x8, mask32x8, prelude::*, u8x16, u16x8};
use std::convert::Infallible;

/// Largest number of columns and of rows between two vertices of a small face; `2^k - 1`.
const MAX_EXTENT: i32 = 63;
pub(crate) const ROWS: usize = 8;
const FRACTION_BITS: u32 = 19;
/// `ceil(2^FRACTION_BITS / rows)` by number of rows.
const RECIPROCALS: [i32; MAX_EXTENT as usize + 1] = {
    let mut reciprocals = [0; MAX_EXTENT as usize + 1];
    let mut rows = 1;
    while rows <= MAX_EXTENT {
        reciprocals[rows as usize] = ((1 << FRACTION_BITS) + rows - 1) / rows;
        rows += 1;
    }
    reciprocals
};

/// Adding this to a number below 2^51 rounds it to an integer, which then is in the low bits of the
/// sum; 1.5 * 2^52.
const ROUND_TO_NEAREST: f64 = 6_755_399_441_055_744.0;
/// Adding this to a number below 2^22 rounds it to an integer, and subtracting it leaves that;
/// 1.5 * 2^23.
const ROUND_TO_NEAREST_F32: f32 = 12_582_912.0;
const FLOATING_POINT_LIMIT: i64 = 1 << 33;
pub(crate) const PLANE_PRECISION: u8 = 8;
pub(crate) const LANES: usize = 8;
pub(crate) const MAX_COMPONENTS: usize = 4;
/// Samples that a vector of 8-bit samples reads from a pixel on.
const SAMPLES_READ: usize = 2 * LANES;
/// Pixels whose squared differences a lane sums up exactly: `256 * 255^2 < 2^24`.
const PIXELS_PER_SUM: usize = 256;

// A row's vectors leave the lanes capacity for eight rows at least.
const _: () = assert!((MAX_EXTENT as usize * MAX_COMPONENTS / LANES + 1) * ROWS <= PIXELS_PER_SUM);

/// Calls `use_row(y, first, end)` for each row in which the counter-clockwise face `abc` owns the
/// pixels of the columns `first..end`, from the bottom up.
#[inline(always)]
pub(crate) fn for_each_row(corners: [Point; 3], mut use_row: impl FnMut(i32, i32, i32)) {
    let Ok(()) = try_for_each_row(
        corners,
        #[inline(always)]
        |y, first, end| {
            use_row(y, first, end);
            Ok::<_, Infallible>(())
        },
    );
}

/// [`for_each_row`] up to the first error of `use_row`.
#[inline(always)]
pub(crate) fn try_for_each_row<E>(
    corners: [Point; 3],
    mut use_row: impl FnMut(i32, i32, i32) -> Result<(), E>,
) -> Result<(), E> {
    let [bottom, middle, top] = by_row(corners);
    let middle_is_right = orientation(bottom, middle, top) > 0;
    if bottom.y == 0 && middle.y == 0 {
        let left = bottom.x.min(middle.x);
        use_row(0, left + i32::from(left > 0), bottom.x.max(middle.x) + 1)?;
    }
    let mut long = EdgeWalk::new(bottom, top);
    for (from, to) in [(bottom, middle), (middle, top)] {
        if from.y == to.y {
            continue;
        }
        let mut short = EdgeWalk::new(from, to);
        for y in from.y + 1..=to.y {
            long.step();
            short.step();
            let (left, right) = if middle_is_right { (&long, &short) } else { (&short, &long) };
            // Column 0 belongs to a face that begins there.
            let is_at_zero = left.x == 0 && left.rest == 0 && (right.x > 0 || right.rest > 0);
            let (first, end) = (left.x + i32::from(!is_at_zero), right.x + 1);
            if first < end {
                use_row(y, first, end)?;
            }
        }
    }
    Ok(())
}

/// An edge crossed row by row in integers. A step adds the quotient and the remainder of the slope,
/// so an edge takes one division.
struct EdgeWalk {
    /// The column at or left of the crossing.
    x: i32,
    /// Distance from `x` to the crossing, in units of `1 / rows`.
    rest: i32,
    columns_per_row: i32,
    rest_per_row: i32,
    /// Rows between the ends of the edge, at least 1.
    rows: i32,
}

impl EdgeWalk {
    /// Starts in the row of the lower end of an edge that is not horizontal.
    #[inline]
    fn new(from: Point, to: Point) -> Self {
        let (columns, rows) = (to.x - from.x, to.y - from.y);
        Self {
            x: from.x,
            rest: 0,
            columns_per_row: columns.div_euclid(rows),
            rest_per_row: columns.rem_euclid(rows),
            rows,
        }
    }

    #[inline]
    fn step(&mut self) {
        self.x += self.columns_per_row;
        self.rest += self.rest_per_row;
        if self.rest >= self.rows {
            self.rest -= self.rows;
            self.x += 1;
        }
    }
}

/// The vertices of a face by row, without branches: their outcomes would be random.
#[inline(always)]
fn by_row(corners: [Point; 3]) -> [Point; 3] {
    let [a, b, c] = corners.map(|p| u64::from(p.y as u32) << 32 | u64::from(p.x as u32));
    let (low, high) = (a.min(b), a.max(b));
    let (low, middle, high) = (low.min(c), low.max(c.min(high)), high.max(c));
    [low, middle, high].map(|p| Point::new(p as i32, (p >> 32) as i32))
}

/// A face of at most [`MAX_EXTENT`] columns and rows: the edges that bound its rows. Edges cross
/// rows at multiples of a slope, so no row waits for another.
#[derive(Clone, Copy)]
pub(crate) struct SmallFace {
    long: Slope,
    lower: Slope,
    upper: Slope,
    /// Rows from the lowest vertex to the middle one.
    middle: i32,
    /// The row of the lowest vertex; the face owns pixels from the next row on.
    pub(crate) bottom: i32,
    pub(crate) rows: i32,
    left: i32,
    pub(crate) columns: i32,
}

/// The columns where an edge crosses the rows above its lower end, in fixed point, with a table of
/// reciprocals instead of a division.
///
/// The quotient of `n = 64 rows + columns k` by `rows`, for the `k`-th row, is `n r >> 19` with
/// `r = ceil(2^19 / rows)`. The reciprocal `r` is too large by less than 1 and `n` is at most
/// `127 rows`, so the product is too large by less than `127 * 63 * 63 / rows < 2^19 / rows`: no
/// integer is reached too early. The 64 columns keep `n` from being negative.
#[derive(Clone, Copy)]
struct Slope {
    at_lower_end: i32,
    per_row: i32,
    origin: i32,
}

pub(crate) struct Rows {
    pub(crate) firsts: [i32; ROWS],
    /// Number of pixels from there on; none when it is not positive.
    pub(crate) counts: [i32; ROWS],
}

impl SmallFace {
    /// The small face of three vertices; `None` when its extent is larger.
    #[inline(always)]
    pub(crate) fn new(corners: [Point; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(|p| p.x);
        let left = a.min(b).min(c);
        let columns = a.max(b).max(c) - left;
        let [bottom, middle, top] = by_row(corners);
        let rows = top.y - bottom.y;
        (columns <= MAX_EXTENT && rows <= MAX_EXTENT).then(|| Self {
            long: Slope::new(bottom, top),
            lower: Slope::new(bottom, middle),
            upper: Slope::new(middle, top).counted_from_below(middle.y - bottom.y),
            middle: middle.y - bottom.y,
            bottom: bottom.y,
            rows,
            left,
            columns,
        })
    }

    /// Whether the face touches column 0 or row 0, where [`rows`](Self::rows) are not its own.
    #[inline(always)]
    pub(crate) fn touches_axes(&self) -> bool {
        self.left == 0 || self.bottom == 0
    }

    /// The pixels of eight rows, the first of them `row + 1` rows above the lowest vertex. Those of
    /// rows above the highest vertex mean nothing.
    #[inline(always)]
    pub(crate) fn rows<S: Simd>(&self, simd: S, row: i32) -> Rows {
        let steps = i32x8::simd_from(simd, [1, 2, 3, 4, 5, 6, 7, 8]) + row;
        let long = self.long.columns(steps);
        let in_lower: mask32x8<S> = steps.simd_le(self.middle);
        let short = in_lower.select(self.lower.columns(steps), self.upper.columns(steps));
        // In all rows the long edge is on the same side.
        let (left, right) = (long.min(short), long.max(short));
        Rows { firsts: (left + 1).into(), counts: (right - left).into() }
    }
}

impl Slope {
    /// The slope of an edge from its lower end; that of a horizontal edge means nothing.
    #[inline(always)]
    fn new(from: Point, to: Point) -> Self {
        let (columns, rows) = (to.x - from.x, to.y - from.y);
        let reciprocal = RECIPROCALS[(rows & MAX_EXTENT) as usize];
        let offset = MAX_EXTENT + 1;
        Self {
            at_lower_end: offset * rows * reciprocal,
            per_row: columns * reciprocal,
            origin: from.x - offset,
        }
    }

    /// The same edge for steps that count from a row `rows` below its lower end.
    #[inline(always)]
    fn counted_from_below(self, rows: i32) -> Self {
        // What overflows here comes back when the steps are added.
        let before = self.per_row.wrapping_mul(rows);
        Self { at_lower_end: self.at_lower_end.wrapping_sub(before), ..self }
    }

    #[inline(always)]
    fn columns<S: Simd>(self, steps: i32x8<S>) -> i32x8<S> {
        ((steps * self.per_row + self.at_lower_end) >> FRACTION_BITS) + self.origin
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Interpolant {
    double_area: i64,
    quarter_reciprocal: f64,
    at_origin: i64,
    /// Change of the numerator from one column to the next.
    per_column: i64,
    /// Change of the numerator from one row to the next.
    per_row: i64,
}

impl Interpolant {
    #[inline]
    pub(crate) fn new([a, b, c]: [Point; 3], samples: [u16; 3]) -> Self {
        let double_area = orientation(a, b, c);
        let [za, zb, zc] = samples.map(i64::from);
        let (bx, by) = (i64::from(b.x - a.x), i64::from(b.y - a.y));
        let (cx, cy) = (i64::from(c.x - a.x), i64::from(c.y - a.y));
        let per_column = (zb - za) * cy - (zc - za) * by;
        let per_row = (zc - za) * bx - (zb - za) * cx;
        let at_a = double_area * za;
        let at_origin = at_a - per_column * i64::from(a.x) - per_row * i64::from(a.y);
        let quarter_reciprocal = 0.25 / double_area as f64;
        Self { double_area, quarter_reciprocal, at_origin, per_column, per_row }
    }

    /// Twice the area of the face.
    pub(crate) fn double_area(&self) -> i64 {
        self.double_area
    }

    /// Its value, not rounded.
    #[inline(always)]
    pub(crate) fn at(&self, x: i32, y: i32) -> f64 {
        let numerator =
            self.at_origin + self.per_column * i64::from(x) + self.per_row * i64::from(y);
        numerator as f64 / self.double_area as f64
    }

    /// Its differences, not rounded, from the `samples` of row `y` from column `x` on, times twice
    /// the face's area.
    #[inline(always)]
    pub(crate) fn differences(&self, x: i32, y: i32, samples: &[u16]) -> impl Iterator<Item = i64> {
        let start = self.at_origin + self.per_column * i64::from(x) + self.per_row * i64::from(y);
        (0i64..).zip(samples).map(move |(i, &sample)| {
            start + self.per_column * i - self.double_area * i64::from(sample)
        })
    }

    /// Sum of its squared differences from the `samples` of row `y` from column `x` on.
    #[inline(always)]
    pub(crate) fn squared_error(&self, x: i32, y: i32, samples: &[u16]) -> u64 {
        let mut sum = 0;
        self.for_each_value(
            x,
            y,
            samples.len(),
            #[inline(always)]
            |i, value| {
                let difference = (value - i32::from(samples[i])).unsigned_abs();
                sum += u64::from(difference * difference);
            },
        );
        sum
    }

    /// Writes the rounded interpolant of row `y` from column `x` on.
    #[inline(always)]
    pub(crate) fn fill(&self, x: i32, y: i32, samples: &mut [u16]) {
        self.for_each_value(x, y, samples.len(), |i, value| samples[i] = value as u16);
    }

    /// Calls `use_value(i, value)` with the rounded interpolant at `(x + i, y)` for `count` pixels.
    #[inline(always)]
    fn for_each_value(&self, x: i32, y: i32, count: usize, mut use_value: impl FnMut(usize, i32)) {
        let start = self.at_origin + self.per_column * i64::from(x) + self.per_row * i64::from(y);
        if self.double_area > FLOATING_POINT_LIMIT {
            for i in 0..count {
                let numerator = start + self.per_column * i as i64;
                let rounded = (2 * numerator + self.double_area).div_euclid(2 * self.double_area);
                use_value(i, rounded as i32);
            }
            return;
        }
        let (first, step) = ((4 * start + 1) as f64, (4 * self.per_column) as f64);
        for i in 0..count {
            let value = (first + step * i as f64) * self.quarter_reciprocal;
            use_value(i, (value + ROUND_TO_NEAREST).to_bits() as i32);
        }
    }
}

/// The interpolants of a small face's components in lanes: eight pixels of one component, four of
/// two, or two of three or four.
///
/// Every number up to the quotient is an integer below 2^24, which 32-bit floating point holds
/// exactly: vertices are at most 63 columns and rows apart, so `den` is at most `63^2`, the
/// numerators `4 num + 1` at the face's pixels are at most `4 * 255 * 63^2 + 1 < 2^22`, and they
/// change over the face's extent by at most `4 * 255 * 2 * 63 * 63 < 2^23` in each direction. The
/// quotient by `4 den` is below 256, so two roundings leave an error below `255 * 2^-23`, less than
/// half of `1 / (4 * 63^2)`, the least distance of a quotient from a tie. Lanes beyond the end of a
/// row hold numbers that need not be exact and do not count.
#[derive(Clone, Copy)]
pub(crate) struct Plane<S: Simd> {
    pub(crate) simd: S,
    pub(crate) a: Point,
    /// Numerators at the first vertex and at the pixels after it.
    at_a: f32x8<S>,
    pub(crate) per_column: f32x8<S>,
    pub(crate) per_row: f32x8<S>,
    pub(crate) quarter_reciprocal: f32,
    /// Pixels from the first lane's to that of each lane.
    pub(crate) offsets: i32x8<S>,
}

impl<S: Simd> Plane<S> {
    #[inline(always)]
    pub(crate) fn new(
        simd: S,
        [a, b, c]: [Point; 3],
        [za, zb, zc]: [f32x8<S>; 3],
        offsets: i32x8<S>,
    ) -> Self {
        let ((bx, by), (cx, cy)) = ((b.x - a.x, b.y - a.y), (c.x - a.x, c.y - a.y));
        let double_area = (bx * cy - by * cx) as f32;
        let (to_b, to_c) = ((zb - za) * 4.0, (zc - za) * 4.0);
        let per_column = to_b * cy as f32 - to_c * by as f32;
        let per_row = to_c * bx as f32 - to_b * cx as f32;
        let at_a = za * (4.0 * double_area) + 1.0 + per_column * offsets.to_float::<f32x8<S>>();
        let quarter_reciprocal = 0.25 / double_area;
        Self { simd, a, at_a, per_column, per_row, quarter_reciprocal, offsets }
    }

    /// The numerators in row `y` at and after the column of the first vertex.
    #[inline(always)]
    pub(crate) fn row(&self, y: i32) -> f32x8<S> {
        self.at_a + self.per_row * (y - self.a.y) as f32
    }

    #[inline(always)]
    pub(crate) fn rounded(&self, numerators: f32x8<S>) -> f32x8<S> {
        numerators * self.quarter_reciprocal + ROUND_TO_NEAREST_F32 - ROUND_TO_NEAREST_F32
    }
}

pub(crate) trait Sample: Copy + Default + Into<f32> + Send + Sync {
    /// A sample that has no more bits than this type.
    fn of(sample: u16) -> Self;

    /// The first eight of at least [`SAMPLES_READ`] samples.
    fn first<S: Simd>(simd: S, samples: &[Self]) -> f32x8<S>;

    #[inline(always)]
    fn repeated<S: Simd, const STRIDE: usize>(simd: S, samples: &[Self]) -> f32x8<S> {
        let samples = &samples[..STRIDE];
        f32x8::simd_from(simd, std::array::from_fn(|lane| samples[lane % STRIDE].into()))
    }
}

impl Sample for u8 {
    fn of(sample: u16) -> Self {
        sample as u8
    }

    #[inline(always)]
    fn first<S: Simd>(simd: S, samples: &[Self]) -> f32x8<S> {
        let (first, second) = u8x16::from_slice(simd, &samples[..SAMPLES_READ]).widen().0.widen();
        first.combine(second).to_float()
    }
}

/// Only the quadratic model reads 16-bit samples.
impl Sample for u16 {
    fn of(sample: u16) -> Self {
        sample
    }

    #[inline(always)]
    fn first<S: Simd>(simd: S, samples: &[Self]) -> f32x8<S> {
        let (first, second) = u16x8::from_slice(simd, &samples[..LANES]).widen();
        first.combine(second).to_float()
    }
}

/// An image of up to [`MAX_COMPONENTS`] components, the samples of each pixel side by side.
pub(crate) struct Pixels<T = u8> {
    pub(crate) level: Level,
    pub(crate) width: usize,
    /// Samples of each pixel: 1, 2 or 4. The fourth sample of three components is 0.
    pub(crate) stride: usize,
    /// Row by row, with [`SAMPLES_READ`] more at the end.
    pub(crate) samples: Vec<T>,
}

impl<T: Sample> Pixels<T> {
    /// The pixels of an image; `None` when it has more components or bits.
    pub(crate) fn new(image: &Image, poller: &mut Poller<'_>) -> Result<Option<Self>, Cancelled> {
        let bits = 8 * size_of::<T>();
        if usize::from(image.precision()) > bits || image.component_count() > MAX_COMPONENTS {
            return Ok(None);
        }
        let stride = image.component_count().next_power_of_two();
        let mut samples = vec![T::default(); image.pixel_count() * stride + SAMPLES_READ];
        for (c, component) in image.components().iter().enumerate() {
            let pixels = samples.chunks_mut(stride * POINTS_PER_POLL);
            for (pixels, component) in pixels.zip(component.chunks(POINTS_PER_POLL)) {
                poller.poll()?;
                let stored = pixels[c..].iter_mut().step_by(stride);
                stored.zip(component).for_each(|(stored, &sample)| *stored = T::of(sample));
            }
        }
        Ok(Some(Self { level: Level::new(), width: image.width(), stride, samples }))
    }

    #[inline(always)]
    pub(crate) fn plane<S: Simd, const STRIDE: usize>(
        &self,
        simd: S,
        corners: [Point; 3],
    ) -> Plane<S> {
        // In a closure for `map` this would not always be compiled for the machine's vectors.
        let at = |p: Point| &self.samples[(p.y as usize * self.width + p.x as usize) * STRIDE..];
        let at_corners = [
            T::repeated::<S, STRIDE>(simd, at(corners[0])),
            T::repeated::<S, STRIDE>(simd, at(corners[1])),
            T::repeated::<S, STRIDE>(simd, at(corners[2])),
        ];
        let offsets = i32x8::simd_from(simd, std::array::from_fn(|lane| (lane / STRIDE) as i32));
        Plane::new(simd, corners, at_corners, offsets)
    }
}

impl Pixels {
    /// Appends the errors of counter-clockwise faces to `errors` and returns their sum: sums over
    /// pixels and components of squared differences between the rounded interpolant and the image.
    /// Stops before the first face that is not small, and where the sum reaches `limit`.
    pub(crate) fn errors(&self, faces: &[[Point; 3]], limit: u64, errors: &mut Vec<u64>) -> u64 {
        match self.stride {
            1 => dispatch!(self.level, simd => self.errors_by::<_, 1>(simd, faces, limit, errors)),
            2 => dispatch!(self.level, simd => self.errors_by::<_, 2>(simd, faces, limit, errors)),
            _ => dispatch!(self.level, simd => self.errors_by::<_, 4>(simd, faces, limit, errors)),
        }
    }

    #[inline(always)]
    fn errors_by<S: Simd, const STRIDE: usize>(
        &self,
        simd: S,
        faces: &[[Point; 3]],
        limit: u64,
        errors: &mut Vec<u64>,
    ) -> u64 {
        let mut sum = 0;
        for &corners in faces {
            let Some(face) = SmallFace::new(corners) else { break };
            let error = self.error::<S, STRIDE>(simd, corners, &face);
            errors.push(error);
            sum += error;
            if sum >= limit {
                break;
            }
        }
        sum
    }

    #[inline(always)]
    fn error<S: Simd, const STRIDE: usize>(
        &self,
        simd: S,
        corners: [Point; 3],
        face: &SmallFace,
    ) -> u64 {
        let lanes = f32x8::splat(simd, 0.0);
        let mut sum = Sum { plane: self.plane::<S, STRIDE>(simd, corners), lanes, total: 0 };
        if face.touches_axes() {
            return sum.of_walk::<STRIDE>(self, corners);
        }
        let vectors_per_row = face.columns as usize * STRIDE / LANES + 1;
        let mut rows_summed = 0;
        for first_row in (0..face.rows).step_by(ROWS) {
            let rows = face.rows(simd, first_row);
            let count = ROWS.min((face.rows - first_row) as usize);
            if (rows_summed + count) * vectors_per_row > PIXELS_PER_SUM {
                sum.empty_lanes();
                rows_summed = 0;
            }
            rows_summed += count;
            let y = face.bottom + 1 + first_row;
            let (mut numerators, mut start) = (sum.plane.row(y), y as usize * self.width);
            for (&first, &points) in rows.firsts.iter().zip(&rows.counts).take(count) {
                let ahead = (first - sum.plane.a.x) as f32;
                let from_first = numerators + sum.plane.per_column * ahead;
                let samples = &self.samples[(start + first as usize) * STRIDE..];
                sum.add_row::<STRIDE>(from_first, samples, points);
                numerators += sum.plane.per_row;
                start += self.width;
            }
        }
        sum.empty_lanes();
        sum.total
    }
}

struct Sum<S: Simd> {
    plane: Plane<S>,
    lanes: f32x8<S>,
    total: u64,
}

impl<S: Simd> Sum<S> {
    /// The sum over a face whose rows only the walk finds.
    #[inline(always)]
    fn of_walk<const STRIDE: usize>(mut self, pixels: &Pixels, corners: [Point; 3]) -> u64 {
        for_each_row(
            corners,
            #[inline(always)]
            |y, first, end| {
                let ahead = (first - self.plane.a.x) as f32;
                let numerators = self.plane.row(y) + self.plane.per_column * ahead;
                let at = (y as usize * pixels.width + first as usize) * STRIDE;
                self.add_row::<STRIDE>(numerators, &pixels.samples[at..], end - first);
                self.empty_lanes();
            },
        );
        self.total
    }

    /// Adds the squared differences in the first `points` pixels of `samples`.
    #[inline(always)]
    fn add_row<const STRIDE: usize>(
        &mut self,
        mut numerators: f32x8<S>,
        samples: &[u8],
        mut points: i32,
    ) {
        let plane = &self.plane;
        let mut at = 0;
        loop {
            let values = plane.rounded(numerators);
            let samples = u8::first(plane.simd, &samples[at..]);
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

    #[inline(always)]
    fn empty_lanes(&mut self) {
        let lanes: [i32; LANES] = self.lanes.to_int::<i32x8<S>>().into();
        self.total += lanes.iter().sum::<i32>() as u64;
        self.lanes = f32x8::splat(self.plane.simd, 0.0);
    }
}

#[cfg(test)]
mod tests;
