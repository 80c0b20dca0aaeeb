//! The values at the vertices that fit the picture best: least squares.
//!
//! Without rounding the approximation is linear in the values, so its squared error is least where
//! the normal equations hold. Their matrix has an entry for each vertex and each edge. Conjugate
//! gradients with the diagonal as preconditioner solve them (Magnus R. Hestenes and Eduard Stiefel,
//! "Methods of conjugate gradients for solving linear systems", 1952), in some 30 steps from the
//! current values. Sums have one fixed order, so that the result is the same on every machine.

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::face_error::scan_conversion::try_for_each_row;
use crate::image::Point;
use crate::refinement::unconstrained::valued_mesh::ValuedMesh;
use crate::triangulation::predicates::orientation;
use crate::triangulation::{Face, NONE, next};

/// The steps end when the residual has fallen to this part of the right-hand side.
const TOLERANCE: f64 = 1e-6;
const MAX_STEPS: usize = 200;

/// Fits the values of all vertices at once, if that lowers the error after rounding.
pub(crate) fn fit_values(
    mesh: &mut ValuedMesh<'_>,
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let equations = NormalEquations::new(mesh, control)?;
    let (count, largest) = (mesh.image.component_count(), f64::from(mesh.image.max_sample()));
    let (values_before, error_before) = (mesh.values.clone(), mesh.triangulation.total_error);
    for c in 0..count {
        let before = values_before.iter().skip(c).step_by(count);
        let mut values: Vec<f64> = before.map(|&value| value.into()).collect();
        equations.solve(c, &mut values, control)?;
        for (rounded, value) in mesh.values.iter_mut().skip(c).step_by(count).zip(&values) {
            *rounded = (value + 0.5).floor().clamp(0.0, largest) as u16;
        }
    }
    mesh.limit_colors_to_alpha();
    mesh.measure(Stage::Refine, control)?;
    if mesh.triangulation.total_error >= error_before {
        mesh.values = values_before;
        mesh.measure(Stage::Refine, control)?;
    }
    Ok(())
}

/// The matrix, symmetric, and a right-hand side for each component: sums over all pixels, each
/// times its weight, of the interpolation weights of the vertices of the pixel's face.
struct NormalEquations {
    diagonal: Vec<f64>,
    /// For each edge its ends and the sum of the products of their weights, over both faces.
    edges: Vec<(u32, u32, f64)>,
    right_hand_sides: Vec<Vec<f64>>,
}

impl NormalEquations {
    fn new(mesh: &ValuedMesh<'_>, control: &dyn Control) -> Result<Self, Cancelled> {
        let triangulation = &mesh.triangulation;
        let zeros = vec![0.0; triangulation.points.len()];
        let right_hand_sides = vec![zeros.clone(); mesh.image.component_count()];
        let mut made = Self { diagonal: zeros, edges: Vec::new(), right_hand_sides };
        let mut products = Vec::with_capacity(triangulation.slot_count());
        let poller = &mut Poller::new(control, Stage::Refine, 0, 1);
        for slot in 0..triangulation.slot_count() as u32 {
            poller.poll()?;
            products.push(made.add_face(mesh, triangulation.vertices_of(slot), poller)?);
        }
        let product = |h: u32| products[h as usize / 3][h as usize % 3];
        for (h, &twin) in (0..).zip(&triangulation.twins) {
            poller.step(1)?;
            if twin == NONE || h < twin {
                let other = if twin == NONE { 0.0 } else { product(twin) };
                let [from, to] = [h, next(h)].map(|h| triangulation.origins[h as usize]);
                made.edges.push((from, to, product(h) + other));
            }
        }
        Ok(made)
    }

