//! Relocation: each vertex in turn goes to the place nearby where the error is least.
//!
//! Coordinate descent on the places of the vertices. Moving a vertex is removal and insertion, so
//! the mesh stays the preferred-directions Delaunay triangulation of its points; every place is
//! scored by the true change of the error over the faces that change. A vertex is looked at again
//! only when the faces around it have changed since. Each move lowers the error, so the passes end.
//!
//! A thorough look tries every place of a window. A foresighted one tries the few that the
//! derivatives of the error promise most from, for a third of the time.

use super::dynamic_triangulation::patch::{Cuts, Part, Partition};
use super::measured_mesh::moves::{Choice, Moved};
use super::measured_mesh::{FaceMeasure, MeasuredMesh};
use crate::control::{Cancelled, Control, Stage};
use crate::mesh::Point;
use crate::parallel::{Poll, share_out};
use crate::tile_order::tile_order;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Places that a foresighted look tries at most.
const PROMISING: usize = 3;

/// A place is tried when the error is foreseen to rise by less than this part of that of the faces
/// around: the forecast is rough where faces are of few points.
const DOUBT: f32 = 0.5;

/// A mesh of at least so many vertices is looked at in two patches: a smaller one is done before two
/// threads are.
const LEAST_PARTED: usize = 256;

/// Vertices of a patch of a mesh that has more than two: the smaller they are, the more vertices lie too
/// near to their edges.
const LEAST_PATCH: usize = 2048;

/// Looks at each vertex whose surroundings have changed, pass after pass.
#[derive(Clone)]
pub(crate) struct Relocation {
    /// Whether the surroundings of a vertex have changed since it was looked at.
    changed: Vec<bool>,
    /// Whether a vertex is still to be looked at in the pass at hand.
    is_due: Vec<bool>,
    /// The vertices tile by tile, as they were at first.
    order: Vec<u32>,
    /// What a foresighted look has found.
    promising: Vec<(f32, Point)>,
}

/// How to look for a better place for a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Look {
    /// The first that is better of the most promising places up to two columns and rows away; where
    /// none can be foreseen, the best of the 8 lattice points around.
    Foresighted,
    /// The best of the 24 lattice points up to two columns and rows away.
    Thorough,
}

/// Columns and rows to go to the lattice points at most so many columns and rows away, nearer ones
/// first.
fn offsets(radius: i32) -> Vec<(i32, i32)> {
    let range = || -radius..=radius;
    let around = range().flat_map(|dy| range().map(move |dx| (dx, dy)));
    let squared = |(dx, dy): (i32, i32)| dx * dx + dy * dy;
    let mut offsets: Vec<(i32, i32)> = around.filter(|&offset| offset != (0, 0)).collect();
    offsets.sort_by_key(|&offset| (squared(offset), offset.1, offset.0));
    offsets
}

impl Relocation {
    /// Has every vertex looked at.
    pub(crate) fn new<M: FaceMeasure>(mesh: &MeasuredMesh<M>) -> Self {
        let points = &mesh.triangulation.points;
        let (width, height) = mesh.size();
        let (count, order) = (points.len(), tile_order(points, width, height));
        let changed = vec![true; count];
        Self { is_due: changed.clone(), changed, order, promising: Vec::new() }
    }

    /// Has one more vertex, the next by number, looked at too.
    pub(crate) fn add(&mut self, vertex: u32) {
        self.changed.push(true);
        self.is_due.push(true);
        self.order.push(vertex);
    }

    /// Has every vertex looked at again, for another kind of look.
    pub(crate) fn restart(&mut self) {
        self.changed.fill(true);
    }

    /// Notes that the surroundings of vertices have changed.
    pub(crate) fn note(&mut self, vertices: &[u32]) {
        for &v in vertices {
            self.changed[v as usize] = true;
        }
    }

