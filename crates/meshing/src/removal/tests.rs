//! Helpers of the tests of removal, and what is cached during removal against what is computed
//! afresh.

use super::*;
use crate::control::tests::{Recorder, poller};
use crate::control::{POINTS_PER_POLL, Stage};
use crate::face_error::tests::evaluator_of;
use crate::face_error::{FaceErrors, FaceMeasure};
use crate::image::corner_points;
use crate::removal::greedy::Group;
use crate::triangulation::hole::HoleFiller;
use crate::triangulation::triangulate;
use proptest::prelude::*;

/// All lattice points, by row, then column.
pub(crate) fn lattice(width: usize, height: usize) -> Vec<Point> {
    (0..height as i32).flat_map(|y| (0..width as i32).map(move |x| Point::new(x, y))).collect()
}

/// Removal of all but `size` vertices, listed.
pub(crate) fn down_to(size: usize) -> StopRule {
    StopRule { size, bound: None, bad_point_removal: false, lists_removals: true }
}

/// What removal of all but `size` lattice points leaves.
pub(crate) fn simplify(image: &Image, size: usize, parallel: Parallel) -> Simplified {
    let measure = evaluator_of(image);
    let points = lattice(image.width(), image.height());
    let triangulation = Triangulation::new(points, &()).unwrap();
    simplify_by(image, &measure, triangulation, down_to(size), parallel, &()).unwrap()
}

/// What removal from all lattice points starts from.
pub(crate) fn start(
    image: &Image,
    measure: &ErrorEvaluator<'_>,
    rule: StopRule,
    digits: u32,
    control: &dyn Control,
) -> Start {
    let points = lattice(image.width(), image.height());
    let triangulation = Triangulation::new(points, &()).unwrap();
    prepare(image, triangulation, rule, measure, digits, control).unwrap()
}

impl Start {
    /// Makes the next removal.
    fn remove_one(&mut self, measure: &ErrorEvaluator<'_>) {
        let Self { stars, queues, progress } = self;
        let mut group = Group::new(stars.whole(), queues, measure, poller());
        let removed = group.remove_next(0, |_| true).unwrap().unwrap();
        progress.record(stars.vertices.points[removed.vertex as usize], removed);
    }

    /// The errors stored for the faces are those computed afresh.
    fn assert_errors_are_current(&mut self, measure: &ErrorEvaluator<'_>) {
        let mut errors = FaceErrors::new(measure);
        let stars = self.stars.whole();
        let mut total = 0;
        for v in stars.numbers(0).filter(|&v| !stars.is_removed(v)) {
            let star = stars.star(v);
            let neighbours = &star.neighbours;
            for (i, &error) in star.errors.iter().enumerate() {
                let last = i + 1 == neighbours.len();
                let fresh = if last && stars.is_on_border(v) {
                    0
                } else {
                    let next = neighbours[if last { 0 } else { i + 1 }];
                    errors
                        .error([v, neighbours[i], next].map(|v| stars.point(v)), &mut poller())
                        .unwrap()
                };
                assert_eq!(error, fresh);
                total += u128::from(fresh);
            }
        }
        assert_eq!(3 * u128::from(self.progress.error), total);
    }

    /// The faces are those of the remaining vertices, triangulated afresh.
    fn assert_triangulated_afresh(&mut self) {
        let (points, faces) = mesh_of(&self.stars.whole(), &mut self.progress.poller(&())).unwrap();
        assert!(points.is_sorted());
        assert_eq!(faces, triangulate(&points));
    }

