//! The squared error of small faces over samples of up to 8 bits, all components at once.
//!
//! [`Plane`] proves that 32-bit floating point computes the rounded interpolants exactly. Sums of
//! squares are exact below 2^24; they leave the lanes before 257 pixels are in one.
//!
//! The program chooses the instructions of its machine as it runs; on all of them each lane does
//! the same operations in the same order.

use crate::control::{Cancelled, POINTS_PER_POLL, Poller};
use crate::face_error::interpolant::Plane;
use crate::face_error::pixels_of_face::{MAX_EXTENT, ROWS, SmallFace, for_each_row};
use crate::image::{Image, Point};
use fearless_simd::{Level, Simd, dispatch, f32x8, i32x8, mask32x8, prelude::*, u8x16, u16x8};

pub(crate) const LANES: usize = 8;

pub(crate) const MAX_COMPONENTS: usize = 4;

/// Samples that a vector of 8-bit samples reads from a pixel on.
const SAMPLES_READ: usize = 2 * LANES;

/// Pixels whose squared differences a lane sums up exactly: `256 * 255^2 < 2^24`.
const PIXELS_PER_SUM: usize = 256;

// A row's vectors leave the lanes capacity for eight rows at least.
const _: () = assert!((MAX_EXTENT as usize * MAX_COMPONENTS / LANES + 1) * ROWS <= PIXELS_PER_SUM);

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
