//! The initial points of a mesh, by each of the generators.

pub(crate) mod error_diffusion;
pub(crate) mod floyd_steinberg;
pub(crate) mod greedy_insertion;
pub(crate) mod threshold_search;

use crate::control::{Cancelled, Control};
use crate::density::Density;
use crate::image::{Image, Point, corner_points};
use crate::parameters::choices::Generator;
use crate::parameters::{Parameters, Weights};
use crate::points::error_diffusion::diffuse_to_size;
use crate::points::greedy_insertion::inserted_points;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Chooses about `size` initial points of an image, by row, then column, the four corners among
/// them.
///
/// Error diffusion chooses within its tolerance of `size`, then the corners are added; the other
/// generators count the corners. Greedy insertion chooses fewer where these leave no error. `size` is at most the number of lattice points, and all of these
/// are taken when it is that number.
///
/// # Errors
/// When the control cancels.
pub fn sample_points(
    image: &Image,
    parameters: &Parameters,
    size: usize,
    control: &dyn Control,
) -> Result<Vec<Point>, Cancelled> {
    let (width, height) = (image.width(), image.height());
    if parameters.generator == Generator::Insertion && size < width * height {
        let weights = parameters.weights.as_ref().map(Weights::values);
        return inserted_points(image, parameters.error_metric, weights, size, control);
    }
    let mut chosen = match parameters.generator {
        _ if size >= width * height => vec![1; width * height],
        Generator::All | Generator::Insertion => vec![1; width * height],
        Generator::Random => random_points(width, height, size, parameters.seed),
        Generator::Uniform => uniform_points(width, height, size),
        Generator::ErrorDiffusion => {
            let density = Density::new(image, parameters, control)?;
            diffuse_to_size(&density, size, parameters, control)?
        }
    };
    for corner in corner_points(width, height) {
        chosen[corner.y as usize * width + corner.x as usize] = 1;
    }
    Ok(marked_points(&chosen, width))
}

/// The marked lattice points, by row, then column.
fn marked_points(chosen: &[u8], width: usize) -> Vec<Point> {
    let mut points = Vec::with_capacity(chosen.iter().map(|&mark| usize::from(mark)).sum());
    for (y, row) in chosen.chunks_exact(width).enumerate() {
        let marked = row.iter().enumerate().filter(|(_, mark)| **mark != 0);
        points.extend(marked.map(|(x, _)| Point::new(x as i32, y as i32)));
    }
    points
}

/// Marks the corners and `size - 4` other lattice points, all sets of them equally likely.
///
/// Robert W. Floyd's sampling without replacement (Jon Bentley, "Programming pearls: a sample of
/// brilliance", 1987), over a stream that is the same for a seed on every machine.
fn random_points(width: usize, height: usize, size: usize, seed: u64) -> Vec<u8> {
    let mut chosen = vec![0; width * height];
    let corners = corner_points(width, height).map(|p| p.y as usize * width + p.x as usize);
    let inner: Vec<u32> = (0..width * height)
        .filter(|place| !corners.contains(place))
        .map(|place| place as u32)
        .collect();
    let mut stream = ChaCha8Rng::seed_from_u64(seed);
    for bound in inner.len() - (size - corners.len()).min(inner.len())..inner.len() {
        // The high half of a 128-bit product maps 64 random bits to 0..=bound, evenly but for
        // a bias below 2^-24.
        let drawn = ((u128::from(stream.next_u64()) * (bound as u128 + 1)) >> 64) as usize;
        let drawn = inner[drawn] as usize;
        let place = if chosen[drawn] == 0 { drawn } else { inner[bound] as usize };
        chosen[place] = 1;
    }
    chosen
}

/// Marks a regular grid of about `size` points whose outermost ones lie on the border, with
/// steps as equal in both directions as whole numbers of rows and columns allow.
fn uniform_points(width: usize, height: usize, size: usize) -> Vec<u8> {
    let aspect = (width - 1) as f64 / (height - 1) as f64;
    let rows = ((size as f64 / aspect).sqrt().round() as usize).clamp(2, height.min(size / 2));
    let columns = (size / rows).clamp(2, width);
    let place =
        |i: usize, count: usize, side: usize| (i * (side - 1) + (count - 1) / 2) / (count - 1);
    let mut chosen = vec![0; width * height];
    for j in 0..rows {
        for i in 0..columns {
            chosen[place(j, rows, height) * width + place(i, columns, width)] = 1;
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(chosen: &[u8]) -> usize {
        chosen.iter().map(|&mark| usize::from(mark)).sum()
    }

    #[test]
    fn random_points_are_as_many_as_asked_and_the_same_for_a_seed() {
        for size in [4, 5, 30, 70] {
            let chosen = random_points(10, 7, size, 1);
            assert_eq!(count(&chosen), size - 4);
            assert_eq!(chosen, random_points(10, 7, size, 1));
        }
        assert_ne!(random_points(10, 7, 30, 1), random_points(10, 7, 30, 2));
    }

    #[test]
    fn uniform_points_hold_the_corners_and_do_not_exceed_the_size() {
        for (width, height, size) in
            [(10, 10, 25), (100, 3, 40), (2, 50, 10), (7, 7, 4), (5, 5, 24)]
        {
            let chosen = uniform_points(width, height, size);
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
    fn uniform_points_have_steps_as_equal_as_rows_and_columns_allow() {
        for (width, height, size, rows, columns) in [
            (5, 9, 15, 5, 3),
            (5, 5, 10, 3, 3),
            (5, 5, 7, 3, 2),
            (3, 5, 8, 4, 2),
            (101, 51, 66, 6, 11),
        ] {
            let chosen = uniform_points(width, height, size);
            let in_rows = chosen.chunks(width).filter(|row| row.contains(&1)).count();
            assert_eq!(
                (in_rows, count(&chosen)),
                (rows, rows * columns),
                "{width} {height} {size}"
            );
        }
    }

    #[test]
    fn any_lattice_point_may_be_a_random_one() {
        let mut times = [0; 9];
        for seed in 0..400 {
            let chosen = random_points(3, 3, 6, seed);
            times.iter_mut().zip(chosen).for_each(|(times, mark)| *times += usize::from(mark));
        }
        // Two of the five that are no corners, and these 160 times each on average.
        for (place, &times) in times.iter().enumerate() {
            let expected = if [0, 2, 6, 8].contains(&place) { 0..1 } else { 120..200 };
            assert!(expected.contains(&times), "{place}: {times}");
        }
    }

    #[test]
    fn insertion_gives_no_more_points_than_asked_for_unless_all_are() {
        use crate::parameters::Target;
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
