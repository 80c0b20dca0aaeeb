//! Refinement: better meshes of the same size, beyond the thesis.
//!
//! Greedy removal looks at one vertex at a time and never puts one back. Here the mesh it leaves is
//! improved by descent: vertices move (`relocation`), change places with better ones (`swaps`), and
//! the mesh grows and shrinks again (`growth`, quickly by `batch_removal`), each step scored by the true change of the error
//! over the faces that change (`measured_mesh`, on a `dynamic_triangulation`). The model stays
//! what it is, a preferred-directions Delaunay triangulation of points that carry the image's own
//! samples. Beyond that model `liberation` flips edges, fits values (`fitted_values`) and moves
//! vertices with their values (`vertex_moves`, on a `valued_mesh`). The steps and their order are in `schedule`. Figures are in `docs/quality.md`.

mod batch_removal;
pub(crate) mod growth;
mod insertion_candidates;
mod relocation;
mod removal_costs;
pub(crate) mod schedule;
mod swaps;
pub(crate) mod unconstrained;

use crate::control::{Cancelled, Control, Stage};
use crate::dynamic_mesh::{FaceMeasure, MeasuredMesh};
use batch_removal::remove_in_batches;
use growth::Among;
use relocation::{Look, Relocation, Scope};
use schedule::Step;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A round of growth pays when it takes off at least this part of the error: 0.0009 dB.
const PAYS: f64 = 2e-4;

/// Rounds of growth of one kind at most.
const MOST_ROUNDS: usize = 40;

/// The part of the error that is left when 1.03 dB have been gained: a decibel over MGPRFS, whose exact
/// order may leave a mesh a little better than the tiles do that refinement begins with.
const GOAL: f64 = 0.788_86;

/// Decibels for each part of the error to be gained, where these are few: `10 / ln 10`.
const DECIBELS_PER_PART: f64 = 4.343;

/// Where no more decibels are lacking, one more look at the vertices is tried: it gains some 0.01 to 0.04.
const LITTLE: f64 = 0.06;

/// Where no more are lacking, a decibel and a little more has been gained, and nothing more is done.
const NEGLIGIBLE: f64 = 0.015;

/// How many percent a mesh grows for the decibels that it lacks.
struct Rate {
    per_decibel: f64,
    least: usize,
    most: usize,
}

/// In the first round of growth: a half of a decibel and more is lacking then, or it lacks so little that
/// any growth reaches the goal.
const FIRST: Rate = Rate { per_decibel: 45.0, least: 20, most: 25 };

/// In the round that is to reach the goal: by 8 percent it gains some 0.1 dB, as vertices find better
/// places in it too.
const LAST: Rate = Rate { per_decibel: 80.0, least: 4, most: 14 };

impl Rate {
    fn percent(&self, decibels: f64) -> usize {
        ((self.per_decibel * decibels).ceil() as usize).clamp(self.least, self.most)
    }
}

/// How a mesh grows and shrinks again.
#[derive(Clone, Copy)]
struct Growth {
    among: Among,
    /// How its vertices look for better places.
    look: Look,
    /// Which of them do while there are more than may stay.
    scope: Scope,
    /// Whether it shrinks by many vertices at a time.
    is_in_batches: bool,
    /// Which vertices look after it has shrunk, and how often at most.
    settling_scope: Scope,
    settling_passes: usize,
}

/// For the least time.
const QUICK: Growth = Growth {
    among: Among::First,
    look: Look::Foresighted,
    scope: Scope::Inner,
    is_in_batches: true,
    settling_scope: Scope::Most,
    settling_passes: 1,
};

/// For the best mesh.
const THOROUGH: Growth = Growth {
    among: Among::All,
    look: Look::Thorough,
    scope: Scope::All,
    is_in_batches: false,
    settling_scope: Scope::All,
    settling_passes: 4,
};