    /// Looks once at each vertex whose surroundings have changed, and tells how many there were: first
    /// at those well inside the patches of a large mesh, patch by patch on all threads, then in the same
    /// way at those inside of patches that are cut askew to the first ones, then at the others. What
    /// comes of it does not depend on the threads.
    pub(crate) fn pass<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        look: Look,
        control: &dyn Control,
    ) -> Result<usize, Cancelled> {
        let halvings = halvings(mesh.vertex_count());
        let mut looked_at = 0;
        if halvings > 0 {
            looked_at = self.look_in_patches(mesh, look, (Cuts::Straight, halvings), control)?;
            looked_at += self.look_in_patches(mesh, look, (Cuts::Diagonal, halvings), control)?;
        }
        let count = self.order.len();
        let poll = |i| control.poll(Stage::Refine, 2 * count + i, 3 * count);
        looked_at += self.look_in_order(mesh, look, &poll)?;
        self.is_due.fill(true);
        Ok(looked_at)
    }

    /// Looks at the vertices inside of patches that are due, and has the others still to be looked at.
    fn look_in_patches<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        look: Look,
        (cuts, halvings): (Cuts, u32),
        control: &dyn Control,
    ) -> Result<usize, Cancelled> {
        let partition = Partition::new(&mesh.triangulation, cuts, halvings);
        let due = self.order.iter().copied().filter(|&v| self.is_due[v as usize]);
        let orders = partition.in_parts(due);
        let mut patches: Vec<Option<(MeasuredMesh<M>, Self, usize)>> = Vec::new();
        patches.resize_with(orders.len(), || None);
        let count = self.order.len();
        let (total, done) = (3 * count, AtomicUsize::new(cuts as usize * count));
        let is_cancelled = AtomicBool::new(false);
        let hear = |_| if is_cancelled.load(Ordering::Relaxed) { Err(Cancelled) } else { Ok(()) };
        let ask = |i| {
            let poll = control.poll(Stage::Refine, done.load(Ordering::Relaxed) + i, total);
            poll.inspect_err(|_| is_cancelled.store(true, Ordering::Relaxed))
        };
        let work = |number: u32, order: Vec<u32>, poll: Poll<'_>| {
            let (mut patch, is_inner) = mesh.patch(&partition, number);
            let mut relocation = self.of_part(&partition.parts[number as usize], order, &is_inner);
            let looked_at = relocation.look_in_order(&mut patch, look, poll)?;
            done.fetch_add(relocation.order.len(), Ordering::Relaxed);
            Ok((patch, relocation, looked_at))
        };
        let shares = patches.iter_mut().zip(orders).enumerate();
        let own = |(number, (patch, order)): (usize, (&mut Option<_>, _))| {
            *patch = Some(work(number as u32, order, &ask)?);
            Ok(())
        };
        // Only a cancelled work ends early, and of that the caller's own thread tells.
        let other = |(number, (patch, order)): (usize, (&mut Option<_>, _))| {
            *patch = work(number as u32, order, &hear).ok();
        };
        share_out(control.threads(), shares, own, other)?;
        let (before, mut all_looked_at) = (mesh.total_error(), 0);
        for (part, patch) in partition.parts.iter().zip(patches) {
            let Some((patch, relocation, looked_at)) = patch else { return Err(Cancelled) };
            mesh.put_in(part, &patch, before);
            for (number, &v) in part.vertices.iter().enumerate() {
                self.changed[v as usize] = relocation.changed[number];
                self.is_due[v as usize] = relocation.is_due[number];
            }
            all_looked_at += looked_at;
        }
        Ok(all_looked_at)
    }

    /// What is known of the vertices of a part, of which those inside are to be looked at in `order`.
    fn of_part(&self, part: &Part, mut order: Vec<u32>, is_inner: &[bool]) -> Self {
        order.retain(|&number| is_inner[number as usize]);
        Self {
            changed: part.vertices.iter().map(|&v| self.changed[v as usize]).collect(),
            is_due: part.vertices.iter().map(|&v| self.is_due[v as usize]).collect(),
            order,
            promising: Vec::new(),
        }
    }

    /// Looks once at each vertex whose surroundings have changed and which is due, and tells how many
    /// there were. Those that can't be moved for the fence of a patch remain due.
    fn look_in_order<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        look: Look,
        poll: Poll<'_>,
    ) -> Result<usize, Cancelled> {
        let (near, window, mut looked_at) = (offsets(1), offsets(2), 0);
        for i in 0..self.order.len() {
            let vertex = self.order[i];
            if !std::mem::take(&mut self.is_due[vertex as usize])
                || !self.changed[vertex as usize]
                || !mesh.is_movable(vertex)
            {
                continue;
            }
            poll(i)?;
            let moved = match look {
                Look::Foresighted => self.follow_forecast(mesh, vertex, &near, &window),
                Look::Thorough => move_to_best(mesh, vertex, &window),
            };
            match moved {
                Moved::Yes => {
                    self.note(mesh.left());
                    self.note(mesh.reached());
                }
                Moved::No => self.changed[vertex as usize] = false,
                Moved::Fenced => self.is_due[vertex as usize] = true,
            }
            looked_at += usize::from(moved != Moved::Fenced);
        }
        Ok(looked_at)
    }

    /// Moves a vertex to the first of the promising places that is better than its own.
    fn follow_forecast<M: FaceMeasure>(
        &mut self,
        mesh: &mut MeasuredMesh<M>,
        vertex: u32,
        near: &[(i32, i32)],
        window: &[(i32, i32)],
    ) -> Moved {
        if !mesh.look_at(vertex) {
            return Moved::Fenced;
        }
        if !mesh.find_promising(window, (PROMISING, DOUBT), &mut self.promising) {
            return move_to_best(mesh, vertex, near);
        }
        if self.promising.is_empty() {
            return Moved::No;
        }
        let places = self.promising.iter().map(|&(_, place)| place);
        mesh.move_vertex(places, Choice::First)
    }
}

