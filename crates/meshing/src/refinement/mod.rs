//! Refinement: better meshes of the same size, beyond the thesis.
//!
//! Greedy removal evaluates one vertex at a time and never inserts one again. Refinement improves
//! the mesh that it leaves by descent: vertices move ([`relocation`]), and the mesh grows and
//! shrinks again ([`growth`]). No step raises the measured error. The mesh stays a
//! preferred-directions Delaunay triangulation whose vertices carry the image's samples, but for
//! [`unconstrained`] refinement. [`schedule`] has the steps of each effort.

pub(crate) mod batch_removal;
mod growth;
mod insertion_candidates;
mod progress;
mod relocation;
mod schedule;
pub(crate) mod unconstrained;

use crate::control::{Cancelled, Control};
use crate::dynamic_mesh::MeasuredMesh;
use crate::dynamic_mesh::half_edges::SortedMesh;
use crate::dynamic_mesh::patches::Cuts;
use crate::face_error::FaceMeasure;
use growth::grow_and_shrink;
use progress::begin_step;
use relocation::Relocation;
use schedule::{Step, steps};

/// Lowers a mesh's error with an effort of 0 (nothing) to 9. The number of vertices stays.
pub(crate) fn refine<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    effort: u8,
    control: &dyn Control,
) -> Result<SortedMesh, Cancelled> {
    let count = steps(effort).count();
    let start = begin_step(control, 0, count + 1)?;
    let mut relocation = Relocation::new(mesh, &start)?;
    for (done, step) in steps(effort).enumerate() {
        let progress = begin_step(control, done, count + 1)?;
        match step {
            Step::Relocate(search) => relocation.pass(mesh, search, &Cuts::BOTH, &progress)?,
            Step::RelocateAll(search) => {
                relocation.is_outdated.fill(true);
                relocation.pass(mesh, search, &Cuts::BOTH, &progress)?;
            }
            Step::Grow(search, percent) => {
                grow_and_shrink(mesh, percent, search, &mut relocation, &progress)?;
            }
        }
    }
    mesh.triangulation.sorted(&begin_step(control, count, count + 1)?)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::control::Stage;
    use crate::control::tests::poller;
    use crate::face_error::tests::evaluator_of;
    use crate::face_error::{ErrorEvaluator, FaceErrors};
    use crate::image::{Image, Point, corner_points};
    use crate::refinement::relocation::Search;
    use crate::triangulation::Face;
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

    /// A picture of two components of 8 levels, and points of it, the corners among them.
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

    /// The measured triangulation of points given by row, then column.
    pub(crate) fn measured<'m>(
        evaluator: &'m ErrorEvaluator<'m>,
        image: &Image,
        points: Vec<Point>,
    ) -> MeasuredMesh<FaceErrors<'m>> {
        let (size, errors) = ((image.width(), image.height()), FaceErrors::new(evaluator));
        MeasuredMesh::new(points, size, errors, Stage::Refine, &()).unwrap()
    }

    /// The squared error of faces that carry the image's samples.
    pub(super) fn sum_of_errors(image: &Image, points: &[Point], faces: &[Face]) -> u64 {
        let evaluator = evaluator_of(image);
        let mut errors = FaceErrors::new(&evaluator);
        faces
            .iter()
            .map(|face| errors.error(face.map(|v| points[v as usize]), &mut poller()).unwrap())
            .sum()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn growth_without_gain_is_undone(
            (width, height) in (2usize..12, 2usize..12),
            samples in prop::collection::vec(0u16..3, 144),
            seeds in prop::collection::vec((0usize..12, 0usize..12), 0..30),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let evaluator = evaluator_of(&image);
            let mut mesh = measured(&evaluator, &image, points);
            let mut relocation = Relocation::new(&mesh, &()).unwrap();
            for _ in 0..4 {
                let error = mesh.triangulation.total_error;
                let before = mesh.triangulation.sorted(&());
                grow_and_shrink(&mut mesh, 30, Search::Exhaustive, &mut relocation, &()).unwrap();
                prop_assert!(mesh.triangulation.total_error <= error);
                if mesh.triangulation.total_error == error {
                    prop_assert_eq!(mesh.triangulation.sorted(&()), before);
                }
            }
        }
    }
}
