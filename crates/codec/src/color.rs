//! The colours of sample vectors: gray, gray and alpha, RGB, RGBA.

use crate::rounding::rounded_quotient;
use pixmesh_meshing::Shape;
use pixmesh_meshing::alpha::has_alpha;

/// Red, green, blue and alpha of a sample vector, each sample converted: one component is gray, two
/// are gray and alpha, three RGB, four RGBA; of five and more the first three are RGB.
pub(crate) fn rgba<T: Copy>(
    samples: &[u16],
    color: impl Fn(u16) -> T,
    alpha: impl Fn(u16) -> T,
    opaque: T,
) -> [T; 4] {
    let [red, green, blue, last] = match *samples {
        [gray] => [gray, gray, gray, 0],
        [gray, last] => [gray, gray, gray, last],
        [red, green, blue] => [red, green, blue, 0],
        [red, green, blue, last, ..] => [red, green, blue, last],
        [] => [0; 4],
    };
    let alpha = if has_alpha(samples.len()) { alpha(last) } else { opaque };
    [color(red), color(green), color(blue), alpha]
}

/// The luma's weights of red, green and blue, in thousandths.
const LUMA_WEIGHTS: [u32; 3] = [299, 587, 114];

/// The sum of the luma's weights: a luma of 1000 is one step of a sample.
pub(crate) const LUMA_SUM: u32 = 1000;

/// The luma of three or more components, else the first, in thousandths of a step.
pub(crate) fn luma(samples: &[u16]) -> u32 {
    match *samples {
        [red, green, blue, ..] => {
            let weighted = [red, green, blue].into_iter().zip(LUMA_WEIGHTS);
            weighted.map(|(sample, weight)| u32::from(sample) * weight).sum()
        }
        _ => samples.first().map_or(0, |&gray| u32::from(gray) * LUMA_SUM),
    }
}

/// What each sample of a precision becomes in sRGB of 8 bits, rounded to the nearest, halves up.
pub(crate) struct Colors(Vec<u8>);

impl Colors {
    pub(crate) fn new(shape: Shape) -> Self {
        let largest = u64::from(u16::MAX >> (16 - shape.precision));
        Self((0..=largest).map(|sample| rounded_quotient(255 * sample, largest) as u8).collect())
    }

    /// Red, green, blue and alpha of a sample vector.
    pub(crate) fn rgba(&self, samples: &[u16]) -> [u8; 4] {
        let scale = |sample: u16| self.0.get(usize::from(sample)).copied().unwrap_or(255);
        rgba(samples, scale, scale, 255)
    }
}