    /// Adds the pixels of a face; returns the sums of products of each corner and the next.
    fn add_face(
        &mut self,
        mesh: &ValuedMesh<'_>,
        face: Face,
        poller: &mut Poller<'_>,
    ) -> Result<[f64; 3], Cancelled> {
        let corners = face.map(|v| mesh.triangulation.points[v as usize]);
        let [a, b, c] = corners;
        let reciprocal = 1.0 / orientation(a, b, c) as f64;
        let (mut squares, mut products) = ([0.0; 3], [0.0; 3]);
        let mut sides = vec![[0.0; 3]; self.right_hand_sides.len()];
        try_for_each_row(corners, |y, first, end| {
            poller.step((end - first) as usize)?;
            let pixel_weights = mesh.weights_of_row(y, first, end);
            for x in first..end {
                let p = Point::new(x, y);
                let count = pixel_weights.map_or(1.0, |row| f64::from(row[(x - first) as usize]));
                let weights = [orientation(b, c, p), orientation(c, a, p), orientation(a, b, p)]
                    .map(|weight| weight as f64 * reciprocal);
                for i in 0..3 {
                    squares[i] += count * weights[i] * weights[i];
                    products[i] += count * weights[i] * weights[(i + 1) % 3];
                }
                for (c, side) in sides.iter_mut().enumerate() {
                    let sample = f64::from(mesh.image.sample(c, x as usize, y as usize));
                    for i in 0..3 {
                        side[i] += count * weights[i] * sample;
                    }
                }
            }
            Ok(())
        })?;
        for (i, v) in face.into_iter().enumerate() {
            self.diagonal[v as usize] += squares[i];
            for (all, side) in self.right_hand_sides.iter_mut().zip(&sides) {
                all[v as usize] += side[i];
            }
        }
        Ok(products)
    }

    fn multiply(&self, vector: &[f64], control: &dyn Control) -> Result<Vec<f64>, Cancelled> {
        let mut product: Vec<f64> = self.diagonal.iter().zip(vector).map(|(d, v)| d * v).collect();
        let mut poller = Poller::new(control, Stage::Refine, 0, 1);
        for &(a, b, entry) in &self.edges {
            poller.step(1)?;
            product[a as usize] += entry * vector[b as usize];
            product[b as usize] += entry * vector[a as usize];
        }
        Ok(product)
    }

