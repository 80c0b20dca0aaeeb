//! The search for the smallest mesh of a quality, for methods whose meshes of different sizes have
//! nothing in common: those that do not simplify, and those that refine.
//!
//! The quality of such meshes all but grows with their size, so the search doubles or halves the
//! size until the side changes, then bisects.

use crate::control::{Cancelled, Control, Stage};
use crate::parameters::MIN_SIZE;
use std::num::NonZeroUsize;

/// The first size tried is this part of the lattice points.
const FIRST_PART: usize = 64;

/// What progress is counted in: more meshes than the search ever makes.
const MOST_MESHES: usize = 64;

/// Tries mesh sizes from [`MIN_SIZE`] to `all` until the smallest size that keeps a bound and the
/// largest that does not are neighbours, or differ by at most one part in `precision`.
///
/// `keeps` makes a mesh of a size and tells whether it keeps the bound; the mesh of `all` points is
/// taken to keep it.
///
/// # Errors
/// The first error of `keeps`.
pub(crate) fn bisect_size<E>(
    all: usize,
    precision: usize,
    mut keeps: impl FnMut(usize) -> Result<bool, E>,
) -> Result<(), E> {
    let mut size = (all / FIRST_PART).max(MIN_SIZE);
    // No mesh of `below` points keeps the bound, one of `above` does.
    let (mut below, mut above) = (MIN_SIZE - 1, all);
    if keeps(size)? {
        above = size;
        while above > MIN_SIZE {
            size = (above / 2).max(MIN_SIZE);
            if !keeps(size)? {
                below = size;
                break;
            }
            above = size;
        }
    } else {
        below = size;
        while below < all {
            size = (2 * below).min(all);
            if keeps(size)? {
                above = size;
                break;
            }
            below = size;
        }
    }
    while above > below + 1 + above / precision {
        let middle = below.midpoint(above);
        if keeps(middle)? {
            above = middle;
        } else {
            below = middle;
        }
    }
    Ok(())
}

/// A control that reports the meshes made so far, not the stages of each.
pub(crate) struct SearchProgress<'a> {
    pub(crate) control: &'a dyn Control,
    /// Meshes made so far.
    pub(crate) meshes: usize,
}

impl Control for SearchProgress<'_> {
    fn poll(&self, _: Stage, _: usize, _: usize) -> Result<(), Cancelled> {
        self.control.poll(Stage::Search, self.meshes.min(MOST_MESHES), MOST_MESHES)
    }

    fn threads(&self) -> NonZeroUsize {
        self.control.threads()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;
    use crate::model::rasterize::rasterize;
    use crate::parameters::method::Method;
    use crate::parameters::{ErrorBound, Target};
    use crate::pipeline::{is_within, mesh_image};

    /// A slope with a disc on it: more points make a better mesh of it, and few a fair one.
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
    fn the_smallest_mesh_is_found_below_and_above_the_size_first_tried() {
        let image = slope_with_disc();
        let first = image.pixel_count() / FIRST_PART;
        // What the meshes of these sizes reach is the bound, and no smaller one may be missed.
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
    fn a_bound_that_every_mesh_keeps_needs_the_corners_alone() {
        let parameters = Method::Preview.parameters(Target::Psnr(1.0));
        let found = mesh_image(&slope_with_disc(), &parameters, &()).unwrap();
        assert_eq!(found.mesh.points().len(), MIN_SIZE);
    }

    /// Notes what it is told, on three threads.
    #[derive(Default)]
    struct Notes(std::sync::Mutex<Vec<(Stage, usize, usize)>>);

    impl Control for Notes {
        fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
            self.0.lock().unwrap().push((stage, done, total));
            Ok(())
        }

        fn threads(&self) -> NonZeroUsize {
            NonZeroUsize::new(3).unwrap()
        }
    }

    #[test]
    fn a_search_tells_of_the_meshes_made_and_of_no_other_stage() {
        let notes = Notes::default();
        let parameters = Method::Preview.parameters(Target::Psnr(30.0));
        mesh_image(&slope_with_disc(), &parameters, &notes).unwrap();
        let quiet = SearchProgress { control: &notes, meshes: 3 };
        assert_eq!(quiet.threads(), notes.threads());
        let told = notes.0.into_inner().unwrap();
        let is_of_search = |&(stage, done, total): &(Stage, usize, usize)| {
            stage == Stage::Search && done < total && total == MOST_MESHES
        };
        assert!(told.iter().all(is_of_search));
        assert!(told.is_sorted_by_key(|&(_, done, _)| done));
        let last = told.last().unwrap().1;
        assert!((0..=last).all(|meshes| told.iter().any(|&(_, done, _)| done == meshes)));
        assert!(last > 3, "{last}");
    }

    #[test]
    fn a_bound_is_kept_when_it_is_just_reached() {
        let image = slope_with_disc();
        let parameters = Method::Preview.parameters(Target::Size(40));
        let model = mesh_image(&image, &parameters, &()).unwrap();
        let rebuilt = rasterize(&model.mesh, &()).unwrap();
        let pairs = || image.components()[0].iter().zip(&rebuilt.components()[0]);
        let most = pairs().map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        let squared: u64 = pairs().map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2)).sum();
        let mean = squared as f64 / 1024.0;
        let keeps = |bound| is_within(&image, &model, &parameters, bound, &()).unwrap();
        assert!(most > 1 && mean > 1.0);
        assert!(keeps(ErrorBound::MaxError(most)) && !keeps(ErrorBound::MaxError(most - 1)));
        assert!(keeps(ErrorBound::MeanError(mean)) && !keeps(ErrorBound::MeanError(mean * 0.999)));
        let psnr_db = model.fidelity.psnr_db();
        assert!(keeps(ErrorBound::PsnrDb(psnr_db)) && !keeps(ErrorBound::PsnrDb(psnr_db + 0.001)));
    }
}
