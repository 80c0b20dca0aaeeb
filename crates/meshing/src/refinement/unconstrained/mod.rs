//! Unconstrained refinement: edges that are not Delaunay, values that are not the image's samples,
//! and moves of vertices with both.
//!
//! Edge flips by the error of the approximation: Nira Dyn, David Levin and Samuel Rippa, "Data
//! dependent triangulations for piecewise linear interpolation", 1990.

pub(crate) mod bounded;
pub(crate) mod least_squares;
pub(crate) mod moves;
pub(crate) mod valued_mesh;

use crate::control::{Cancelled, Control};
use crate::dynamic_mesh::half_edges::SortedMesh;
use crate::refinement::progress::begin_step;
use crate::refinement::unconstrained::least_squares::fit_values;
use crate::refinement::unconstrained::moves::{Freedom, VertexMoves};
use crate::refinement::unconstrained::valued_mesh::ValuedMesh;

/// Relative improvement threshold: the rounds end when one lowers the error by less than this part.
const LEAST_IMPROVEMENT: f64 = 2e-4;
const ROUNDS_WITHOUT_MOVES: usize = 4;
const ROUNDS_PER_EFFORT: usize = 3;
const PASSES: usize = 3;

/// Flips edges, fits values and, with an effort above 0, moves vertices, in rounds. No step raises
/// the error. Returns the vertices and faces.
pub(crate) fn refine_unconstrained(
    mesh: &mut ValuedMesh<'_>,
    freedom: Freedom,
    effort: u8,
    control: &dyn Control,
) -> Result<SortedMesh, Cancelled> {
    let rounds = match effort {
        0 => ROUNDS_WITHOUT_MOVES,
        _ => ROUNDS_PER_EFFORT * usize::from(effort),
    };
    let mut moves = VertexMoves::new(mesh.triangulation.points.len(), freedom);
    for done in 0..rounds {
        let progress = begin_step(control, done, rounds + 1)?;
        let before = mesh.triangulation.total_error;
        if freedom.connectivity {
            mesh.flip_edges(&progress)?;
        }
        if freedom.values {
            fit_values(mesh, &progress)?;
        }
        if effort > 0 {
            moves.is_outdated.fill(true);
            for _ in 0..PASSES {
                moves.pass(mesh, &progress)?;
            }
        }
        if ((before - mesh.triangulation.total_error) as f64) < LEAST_IMPROVEMENT * before as f64 {
            break;
        }
    }
    mesh.triangulation.sorted(&begin_step(control, rounds, rounds + 1)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Stage;
    use crate::control::tests::Recorder;
    use crate::image::{Image, Point};
    use crate::refinement::unconstrained::valued_mesh::tests::{
        error_of_rebuilt, faces_of, valued,
    };

    const SIDE: usize = 48;

    const FREEDOMS: [Freedom; 3] = [
        Freedom { connectivity: true, values: false },
        Freedom { connectivity: false, values: true },
        Freedom { connectivity: true, values: true },
    ];

    /// A picture of discs on a slope, and points of a grid.
    fn picture() -> (Image, Vec<Point>) {
        let sample = |i: usize| {
            let (x, y) = ((i % SIDE) as i32, (i / SIDE) as i32);
            let inside = (x % 24 - 11).pow(2) + (y % 24 - 12).pow(2) < 60;
            (2 * x + y) as u16 + if inside { 90 } else { 0 }
        };
        let samples = (0..SIDE * SIDE).map(sample).collect();
        let image = Image::from_bottom_up(SIDE, SIDE, 8, vec![samples]).unwrap();
        let steps = [0, 7, 15, 22, 31, 38, 47];
        let points = steps.iter().flat_map(|&y| steps.map(|x| Point::new(x, y))).collect();
        (image, points)
    }

    #[test]
    fn each_freedom_lowers_the_error() {
        let (image, points) = picture();
        let before = valued(&image, None, points.clone()).triangulation.total_error;
        for freedom in FREEDOMS {
            let refined = |effort| {
                let mut mesh = valued(&image, None, points.clone());
                refine_unconstrained(&mut mesh, freedom, effort, &()).unwrap();
                let points = mesh.triangulation.points.clone();
                let error = error_of_rebuilt(&image, &points, &mesh.values, &faces_of(&mesh));
                assert_eq!(mesh.triangulation.total_error, error);
                (error, points)
            };
            let (still, unmoved) = refined(0);
            assert!(still < before && unmoved == points, "{freedom:?}");
            let (moved, positions) = refined(2);
            assert!(moved < still && positions != points, "{freedom:?}");
        }
    }

    #[test]
    fn pixels_of_weight_zero_do_not_count() {
        let (image, points) = picture();
        let weights = vec![0; SIDE * SIDE];
        let mut mesh = valued(&image, Some(&weights), points.clone());
        let values = mesh.values.clone();
        refine_unconstrained(&mut mesh, FREEDOMS[2], 1, &()).unwrap();
        assert_eq!((mesh.triangulation.total_error, &mesh.values), (0, &values));
        assert_eq!(mesh.triangulation.points, points);
    }

    #[test]
    fn every_part_can_be_cancelled() {
        let (image, points) = picture();
        for poll in [0, 1, 50, 200, 1000] {
            let mut mesh = valued(&image, None, points.clone());
            let control = Recorder::cancelling_at(poll);
            let ended = refine_unconstrained(&mut mesh, FREEDOMS[2], 1, &control);
            assert_eq!(ended, Err(Cancelled));
            let reports = control.reports();
            assert!(reports.iter().all(|report| report.0 == Stage::Refine));
            assert_eq!(reports.len(), poll + 1);
        }
    }
}
