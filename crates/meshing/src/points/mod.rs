//! The initial points of a mesh, by each of the generators.

pub(crate) mod bounded_insertion;
pub(crate) mod error_diffusion;
pub(crate) mod floyd_steinberg;
pub(crate) mod greedy_insertion;
pub(crate) mod reduced;
pub(crate) mod threshold_search;

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::density::Density;
use crate::error::MeshingError;
use crate::image::{Image, Point, corner_points};
use crate::parameters::choices::Generator;
use crate::parameters::{Parameters, Weights, check_size};
use crate::points::error_diffusion::diffuse_to_size;
use crate::points::greedy_insertion::inserted_points;
use crate::points::reduced::diffuse_in_reduced;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Chooses about `size` initial points of an image, by row, then column, the four corners among
/// them.
///
/// Error diffusion chooses a number within its tolerance of `size`, in a reduced picture within 10
/// points or 0.2 %; then the corners are added. The other generators count the corners; a regular
/// grid has at most `size` points, and greedy insertion chooses fewer where these leave no error.
///
/// # Errors
/// When `size` is not between 4, the corners, and the number of lattice points, a parameter is out
/// of its bounds or not defined for such an image, or the control cancels.
///
/// ```
/// use pixmesh_meshing::{Image, Parameters, parameters::Generator, sample_points};
/// let image = Image::from_top_down(16, 16, 8, vec![(0..=255).collect()])?;
/// let grid = Parameters::default().generator(Generator::Uniform);
/// assert_eq!(sample_points(&image, &grid, 9, &())?.len(), 9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn sample_points(
    image: &Image,
    parameters: &Parameters,
    size: usize,
    control: &dyn Control,
) -> Result<Vec<Point>, MeshingError> {
    check_size("size", size, image.pixel_count())?;
    parameters.check()?;
    parameters.check_components(image.component_count())?;
    parameters.check_weights((image.width(), image.height()))?;
    Ok(initial_points(image, parameters, size, control)?)
}

/// [`sample_points`] of a size and parameters that are known to be valid for the image.
pub(crate) fn initial_points(
    image: &Image,
    parameters: &Parameters,
    size: usize,
    control: &dyn Control,
) -> Result<Vec<Point>, Cancelled> {
    let (width, height) = (image.width(), image.height());
    let mut poller = Poller::new(control, Stage::Triangulate, 0, size);
    let mut marks = match parameters.generator {
        _ if size >= width * height => vec![1; width * height],
        Generator::All => vec![1; width * height],
        Generator::Insertion if parameters.inserts(image.shape()) => {
            let weights = parameters.weights.as_ref().map(Weights::values);
            return inserted_points(image, parameters.error_metric, weights, size, control);
        }
        Generator::Insertion => {
            diffuse_in_reduced(image, parameters.weights.as_ref(), size, control)?
        }
        Generator::Random => random_points(width, height, size, parameters.seed, &mut poller)?,
        Generator::Uniform => uniform_points(width, height, size, &mut poller)?,
        Generator::ErrorDiffusion => {
            let density = Density::of_checked(image, parameters, control)?;
            let marks = diffuse_to_size(&density, size, parameters, control)?;
            density.fields.into_iter().try_for_each(|_field| poller.poll()).map(|()| marks)?
        }
    };
    poller.poll()?;
    for corner in corner_points(width, height) {
        marks[corner.y as usize * width + corner.x as usize] = 1;
    }
    let mut points = Vec::with_capacity(marks.iter().map(|&mark| usize::from(mark)).sum());
    for (y, row) in marks.chunks_exact(width).enumerate() {
        poller.step(width)?;
        points.extend((0..width).filter(|&x| row[x] != 0).map(|x| Point::new(x as i32, y as i32)));
    }
    Ok(points)
}

/// Marks `size - 4` lattice points that are no corners, all sets of them equally likely.
///
/// Robert W. Floyd's sampling without replacement (Jon Bentley, "Programming pearls: a sample of
/// brilliance", 1987), from a stream that a seed fixes on every machine.
fn random_points(
    width: usize,
    height: usize,
    size: usize,
    seed: u64,
    poller: &mut Poller<'_>,
) -> Result<Vec<u8>, Cancelled> {
    let all = width * height;
    // The lattice index of the inner point of this number, the corners being skipped.
    let inner = |i: usize| match i {
        _ if i + 2 < width => i + 1,
        _ if i + 2 < all - width => i + 2,
        _ => i + 3,
    };
    let (mut marks, mut stream) = (vec![0; all], ChaCha8Rng::seed_from_u64(seed));
    for bound in all - size..all - 4 {
        poller.step(1)?;
        // The high half of a product maps 64 random bits to 0..=bound with a bias below 2^-24.
        let drawn = ((u128::from(stream.next_u64()) * (bound as u128 + 1)) >> 64) as usize;
        let chosen = if marks[inner(drawn)] == 0 { drawn } else { bound };
        marks[inner(chosen)] = 1;
    }
    Ok(marks)
}