/// How often a mesh of so many vertices is halved to make patches.
fn halvings(vertex_count: usize) -> u32 {
    let patches = (vertex_count / LEAST_PATCH).checked_ilog2().unwrap_or(0);
    patches.max(u32::from(vertex_count >= LEAST_PARTED))
}

/// Moves a vertex to the best place of those around it, if one is better than its own.
fn move_to_best<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    vertex: u32,
    offsets: &[(i32, i32)],
) -> Moved {
    let from = mesh.triangulation.points[vertex as usize];
    let places = offsets.iter().map(|&(dx, dy)| Point::new(from.x + dx, from.y + dy));
    if mesh.look_at(vertex) { mesh.move_vertex(places, Choice::Best) } else { Moved::Fenced }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choices::ErrorMetric;
    use crate::control::Unattended;
    use crate::face_error::{FaceErrors, Measure};
    use crate::image::Image;
    use crate::mesh::corner_points;
    use crate::refine::tests::{measure_of, measured, picture, sum_of_errors};
    use crate::triangulation::triangulate;
    use proptest::prelude::*;
    use std::collections::BTreeSet;
    use std::num::NonZeroUsize;

    /// The places after one look at each vertex, each candidate triangulated and measured afresh.
    fn relocated_by_brute_force(
        image: &Image,
        mut points: Vec<Point>,
        order: &[u32],
        look: Look,
    ) -> Vec<Point> {
        let measure = measure_of(image);
        let mesh = measured(&measure, image, points.clone());
        let error = |points: &[Point]| sum_of_errors(image, points, &triangulate(points));
        let (width, height) = (image.width() as i32, image.height() as i32);
        let inside = |p: &Point| (0..width).contains(&p.x) && (0..height).contains(&p.y);
        for &v in order.iter().filter(|&&v| mesh.is_movable(v)) {
            let from = points[v as usize];
            let around = offsets(2).into_iter().map(|(x, y)| Point::new(from.x + x, from.y + y));
            let places: Vec<Point> = match look {
                Look::Thorough => around.filter(inside).collect(),
                Look::Foresighted => {
                    let mut mesh = measured(&measure, image, points.clone());
                    let mut promising = Vec::new();
                    let most = (PROMISING, DOUBT);
                    mesh.look_at(v);
                    assert!(mesh.find_promising(&offsets(2), most, &mut promising));
                    promising.into_iter().map(|(_, place)| place).collect()
                }
            };
            let mut best = (error(&points), from);
            for candidate in places {
                if points.contains(&candidate) {
                    continue;
                }
                let mut moved = points.clone();
                moved[v as usize] = candidate;
                let error = error(&moved);
                if error < best.0 {
                    best = (error, candidate);
                    if look == Look::Foresighted {
                        break;
                    }
                }
            }
            points[v as usize] = best.1;
        }
        points
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn a_pass_moves_vertices_as_trying_every_place_on_a_fresh_mesh_does(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..8),
            look in prop::sample::select(&[Look::Foresighted, Look::Thorough][..]),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let measure = measure_of(&image);
            let mut mesh = measured(&measure, &image, points.clone());
            let mut relocation = Relocation::new(&mesh);
            let order = relocation.order.clone();
            relocation.pass(&mut mesh, look, &Unattended).unwrap();
            let expected = relocated_by_brute_force(&image, points, &order, look);
            prop_assert_eq!(&mesh.triangulation.points, &expected);
            let total = sum_of_errors(&image, &expected, &triangulate(&expected));
            prop_assert_eq!(mesh.total_error(), total);
            for slot in 0..mesh.triangulation.slot_count() as u32 {
                let used = mesh.triangulation.is_used(slot);
                let error = used.then(|| measured_error(&measure, mesh.triangulation.corners(slot)));
                prop_assert_eq!(mesh.face_error(slot), error.unwrap_or(0));
            }
        }

        #[test]
        fn a_pass_with_patches_is_one_of_the_whole_mesh_patch_by_patch(
            (width, height) in (2usize..24, 2usize..24),
            samples in prop::collection::vec(0u16..64, 576),
            seeds in prop::collection::vec((0usize..24, 0usize..24), 0..90),
            look in prop::sample::select(&[Look::Foresighted, Look::Thorough][..]),
            (halvings, threads) in (1u32..4, 1usize..4),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let measure = measure_of(&image);
            let new_mesh = || measured(&measure, &image, points.clone());
            let threads = Threads(NonZeroUsize::new(threads).unwrap());
            let mut mesh = new_mesh();
            let mut relocation = Relocation::new(&mesh);
            // The same looks on the whole mesh, one patch after the other, then at what is left.
            let mut twin = new_mesh();
            let mut in_turn = Relocation::new(&twin);
            let all = in_turn.order.clone();
            for cuts in [Cuts::Straight, Cuts::Diagonal] {
                let was_due = relocation.is_due.clone();
                let count =
                    relocation.look_in_patches(&mut mesh, look, (cuts, halvings), &threads).unwrap();
                let partition = Partition::new(&twin.triangulation, cuts, halvings);
                let orders = partition.in_parts(all.iter().copied());
                let by_part = orders.iter().zip(&partition.parts).flat_map(|(order, part)| {
                    order.iter().map(|&number| part.vertices[number as usize])
                });
                let is_looked_at =
                    |v: &u32| was_due[*v as usize] && !relocation.is_due[*v as usize];
                in_turn.order = by_part.filter(is_looked_at).collect();
                let again = in_turn.look_in_order(&mut twin, look, &|_| Ok(())).unwrap();
                prop_assert_eq!(count, again);
                prop_assert_eq!(&in_turn.is_due, &relocation.is_due);
                assert_same(&mesh, &twin)?;
            }
            for (relocation, mesh) in [(&mut relocation, &mut mesh), (&mut in_turn, &mut twin)] {
                relocation.order = all.clone();
                relocation.look_in_order(mesh, look, &|_| Ok(())).unwrap();
            }
            assert_same(&mesh, &twin)?;
            prop_assert_eq!(&relocation.changed, &in_turn.changed);
            let (left, faces, _) = mesh.triangulation.mesh();
            prop_assert_eq!(&faces, &triangulate(&left));
            prop_assert_eq!(mesh.total_error(), sum_of_errors(&image, &left, &faces));
            for v in (0..points.len() as u32).filter(|&v| mesh.is_movable(v)).collect::<Vec<_>>() {
                mesh.remove(v);
            }
            prop_assert_eq!(mesh.total_error(), sum_of_errors_of_corners(&image));
        }

        #[test]
        fn the_promising_places_are_the_vacant_ones_of_least_forecast_in_order(
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 1..8),
        ) {
            let (image, points) = picture(9, 9, &samples, &seeds);
            let measure = measure_of(&image);
            let mut mesh = measured(&measure, &image, points.clone());
            let (mut all, mut few) = (Vec::new(), Vec::new());
            for v in (0..points.len() as u32).filter(|&v| mesh.is_movable(v)).collect::<Vec<_>>() {
                mesh.look_at(v);
                    assert!(mesh.find_promising(&offsets(2), (24, f32::MAX), &mut all));
                mesh.look_at(v);
                    assert!(mesh.find_promising(&offsets(2), (2, f32::MAX), &mut few));
                let from = points[v as usize];
                let near = |p: &Point| (p.x - from.x).abs() <= 2 && (p.y - from.y).abs() <= 2;
                let lattice = (0..9).flat_map(|y| (0..9).map(move |x| Point::new(x, y)));
                let vacant = lattice.filter(near).filter(|p| !points.contains(p)).count();
                // Where there is no error nothing can be gained, though rounding may foresee it.
                let slots = 0..mesh.triangulation.slot_count() as u32;
                let around = slots.filter(|&t| mesh.triangulation.corners(t).contains(&from));
                let is_perfect = around.map(|t| mesh.face_error(t)).sum::<u64>() == 0;
                if is_perfect {
                    prop_assert!(all.iter().all(|&(change, _)| change < 0.0));
                } else {
                    prop_assert_eq!(all.len(), vacant);
                }
                prop_assert!(all.is_sorted_by(|a, b| a.0 <= b.0));
                prop_assert_eq!(&few[..], &all[..few.len()]);
            }
        }
    }

    #[test]
    fn equal_weights_change_nothing_of_what_is_promised() {
        let samples: Vec<u16> = (0..81).map(|i| (i * i / 3 % 64) as u16).collect();
        let seeds: Vec<(usize, usize)> = (0..12).map(|i| (i * 5 % 9, i * 7 % 9)).collect();
        let (plain, points) = picture(9, 9, &samples, &seeds);
        let weighted = plain.clone().with_weights(vec![77; 81]).unwrap();
        let measures = [&plain, &weighted]
            .map(|image| Measure::with_foresight(image, ErrorMetric::MeanCompSe));
        let [mut plain_mesh, mut weighted_mesh] =
            [0, 1].map(|i| measured(&measures[i], &plain, points.clone()));
        assert_eq!(weighted_mesh.total_error(), 77 * plain_mesh.total_error());
        let mut refused = 0;
        for v in (0..points.len() as u32).filter(|&v| plain_mesh.is_movable(v)).collect::<Vec<_>>()
        {
            let promised = [&mut plain_mesh, &mut weighted_mesh].map(|mesh| {
                let (mut any, mut likely) = (Vec::new(), Vec::new());
                mesh.look_at(v);
                assert!(mesh.find_promising(&offsets(2), (24, f32::MAX), &mut any));
                assert!(mesh.find_promising(&offsets(2), (24, DOUBT), &mut likely));
                refused += any.len() - likely.len();
                (any, likely)
            });
            assert_eq!(promised[0], promised[1]);
        }
        assert!(refused > 0);
    }

    #[test]
    fn nearly_all_vertices_are_looked_at_in_patches_and_nearly_all_others_in_those_askew() {
        let samples: Vec<u16> = (0..90 * 90).map(|i| (i * i / 7 % 64) as u16).collect();
        let seeds: Vec<(usize, usize)> =
            (0..30 * 30).map(|i| (i % 30 * 3, i / 30 * 3 + i % 2)).collect();
        let (image, points) = picture(90, 90, &samples, &seeds);
        let measure = measure_of(&image);
        let mut mesh = measured(&measure, &image, points.clone());
        let mut relocation = Relocation::new(&mesh);
        let mut look = |cuts| {
            let how = (cuts, 1);
            relocation.look_in_patches(&mut mesh, Look::Foresighted, how, &Unattended).unwrap()
        };
        let (first, second) = (look(Cuts::Straight), look(Cuts::Diagonal));
        let all = points.len() - 4;
        assert!(first > all * 3 / 4, "{first} of {all}");
        assert!((all - first) * 3 / 4 < second && second <= all - first, "{second} after {first}");
    }

    #[test]
    fn patches_are_two_in_a_mesh_of_256_vertices_and_have_2048_vertices_or_more_in_larger_ones() {
        let counts = [0, 255, 256, 2047, 4096, 8191, 8192, 16_383, 16_384, 1 << 20];
        assert_eq!(counts.map(halvings), [0, 0, 1, 1, 1, 1, 2, 2, 3, 9]);
    }

    /// Two meshes have the same vertices at the same places, the same faces and the same errors.
    fn assert_same(
        a: &MeasuredMesh<FaceErrors<'_>>,
        b: &MeasuredMesh<FaceErrors<'_>>,
    ) -> Result<(), TestCaseError> {
        prop_assert_eq!(&a.triangulation.points, &b.triangulation.points);
        prop_assert_eq!(a.triangulation.mesh(), b.triangulation.mesh());
        prop_assert_eq!(a.total_error(), b.total_error());
        let errors = |mesh: &MeasuredMesh<FaceErrors<'_>>| {
            let slots = 0..mesh.triangulation.slot_count() as u32;
            let used = slots.filter(|&slot| mesh.triangulation.is_used(slot));
            used.map(|slot| {
                (mesh.triangulation.corners(slot).iter().min().copied(), mesh.face_error(slot))
            })
            .collect::<BTreeSet<_>>()
        };
        prop_assert_eq!(errors(a), errors(b));
        for y in 0..a.size().1 as i32 {
            for x in 0..a.size().0 as i32 {
                prop_assert_eq!(a.is_vacant(Point::new(x, y)), b.is_vacant(Point::new(x, y)));
            }
        }
        Ok(())
    }

    /// The error of the mesh that has the corners alone.
    fn sum_of_errors_of_corners(image: &Image) -> u64 {
        let mut corners = corner_points(image.width(), image.height());
        corners.sort_unstable();
        sum_of_errors(image, &corners, &triangulate(&corners))
    }

    /// Never cancels, and has some threads.
    struct Threads(NonZeroUsize);

    impl Control for Threads {
        fn poll(&self, _: Stage, _: usize, _: usize) -> Result<(), Cancelled> {
            Ok(())
        }

        fn threads(&self) -> NonZeroUsize {
            self.0
        }
    }

    /// The error of a face, measured afresh.
    fn measured_error(measure: &Measure<'_>, corners: [Point; 3]) -> u64 {
        FaceErrors::new(measure).error(corners)
    }
}
