//! Greedy insertion until a bound holds: the points of a mesh within a largest error, quickly.
//!
//! Michael Garland and Paul S. Heckbert, "Fast polygonal approximation of terrains and height
//! fields", 1995: again and again, the pixel of largest error of all becomes a vertex.

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::dynamic_mesh::MeasuredMesh;
use crate::face_error::FaceMeasure;
use crate::face_error::bound::Bound;
use crate::image::{Image, MAX_POINTS, Point, corner_points};
use std::collections::BinaryHeap;

/// How many steps of a [`Poller`] an insertion counts, beside one for each pixel.
const STEPS_PER_INSERTION: usize = 256;

/// The lowest bits of a face's error, which hold the number of its worst pixel.
const PIXEL_BITS: u32 = MAX_POINTS.ilog2() + 1;

/// The part of all pixels from which on all are vertices: their triangulation takes no more memory.
const MOST_INSERTED: usize = 2;

/// The points of a mesh that keeps a bound, by row, then column, the corners among them: about the
/// fewest that insertion finds, or all.
pub(crate) fn points_within(
    bound: Bound<'_>,
    control: &dyn Control,
) -> Result<Vec<Point>, Cancelled> {
    let image = bound.image;
    let corners = corner_points(image.width(), image.height()).to_vec();
    let measure = Farthest { bound };
    let mut mesh = MeasuredMesh::new(corners, image.sides(), measure, Stage::Insert, control)?;
    // The faces that break the bound, the largest error first; some were replaced since.
    let mut demands: BinaryHeap<(u64, u32)> = BinaryHeap::new();
    let slots = 0..mesh.triangulation.slot_count() as u32;
    demands.extend(slots.map(|slot| (mesh.triangulation.face_error(slot), slot)));
    let most = image.pixel_count() / MOST_INSERTED;
    let mut poller = Poller::new(control, Stage::Insert, 0, most);
    poller.poll()?;
    while let Some((error, slot)) = demands.pop()
        && error > 0
    {
        // The worst pixel belongs to one face alone.
        if mesh.triangulation.face_error(slot) != error {
            continue;
        }
        poller.done = mesh.triangulation.points.len();
        if poller.done > most {
            drop(mesh);
            return all_points(image, &mut poller);
        }
        poller.step(STEPS_PER_INSERTION)?;
        let pixel = (error & ((1 << PIXEL_BITS) - 1)) as usize;
        let at = Point::new((pixel % image.width()) as i32, (pixel / image.width()) as i32);
        mesh.add_vertex(at, slot, &mut poller)?;
        let demand = |&slot: &u32| (mesh.triangulation.face_error(slot), slot);
        demands.extend(mesh.fan.iter().map(demand).filter(|(error, _)| *error > 0));
    }
    let mut points = mesh.triangulation.points;
    points.sort_unstable();
    Ok(points)
}

fn all_points(image: &Image, poller: &mut Poller<'_>) -> Result<Vec<Point>, Cancelled> {
    let mut points = Vec::with_capacity(image.pixel_count());
    for y in 0..image.height() as i32 {
        poller.step(image.width())?;
        points.extend((0..image.width() as i32).map(|x| Point::new(x, y)));
    }
    Ok(points)
}

/// Measures a face by its worst pixel: how far it is from its sample, then its number among all
/// pixels; 0 where the face keeps the bound.
#[derive(Clone)]
struct Farthest<'a> {
    bound: Bound<'a>,
}

impl FaceMeasure for Farthest<'_> {
    fn error(&mut self, corners: [Point; 3], poller: &mut Poller<'_>) -> Result<u64, Cancelled> {
        let found = self.bound.farthest(corners, poller)?;
        Ok(found.map_or(0, |(parts, at)| {
            let pixel = at.y as usize * self.bound.image.width() + at.x as usize;
            // Samples of 16 bits leave 24 bits for the difference, so that sums of faces fit.
            (parts >> 8) << PIXEL_BITS | pixel as u64
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::face_error::bound::Tolerance;
    use crate::model::mesh::Mesh;
    use crate::model::rasterize::rasterize;
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn points_keep_the_bound(
            (width, height) in (2usize..14, 2usize..14),
            samples in prop::collection::vec(0u16..40, 2 * 14 * 14),
            most in 0u16..40,
        ) {
            let planes = samples.chunks(14 * 14).map(|plane| plane[..width * height].to_vec());
            let image = Image::from_bottom_up(width, height, 8, planes.collect()).unwrap();
            let bound = Bound { image: &image, tolerance: Tolerance::of_rounded(most), has_holes: false };
            let points = points_within(bound, &()).unwrap();
            prop_assert!(points.is_sorted_by(|a, b| a < b));
            let mesh = Mesh::of_samples(&image, points.clone(), triangulate(&points), &()).unwrap();
            let rebuilt = rasterize(&mesh, &()).unwrap();
            let (expected, found) = (image.components().concat(), rebuilt.components().concat());
            prop_assert!(expected.iter().zip(&found).all(|(a, b)| a.abs_diff(*b) <= most));
            let is_all = points.len() == width * height;
            prop_assert!(is_all || points.len() <= 1 + (width * height / MOST_INSERTED).max(4));
        }
    }

    #[test]
    fn the_pixel_of_largest_error_becomes_a_vertex() {
        let mut samples = vec![10; 81];
        samples[4 * 9 + 3] = 30;
        samples[6 * 9 + 7] = 17;
        let image = Image::from_bottom_up(9, 9, 8, vec![samples]).unwrap();
        let inner = |most| {
            let tolerance = Tolerance::of_rounded(most);
            let points =
                points_within(Bound { image: &image, tolerance, has_holes: false }, &()).unwrap();
            let corners = corner_points(9, 9);
            points.into_iter().filter(|point| !corners.contains(point)).collect::<Vec<_>>()
        };
        assert_eq!(inner(20), []);
        assert!(inner(19).contains(&Point::new(3, 4)));
    }
}
