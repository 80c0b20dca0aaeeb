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

use crate::image::Image;
use crate::mesh::Point;
use crate::small_face_rows::{Edges, ROWS, Rows};
use fearless_simd::{Level, Simd, dispatch, f32x8, i32x8, mask32x8, prelude::*, u8x16, u32x4};

/// Stands for the error of a face that is not small.
pub(crate) const TOO_LARGE: u64 = u64::MAX;

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

    /// The error of a small face.
    #[inline(always)]
    fn squared_error<S: Simd, const STRIDE: usize>(&self, simd: S, corners: [Point; 3]) -> u64 {
        let Some(edges) = Edges::new(corners) else { return TOO_LARGE };
        if edges.left == 0 || edges.bottom == 0 {
            return TOO_LARGE;
        }
        let mut sum = Sum {
            plane: Plane::new::<STRIDE>(simd, self, corners),
            lanes: f32x8::splat(simd, 0.0),
            total: 0,
        };
        let vectors_per_row = edges.columns as usize * STRIDE / LANES + 1;
        // At least the rows of one vector: a row has 32 vectors at most.
        let rows_per_sum = POINTS_PER_SUM / vectors_per_row;
        let mut rows_summed = 0;
        for first_row in (0..edges.rows).step_by(ROWS) {
            let rows = edges.rows(simd, first_row);
            let count = ROWS.min((edges.rows - first_row) as usize);
            if rows_summed + count > rows_per_sum {
                sum.empty();
                rows_summed = 0;
            }
            rows_summed += count;
            sum.add_rows::<STRIDE>(self, edges.bottom + 1 + first_row, &rows, count);
        }
        sum.empty();
        sum.total
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

    /// The numerators in row `y` at and after the column of the first vertex.
    #[inline(always)]
    fn row(&self, y: i32) -> f32x8<S> {
        self.at_a + self.per_row * (y - self.a.y) as f32
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
                &pixels.bytes[(start + first as usize) * STRIDE..],
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
            let values =
                numerators * plane.quarter_reciprocal + ROUND_TO_NEAREST - ROUND_TO_NEAREST;
            let samples = first_bytes(u8x16::from_slice(plane.simd, &bytes[at..at + BYTES_READ]));
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
