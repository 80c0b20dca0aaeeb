//! Removals of few neighbours against those of any vertex, and how much of them is remembered.

use super::*;
use crate::face_error::Measure;
use crate::image::Image;
use crate::parameters::choices::ErrorMetric;
use crate::removal::candidate::Remover;
use crate::removal::star::INLINE_CAPACITY;
use crate::removal::start::{ONE_TILE, Start};
use crate::removal::tests::{down_to, start};
use proptest::prelude::*;
use std::collections::BTreeSet;

const SIDE: usize = 9;

/// A vertex that may go, among vertices of which some have gone.
struct Case<'a> {
    net: &'a MeshView<'a>,
    vertex: u32,
    /// Whether all errors need fewer than 32 bits.
    is_faint: bool,
}

/// Triangles of the neighbours of a star.
type Triangles = BTreeSet<BTreeSet<u32>>;

/// The triangles of a hole that are remembered, if all of them are.
fn remembered(record: &Record) -> Option<Triangles> {
    let neighbours = record.neighbours();
    let fill = record.memory.recall(neighbours.len().checked_sub(2)?)?;
    Some(fill.map(|(places, _)| places.iter().map(|&p| neighbours[p as usize]).collect()).collect())
}

/// The errors of all triangles of places that are remembered.
fn known_errors(memory: &HoleMemory) -> Vec<Option<u64>> {
    let places = INLINE_CAPACITY as u32;
    let triangles = (0..places)
        .flat_map(|a| (a + 1..places).flat_map(move |b| (b + 1..places).map(move |c| [a, b, c])));
    triangles.map(|triangle| memory.error(triangle)).collect()
}

/// Two memories hold no different errors of a triangle, and the same triangles if there are few.
fn assert_alike(quick: &HoleMemory, any: &HoleMemory, neighbour_count: usize) {
    let (quick, any) = (known_errors(quick), known_errors(any));
    if neighbour_count <= MOST_NEIGHBOURS {
        assert_eq!(quick, any);
    }
    assert!(quick.iter().zip(&any).all(|(a, b)| a.is_none() || b.is_none() || a == b));
}

impl Case<'_> {
    fn degree(&self) -> usize {
        self.net.blocks[0].neighbours(self.vertex).len()
    }

    /// What a removal changes is the same by either way; the quick one is taken where it can be.
    fn assert_prepared_alike(&self, remover: &mut Remover<'_>, measure: &Measure<'_>) {
        let (mut few, mut errors) = (FewHoles::default(), FaceErrors::new(measure));
        let (mut quick, mut any) = (Vec::new(), Vec::new());
        remover.prepare_any(self.vertex, self.net, &mut any);
        for Neighbour { star: Packed { record, spilled }, .. } in &any {
            let fits = spilled.as_ref().is_none_or(|star| {
                star.neighbours.len() > INLINE_CAPACITY
                    || star.errors.iter().any(|&e| e > u32::MAX.into())
            });
            assert!(fits && record.is_within() == spilled.is_none());
        }
        let all_fit = self.degree() <= MOST_NEIGHBOURS
            && !self.net.is_on_border(self.vertex)
            && any.iter().all(|neighbour| neighbour.star.record.is_within())
            && any.iter().all(|n| self.net.blocks[0].record(n.vertex).is_within());
        let found = few.prepare(self.vertex, self.net, &mut errors, &mut quick).is_some();
        assert!(if self.is_faint { found == all_fit } else { !found || all_fit });
        if found {
            assert_eq!(quick.len(), any.len());
            quick.iter().zip(&any).for_each(|(quick, any)| assert_same_state(quick, any));
            self.assert_measured_once(&few, &quick);
        }
    }

    /// No triangle was measured that was remembered.
    fn assert_measured_once(&self, few: &FewHoles, neighbours: &[Neighbour]) {
        let mut unknown = Some(0);
        for Neighbour { vertex, star, change } in neighbours {
            if change.is_some() {
                let before = remembered(self.net.blocks[0].record(*vertex));
                let after = remembered(&star.record);
                let new =
                    before.zip(after).map(|(before, after)| after.difference(&before).count());
                unknown = unknown.zip(new).map(|(sum, new)| sum + new);
            }
        }
        assert!(unknown.is_none_or(|unknown| few.face_count == unknown));
    }

    /// The change of error and what is remembered are the same by either way, and what is remembered
    /// is not measured again.
    fn assert_evaluated_alike(&self, remover: &mut Remover<'_>, measure: &Measure<'_>) {
        let (mut few, mut errors) = (FewHoles::default(), FaceErrors::new(measure));
        let (change, memory) = remover.evaluate_any(self.vertex, self.net);
        let quick = few.evaluate(self.vertex, self.net, &mut errors);
        assert!(quick.is_some() || !self.is_faint || self.degree() > INLINE_CAPACITY);
        if let Some((quick_change, quick_memory)) = quick {
            assert_eq!(quick_change, change);
            assert_alike(&quick_memory, &memory, self.degree());
            assert!(self.degree() > MOST_NEIGHBOURS || few.face_count == 0);
        }
    }
}

fn assert_same_state(quick: &Neighbour, any: &Neighbour) {
    assert_eq!((quick.vertex, quick.change), (any.vertex, any.change));
    let (quick, any) = (&quick.star.record, &any.star.record);
    let without_memory = |record: &Record| {
        let mut record = *record;
        record.memory = HoleMemory::NOTHING;
        record
    };
    assert_eq!(without_memory(quick), without_memory(any));
    assert_alike(&quick.memory, &any.memory, any.neighbours().len());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn few_neighbours_are_prepared_as_those_of_any_vertex_are(
        (width, height) in (2..=SIDE, 2..=SIDE),
        precision in prop::sample::select(vec![3, 8, 16]),
        samples in prop::collection::vec(0u16..8, SIDE * SIDE),
        order in Just((0..(SIDE * SIDE) as u32).collect::<Vec<u32>>()).prop_shuffle(),
    ) {
        // Of 16 bits the darkest and the brightest, so that two points need more than 32 bits.
        let sample = |s: &u16| if precision == 16 { s % 2 * 0xffff } else { *s << (precision - 3) };
        let samples = samples.iter().map(sample).take(width * height).collect();
        let image = Image::from_bottom_up(width, height, precision, vec![samples]).unwrap();
        let measure = Measure::new(&image, ErrorMetric::MeanCompSe, None);
        let Start { vertices, mut stars, .. } =
            start(&image, &measure, down_to(4), ONE_TILE, &());
        let mut remover = Remover::new(&measure);
        let leaves = |&vertex: &u32| {
            let point = vertices.points.get(vertex as usize)?;
            (point.x % (width as i32 - 1) != 0 || point.y % (height as i32 - 1) != 0).then_some(vertex)
        };
        for vertex in order.iter().filter_map(leaves) {
            let net = MeshView { vertices: &vertices, blocks: &stars, first_block: 0 };
            let case = Case { net: &net, vertex, is_faint: precision < 16 };
            case.assert_evaluated_alike(&mut remover, &measure);
            case.assert_prepared_alike(&mut remover, &measure);
            let mut neighbours = Vec::new();
            remover.prepare(vertex, &net, &mut neighbours);
            for Neighbour { vertex, star, .. } in neighbours {
                stars[0].write(vertex, star);
            }
            stars[0].remove(vertex);
        }
    }
}