    fn solve(&self, c: usize, values: &mut [f64], control: &dyn Control) -> Result<(), Cancelled> {
        let side = &self.right_hand_sides[c];
        let product = self.multiply(values, control)?;
        let mut residual: Vec<f64> = side.iter().zip(&product).map(|(b, p)| b - p).collect();
        // A diagonal entry is 0 where all pixels around the vertex have weight 0: its value stays.
        let divide = |(r, d): (&f64, &f64)| if *d > 0.0 { r / d } else { 0.0 };
        let scaled = |residual: &[f64]| -> Vec<f64> {
            residual.iter().zip(&self.diagonal).map(divide).collect()
        };
        let mut direction = scaled(&residual);
        let mut slope = dot(&residual, &direction);
        let enough = TOLERANCE * TOLERANCE * dot(side, &scaled(side));
        for step in 0..MAX_STEPS {
            control.poll(Stage::Refine, step, MAX_STEPS)?;
            if slope <= enough {
                break;
            }
            let product = self.multiply(&direction, control)?;
            let curvature = dot(&direction, &product);
            if curvature <= 0.0 {
                break;
            }
            let length = slope / curvature;
            for (value, d) in values.iter_mut().zip(&direction) {
                *value += length * d;
            }
            for (r, p) in residual.iter_mut().zip(&product) {
                *r -= length * p;
            }
            let preconditioned = scaled(&residual);
            let next_slope = dot(&residual, &preconditioned);
            let turn = next_slope / slope;
            for (d, p) in direction.iter_mut().zip(&preconditioned) {
                *d = p + turn * *d;
            }
            slope = next_slope;
        }
        Ok(())
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::Recorder;
    use crate::face_error::scan_conversion::for_each_row;
    use crate::refinement::tests::picture;
    use crate::refinement::unconstrained::valued_mesh::tests::{
        error_of_rebuilt, faces_of, valued,
    };
    use proptest::prelude::*;

    /// Every lattice point with the interpolation weights of the vertices of its face.
    fn weights_of_points(mesh: &ValuedMesh<'_>) -> Vec<(Point, [(u32, f64); 3])> {
        let mut rows = Vec::new();
        for face in faces_of(mesh) {
            let [a, b, c] = face.map(|v| mesh.triangulation.points[v as usize]);
            let area = orientation(a, b, c) as f64;
            for_each_row([a, b, c], |y, first, end| {
                for x in first..end {
                    let p = Point::new(x, y);
                    let weights = [(b, c), (c, a), (a, b)].map(|(u, v)| orientation(u, v, p));
                    let weight = |i: usize| (face[i], weights[i] as f64 / area);
                    rows.push((p, [weight(0), weight(1), weight(2)]));
                }
            });
        }
        rows
    }

    /// The least-squares values of a component by elimination on the full matrix.
    fn solved_by_elimination(mesh: &ValuedMesh<'_>, c: usize) -> Vec<f64> {
        let count = mesh.triangulation.points.len();
        let mut matrix = vec![vec![0.0; count + 1]; count];
        for (p, weights) in weights_of_points(mesh) {
            let sample = f64::from(mesh.image.sample(c, p.x as usize, p.y as usize));
            for (u, weight) in weights {
                for (v, other) in weights {
                    matrix[u as usize][v as usize] += weight * other;
                }
                matrix[u as usize][count] += weight * sample;
            }
        }
        for pivot in 0..count {
            let largest =
                |&a: &usize, &b: &usize| matrix[a][pivot].abs().total_cmp(&matrix[b][pivot].abs());
            let row = (pivot..count).max_by(largest).unwrap();
            matrix.swap(pivot, row);
            let pivot_row = matrix[pivot].clone();
            for (_, row) in matrix.iter_mut().enumerate().filter(|(i, _)| *i != pivot) {
                let factor = row[pivot] / pivot_row[pivot];
                for (entry, above) in row.iter_mut().zip(&pivot_row) {
                    *entry -= factor * above;
                }
            }
        }
        (0..count).map(|v| matrix[v][count] / matrix[v][v]).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn fitted_values_are_rounded_least_squares(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..10),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let mut mesh = valued(&image, None, points.clone());
            let [first, second] = [0, 1].map(|c| solved_by_elimination(&mesh, c));
            let best: Vec<f64> = first.iter().zip(&second).flat_map(|(a, b)| [*a, *b]).collect();
            // Where one is as near to another whole number either will do.
            prop_assume!(best.iter().all(|value| (value.rem_euclid(1.0) - 0.5).abs() > 1e-3));
            let mut rounded: Vec<u16> =
                best.iter().map(|value| value.round().clamp(0.0, 7.0) as u16).collect();
            // A colour is at most its alpha.
            rounded.chunks_exact_mut(2).for_each(|values| values[0] = values[0].min(values[1]));
            let error = |values: &[u16]| {
                error_of_rebuilt(&image, &points, values, &faces_of(&mesh))
            };
            let before = mesh.values.clone();
            let lowers = error(&rounded) < error(&before);
            let expected = if lowers { rounded } else { before };
            let expected_error = error(&expected);
            fit_values(&mut mesh, &()).unwrap();
            prop_assert_eq!(&mesh.values, &expected);
            prop_assert_eq!(mesh.triangulation.total_error, expected_error);
        }
    }

    /// Solves equations from some values on; returns the values and the number of steps.
    fn solved(equations: &NormalEquations, mut values: Vec<f64>) -> (Vec<f64>, usize) {
        let recorder = Recorder::default();
        equations.solve(0, &mut values, &recorder).unwrap();
        let reports = recorder.reports();
        let steps = reports.iter().filter(|(_, _, total)| *total == MAX_STEPS);
        (values, steps.map(|(_, done, _)| *done).max().unwrap())
    }

    #[test]
    fn steps_end_at_the_tolerance() {
        let (diagonal, right_hand_sides) = (vec![4.0, 4.0], vec![vec![8000.0, 4000.0]]);
        let equations = NormalEquations { diagonal, edges: vec![], right_hand_sides };
        for (off, steps) in [(1e-7, 0), (1e-5, 1)] {
            let values = vec![2000.0 * (1.0 + off), 1000.0 * (1.0 - off)];
            let (found, made) = solved(&equations, values.clone());
            assert_eq!((made, found == values), (steps, steps == 0), "{off}");
        }
    }
}
