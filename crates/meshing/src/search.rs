//! The search for the smallest mesh of a quality, for methods that do not simplify or that refine:
//! one run makes a mesh of one size only.
//!
//! The quality of such meshes nearly always grows with their size. The search doubles or halves the
//! size until the bound lies between two sizes, then bisects.

use crate::control::{Control, Stage, Translated};
use crate::parameters::MIN_SIZE;

/// The first size tried is this part of the lattice points.
const FIRST_PART: usize = 64;

/// The total of progress reports: more meshes than the search ever makes.
const MOST_MESHES: usize = 64;

/// Tries mesh sizes from [`MIN_SIZE`] to `all` until the smallest size that keeps a bound and the
/// largest that does not are neighbours, or differ by at most one part in `precision`.
///
/// `keeps` makes a mesh of a size and returns whether it keeps the bound, as all points would.
pub(crate) fn bisect_size<E>(
    all: usize,
    precision: usize,
    mut keeps: impl FnMut(usize) -> Result<bool, E>,
) -> Result<(), E> {
    let mut size = (all / FIRST_PART).max(MIN_SIZE);
    // The largest size found that does not keep the bound, and the smallest that does.
    let (mut below, mut above) = (MIN_SIZE - 1, None);
    loop {
        if keeps(size)? {
            above = Some(size);
        } else {
            below = size;
        }
        size = match above {
            None if below == all => return Ok(()),
            None => (2 * below).min(all),
            Some(above) if above <= below + 1 + above / precision => return Ok(()),
            Some(above) if below < MIN_SIZE => (above / 2).max(MIN_SIZE),
            Some(above) => below.midpoint(above),
        };
    }
}

/// A control that reports the number of meshes made so far, not the stages of each.
pub(crate) fn count_meshes(control: &dyn Control, made: usize) -> impl Control {
    let count = (Stage::Search, made.min(MOST_MESHES), MOST_MESHES);
    Translated { control, translate: move |_, _, _| count }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::OnThreads;
    use crate::control::tests::Recorder;
    use crate::image::Image;
    use crate::model::rasterize::rasterize;
    use crate::parameters::Target;
    use crate::parameters::method::Method;
    use crate::pipeline::{is_within, mesh_image};
    use std::num::NonZeroUsize;

    /// A slope with a disc on it.
    fn slope_with_disc() -> Image {
        let sample = |i: usize| {
            let (x, y) = (i as i32 % 32, i as i32 / 32);
            (3 * x + 2 * y) as u16 + if (x - 16).pow(2) + (y - 12).pow(2) < 60 { 20 } else { 0 }
        };
        Image::from_bottom_up(32, 32, 8, vec![(0..32 * 32).map(sample).collect()]).unwrap()
    }

    fn psnr_of_size(image: &Image, size: usize) -> f64 {
        let parameters = Method::Preview.parameters(Target::Size(size));
        mesh_image(image, &parameters, &()).unwrap().fidelity.psnr_db()
    }

    #[test]
    fn finds_the_smallest_mesh_around_the_first_size() {
        let image = slope_with_disc();
        let first = image.pixel_count() / FIRST_PART;
        // The bound is the quality of a mesh of this size.
        for wanted in [MIN_SIZE, MIN_SIZE + 2, first - 3, first, first + 5, 3 * first] {
            let bound = psnr_of_size(&image, wanted);
            let parameters = Method::Preview.parameters(Target::Psnr(bound));
            let found = mesh_image(&image, &parameters, &()).unwrap();
            assert!(found.fidelity.psnr_db() >= bound, "{wanted}");
            let size = found.mesh.points().len();
            if size > MIN_SIZE {
                let before = psnr_of_size(&image, size - 1);
                assert!(before < bound, "{wanted}: {} keep the bound, too", size - 1);
            }
        }
    }

    #[test]
    fn bound_of_every_mesh_needs_the_corners_alone() {
        let parameters = Method::Preview.parameters(Target::Psnr(1.0));
        let found = mesh_image(&slope_with_disc(), &parameters, &()).unwrap();
        assert_eq!(found.mesh.points().len(), MIN_SIZE);
    }

    #[test]
    fn reports_the_meshes_made_and_no_other_stage() {
        let control = OnThreads(Recorder::default(), NonZeroUsize::MAX);
        let parameters = Method::Preview.parameters(Target::Psnr(30.0));
        mesh_image(&slope_with_disc(), &parameters, &control).unwrap();
        assert_eq!(count_meshes(&control, 3).threads(), NonZeroUsize::MAX);
        let reports = control.0.reports();
        assert!(reports.iter().all(|(stage, ..)| *stage == Stage::Search), "{reports:?}");
        let meshes = reports.into_iter().filter(|(.., total)| *total == MOST_MESHES);
        let mut meshes: Vec<usize> = meshes.map(|(_, done, _)| done).collect();
        assert!(meshes.is_sorted());
        meshes.dedup();
        assert_eq!(meshes, (0..meshes.len()).collect::<Vec<_>>());
        assert!(meshes.len() > 4, "{meshes:?}");
    }

    #[test]
    fn keeps_a_bound_that_is_just_reached() {
        let image = slope_with_disc();
        let parameters = Method::Preview.parameters(Target::Size(40));
        let made = mesh_image(&image, &parameters, &()).unwrap();
        let rebuilt = rasterize(&made.mesh, &()).unwrap();
        let pairs = || image.components()[0].iter().zip(&rebuilt.components()[0]);
        let most = pairs().map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        let squared: u64 = pairs().map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2)).sum();
        let mean = squared as f64 / 1024.0;
        let keeps =
            |target| is_within(&image, &made, &parameters.clone().target(target), &()).unwrap();
        assert!(most > 1 && mean > 1.0);
        assert!(keeps(Target::MaxError(most)) && !keeps(Target::MaxError(most - 1)));
        assert!(keeps(Target::MeanError(mean)) && !keeps(Target::MeanError(mean * 0.999)));
        let psnr_db = made.fidelity.psnr_db();
        assert!(keeps(Target::Psnr(psnr_db)) && !keeps(Target::Psnr(psnr_db + 0.001)));
    }
}
