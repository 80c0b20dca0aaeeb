//! Greedy insertion: initial points for a mesh that a page shows before a better one arrives.
//!
//! Michael Garland and Paul S. Heckbert, "Fast polygonal approximation of terrains and height
//! fields", 1995, repeatedly insert the point of largest error. Here the face of largest error gets
//! a vertex at its pixel of largest error or the centroid of the errors, whichever is better.

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::dynamic_mesh::MeasuredMesh;
use crate::face_error::scan_conversion::{Interpolant, try_for_each_row};
use crate::face_error::{ErrorEvaluator, FaceErrors};
use crate::image::{Image, Point, corner_points};
use crate::parameters::choices::ErrorMetric;
use crate::triangulation::predicates::orientation;
use std::collections::BinaryHeap;

/// How many steps of a [`Poller`] an insertion counts, beside one for each pixel.
const STEPS_PER_INSERTION: usize = 1024;

/// A face with an error, in the order in which faces get vertices: by error, then by vertices.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Demand {
    error: u64,
    corners: [Point; 3],
    slot: u32,
}

/// Chooses up to `size` points of an image, by row, then column, the corners among them; fewer if
/// all faces have no error before.
pub(crate) fn inserted_points(
    image: &Image,
    metric: ErrorMetric,
    weights: Option<&[u8]>,
    size: usize,
    control: &dyn Control,
) -> Result<Vec<Point>, Cancelled> {
    let corners = corner_points(image.width(), image.height()).to_vec();
    let mut poller = Poller::new(control, Stage::Insert, 0, size);
    let measure = ErrorEvaluator::new(image, metric, weights, &mut poller)?;
    let (sides, errors) = (image.sides(), FaceErrors::new(&measure));
    let mesh = MeasuredMesh::new(corners, sides, errors, Stage::Insert, control)?;
    let mut insertion = Insertion { image, weights, mesh, demands: BinaryHeap::new(), poller };
    for slot in 0..insertion.mesh.triangulation.slot_count() as u32 {
        insertion.demand(slot);
    }
    control.poll(Stage::Insert, 0, size)?;
    for count in 4..size {
        insertion.poller.done = count;
        if !insertion.insert_one()? {
            break;
        }
    }
    let mut points = insertion.mesh.triangulation.points;
    points.sort_unstable();
    Ok(points)
}

struct Insertion<'a> {
    image: &'a Image,
    weights: Option<&'a [u8]>,
    mesh: MeasuredMesh<FaceErrors<'a>>,
    /// The faces, the largest error first; some of them were replaced since.
    demands: BinaryHeap<Demand>,
    poller: Poller<'a>,
}

impl Insertion<'_> {
    fn demand(&mut self, slot: u32) {
        let error = self.mesh.triangulation.face_error(slot);
        if error > 0 {
            let corners = self.mesh.triangulation.corners(slot);
            self.demands.push(Demand { error, corners, slot });
        }
    }

    /// Inserts a vertex into the face of largest error, at the better of two positions. Returns
    /// whether any face has an error.
    fn insert_one(&mut self) -> Result<bool, Cancelled> {
        while let Some(Demand { corners, slot, .. }) = self.demands.pop() {
            if self.mesh.triangulation.corners(slot) != corners {
                continue;
            }
            let (mut best, mut limit) = (None, i64::MAX);
            let Self { mesh: MeasuredMesh { triangulation, evaluator, .. }, poller, .. } = self;
            poller.step(STEPS_PER_INSERTION)?;
            let tried = positions(self.image, self.weights, corners, poller)?;
            for at in tried.into_iter().flatten() {
                let change = evaluator.insertion_change(triangulation, at, slot, limit, poller)?;
                if let Some(change) = change {
                    (best, limit) = (Some(at), change);
                }
            }
            let Some(position) = best else { continue };
            self.mesh.add_vertex(position, slot, poller)?;
            for i in 0..self.mesh.fan.len() {
                self.demand(self.mesh.fan[i]);
            }
            return Ok(true);
        }
        Ok(false)
    }
}

