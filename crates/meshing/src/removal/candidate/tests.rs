//! The arrays against the lists.

use super::*;
use crate::image::Image;
use crate::parameters::choices::ErrorMetric;
use crate::removal::start::{ONE_TILE, Start};
use crate::removal::tests::{down_to, start};
use proptest::prelude::*;

const SIDE: usize = 9;

/// A neighbour's state without its cache.
fn state(neighbour: &Neighbour) -> (u32, Record, Option<&Star>, Option<i64>) {
    let Neighbour { vertex, star: Packed { record, spilled }, change } = neighbour;
    let mut record = *record;
    record.fill = FillCache::EMPTY;
    (*vertex, record, spilled.as_deref(), *change)
}

/// The change of error of a star, with nothing cached.
fn fresh_change(evaluator: &mut Evaluator<'_>, star: &Star, view: &MeshView<'_>) -> i64 {
    evaluator.fill_star(star, &FillCache::EMPTY, Former::SAME, view).0
}

/// Evaluates and prepares a vertex both ways.
fn assert_agree(evaluator: &mut Evaluator<'_>, vertex: u32, view: &MeshView<'_>) {
    let (change, _) = evaluator.evaluate(vertex, view);
    assert_eq!(change, fresh_change(evaluator, &view.stars(vertex).star(vertex), view));
    let (mut chosen, mut by_lists) = (Vec::new(), Vec::new());
    evaluator.prepare(vertex, view, &mut chosen);
    evaluator.prepare_list(vertex, view, &mut by_lists);
    assert!(chosen.iter().map(state).eq(by_lists.iter().map(state)));
    for (at, neighbour) in by_lists.iter().enumerate() {
        let first = evaluator.wedges.partition_point(|wedge| wedge.at < at);
        evaluator.collect_replacement(at, first, view.is_on_border(vertex));
        let star = view.stars(neighbour.vertex).star(neighbour.vertex);
        let (star, _) = star.without(vertex, &evaluator.replacement);
        let is_corner = view.is_corner(neighbour.vertex);
        let expected = (!is_corner).then(|| fresh_change(evaluator, &star, view));
        assert_eq!(neighbour.change, expected);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn arrays_and_lists_agree(
        (width, height) in (2..=SIDE, 2..=SIDE),
        precision in prop::sample::select(vec![3, 8, 16]),
        samples in prop::collection::vec(0u16..8, SIDE * SIDE),
        order in Just((0..(SIDE * SIDE) as u32).collect::<Vec<u32>>()).prop_shuffle(),
    ) {
        // Of 16 bits the darkest and the brightest, so that two points need more than 32 bits.
        let sample = |s: &u16| if precision == 16 { s % 2 * 0xffff } else { *s << (precision - 3) };
        let samples = samples.iter().map(sample).take(width * height).collect();
        let image = Image::from_bottom_up(width, height, precision, vec![samples]).unwrap();
        let measure = ErrorEvaluator::new(&image, ErrorMetric::MeanCompSe, None);
        let Start { vertices, mut stars, .. } =
            start(&image, &measure, down_to(4), ONE_TILE, &());
        let mut evaluator = Evaluator::new(&measure);
        for vertex in order.into_iter().filter(|&v| (v as usize) < vertices.points.len()) {
            let view = MeshView { vertices: &vertices, blocks: &stars, first_block: 0 };
            if view.is_corner(vertex) {
                continue;
            }
            assert_agree(&mut evaluator, vertex, &view);
            let mut neighbours = Vec::new();
            evaluator.prepare(vertex, &view, &mut neighbours);
            for Neighbour { vertex, star, .. } in neighbours {
                stars[0].write(vertex, star);
            }
            stars[0].remove(vertex);
        }
    }
}
