//! Batch removal: the cheapest vertices of a mesh leave many at a time.
//!
//! Where they leave one by one (`growth`), each changes what the removal of those around it costs, which
//! are evaluated again one after the other. Here a batch is made of the cheapest vertices, as many as
//! must still go, but for the neighbours of those that go before them: what a vertex costs does not
//! change while its neighbours stay. All vertices around the batch are then evaluated together, on all
//! threads, and each but once. The order differs a little from that of one by one.

use crate::control::{Cancelled, Control};
use crate::dynamic_mesh::probe::find_all;
use crate::dynamic_mesh::{FaceMeasure, MeasuredMesh};

/// What the removal of a vertex costs, and the vertex.
type Cost = (i64, u32);

/// Removes `count` vertices, or all that can be; `note` hears of the vertices around each.
///
/// # Errors
/// When the control cancels.
pub(crate) fn remove_in_batches<M: FaceMeasure>(
    mesh: &mut MeasuredMesh<M>,
    count: usize,
    mut note: impl FnMut(&[u32]),
    control: &dyn Control,
) -> Result<(), Cancelled> {
    let mut is_stale = vec![false; mesh.triangulation.points.len()];
    let mut stale: Vec<u32> = (0..is_stale.len() as u32).collect();
    let (mut costs, mut left) = (Vec::<Cost>::new(), count);
    while left > 0 {
        stale.retain(|&v| mesh.is_movable(v));
        costs.extend(evaluate(mesh, &stale, control)?);
        stale.clear();
        if costs.is_empty() {
            break;
        }
        for &(_, vertex) in cheapest(&mut costs, left) {
            if is_stale[vertex as usize] {
                continue;
            }
            mesh.remove(vertex);
            left -= 1;
            note(mesh.left());
            stale.extend(mesh.left().iter().filter(|&&v| !is_stale[v as usize]));
            mesh.left().iter().for_each(|&v| is_stale[v as usize] = true);
        }
        costs.retain(|&(_, v)| mesh.is_movable(v) && !is_stale[v as usize]);
        stale.iter().for_each(|&v| is_stale[v as usize] = false);
    }
    Ok(())
}

/// What the removal of each of some vertices costs.
fn evaluate<M: FaceMeasure>(
    mesh: &MeasuredMesh<M>,
    vertices: &[u32],
    control: &dyn Control,
) -> Result<impl Iterator<Item = Cost>, Cancelled> {
    let (surface, new_probe) = (mesh.surface(), || mesh.another_probe());
    let find = |vertex, probe: &mut _| surface.removal_change(vertex, probe);
    let changes = find_all(vertices, new_probe, find, control)?;
    Ok(changes.into_iter().zip(vertices.iter().copied()))
}

/// The cheapest `count`, or all, in ascending order.
fn cheapest(costs: &mut [Cost], count: usize) -> &[Cost] {
    let count = count.min(costs.len());
    if count < costs.len() {
        costs.select_nth_unstable(count);
    }
    costs[..count].sort_unstable();
    &costs[..count]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::OnThreads;
    use crate::image::Point;
    use crate::refinement::tests::{measure_of, measured, picture, sum_of_errors};
    use crate::triangulation::{Face, triangulate};
    use proptest::prelude::*;
    use std::num::NonZeroUsize;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn a_batch_is_the_cheapest_vertices_but_for_neighbours_of_those_before_them(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(0u16..64, 81),
            seeds in prop::collection::vec((0usize..9, 0usize..9), 0..20),
            (part, threads) in (0usize..=100, 1usize..4),
        ) {
            let (image, points) = picture(width, height, &samples, &seeds);
            let (measure, control) = (measure_of(&image), OnThreads((), NonZeroUsize::new(threads).unwrap()));
            let mut mesh = measured(&measure, &image, points.clone());
            let count = (points.len() - 4) * part / 100;
            let mut heard = Vec::new();
            remove_in_batches(&mut mesh, count, |around| heard.push(around.to_vec()), &control).unwrap();
            prop_assert_eq!(heard.len(), count);
            // The same, all triangulated and measured afresh for each batch.
            let error = |points: &[Point]| sum_of_errors(&image, points, &triangulate(points)) as i64;
            let (mut twin, mut left) = (points.clone(), count);
            while left > 0 {
                let cost = |p: &Point| {
                    let without: Vec<Point> = twin.iter().copied().filter(|q| q != p).collect();
                    error(&without) - error(&twin)
                };
                let movable = twin.iter().filter(|p| !mesh.triangulation.is_corner(**p));
                let mut costs: Vec<(i64, Point)> = movable.map(|p| (cost(p), *p)).collect();
                // Vertices are numbered by place at first.
                costs.sort_by_key(|&(cost, p)| (cost, points.iter().position(|q| *q == p)));
                let faces = triangulate(&twin);
                let number = |p: Point| twin.iter().position(|q| *q == p).unwrap() as u32;
                let mut gone: Vec<Point> = Vec::new();
                for &(_, p) in costs.iter().take(left) {
                    let is_beside = |q: &Point| {
                        faces.iter().any(|f: &Face| f.contains(&number(p)) && f.contains(&number(*q)))
                    };
                    if !gone.iter().any(is_beside) {
                        gone.push(p);
                    }
                }
                left -= gone.len();
                twin.retain(|p| !gone.contains(p));
            }
            let (kept, faces, _) = mesh.triangulation.mesh();
            prop_assert_eq!(&kept, &twin);
            prop_assert_eq!(&faces, &triangulate(&twin));
            prop_assert_eq!(mesh.total_error(), sum_of_errors(&image, &twin, &faces));
        }
    }

    #[test]
    fn all_but_the_corners_can_go_and_no_more() {
        let seeds: Vec<(usize, usize)> = (0..40).map(|i| (i % 8, i * 3 % 7)).collect();
        let samples: Vec<u16> = (0..81).map(|i| i * i % 64).collect();
        let (image, points) = picture(8, 8, &samples, &seeds);
        let measure = measure_of(&image);
        let mut mesh = measured(&measure, &image, points);
        remove_in_batches(&mut mesh, usize::MAX, |_| (), &()).unwrap();
        assert_eq!(mesh.vertex_count(), 4);
    }
}
