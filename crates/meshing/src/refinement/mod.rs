//! Refinement: better meshes of the same size, beyond the thesis.
//!
//! Greedy removal looks at one vertex at a time and never puts one back. Here the mesh it leaves is
//! improved by descent: vertices move (`relocation`), change places with better ones (`swaps`), and
//! the mesh grows and shrinks again (`growth`, quickly by `batch_removal`), each step scored by the true change of the error
//! over the faces that change (`measured_mesh`, on a `dynamic_triangulation`). The model stays
//! what it is, a preferred-directions Delaunay triangulation of points that carry the image's own
//! samples. Beyond that model `liberation` flips edges, fits values (`fitted_values`) and moves
//! vertices with their values (`vertex_moves`, on a `valued_mesh`). The steps and their order are in `schedule`. Figures are in `docs/quality.md`.

pub(crate) mod batch_removal;
mod growth;
mod insertion_candidates;
mod relocation;
mod schedule;
pub(crate) mod unconstrained;

use crate::control::{Cancelled, Control, Stage};
use crate::dynamic_mesh::{FaceMeasure, MeasuredMesh};
use growth::grow_and_shrink;
use relocation::{Look, Relocation, Scope};
use schedule::{Step, steps};
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Moves the vertices of a mesh so that its error falls, with an effort of 0 (nothing) to 9; their
/// number stays.
///
/// # Errors
/// When the control cancels.
pub(crate) fn refine<M: FaceMeasure>(
    mut mesh: MeasuredMesh<M>,
    effort: u8,
    control: &dyn Control,
) -> Result<MeasuredMesh<M>, Cancelled> {
    let mut relocation = Relocation::new(&mesh);
    let count = steps(effort).count();
    for (done, step) in steps(effort).enumerate() {
        let control = Part { control, done, count, reached: AtomicUsize::new(0) };
        control.poll(Stage::Refine, 0, 1)?;
        take_step(step, &mut mesh, &mut relocation, &control)?;
    }
    Ok(mesh)
}

fn take_step<M: FaceMeasure>(
    step: Step,
    mesh: &mut MeasuredMesh<M>,
    relocation: &mut Relocation,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let scope = |look| if look == Look::Foresighted { Scope::Most } else { Scope::All };
    match step {
        Step::Relocate(look) => relocation.pass(mesh, (look, scope(look)), control).map(|_| ()),
        Step::RelocateAll(look) => {
            relocation.restart();
            relocation.pass(mesh, (look, scope(look)), control).map(|_| ())
        }
        Step::Grow(look, percent) => grow_and_shrink(mesh, percent, look, relocation, control),
    }
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

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::face_error::{ErrorEvaluator, FaceErrors};
    use crate::image::{Image, Point, corner_points};
    use crate::model::flat_color::{FlatFaces, RowSums};
    use crate::parameters::choices::ErrorMetric;
    use crate::triangulation::{Face, triangulate};
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    /// A shaded picture with an edge and some texture.
    pub(crate) fn shaded(side: usize) -> Image {
        let sample = |i: usize, c: usize| {
            let (x, y) = (i % side, i / side);
            let on_disc = x.abs_diff(side / 3).pow(2) + y.abs_diff(side / 2).pow(2) < side * 4;
            let texture = (x * 7 + y * 13) % 5 * 6;
            (x * x / 40 + y * (1 + c) + if on_disc { 90 } else { 0 } + texture).min(255) as u16
        };
        let component = |c| (0..side * side).map(|i| sample(i, c)).collect();
        Image::from_bottom_up(side, side, 8, vec![component(0), component(1)]).unwrap()
    }

    #[test]
    fn flat_faces_are_refined_by_their_own_errors() {
        let image = shaded(40);
        let sums = RowSums::new(&image, None);
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
    fn progress_of_steps_never_goes_back() {
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
    pub(super) fn measure_of(image: &Image) -> ErrorEvaluator<'_> {
        ErrorEvaluator::new(image, ErrorMetric::MeanCompSe, None)
    }

    /// The measured triangulation of points given by row, then column.
    pub(crate) fn measured<'m>(
        measure: &'m ErrorEvaluator<'m>,
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
        fn more_effort_is_never_worse(
            (width, height) in (2usize..12, 2usize..12),
            samples in prop::collection::vec(0u16..64, 144),
            seeds in prop::collection::vec((0usize..12, 0usize..12), 0..30),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let (measure, count) = (measure_of(&image), points.len());
            let mut last = measured(&measure, &image, points.clone()).total_error();
            for effort in [0, 1, 3, 5, 9] {
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
        fn growth_that_does_not_pay_off_is_undone(
            (width, height) in (2usize..12, 2usize..12),
            samples in prop::collection::vec(0u16..3, 144),
            seeds in prop::collection::vec((0usize..12, 0usize..12), 0..30),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let measure = measure_of(&image);
            let mut mesh = measured(&measure, &image, points);
            let mut relocation = Relocation::new(&mesh);
            for _ in 0..4 {
                let (error, before) = (mesh.total_error(), mesh.triangulation.mesh());
                let step = Step::Grow(Look::Thorough, 30);
                take_step(step, &mut mesh, &mut relocation, &()).unwrap();
                prop_assert!(mesh.total_error() <= error);
                if mesh.total_error() == error {
                    prop_assert_eq!(mesh.triangulation.mesh(), before);
                }
            }
        }
    }
}