/// Marks a regular grid of at most `size` points whose outermost ones lie on the border, with
/// steps as equal in both directions as whole numbers of rows and columns allow.
fn uniform_points(
    width: usize,
    height: usize,
    size: usize,
    poller: &mut Poller<'_>,
) -> Result<Vec<u8>, Cancelled> {
    let aspect = (width - 1) as f64 / (height - 1) as f64;
    let rows = ((size as f64 / aspect).sqrt().round() as usize).clamp(2, height.min(size / 2));
    let columns = (size / rows).clamp(2, width);
    let position =
        |i: usize, count: usize, side: usize| (i * (side - 1) + (count - 1) / 2) / (count - 1);
    let mut marks = vec![0; width * height];
    for j in 0..rows {
        poller.step(columns)?;
        for i in 0..columns {
            marks[position(j, rows, height) * width + position(i, columns, width)] = 1;
        }
    }
    Ok(marks)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::POINTS_PER_POLL;
    use crate::control::tests::{Recorder, poller};
    use crate::parameters::Target;
    use crate::parameters::choices::Policy;

    fn count(chosen: &[u8]) -> usize {
        chosen.iter().map(|&mark| usize::from(mark)).sum()
    }

    fn random(width: usize, height: usize, size: usize, seed: u64) -> Vec<u8> {
        random_points(width, height, size, seed, &mut poller()).unwrap()
    }

    fn uniform(width: usize, height: usize, size: usize) -> Vec<u8> {
        uniform_points(width, height, size, &mut poller()).unwrap()
    }

    fn gradient(width: usize, height: usize) -> Image {
        let samples = (0..width * height).map(|i| (i * i % 251) as u16).collect();
        Image::from_bottom_up(width, height, 8, vec![samples]).unwrap()
    }

    fn with_generator(generator: Generator) -> Parameters {
        Parameters { generator, ..Parameters::default().target(Target::Percent(50.0)) }
    }

    #[test]
    fn sizes_out_of_bounds_are_refused() {
        for generator in Generator::ALL {
            for size in [0, 3, 31] {
                let refused =
                    sample_points(&gradient(6, 5), &with_generator(*generator), size, &());
                let error = refused.unwrap_err().to_string();
                assert_eq!(error, format!("size is {size}, but must lie in 4 to 30"));
            }
            let points = sample_points(&gradient(6, 5), &with_generator(*generator), 4, &());
            assert!(points.unwrap().len() >= 4, "{generator}");
        }
    }

    #[test]
    fn parameters_out_of_bounds_are_refused() {
        let even = Parameters { smoothing_order: 4, ..with_generator(Generator::Uniform) };
        let refused = sample_points(&gradient(6, 5), &even, 5, &());
        assert!(matches!(refused, Err(MeshingError::Parameter(_))), "{refused:?}");
        let colour =
            Parameters { policy: Policy::Psc, ..Parameters::default().target(Target::Size(5)) };
        let refused = sample_points(&gradient(6, 5), &colour, 5, &());
        assert!(matches!(refused, Err(MeshingError::Parameter(_))), "{refused:?}");
    }

    #[test]
    fn polls_are_frequent_in_any_shape() {
        for (width, height) in [(20, 60_000), (1100, 1100), (60_000, 20)] {
            let size = width * height / 2;
            for generator in [Generator::All, Generator::Random, Generator::Uniform] {
                let recorder = Recorder::default();
                let image = gradient(width, height);
                sample_points(&image, &with_generator(generator), size, &recorder).unwrap();
                let polls = recorder.reports().len();
                assert!(polls >= width * height / (2 * POINTS_PER_POLL), "{generator}: {polls}");
            }
        }
    }

    #[test]
    fn random_points_have_the_size_and_follow_the_seed() {
        for size in [4, 5, 30, 70] {
            let chosen = random(10, 7, size, 1);
            assert_eq!(count(&chosen), size - 4);
            assert_eq!(chosen, random(10, 7, size, 1));
        }
        assert_ne!(random(10, 7, 30, 1), random(10, 7, 30, 2));
    }

    #[test]
    fn uniform_points_hold_the_corners() {
        for (width, height, size) in
            [(10, 10, 25), (100, 3, 40), (2, 50, 10), (7, 7, 4), (5, 5, 24)]
        {
            let chosen = uniform(width, height, size);
            for corner in [0, width - 1, width * (height - 1), width * height - 1] {
                assert_eq!(chosen[corner], 1);
            }
            assert!(
                count(&chosen) <= size && count(&chosen) * 2 > size,
                "{} of {size}",
                count(&chosen)
            );
        }
    }

    #[test]
    fn uniform_points_have_equal_steps() {
        for (width, height, size, rows, columns) in [
            (5, 9, 15, 5, 3),
            (5, 5, 10, 3, 3),
            (5, 5, 7, 3, 2),
            (3, 5, 8, 4, 2),
            (101, 51, 66, 6, 11),
        ] {
            let chosen = uniform(width, height, size);
            let in_rows = chosen.chunks(width).filter(|row| row.contains(&1)).count();
            assert_eq!(
                (in_rows, count(&chosen)),
                (rows, rows * columns),
                "{width} {height} {size}"
            );
        }
    }

    #[test]
    fn all_inner_points_are_equally_likely() {
        let mut times = [0; 9];
        for seed in 0..400 {
            let chosen = random(3, 3, 6, seed);
            times.iter_mut().zip(chosen).for_each(|(times, mark)| *times += usize::from(mark));
        }
        // Two of five inner points each time: 160 times each on average.
        for (point, &times) in times.iter().enumerate() {
            let expected = if [0, 2, 6, 8].contains(&point) { 0..1 } else { 120..200 };
            assert!(expected.contains(&times), "{point}: {times}");
        }
    }

    #[test]
    fn insertion_stops_without_error() {
        use crate::parameters::method::Method;

        let samples: Vec<u16> = (0..64).map(|i| if i == 27 { 9 } else { 0 }).collect();
        let image = Image::from_bottom_up(8, 8, 8, vec![samples]).unwrap();
        let of = |size| {
            let parameters = Method::Preview.parameters(Target::Size(size));
            sample_points(&image, &parameters, size, &()).unwrap().len()
        };
        assert_eq!(of(5), 5);
        assert!(of(20) <= 20 && of(63) < 63, "nearly all of it is flat");
        assert_eq!(of(64), 64);
    }
}
