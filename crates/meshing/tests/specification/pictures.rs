//! Random small pictures: flat, noisy, ramps, steps and few-valued ones, of all precisions.

use pixmesh_meshing::{Image, Method, Parameters, Target, mesh_image};
use proptest::collection::vec;
use proptest::prelude::*;
use std::ops::RangeInclusive;

/// What a component looks like.
#[derive(Clone, Copy, Debug)]
enum Pattern {
    Flat,
    Noise,
    Ramp,
    Step,
    TwoLevels,
    ThreeNeighbouringLevels,
    Checkerboard,
    Dots,
}

const PATTERNS: [Pattern; 8] = [
    Pattern::Flat,
    Pattern::Noise,
    Pattern::Ramp,
    Pattern::Step,
    Pattern::TwoLevels,
    Pattern::ThreeNeighbouringLevels,
    Pattern::Checkerboard,
    Pattern::Dots,
];

/// Proptest's settings: this many cases, no files written.
pub(crate) fn cases(count: u32) -> ProptestConfig {
    ProptestConfig { cases: count, failure_persistence: None, ..ProptestConfig::default() }
}

/// Pictures of these sides, numbers of components and 1, 8, 12 or 16 bits.
pub(crate) fn pictures(
    sides: RangeInclusive<usize>,
    component_counts: RangeInclusive<usize>,
) -> impl Strategy<Value = Image> {
    let precisions = prop::sample::select(vec![1u8, 8, 12, 16]);
    (sides.clone(), sides, component_counts, precisions).prop_flat_map(
        |(width, height, count, precision)| {
            let component =
                (prop::sample::select(&PATTERNS[..]), vec(any::<u16>(), width * height));
            vec(component, count).prop_map(move |components| {
                let draw = |(pattern, noise): &(Pattern, Vec<u16>)| {
                    drawn(*pattern, noise, width, u16::MAX >> (16 - precision))
                };
                image(width, height, precision, components.iter().map(draw).collect())
            })
        },
    )
}

/// The samples of a pattern whose free numbers are those of `noise`.
fn drawn(pattern: Pattern, noise: &[u16], width: usize, largest: u16) -> Vec<u16> {
    let (low, high) = (noise[0] & largest, noise[1] & largest);
    let slope = (usize::from(noise[2] % 7), usize::from(noise[3] % 7));
    let height = noise.len() / width;
    let sample = |i: usize| {
        let (x, y) = (i % width, i / width);
        let along = slope.0 * x + slope.1 * y;
        let half = (slope.0 * width + slope.1 * height) / 2;
        match pattern {
            Pattern::Flat => low,
            Pattern::Noise => noise[i] & largest,
            Pattern::Ramp => (usize::from(low) + along).min(usize::from(largest)) as u16,
            Pattern::Step => [low, high][usize::from(along > half)],
            Pattern::TwoLevels => [low, high][usize::from(noise[i] >> 15)],
            Pattern::ThreeNeighbouringLevels => low.saturating_add(noise[i] % 3).min(largest),
            Pattern::Checkerboard => [low, high][(x + y) % 2],
            Pattern::Dots => [low, high][usize::from(noise[i] < u16::MAX / 16)],
        }
    };
    (0..noise.len()).map(sample).collect()
}

/// An image of parts that are known to be valid.
pub(crate) fn image(
    width: usize,
    height: usize,
    precision: u8,
    components: Vec<Vec<u16>>,
) -> Image {
    Image::from_bottom_up(width, height, precision, components).expect("the parts make an image")
}

/// An image of one component of 8 bits drawn by a function of column and row.
pub(crate) fn gray(width: usize, height: usize, sample: impl Fn(usize, usize) -> u16) -> Image {
    let samples = (0..width * height).map(|i| sample(i % width, i / width)).collect();
    image(width, height, 8, vec![samples])
}

/// Hash-like noise of 8 bits.
pub(crate) fn noise(x: usize, y: usize) -> u16 {
    let mixed = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (mixed >> 56) as u16
}

/// The methods defined for this many components.
pub(crate) fn methods_for(component_count: usize) -> Vec<Method> {
    let fits = |method: &&Method| method.check_component_count(component_count).is_ok();
    Method::ALL.iter().filter(fits).copied().collect()
}

/// A target of `share` of the points between the corners and the whole lattice.
pub(crate) fn size_target(image: &Image, share: f64) -> Target {
    let free = (image.pixel_count() - 4) as f64;
    Target::Size(4 + (share * free) as usize)
}

/// The model that a set of parameters makes of an image, which it must be able to.
pub(crate) fn model(image: &Image, parameters: &Parameters) -> pixmesh_meshing::Approximation {
    mesh_image(image, &parameters.clone().lists_removals(true), &())
        .expect("the parameters fit the image")
}
