//! The squared error of small faces of pictures of up to 8 bits, all components at once.
//!
//! As [`Interpolant`](crate::interpolant) computes it, but in 32-bit floating point, the components
//! of a lattice point side by side in the lanes of a vector. Every number up to the quotient is a
//! whole one below 2^24 and so exact: with vertices at most 63 columns and rows apart, twice the
//! area `den` is at most `63^2`, the numerators `4 num + 1` of the face's points at most
//! `4 * 255 * 63^2 + 1 < 2^22`, and their change over the face's extent in each direction at most
//! `4 * 255 * 2 * 63 * 63 < 2^23`. The quotient by `4 den` is below 256, so two roundings leave an
//! error below `255 * 2^-23`, less than half of `1 / (4 * 63^2)`, the least distance of a quotient
//! from a tie. Sums of squares are exact below 2^24: they are taken out of the lanes before 257
//! points are in them.
//!
//! Against the interpolants of one component after the other in 64 bits this takes less than half
//! of the time of greedy removal for three components (see `PERFORMANCE.md`).

use crate::face_rows::for_each_row;
use crate::image::Image;
use crate::mesh::Point;
use std::ops::{Add, AddAssign, Mul, Sub};
use wide::{f32x4, i32x4};

/// The most columns and rows between two vertices of a small face.
const LARGEST_EXTENT: i32 = 63;

/// Points whose squared differences a lane can sum up exactly: `256 * 255^2 < 2^24`.
const POINTS_PER_SUM: i32 = 256;

/// Adding this to a number below 2^22 rounds it to a whole number, taking it away leaves that.
const ROUND_TO_NEAREST: f32 = 12_582_912.0; // 1.5 * 2^23

/// Numbers side by side, one for each component.
pub(crate) trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + AddAssign
{
    /// The samples of a lattice point as they are kept, a byte each.
    type Stored: Copy;

    /// The same number in every lane.
    fn splat(number: f32) -> Self;

    /// Keeps the samples of a lattice point, 0 in the lanes that no component fills.
    fn store(samples: impl Iterator<Item = u16>) -> Self::Stored;

    /// The samples kept.
    fn load(stored: Self::Stored) -> Self;

    /// The sum of whole numbers below 2^24 each.
    fn total(self) -> u64;
}

impl Lanes for f32 {
    type Stored = u8;

    #[inline]
    fn splat(number: f32) -> Self {
        number
    }

    fn store(mut samples: impl Iterator<Item = u16>) -> u8 {
        samples.next().map_or(0, |sample| sample as u8)
    }

    #[inline]
    fn load(stored: u8) -> Self {
        stored.into()
    }

    #[inline]
    fn total(self) -> u64 {
        self as u64
    }
}

impl Lanes for f32x4 {
    type Stored = [u8; 4];

    #[inline]
    fn splat(number: f32) -> Self {
        Self::splat(number)
    }

    fn store(samples: impl Iterator<Item = u16>) -> [u8; 4] {
        let mut stored = [0; 4];
        for (byte, sample) in stored.iter_mut().zip(samples) {
            *byte = sample as u8;
        }
        stored
    }

    #[inline]
    fn load(stored: [u8; 4]) -> Self {
        Self::from_i32x4(i32x4::from(stored.map(i32::from)))
    }

    #[inline]
    fn total(self) -> u64 {
        let lanes = self.trunc_int().to_array();
        lanes.iter().map(|&sum| sum as u64).sum()
    }
}

/// A picture of up to 8 bits, the components of each point side by side.
pub(crate) struct Pixels<L: Lanes> {
    width: usize,
    pixels: Vec<L::Stored>,
}

impl<L: Lanes> Pixels<L> {
    /// The points of a picture of at most as many components as there are lanes, and 8 bits.
    pub(crate) fn new(image: &Image) -> Self {
        let components = image.components();
        let pixel = |i: usize| L::store(components.iter().map(|samples| samples[i]));
        Self { width: image.width(), pixels: (0..image.pixel_count()).map(pixel).collect() }
    }

    /// Sum over the lattice points of a counter-clockwise face and all components of the squared
    /// differences between the rounded interpolant and the picture; `None` when the face is too
    /// large.
    #[inline]
    pub(crate) fn squared_error(&self, corners: [Point; 3]) -> Option<u64> {
        let [a, b, c] = corners;
        let ((bx, by), (cx, cy)) = ((b.x - a.x, b.y - a.y), (c.x - a.x, c.y - a.y));
        if extent(bx, cx) > LARGEST_EXTENT || extent(by, cy) > LARGEST_EXTENT {
            return None;
        }
        let double_area = (bx * cy - by * cx) as f32;
        let [za, zb, zc] =
            corners.map(|p| L::load(self.pixels[p.y as usize * self.width + p.x as usize]));
        let number = |n: i32| L::splat(n as f32);
        let (to_b, to_c) = ((zb - za) * number(4), (zc - za) * number(4));
        let per_column = to_b * number(cy) - to_c * number(by);
        let per_row = to_c * number(bx) - to_b * number(cx);
        let at_a = za * L::splat(4.0 * double_area) + number(1);
        let quarter_reciprocal = L::splat(0.25 / double_area);
        let round = L::splat(ROUND_TO_NEAREST);

        let (mut total, mut sums, mut summed) = (0, number(0), 0);
        for_each_row(corners, |y, first, end| {
            if summed + (end - first) > POINTS_PER_SUM {
                total += sums.total();
                (sums, summed) = (number(0), 0);
            }
            summed += end - first;
            let row = y as usize * self.width;
            let mut numerator = at_a + per_column * number(first - a.x) + per_row * number(y - a.y);
            for &pixel in &self.pixels[row + first as usize..row + end as usize] {
                let value = numerator * quarter_reciprocal + round - round;
                let difference = value - L::load(pixel);
                sums += difference * difference;
                numerator += per_column;
            }
        });
        Some(total + sums.total())
    }
}

/// How far apart the first vertex at 0 and those at `b` and `c` are.
#[inline]
fn extent(b: i32, c: i32) -> i32 {
    b.max(c).max(0) - b.min(c).min(0)
}
