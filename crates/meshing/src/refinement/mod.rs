//! Refinement: better meshes of the same size, beyond the thesis.
//!
//! Greedy removal evaluates one vertex at a time and never puts one back. Refinement improves the
//! mesh that it leaves by descent: vertices move ([`relocation`]), and the mesh grows and shrinks
//! again ([`growth`]). The true change of the error decides on each change. The mesh stays a
//! preferred-directions Delaunay triangulation whose vertices carry the image's samples;
//! [`unconstrained`] refinement gives that up. [`schedule`] has the steps of each effort.

pub(crate) mod batch_removal;
mod growth;
mod insertion_candidates;
mod progress;
mod relocation;
mod schedule;
pub(crate) mod unconstrained;

use crate::control::{Cancelled, Control};
use crate::dynamic_mesh::MeasuredMesh;
use crate::dynamic_mesh::measured::FaceMeasure;
use growth::grow_and_shrink;
use progress::StepProgress;
use relocation::{Relocation, Scope, Search};
use schedule::{Step, steps};

/// Lowers the error of a mesh with an effort of 0 (nothing) to 9. The number of vertices stays.
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
        let progress = StepProgress::begin(control, done, count)?;
        take_step(step, &mut mesh, &mut relocation, &progress)?;
    }
    Ok(mesh)
}

fn take_step<M: FaceMeasure>(
    step: Step,
    mesh: &mut MeasuredMesh<M>,
    relocation: &mut Relocation,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let scope = |search| match search {
        Search::Predicted => Scope::TwoPartitions,
        Search::Exhaustive => Scope::All,
    };
    match step {
        Step::Relocate(search) => relocation.pass(mesh, search, scope(search), control),
        Step::RelocateAll(search) => {
            relocation.restart();
            relocation.pass(mesh, search, scope(search), control)
        }
        Step::Grow(search, percent) => grow_and_shrink(mesh, percent, search, relocation, control),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::control::Stage;
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
        let errors = FlatFaces::new(&sums);
        let mesh = MeasuredMesh::new(points, (40, 40), errors, Stage::Refine, &()).unwrap();
        let before = mesh.total_error();
        let refined = refine(mesh, 5, &()).unwrap();
        let (points, faces, _) = refined.triangulation().mesh();
        let error = |face: &Face| FlatFaces::new(&sums).error(face.map(|v| points[v as usize]));
        assert_eq!(refined.total_error(), faces.iter().map(error).sum::<u64>());
        assert!(refined.total_error() < before);
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
        let (size, errors) = ((image.width(), image.height()), FaceErrors::new(measure));
        MeasuredMesh::new(points, size, errors, Stage::Refine, &()).unwrap()
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
                let (points, faces, _) = mesh.triangulation().mesh();
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
                let (error, before) = (mesh.total_error(), mesh.triangulation().mesh());
                let step = Step::Grow(Search::Exhaustive, 30);
                take_step(step, &mut mesh, &mut relocation, &()).unwrap();
                prop_assert!(mesh.total_error() <= error);
                if mesh.total_error() == error {
                    prop_assert_eq!(mesh.triangulation().mesh(), before);
                }
            }
        }
    }
}
