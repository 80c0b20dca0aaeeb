//! The squared error of small faces of pictures of up to 8 bits, all components at once.
//!
//! As [`Interpolant`](crate::interpolant) computes it, but in 32-bit floating point, eight samples
//! side by side in the lanes of a vector: eight lattice points of one component, four of two, two of
//! three or four. Every number up to the quotient is a whole one below 2^24 and so exact: with
//! vertices at most 63 columns and rows apart, twice the area `den` is at most `63^2`, the
//! numerators `4 num + 1` of the face's points at most `4 * 255 * 63^2 + 1 < 2^22`, and their change
//! over the face's extent in each direction at most `4 * 255 * 2 * 63 * 63 < 2^23`. The quotient by
//! `4 den` is below 256, so two roundings leave an error below `255 * 2^-23`, less than half of
//! `1 / (4 * 63^2)`, the least distance of a quotient from a tie. Sums of squares are exact below
//! 2^24: they are taken out of the lanes before 257 points are in them. Lanes beyond the end of a
//! row hold numbers that need not be exact and do not count.
//!
//! The vectors are those of the machine the program runs on, chosen as it runs; every lane does the
//! same operations in the same order on all of them (see `PERFORMANCE.md`).

use crate::face_rows::{for_each_inner_row, for_each_row};
use crate::image::Image;
use crate::mesh::Point;
use fearless_simd::{Level, Simd, dispatch, f32x8, i32x8, mask32x8, prelude::*, u8x16, u32x4};

/// The most columns and rows between two vertices of a small face.
pub(crate) const LARGEST_EXTENT: i32 = 63;

/// Samples side by side in a vector.
const LANES: usize = 8;

/// Bytes read at each point.
const BYTES_READ: usize = 16;

/// Points whose squared differences a lane can sum up exactly: `256 * 255^2 < 2^24`.
const POINTS_PER_SUM: usize = 256;

/// Adding this to a number below 2^22 rounds it to a whole number, taking it away leaves that.
const ROUND_TO_NEAREST: f32 = 12_582_912.0; // 1.5 * 2^23

/// A picture of up to four components and 8 bits, the samples of each point side by side, a byte
/// each.
pub(crate) struct Pixels {
    level: Level,
    width: usize,
    /// Bytes of each point: 1, 2 or 4; the fourth of three components is 0.
    stride: usize,
    /// So many bytes more than the points have that a vector can be read at each of them.
    bytes: Vec<u8>,
}

impl Pixels {
    /// The points of a picture; `None` when it has more components or bits.
    pub(crate) fn new(image: &Image) -> Option<Self> {
        if image.precision() > 8 || image.component_count() > 4 {
            return None;
        }
        let stride = image.component_count().next_power_of_two();
        let mut bytes = vec![0; image.pixel_count() * stride + BYTES_READ];
        for (c, component) in image.components().iter().enumerate() {
            let bytes = bytes[c..].iter_mut().step_by(stride);
            bytes.zip(component).for_each(|(byte, &sample)| *byte = sample as u8);
        }
        Some(Self { level: Level::new(), width: image.width(), stride, bytes })
    }

    /// The errors of counter-clockwise faces, `None` for those that are too large: sums over the
    /// lattice points and components of the squared differences between the rounded interpolant and
    /// the picture.
    pub(crate) fn squared_errors(&self, faces: &[[Point; 3]], errors: &mut [Option<u64>]) {
        dispatch!(self.level, simd => self.squared_errors_by(simd, faces, errors));
    }

    #[inline(always)]
    fn squared_errors_by<S: Simd>(
        &self,
        simd: S,
        faces: &[[Point; 3]],
        errors: &mut [Option<u64>],
    ) {
        for (&face, error) in faces.iter().zip(errors) {
            *error = match self.stride {
                _ if !is_small(face) => None,
                1 => Some(self.squared_error::<S, 1>(simd, face)),
                2 => Some(self.squared_error::<S, 2>(simd, face)),
                _ => Some(self.squared_error::<S, 4>(simd, face)),
            };
        }
    }

    /// The error of a small face.
    #[inline(always)]
    fn squared_error<S: Simd, const STRIDE: usize>(&self, simd: S, corners: [Point; 3]) -> u64 {
        let plane = Plane::<S>::new::<STRIDE>(simd, self, corners);
        let mut sum = Sum { simd, total: 0, lanes: f32x8::splat(simd, 0.0), points: 0 };
        let [a, b, c] = corners;
        if a.x.min(b.x).min(c.x) > 0 && a.y.min(b.y).min(c.y) > 0 {
            for_each_inner_row(
                corners,
                #[inline(always)]
                |y, first, end| plane.add_row::<STRIDE>(self, y, first, end, &mut sum),
            );
        } else {
            for_each_row(
                corners,
                #[inline(always)]
                |y, first, end| plane.add_row::<STRIDE>(self, y, first, end, &mut sum),
            );
        }
        sum.finish()
    }

    /// The samples at a byte and after it.
    #[inline(always)]
    fn load<S: Simd>(&self, simd: S, at: usize) -> f32x8<S> {
        first_bytes(u8x16::from_slice(simd, &self.bytes[at..at + BYTES_READ]))
    }