    /// The queue's keys are the changes of the error, face by face.
    fn assert_keys_are_current(&mut self, measure: &ErrorEvaluator<'_>) {
        let (mut errors, mut filler) = (FaceErrors::new(measure), HoleFiller::default());
        let stars = self.stars.whole();
        for entry in self.queues[0].entries() {
            let star = stars.star(entry.vertex);
            let boundary: Vec<Point> = star.neighbours.iter().map(|&v| stars.point(v)).collect();
            let fill = filler.fill(&boundary).iter();
            let filled = fill.map(|face| {
                errors.error(face.map(|at| boundary[at as usize]), &mut poller()).unwrap()
            });
            let change = filled.sum::<u64>() as i64 - star.errors.iter().sum::<u64>() as i64;
            assert_eq!(change, entry.change);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn keeps_errors_faces_and_keys_current(
        // Thin images have vertices of many neighbours.
        (width, height) in prop_oneof![(2usize..8, 2usize..8), (12usize..30, 2usize..4)],
        precision in prop::sample::select(&[3, 16][..]),
        samples in prop::collection::vec(0u16..64, 96),
    ) {
        // Few levels, so that equal changes of error are common; of 16 bits the darkest and the
        // brightest, so that the errors of some faces need more than 32 bits.
        let level = |s: u16| if precision == 3 { s % 8 } else { s % 2 * 0xffff };
        let plane = |c: usize| {
            samples.iter().map(|s| level(s >> c)).take(width * height).collect::<Vec<u16>>()
        };
        let components = vec![plane(0), plane(3)];
        let image = Image::from_bottom_up(width, height, precision, components).unwrap();
        let measure = evaluator_of(&image);
        let mut start = start(&image, &measure, down_to(4), ONE_TILE, &());
        while start.queues[0].len() > 0 {
            start.remove_one(&measure);
            start.assert_errors_are_current(&measure);
            start.assert_triangulated_afresh();
            start.assert_keys_are_current(&measure);
        }
        prop_assert_eq!(start.progress.surplus_left(), 0);
    }
}

#[test]
fn polls_between_bounded_steps() {
    // The queue, the stars and the order of 262,144 vertices are each made in several steps.
    let (width, height) = (512, 512);
    let plane = (0..width * height).map(|i| (i % 7) as u16).collect();
    let image = Image::from_bottom_up(width, height, 3, vec![plane]).unwrap();
    let measure = evaluator_of(&image);
    let triangulation = Triangulation::new(lattice(width, height), &()).unwrap();
    let recorder = Recorder::default();
    let rule = down_to(width * height);
    let mut start = prepare(&image, triangulation, rule, &measure, ONE_TILE, &recorder).unwrap();
    let count = width * height;
    // 8,192 faces or first evaluations a poll.
    let measured = 2 * (width - 1) * (height - 1) / 8192 + count / 8192;
    // Two passes for the order, one each for points, vertices and the queue; six half-edges and one
    // star of eight steps a vertex.
    let steps = (2 + 3 + 6 + 8) * count;
    let polls = recorder.done(Stage::Simplify, 0).len();
    assert!(polls >= measured + steps / POINTS_PER_POLL - 8, "{polls}");
    let recorder = Recorder::default();
    mesh_of(&start.stars.whole(), &mut start.progress.poller(&recorder)).unwrap();
    assert!(recorder.reports().len() >= 10 * count / POINTS_PER_POLL);
    let recorder = Recorder::default();
    start.merge_tiles(&recorder).unwrap();
    assert!(recorder.reports().len() >= count / POINTS_PER_POLL);
}

#[test]
fn lists_removals_on_request_only() {
    let rule = StopRule { lists_removals: false, ..down_to(9) };
    let image = Image::from_bottom_up(6, 6, 4, vec![(0..36).map(|i| i % 16).collect()]).unwrap();
    let measure = evaluator_of(&image);
    let start = start(&image, &measure, rule, ONE_TILE, &());
    let removed = finish(start, &measure, &()).unwrap();
    assert_eq!((removed.points.len(), removed.removals.capacity()), (9, 0));
}

#[test]
fn polls_by_area_before_the_first_removal() {
    let samples = (0..2_000_000).map(|i| (i * 37 % 101) as u16).collect();
    let image = Image::from_bottom_up(2000, 1000, 8, vec![samples]).unwrap();
    let inner = (0..16).map(|i| Point::new(i * 100 + 150, i * 50 + 100));
    let mut points: Vec<Point> = inner.chain(corner_points(2000, 1000)).collect();
    points.sort_unstable();
    let rule = down_to(points.len());
    let measure = evaluator_of(&image);
    let (triangulation, recorder) = (Triangulation::new(points, &()).unwrap(), Recorder::default());
    simplify_by(&image, &measure, triangulation, rule, Parallel::Exact, &recorder).unwrap();
    let count = recorder.reports().len();
    assert!(count >= 10, "{count} polls for 2,000,000 pixels");
}