/// The first point of largest squared error of a face, and the centroid of the errors if it lies in
/// the face and is no vertex; `None` of a face without error. Weights multiply the errors.
fn positions(
    image: &Image,
    weights: Option<&[u8]>,
    corners: [Point; 3],
    poller: &mut Poller<'_>,
) -> Result<[Option<Point>; 2], Cancelled> {
    let (mut sum, mut by_column, mut by_row) = (0u64, 0u128, 0u128);
    let interpolants: Vec<Interpolant> = (0..image.component_count())
        .map(|c| {
            let samples = corners.map(|p| image.sample(c, p.x as usize, p.y as usize));
            Interpolant::new(corners, samples)
        })
        .collect();
    let (mut approximation, mut errors) = (Vec::new(), Vec::new());
    let mut worst: Option<(u64, Point)> = None;
    try_for_each_row(corners, |y, first, end| {
        let columns = first as usize..end as usize;
        poller.step(columns.len())?;
        errors.clear();
        errors.resize(columns.len(), 0u64);
        approximation.resize(columns.len(), 0u16);
        for (c, interpolant) in interpolants.iter().enumerate() {
            interpolant.fill(first, y, &mut approximation);
            let original = &image.row(c, y as usize)[columns.clone()];
            for ((error, a), b) in errors.iter_mut().zip(original).zip(&approximation) {
                *error += u64::from(a.abs_diff(*b)).pow(2);
            }
        }
        if let Some(weights) = weights {
            let row = &weights[y as usize * image.width()..][columns];
            for (error, &weight) in errors.iter_mut().zip(row) {
                *error *= u64::from(weight);
            }
        }
        for (x, &error) in (first..).zip(&errors) {
            sum += error;
            by_column += u128::from(error) * x as u128;
            by_row += u128::from(error) * y as u128;
            if error > 0 && worst.is_none_or(|(most, _)| error > most) {
                worst = Some((error, Point::new(x, y)));
            }
        }
        Ok(())
    })?;
    let Some((_, worst)) = worst else { return Ok([None; 2]) };
    let half = u128::from(sum) / 2;
    let middle = |moment: u128| ((moment + half) / u128::from(sum)) as i32;
    let middle = Point::new(middle(by_column), middle(by_row));
    let [a, b, c] = corners;
    let is_left = |from, to| orientation(from, to, middle) >= 0;
    let is_inside = is_left(a, b) && is_left(b, c) && is_left(c, a) && !corners.contains(&middle);
    Ok([Some(worst), is_inside.then_some(middle)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::POINTS_PER_POLL;
    use crate::control::tests::{Recorder, poller};
    use crate::face_error::FaceMeasure;
    use crate::face_error::scan_conversion::for_each_row;
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn inserts_the_size_or_leaves_no_error(
            (width, height) in (2usize..12, 2usize..12),
            samples in prop::collection::vec(0u16..9, 144),
            size in 4usize..40,
        ) {
            let samples = samples[..width * height].to_vec();
            let image = Image::from_bottom_up(width, height, 8, vec![samples]).unwrap();
            let metric = ErrorMetric::MeanCompSe;
            let points = inserted_points(&image, metric, None, size, &()).unwrap();
            prop_assert!(points.is_sorted_by(|a, b| a < b));
            let faces = triangulate(&points);
            let measure = ErrorEvaluator::new(&image, metric, None, &mut poller()).unwrap();
            let mut errors = FaceErrors::new(&measure);
            let corners = faces.iter().map(|face| face.map(|v| points[v as usize]));
            let total: u64 =
                corners.map(|corners| errors.error(corners, &mut poller()).unwrap()).sum();
            let count = points.len();
            prop_assert!(count == size || (count < size && total == 0));
        }
    }

    /// The errors of a face's points, by row, then column, computed one by one.
    fn errors_of_points(
        image: &Image,
        weights: Option<&[u8]>,
        corners: [Point; 3],
    ) -> Vec<(Point, u64)> {
        let mut errors = Vec::new();
        for_each_row(corners, |y, first, end| {
            for x in first..end {
                let (column, row) = (x as usize, y as usize);
                let difference = |c: usize| {
                    let samples = corners.map(|p| image.sample(c, p.x as usize, p.y as usize));
                    let mut value = [0];
                    Interpolant::new(corners, samples).fill(x, y, &mut value);
                    u64::from(image.sample(c, column, row).abs_diff(value[0])).pow(2)
                };
                let sum: u64 = (0..image.component_count()).map(difference).sum();
                let weight = weights.map_or(1, |weights| weights[row * image.width() + column]);
                errors.push((Point::new(x, y), sum * u64::from(weight)));
            }
        });
        errors
    }

    proptest! {
        #[test]
        fn positions_are_the_largest_error_and_the_centroid(
            coordinates in prop::array::uniform6(0i32..12),
            samples in prop::collection::vec(0u16..6, 2 * 144),
            weights in prop::option::of(prop::collection::vec(0u8..4, 144)),
        ) {
            let components = samples.chunks(144).map(<[u16]>::to_vec).collect();
            let image = Image::from_bottom_up(12, 12, 8, components).unwrap();
            let weights = weights.as_deref();
            let mut corners =
                [0, 2, 4].map(|i| Point::new(coordinates[i], coordinates[i + 1]));
            if orientation(corners[0], corners[1], corners[2]) < 0 {
                corners.swap(1, 2);
            }
            prop_assume!(orientation(corners[0], corners[1], corners[2]) > 0);
            let errors = errors_of_points(&image, weights, corners);
            let most = errors.iter().map(|&(_, error)| error).max().unwrap_or(0);
            let mut poller = Poller::new(&(), Stage::Insert, 0, 0);
            let found = positions(&image, weights, corners, &mut poller).unwrap();
            if most == 0 {
                prop_assert_eq!(found, [None; 2]);
                return Ok(());
            }
            prop_assert_eq!(found[0], errors.iter().find(|(_, error)| *error == most).map(|e| e.0));
            let sum: u64 = errors.iter().map(|&(_, error)| error).sum();
            let mean = |coordinate: fn(&Point) -> i32| {
                let moment: u64 = errors.iter().map(|(p, e)| coordinate(p) as u64 * e).sum();
                (moment as f64 / sum as f64 + 0.5).floor() as i32
            };
            let middle = Point::new(mean(|p| p.x), mean(|p| p.y));
            let [a, b, c] = corners;
            let is_inside = [(a, b), (b, c), (c, a)].iter().all(|&(from, to)| {
                (to.x - from.x) * (middle.y - from.y) >= (to.y - from.y) * (middle.x - from.x)
            });
            let expected = (is_inside && !corners.contains(&middle)).then_some(middle);
            prop_assert_eq!(found[1], expected);
        }
    }

    #[test]
    fn polls_are_frequent_within_large_faces() {
        let samples = (0..700 * 700).map(|i| (i * 53 % 97) as u16).collect();
        let image = Image::from_bottom_up(700, 700, 8, vec![samples]).unwrap();
        let recorder = Recorder::default();
        inserted_points(&image, ErrorMetric::MeanCompSe, None, 5, &recorder).unwrap();
        let reports = recorder.reports();
        assert!(reports.iter().all(|report| report.0 == Stage::Insert));
        // Half the picture is scanned for positions, then measured for one or two of them.
        let inserted = reports.iter().filter(|report| report.1 == 4).count();
        assert!(inserted > 700 * 700 / 2 / POINTS_PER_POLL, "{reports:?}");
    }

    #[test]
    fn pixels_of_weight_zero_get_no_points() {
        let samples = (0..20 * 20).map(|i| (i * 53 % 97) as u16).collect();
        let image = Image::from_bottom_up(20, 20, 8, vec![samples]).unwrap();
        let weights: Vec<u8> = (0..20 * 20).map(|i| if i % 20 < 8 { 7 } else { 0 }).collect();
        let metric = ErrorMetric::MeanCompSe;
        let points = inserted_points(&image, metric, Some(&weights), 60, &()).unwrap();
        assert_eq!(points.len(), 60);
        let corners = corner_points(20, 20);
        assert!(points.iter().all(|point| point.x < 8 || corners.contains(point)), "{points:?}");
    }
}
