//! Meshes beyond the model of the thesis: edges that are not Delaunay, values that are not the
//! picture's samples, and moves of vertices with both.
//!
//! Edge flips by the error of the approximation: Nira Dyn, David Levin and Samuel Rippa, "Data
//! dependent triangulations for piecewise linear interpolation", 1990.

pub(crate) mod least_squares;
pub(crate) mod moves;
pub(crate) mod valued_mesh;

use crate::control::{Cancelled, Control, Stage};
use crate::refinement::Part;
use crate::refinement::unconstrained::least_squares::fit_values;
use crate::refinement::unconstrained::moves::{Freedom, VertexMoves};
use crate::refinement::unconstrained::valued_mesh::ValuedMesh;
use std::sync::atomic::AtomicUsize;

/// Rounds end when one lowers the error by less than this part.
const PAYS: f64 = 2e-4;

/// Rounds where vertices do not move.
const ROUNDS_WITHOUT_MOVES: usize = 4;

/// Rounds of moves for each level of effort.
const ROUNDS_PER_EFFORT: usize = 3;

/// Looks at each vertex in a round at most this often.
const PASSES: usize = 3;

/// Flips edges, fits values and, with an effort over 0, moves vertices, round after round until one
/// takes off less than a little of the error. No step raises the error.
///
/// # Errors
/// When the control cancels.
pub(crate) fn liberate(
    mesh: &mut ValuedMesh<'_>,
    freedom: Freedom,
    effort: u8,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let rounds = match effort {
        0 => ROUNDS_WITHOUT_MOVES,
        _ => ROUNDS_PER_EFFORT * usize::from(effort),
    };
    let mut moves = VertexMoves::new(mesh.triangulation.points.len(), freedom);
    for done in 0..rounds {
        let control = Part { control, done, count: rounds, reached: AtomicUsize::new(0) };
        control.poll(Stage::Refine, 0, 1)?;
        let before = mesh.total_error;
        if freedom.connectivity {
            mesh.flip_edges();
        }
        if freedom.values {
            fit_values(mesh, &control)?;
        }
        if effort > 0 {
            moves.restart();
            for _ in 0..PASSES {
                moves.pass(mesh, &control)?;
            }
        }
        if ((before - mesh.total_error) as f64) < PAYS * before as f64 {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Cancelled;
    use crate::image::{Image, Point};
    use crate::triangulation::triangulate;
    use std::sync::atomic::Ordering;

    /// A picture of discs on a slope, and points that know nothing of them.
    fn picture() -> (Image, Vec<Point>) {
        let side = 48;
        let sample = |i: usize| {
            let (x, y) = ((i % side) as i32, (i / side) as i32);
            let inside = (x % 24 - 11).pow(2) + (y % 24 - 12).pow(2) < 60;
            (2 * x + y) as u16 + if inside { 90 } else { 0 }
        };
        let image =
            Image::from_bottom_up(side, side, 8, vec![(0..side * side).map(sample).collect()])
                .unwrap();
        let steps = [0, 7, 15, 22, 31, 38, 47];
        let points = steps.iter().flat_map(|&y| steps.map(|x| Point::new(x, y))).collect();
        (image, points)
    }

    /// Cancels when so many rounds are over.
    struct Rounds(usize);

    impl Control for Rounds {
        fn poll(&self, _: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
            // Of all rounds the work is one share each.
            if done * 6 >= total * self.0 { Err(Cancelled) } else { Ok(()) }
        }
    }

    fn freed(freedom: Freedom, effort: u8, control: &dyn Control) -> (u64, Vec<Point>) {
        let (image, points) = picture();
        let mut mesh = ValuedMesh::new(&image, points.clone(), &triangulate(&points));
        let ended = liberate(&mut mesh, freedom, effort, control);
        assert!(ended.is_ok() || control.poll(Stage::Refine, 1, 1).is_err());
        (mesh.total_error, mesh.triangulation.points)
    }

    /// The errors before the first round and after each, of a picture that has no end of details.
    fn errors_of_rounds(freedom: Freedom) -> Vec<u64> {
        /// Notes the last round told of, and cancels when so many are over.
        struct Until(usize, AtomicUsize);
        impl Control for Until {
            fn poll(&self, _: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
                let round = done * 27 / total;
                self.1.fetch_max(round + 1, Ordering::Relaxed);
                if round >= self.0 { Err(Cancelled) } else { Ok(()) }
            }
        }
        let samples = (0..60 * 60).map(|i| (i * i / 11 % 251 / (1 + i % 60 / 9)) as u16).collect();
        let image = Image::from_bottom_up(60, 60, 8, vec![samples]).unwrap();
        let steps = [0, 7, 15, 22, 31, 38, 47, 53, 59];
        let points: Vec<Point> =
            steps.iter().flat_map(|&y| steps.map(|x| Point::new(x, y))).collect();
        let after = |rounds| {
            let until = Until(rounds, AtomicUsize::new(0));
            let mut mesh = ValuedMesh::new(&image, points.clone(), &triangulate(&points));
            let ended = liberate(&mut mesh, freedom, 9, &until);
            assert!(ended.is_ok() || until.1.load(Ordering::Relaxed) > rounds);
            (mesh.total_error, until.1.into_inner())
        };
        let (_, made) = after(27);
        (0..=made).map(|rounds| after(rounds).0).collect()
    }

    #[test]
    fn each_freedom_lowers_the_error_and_only_effort_moves_vertices() {
        let (image, points) = picture();
        let before = ValuedMesh::new(&image, points.clone(), &triangulate(&points)).total_error;
        for (connectivity, values) in [(true, false), (false, true), (true, true)] {
            let freedom = Freedom { connectivity, values };
            let (still, places) = freed(freedom, 0, &());
            assert!(still < before && places == points, "{connectivity} {values}");
            let (moved, places) = freed(freedom, 2, &());
            assert!(moved < still && places != points, "{connectivity} {values}");
        }
    }

    #[test]
    fn rounds_go_on_while_they_pay_and_are_three_for_each_level_of_effort_at_most() {
        let freedom = Freedom { connectivity: true, values: true };
        let after = |rounds| freed(freedom, 2, &Rounds(rounds)).0;
        let errors: Vec<u64> = (1..=6).map(after).collect();
        assert!(errors[0] > errors[1] && errors.is_sorted_by(|a, b| a >= b), "{errors:?}");
        assert_eq!(freed(freedom, 2, &()).0, errors[5]);
        // Half the effort is half the rounds.
        assert_eq!(freed(freedom, 1, &()).0, errors[2]);
    }

    #[test]
    fn the_first_round_that_takes_off_less_than_the_5000th_part_is_the_last() {
        let mut ends = Vec::new();
        for (connectivity, values) in [(true, false), (false, true), (true, true)] {
            let errors = errors_of_rounds(Freedom { connectivity, values });
            let made = errors.len() - 1;
            let pays = |pair: &[u64]| (pair[0] - pair[1]) * 5000 >= pair[0];
            let paid: Vec<bool> = errors.windows(2).map(pays).collect();
            assert!(made > 2 && made < 27, "{made} rounds, {errors:?}");
            assert_eq!(paid.iter().position(|&pays| !pays), Some(made - 1), "{errors:?}");
            ends.push(errors[made - 1] - errors[made]);
        }
        assert!(ends.iter().any(|&gain| gain > 0), "some that pays too little took off something");
    }
}