    /// The samples of one point, again and again.
    #[inline(always)]
    fn repeat<S: Simd, const STRIDE: usize>(&self, simd: S, point: Point) -> f32x8<S> {
        let at = (point.y as usize * self.width + point.x as usize) * STRIDE;
        let mut bytes = [0; 4];
        bytes[..STRIDE].copy_from_slice(&self.bytes[at..at + STRIDE]);
        let repetitions = u32::MAX / (u32::MAX >> (32 - 8 * STRIDE));
        let samples = u32::from_le_bytes(bytes) * repetitions;
        first_bytes(u32x4::splat(simd, samples).to_bytes())
    }
}

/// The first of so many bytes as numbers.
#[inline(always)]
fn first_bytes<S: Simd>(bytes: u8x16<S>) -> f32x8<S> {
    let (first, second) = bytes.widen().0.widen();
    first.combine(second).to_float()
}

/// The planes of a face's components: the numerators of their interpolants.
struct Plane<S: Simd> {
    simd: S,
    a: Point,
    /// Numerators at the first vertex and the points after it.
    at_a: f32x8<S>,
    per_column: f32x8<S>,
    per_row: f32x8<S>,
    quarter_reciprocal: f32,
    /// How many points after the first one each lane stands.
    offsets: i32x8<S>,
}

impl<S: Simd> Plane<S> {
    #[inline(always)]
    fn new<const STRIDE: usize>(simd: S, pixels: &Pixels, corners: [Point; 3]) -> Self {
        let [a, b, c] = corners;
        let ((bx, by), (cx, cy)) = ((b.x - a.x, b.y - a.y), (c.x - a.x, c.y - a.y));
        let double_area = (bx * cy - by * cx) as f32;
        let [za, zb, zc] = corners.map(|p| pixels.repeat::<S, STRIDE>(simd, p));
        let (to_b, to_c) = ((zb - za) * 4.0, (zc - za) * 4.0);
        let per_column = to_b * cy as f32 - to_c * by as f32;
        let per_row = to_c * bx as f32 - to_b * cx as f32;
        let offsets = i32x8::simd_from(simd, std::array::from_fn(|lane| (lane / STRIDE) as i32));
        let at_a = za * (4.0 * double_area) + 1.0 + per_column * offsets.to_float::<f32x8<S>>();
        let quarter_reciprocal = 0.25 / double_area;
        Self { simd, a, at_a, per_column, per_row, quarter_reciprocal, offsets }
    }

    /// Adds the squared differences in columns `first..end` of row `y`.
    #[inline(always)]
    fn add_row<const STRIDE: usize>(
        &self,
        pixels: &Pixels,
        y: i32,
        first: i32,
        end: i32,
        sum: &mut Sum<S>,
    ) {
        let (count, points) = ((end - first) as usize, LANES / STRIDE);
        sum.make_room(count.div_ceil(points));
        let mut at = (y as usize * pixels.width + first as usize) * STRIDE;
        let mut numerators = self.at_a
            + self.per_column * (first - self.a.x) as f32
            + self.per_row * (y - self.a.y) as f32;
        let mut left = count as i32;
        loop {
            let values = numerators * self.quarter_reciprocal + ROUND_TO_NEAREST - ROUND_TO_NEAREST;
            let differences = values - pixels.load(self.simd, at);
            let counts: mask32x8<S> = self.offsets.simd_lt(left);
            sum.add(counts.select(differences, f32x8::splat(self.simd, 0.0)));
            left -= points as i32;
            if left <= 0 {
                return;
            }
            at += LANES;
            numerators += self.per_column * points as f32;
        }
    }
}

/// A sum of squares.
struct Sum<S: Simd> {
    simd: S,
    total: u64,
    lanes: f32x8<S>,
    /// Points in each lane.
    points: usize,
}

impl<S: Simd> Sum<S> {
    /// Empties the lanes if they might not hold the squares of so many points more.
    #[inline(always)]
    fn make_room(&mut self, points: usize) {
        if self.points + points > POINTS_PER_SUM {
            self.total += self.sum_of_lanes();
            (self.lanes, self.points) = (f32x8::splat(self.simd, 0.0), 0);
        }
        self.points += points;
    }

    #[inline(always)]
    fn add(&mut self, differences: f32x8<S>) {
        self.lanes += differences * differences;
    }

    #[inline(always)]
    fn sum_of_lanes(&self) -> u64 {
        let lanes: [i32; LANES] = self.lanes.to_int::<i32x8<S>>().into();
        lanes.iter().sum::<i32>() as u64
    }

    #[inline(always)]
    fn finish(self) -> u64 {
        self.total + self.sum_of_lanes()
    }
}

/// Tells whether the vertices of a face are near enough to each other.
#[inline(always)]
fn is_small([a, b, c]: [Point; 3]) -> bool {
    extent(b.x - a.x, c.x - a.x) <= LARGEST_EXTENT && extent(b.y - a.y, c.y - a.y) <= LARGEST_EXTENT
}

/// How far apart the first vertex at 0 and those at `b` and `c` are.
#[inline(always)]
fn extent(b: i32, c: i32) -> i32 {
    b.max(c).max(0) - b.min(c).min(0)
}
