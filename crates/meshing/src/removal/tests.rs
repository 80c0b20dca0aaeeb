//! What is cached during removal against what is computed afresh.

use super::*;
use crate::face_error::{FaceErrors, FaceMeasure};
use crate::parameters::choices::ErrorMetric;
use crate::removal::candidate::Evaluator;
use crate::removal::fill_cache::FillCache;
use crate::removal::vertices::MeshView;
use crate::triangulation::triangulate;
use proptest::prelude::*;

/// All lattice points, by row, then column.
pub(crate) fn lattice(width: usize, height: usize) -> Vec<Point> {
    (0..height as i32).flat_map(|y| (0..width as i32).map(move |x| Point::new(x, y))).collect()
}

/// Removal of all but `size` vertices.
pub(crate) fn down_to(size: usize) -> StopRule {
    let metric = ErrorMetric::MeanCompSe;
    StopRule { size, bound: None, metric, bad_point_removal: false }
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

/// Accepts one removal.
struct Once<'p> {
    vertices: &'p Vertices,
    progress: &'p mut Progress,
    is_done: bool,
}

impl Selection for Once<'_> {
    fn accepts(&mut self, _: Entry) -> Result<bool, Cancelled> {
        Ok(!self.is_done)
    }

    fn record(&mut self, removed: Entry) {
        self.progress.record(self.vertices.points[removed.vertex as usize], removed);
        self.is_done = true;
    }
}

impl Start {
    /// Makes the next removal.
    fn remove_one(&mut self, measure: &ErrorEvaluator<'_>) {
        let Self { vertices, stars, queues, progress } = self;
        let mut once = Once { vertices, progress, is_done: false };
        Group::new(vertices, measure, 0, stars, queues).remove_from(0, &mut once).unwrap();
    }

    /// The errors kept for the faces are those computed afresh.
    fn assert_errors_are_current(&self, measure: &ErrorEvaluator<'_>) {
        let mut errors = FaceErrors::new(measure);
        let view = MeshView { vertices: &self.vertices, blocks: &self.stars, first_block: 0 };
        let mut total = 0;
        let vertices = 0..self.vertices.points.len() as u32;
        for v in vertices.filter(|&v| !view.stars(v).is_removed(v)) {
            let star = view.stars(v).star(v);
            let neighbours = &star.neighbours;
            for (i, &error) in star.errors.iter().enumerate() {
                let last = i + 1 == neighbours.len();
                let fresh = if last && view.is_on_border(v) {
                    0
                } else {
                    let next = neighbours[if last { 0 } else { i + 1 }];
                    errors.error([v, neighbours[i], next].map(|v| view.point(v)))
                };
                assert_eq!(error, fresh);
                total += fresh;
            }
        }
        assert_eq!(3 * self.progress.error, total);
    }

    /// The faces are those of the remaining vertices, triangulated afresh.
    fn assert_triangulated_afresh(&self) {
        let (points, faces) = self.vertices.mesh(&self.stars, || Ok(())).unwrap();
        assert!(points.is_sorted());
        assert_eq!(faces, triangulate(&points));
    }

    /// The queue's keys are the changes computed afresh, with nothing cached.
    fn assert_keys_are_current(&mut self, measure: &ErrorEvaluator<'_>) {
        let mut evaluator = Evaluator::new(measure);
        for entry in self.queues[0].entries() {
            let cached = self.stars[0].record(entry.vertex).fill;
            self.stars[0].set_fill(entry.vertex, FillCache::EMPTY);
            let view = MeshView { vertices: &self.vertices, blocks: &self.stars, first_block: 0 };
            let (change, _) = evaluator.evaluate(entry.vertex, &view);
            self.stars[0].set_fill(entry.vertex, cached);
            assert_eq!(change, entry.change);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn keeps_errors_faces_and_keys_current(
        (width, height) in (2usize..8, 2usize..8),
        samples in prop::collection::vec(0u16..64, 64),
    ) {
        // Few gray levels, so that equal changes of error are common.
        let plane = |c: usize| samples.iter().map(|s| (s >> c) % 8).take(width * height).collect();
        let image = Image::from_bottom_up(width, height, 3, vec![plane(0), plane(3)]).unwrap();
        let measure = ErrorEvaluator::new(&image, ErrorMetric::MeanCompSe, None);
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