/// Moves the vertices of a mesh so that its error falls, with an effort of 0 (nothing) to 9; their
/// number stays.
///
/// # Errors
/// When the control cancels.
pub(crate) fn refine<M: FaceMeasure>(
    mesh: MeasuredMesh<M>,
    effort: u8,
    control: &dyn Control,
) -> Result<MeasuredMesh<M>, Cancelled> {
    let (relocation, error_at_first) = (Relocation::new(&mesh), mesh.total_error());
    let mut refinement = Refinement { mesh, relocation, error_at_first };
    let count = schedule::steps(effort).count();
    for (done, step) in schedule::steps(effort).enumerate() {
        let control = Part { control, done, count, reached: AtomicUsize::new(0) };
        control.poll(Stage::Refine, 0, 1)?;
        refinement.take(step, &control)?;
    }
    Ok(refinement.mesh)
}

/// Parts of a step that progress is told in.
const PARTS: usize = 1000;

/// Tells of the progress of one step as part of all; never of less than before.
struct Part<'a> {
    control: &'a dyn Control,
    done: usize,
    count: usize,
    /// Parts of this step that have been told of.
    reached: AtomicUsize,
}

impl Control for Part<'_> {
    fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
        let part = done.min(total) * PARTS / total.max(1);
        let reached = self.reached.fetch_max(part, Ordering::Relaxed).max(part);
        self.control.poll(stage, self.done * PARTS + reached, self.count * PARTS)
    }

    fn threads(&self) -> NonZeroUsize {
        self.control.threads()
    }
}

/// A mesh being refined.
struct Refinement<M> {
    mesh: MeasuredMesh<M>,
    relocation: Relocation,
    error_at_first: u64,
}

impl<M: FaceMeasure> Refinement<M> {
    fn take(&mut self, step: Step, control: &dyn Control) -> Result<(), Cancelled> {
        match step {
            Step::Relocate(look) => self.relocate(look, control),
            Step::RelocateAll(look) => {
                self.relocation.restart();
                self.relocate(look, control)
            }
            Step::Swap => {
                let face_count = self.mesh.triangulation.slot_count() / 4;
                swaps::swap_vertices(&mut self.mesh, face_count, &mut self.relocation, control)
            }
            Step::GrowQuickly(percent) => self.grow(percent, QUICK, control).map(|_| ()),
            Step::GrowForDecibel => {
                let percent = FIRST.percent(self.decibels_to_goal());
                self.grow(percent, QUICK, control).map(|_| ())
            }
            Step::ReachDecibel => self.reach(self.decibels_to_goal(), control),
            Step::Grow(percent) => self.grow(percent, THOROUGH, control).map(|_| ()),
            Step::GrowWhileItPays(percent) => {
                for _ in 0..MOST_ROUNDS {
                    if !self.grow(percent, THOROUGH, control)? {
                        break;
                    }
                }
                Ok(())
            }
        }
    }

    fn relocate(&mut self, look: Look, control: &dyn Control) -> Result<(), Cancelled> {
        let scope = if look == Look::Foresighted { Scope::Most } else { Scope::All };
        self.relocation.pass(&mut self.mesh, (look, scope), control).map(|_| ())
    }

    /// How many decibels of the goal are lacking, not more than 0 where it is reached.
    fn decibels_to_goal(&self) -> f64 {
        decibels_to_goal(self.error_at_first, self.mesh.total_error())
    }

    /// Does what is foreseen to gain so many decibels, where these are few.
    fn reach(&mut self, decibels: f64, control: &dyn Control) -> Result<(), Cancelled> {
        if decibels > LITTLE {
            self.grow(LAST.percent(decibels), QUICK, control)?;
        } else if decibels > NEGLIGIBLE {
            self.relocate(QUICK.look, control)?;
        }
        Ok(())
    }

