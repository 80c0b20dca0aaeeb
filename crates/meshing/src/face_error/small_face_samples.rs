//! Samples of a picture in the lanes of vectors, those of each point side by side.

use crate::face_error::small_face::LANES;
use fearless_simd::{Simd, f32x8, prelude::*, u8x16, u16x8, u32x4};

/// A sample as it is kept for small faces.
pub(crate) trait Sample: Copy + Default + Into<f32> + Send + Sync {
    /// The most bits that it has.
    const PRECISION: u8;

    /// A sample of no more bits.
    fn of(sample: u16) -> Self;

    /// The first eight of at least sixteen samples.
    fn first<S: Simd>(simd: S, samples: &[Self]) -> f32x8<S>;

    /// The samples of the first point, again and again.
    fn repeated<S: Simd, const STRIDE: usize>(simd: S, samples: &[Self]) -> f32x8<S>;
}

impl Sample for u8 {
    const PRECISION: u8 = 8;

    #[inline(always)]
    fn of(sample: u16) -> Self {
        sample as u8
    }

    #[inline(always)]
    fn first<S: Simd>(simd: S, samples: &[Self]) -> f32x8<S> {
        first_bytes(u8x16::from_slice(simd, &samples[..2 * LANES]))
    }

    #[inline(always)]
    fn repeated<S: Simd, const STRIDE: usize>(simd: S, samples: &[Self]) -> f32x8<S> {
        if STRIDE == 1 {
            return f32x8::splat(simd, samples[0].into());
        }
        let mut bytes = [0; 4];
        bytes[..STRIDE].copy_from_slice(&samples[..STRIDE]);
        let repetitions = u32::MAX / (u32::MAX >> (32 - 8 * STRIDE));
        let samples = u32::from_le_bytes(bytes) * repetitions;
        first_bytes(u32x4::splat(simd, samples).to_bytes())
    }
}

impl Sample for u16 {
    const PRECISION: u8 = 16;

    #[inline(always)]
    fn of(sample: u16) -> Self {
        sample
    }

    #[inline(always)]
    fn first<S: Simd>(simd: S, samples: &[Self]) -> f32x8<S> {
        let (first, second) = u16x8::from_slice(simd, &samples[..LANES]).widen();
        first.combine(second).to_float()
    }

    #[inline(always)]
    fn repeated<S: Simd, const STRIDE: usize>(simd: S, samples: &[Self]) -> f32x8<S> {
        let samples = &samples[..STRIDE];
        f32x8::simd_from(simd, std::array::from_fn(|lane| f32::from(samples[lane % STRIDE])))
    }
}

/// The first of so many bytes as numbers.
#[inline(always)]
fn first_bytes<S: Simd>(bytes: u8x16<S>) -> f32x8<S> {
    let (first, second) = bytes.widen().0.widen();
    first.combine(second).to_float()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};
    use proptest::prelude::*;

    /// Every way of reading lanes gives the samples that it says.
    #[inline(always)]
    fn assert_lanes<S: Simd, T: Sample, const STRIDE: usize>(simd: S, samples: &[T]) {
        let expected = |at: &dyn Fn(usize) -> usize| -> [f32; LANES] {
            std::array::from_fn(|lane| samples[at(lane)].into())
        };
        let lanes = |lanes: f32x8<S>| -> [f32; LANES] { lanes.into() };
        assert_eq!(lanes(T::first(simd, samples)), expected(&|lane| lane));
        let repeated = lanes(T::repeated::<S, STRIDE>(simd, samples));
        assert_eq!(repeated, expected(&|lane| lane % STRIDE));
    }

    proptest! {
        #[test]
        fn lanes_hold_the_samples_of_a_picture(samples in prop::array::uniform32(0u16..=u16::MAX)) {
            let bytes = samples.map(|sample| u8::of(sample & 255));
            dispatch!(Level::new(), simd => {
                assert_lanes::<_, _, 1>(simd, &samples);
                assert_lanes::<_, _, 2>(simd, &samples);
                assert_lanes::<_, _, 4>(simd, &samples);
                assert_lanes::<_, _, 1>(simd, &bytes);
                assert_lanes::<_, _, 2>(simd, &bytes);
                assert_lanes::<_, _, 4>(simd, &bytes);
            });
        }
    }
}