    /// Has the mesh grow and shrink again, unless that raises its error; tells whether it paid.
    fn grow(
        &mut self,
        percent: usize,
        growth: Growth,
        control: &dyn Control,
    ) -> Result<bool, Cancelled> {
        let (snapshot, relocation_before) = (self.mesh.snapshot(), self.relocation.clone());
        let before = self.mesh.total_error();
        let Self { mesh, relocation, .. } = self;
        let count = (mesh.vertex_count() * percent).div_ceil(100);
        let grown = growth::grow(mesh, (count, growth.among), relocation, control)?;
        relocation.pass(mesh, (growth.look, growth.scope), control)?;
        let note = |around: &[u32]| relocation.note(around);
        if growth.is_in_batches {
            remove_in_batches(mesh, grown, note, control)?;
        } else {
            growth::shrink(mesh, grown, note, control)?;
        }
        for _ in 0..growth.settling_passes {
            if relocation.pass(mesh, (growth.look, growth.settling_scope), control)? == 0 {
                break;
            }
        }
        let after = mesh.total_error();
        if after >= before {
            mesh.restore(snapshot);
            self.relocation = relocation_before;
            return Ok(false);
        }
        Ok((before - after) as f64 >= PAYS * before as f64)
    }
}

/// The same for an error and that at first, to a hundredth where few are lacking.
fn decibels_to_goal(error_at_first: u64, error: u64) -> f64 {
    DECIBELS_PER_PART * (error as f64 / (error_at_first as f64 * GOAL) - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::face_error::{FaceErrors, Measure};
    use crate::image::{Image, Point, corner_points};
    use crate::model::flat_color::{FlatFaces, RowSums};
    use crate::parameters::choices::ErrorMetric;
    use crate::triangulation::{Face, triangulate};
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    /// A shaded picture with an edge and some texture.
    fn shaded(side: usize) -> Image {
        let sample = |i: usize, c: usize| {
            let (x, y) = (i % side, i / side);
            let on_disc = x.abs_diff(side / 3).pow(2) + y.abs_diff(side / 2).pow(2) < side * 4;
            let texture = (x * 7 + y * 13) % 5 * 6;
            (x * x / 40 + y * (1 + c) + if on_disc { 90 } else { 0 } + texture).min(255) as u16
        };
        let component = |c| (0..side * side).map(|i| sample(i, c)).collect();
        Image::from_bottom_up(side, side, 8, vec![component(0), component(1)]).unwrap()
    }

    /// 104 points of a picture 64 columns wide and high, the corners among them.
    fn scattered() -> Vec<Point> {
        let seeds = (0..100).map(|i| Point::new(i % 10 * 6 + i / 10 % 2 * 3 + 2, i / 10 * 6 + 3));
        let points: BTreeSet<Point> = seeds.chain(corner_points(64, 64)).collect();
        points.into_iter().collect()
    }

    /// Changes of the schedule, of what a step does, and of the order of vertices and places change
    /// these numbers; nothing else may.
    #[test]
    fn each_effort_comes_to_the_same_error_on_every_machine() {
        let image = shaded(64);
        let points = scattered();
        let measure = measure_of(&image);
        let errors: Vec<u64> = (0..=9)
            .map(|effort| {
                let mesh = measured(&measure, &image, points.clone());
                refine(mesh, effort, &()).unwrap().total_error()
            })
            .collect();
        let known =
            [2110560, 840774, 725280, 678972, 675990, 668030, 661020, 655778, 653932, 653932];
        assert_eq!(errors, known);
    }

    /// The same for samples of more than 8 bits, whose moves are foreseen in floating point too.
    #[test]
    fn a_picture_of_twelve_bits_is_refined_by_forecasts_to_the_same_error_on_every_machine() {
        let shaded = shaded(64);
        let finer = |samples: &Vec<u16>| {
            samples.iter().enumerate().map(|(i, sample)| sample * 16 + (i % 7) as u16).collect()
        };
        let components = shaded.components().iter().map(finer).collect();
        let image = Image::from_bottom_up(64, 64, 12, components).unwrap();
        let [by_forecasts, by_trials] = [Measure::with_model, Measure::new].map(|new| {
            let measure = new(&image, ErrorMetric::MeanCompSe);
            let mesh = measured(&measure, &image, scattered());
            refine(mesh, 1, &()).unwrap().total_error()
        });
        assert_eq!((by_forecasts, by_trials), (218_475_408, 217_276_596));
    }

    #[test]
    fn what_is_lacking_of_a_decibel_is_told_to_a_hundredth_where_it_is_little() {
        let first = 1u64 << 40;
        for gained in [0.9, 0.95, 1.0, 1.03, 1.2] {
            let error = (first as f64 * 10f64.powf(-gained / 10.0)) as u64;
            let lacking = decibels_to_goal(first, error);
            assert!((lacking - (1.03 - gained)).abs() < 0.01, "{lacking} after {gained}");
        }
        assert!(decibels_to_goal(first, first) > 1.0);
        // Nothing is lacking where there is no error.
        assert!(decibels_to_goal(0, 0).is_nan());
    }

    #[test]
    fn a_mesh_looks_again_or_grows_for_a_decibel_that_it_lacks_and_rests_when_it_has_it() {
        let image = shaded(64);
        let points = scattered();
        let measure = measure_of(&image);
        let refined = |decibels: f64| {
            let mesh = measured(&measure, &image, points.clone());
            let (relocation, error_at_first) = (Relocation::new(&mesh), mesh.total_error());
            let mut refinement = Refinement { mesh, relocation, error_at_first };
            refinement.reach(decibels, &()).unwrap();
            let mesh = refinement.mesh;
            // Growth gives numbers to more vertices than stay.
            assert_eq!(mesh.vertex_count(), points.len());
            (mesh.total_error(), mesh.triangulation.points.len() - points.len())
        };
        let (at_first, _) = refined(0.0);
        assert_eq!(refined(NEGLIGIBLE), (at_first, 0));
        for decibels in [0.016, LITTLE] {
            let (looked, more) = refined(decibels);
            assert!(looked < at_first && more == 0, "{looked} of {at_first}, {more} more");
        }
        let more = [0.061, 0.1, 0.12, 1.0, f64::INFINITY].map(|decibels| refined(decibels).1);
        // 5, 8, 10, 14 and 14 percent of 104.
        assert_eq!(more, [6, 9, 11, 15, 15]);
        let first =
            [f64::NAN, -1.0, 0.4, 0.45, 0.5, 0.55, 9.0].map(|decibels| FIRST.percent(decibels));
        assert_eq!(first, [20, 20, 20, 21, 23, 25, 25]);
        assert_eq!(refined(f64::NAN).0, at_first);
    }

    #[test]
    fn with_foresight_the_vertices_at_the_edges_of_patches_are_left_to_later_passes() {
        let image = shaded(128);
        let seeds = (0..60 * 60).map(|i| Point::new(i % 60 * 2 + 3, i / 60 * 2 + 3));
        let points: BTreeSet<Point> = seeds.chain(corner_points(128, 128)).collect();
        let points: Vec<Point> = points.into_iter().collect();
        let measure = measure_of(&image);
        for (look, scope) in [(Look::Foresighted, Scope::Most), (Look::Thorough, Scope::All)] {
            let mesh = measured(&measure, &image, points.clone());
            let relocation = Relocation::new(&mesh);
            let mut refinement = Refinement { mesh, relocation, error_at_first: 0 };
            refinement.relocate(look, &()).unwrap();
            let passed = |scope| {
                let mut mesh = measured(&measure, &image, points.clone());
                Relocation::new(&mesh).pass(&mut mesh, (look, scope), &()).unwrap();
                mesh.total_error()
            };
            assert_eq!(refinement.mesh.total_error(), passed(scope), "{look:?}");
            assert_ne!(passed(Scope::Most), passed(Scope::All), "{look:?}");
        }
    }

    #[test]
    fn what_is_lacking_is_that_of_the_error_at_first() {
        let image = shaded(64);
        let points = scattered();
        let measure = measure_of(&image);
        for (step, part, more) in [
            (Step::GrowForDecibel, 1, 26),
            (Step::GrowForDecibel, 2, 21),
            (Step::ReachDecibel, 1, 15),
            (Step::ReachDecibel, 2, 0),
        ] {
            let mesh = measured(&measure, &image, points.clone());
            // All of the decibel is lacking, or twice the error has been there.
            let (relocation, error_at_first) = (Relocation::new(&mesh), part * mesh.total_error());
            let mut refinement = Refinement { mesh, relocation, error_at_first };
            refinement.take(step, &()).unwrap();
            // 25, 20, 14 and 0 percent of 104.
            let numbered = refinement.mesh.triangulation.points.len();
            assert_eq!(numbered - points.len(), more, "{step:?}, {part}");
        }
    }

    #[test]
    fn a_mesh_of_flat_faces_is_refined_by_their_errors() {
        let image = shaded(40);
        let sums = RowSums::new(&image);
        let seeds = (0..60).map(|i| Point::new(i * 37 % 40, i * 23 % 39));
        let points: BTreeSet<Point> = seeds.chain(corner_points(40, 40)).collect();
        let points: Vec<Point> = points.into_iter().collect();
        let faces = triangulate(&points);
        let mesh = MeasuredMesh::new(points, &faces, (40, 40), FlatFaces::new(&sums));
        let before = mesh.total_error();
        let refined = refine(mesh, 5, &()).unwrap();
        let (points, faces, _) = refined.triangulation.mesh();
        let error = |face: &Face| FlatFaces::new(&sums).error(face.map(|v| points[v as usize]));
        assert_eq!(refined.total_error(), faces.iter().map(error).sum::<u64>());
        assert!(refined.total_error() < before);
    }

    #[test]
    fn growth_is_repeated_up_to_the_first_time_that_takes_off_less_than_the_5000th_part() {
        let image = shaded(64);
        let measure = measure_of(&image);
        let seeds = (0..200).map(|i| Point::new(i * 37 % 64, i * 23 % 61));
        let points: BTreeSet<Point> = seeds.chain(corner_points(64, 64)).collect();
        let points: Vec<Point> = points.into_iter().collect();
        let new = || {
            let mesh = measured(&measure, &image, points.clone());
            let relocation = Relocation::new(&mesh);
            Refinement { mesh, relocation, error_at_first: 0 }
        };
        let (mut at_once, mut in_turn) = (new(), new());
        at_once.take(Step::GrowWhileItPays(10), &()).unwrap();
        let mut errors = vec![in_turn.mesh.total_error()];
        let mut paid = true;
        while paid {
            paid = in_turn.grow(10, THOROUGH, &()).unwrap();
            let (before, after) = (errors[errors.len() - 1], in_turn.mesh.total_error());
            assert_eq!(paid, (before - after) * 5000 >= before, "{before} to {after}");
            errors.push(after);
        }
        assert_eq!(at_once.mesh.triangulation.points, in_turn.mesh.triangulation.points);
        let last: Vec<u64> = errors[errors.len() - 2..].to_vec();
        assert!(errors.len() > 4 && last[1] < last[0], "{errors:?}");
    }

    #[test]
    fn the_progress_of_a_step_is_a_part_of_all_and_never_goes_back() {
        #[derive(Default)]
        struct Told(std::sync::Mutex<Vec<(Stage, usize, usize)>>);
        impl Control for Told {
            fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
                self.0.lock().unwrap().push((stage, done, total));
                if done == 3 * PARTS { Err(Cancelled) } else { Ok(()) }
            }
            fn threads(&self) -> NonZeroUsize {
                NonZeroUsize::new(7).unwrap()
            }
        }
        let told = Told::default();
        let part = Part { control: &told, done: 2, count: 5, reached: AtomicUsize::new(0) };
        for (done, total) in [(0, 0), (0, 10), (5, 10), (3, 10), (60, 100)] {
            part.poll(Stage::Refine, done, total).unwrap();
        }
        assert_eq!(part.poll(Stage::Refine, 12, 10), Err(Cancelled));
        assert_eq!(part.threads(), told.threads());
        let told = told.0.into_inner().unwrap();
        assert!(told.iter().all(|&(stage, _, total)| stage == Stage::Refine && total == 5000));
        let told: Vec<usize> = told.iter().map(|&(_, done, _)| done).collect();
        assert_eq!(told, [2000, 2000, 2500, 2500, 2600, 3000]);
    }

    /// A picture of few levels in two components, and points of it, the corners among them.
    pub(super) fn picture(
        width: usize,
        height: usize,
        samples: &[u16],
        seeds: &[(usize, usize)],
    ) -> (Image, Vec<Point>) {
        let plane = |c: usize| samples.iter().map(|s| (s >> c) % 8).take(width * height).collect();
        let image = Image::from_bottom_up(width, height, 3, vec![plane(0), plane(3)]).unwrap();
        let inner = seeds.iter().map(|&(x, y)| Point::new((x % width) as i32, (y % height) as i32));
        let points: BTreeSet<Point> = inner.chain(corner_points(width, height)).collect();
        (image, points.into_iter().collect())
    }

    /// What faces of an image are measured against.
    pub(super) fn measure_of(image: &Image) -> Measure<'_> {
        Measure::new(image, ErrorMetric::MeanCompSe)
    }

    /// The measured triangulation of points given by row, then column.
    pub(super) fn measured<'m>(
        measure: &'m Measure<'m>,
        image: &Image,
        points: Vec<Point>,
    ) -> MeasuredMesh<FaceErrors<'m>> {
        let faces = triangulate(&points);
        let size = (image.width(), image.height());
        MeasuredMesh::new(points, &faces, size, FaceErrors::new(measure))
    }

    /// The squared error of faces that carry the image's samples.
    pub(super) fn sum_of_errors(image: &Image, points: &[Point], faces: &[Face]) -> u64 {
        let measure = measure_of(image);
        let mut errors = FaceErrors::new(&measure);
        faces.iter().map(|face| errors.error(face.map(|v| points[v as usize]))).sum()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn more_effort_is_never_worse_and_what_is_known_of_the_mesh_is_what_is_computed_afresh(
            (width, height) in (2usize..12, 2usize..12),
            samples in prop::collection::vec(0u16..64, 144),
            seeds in prop::collection::vec((0usize..12, 0usize..12), 0..30),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let (measure, count) = (measure_of(&image), points.len());
            let mut last = measured(&measure, &image, points.clone()).total_error();
            for effort in [0, 1, 3, 6, 9] {
                let mesh = refine(measured(&measure, &image, points.clone()), effort, &()).unwrap();
                let (points, faces, _) = mesh.triangulation.mesh();
                prop_assert_eq!(points.len(), count);
                prop_assert_eq!(&faces, &triangulate(&points));
                let error = sum_of_errors(&image, &points, &faces);
                prop_assert_eq!(mesh.total_error(), error);
                prop_assert!(error <= last);
                last = error;
            }
        }

        #[test]
        fn growth_that_does_not_lower_the_error_leaves_everything_as_it_was(
            (width, height) in (2usize..12, 2usize..12),
            samples in prop::collection::vec(0u16..3, 144),
            seeds in prop::collection::vec((0usize..12, 0usize..12), 0..30),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let measure = measure_of(&image);
            let mesh = measured(&measure, &image, points);
            let relocation = Relocation::new(&mesh);
            let mut refinement = Refinement { mesh, relocation, error_at_first: 0 };
            for _ in 0..4 {
                let before = (refinement.mesh.total_error(), refinement.mesh.triangulation.mesh());
                let paid = refinement.grow(30, THOROUGH, &()).unwrap();
                if refinement.mesh.total_error() == before.0 {
                    prop_assert!(!paid);
                    prop_assert_eq!(refinement.mesh.triangulation.mesh(), before.1);
                }
            }
        }
    }
}
