//! The vertices in areas of one color leave before greedy removal starts.
//!
//! Where every face at a vertex holds one color, removing the vertex changes no error: the faces
//! that fill the hole hold that color too. For the same reason it stays so when any other such
//! vertex leaves. So all of them leave at once, and the others are triangulated anew.
//!
//! The queue of greedy removal would remove them as well, row by row, as equal changes go. Then the
//! vertices along the emptied area have thousands of neighbours, and the time grows with the square
//! of the number of vertices. Which of them leave first changes no error.
//!
//! Photographs hold small areas of one color too. There the order of equal changes decides which
//! vertices stay near a feature, so a vertex counts as featureless only at some distance from the
//! nearest feature: in few photographs is any vertex so far away, and these keep the order of rows.

use crate::control::{Cancelled, Control, POINTS_PER_POLL, Poller, Stage, collect};
use crate::face_error::scan_conversion::try_for_each_row;
use crate::image::{Image, Point, corner_points};
use crate::removal::greedy::Removal;
use crate::removal::tile_order::tile_order;
use crate::triangulation::Triangulation;
use std::iter::repeat_n;

/// Least number of edges from a featureless vertex to a vertex of a face of several colors.
///
/// Of the photographs of the golden set, `kodim23` has the largest areas of one color: 0.2 % of its
/// vertices are 1 edge or more away from a feature, 0.01 % are 5 away, and none is 6 away.
const LEAST_DISTANCE: usize = 6;

/// Removes at most `surplus` featureless vertices of a triangulation of `image`, and lists them
/// where `lists_removals` says so.
///
/// When there are more, those that stay are spread evenly over the featureless areas.
pub(crate) fn remove_featureless(
    image: &Image,
    triangulation: Triangulation,
    surplus: usize,
    lists_removals: bool,
    control: &dyn Control,
) -> Result<(Triangulation, Vec<Removal>), Cancelled> {
    let mut leaves = featureless_vertices(image, &triangulation, control)?;
    let count = leaves.iter().filter(|&&leaves| leaves).count();
    if count > surplus {
        let points = &triangulation.points;
        let poller = &mut Poller::new(control, Stage::Triangulate, points.len(), points.len());
        thin(&mut leaves, count, surplus, &tile_order(points, image.sides(), poller)?);
    }
    if count.min(surplus) == 0 {
        return Ok((triangulation, Vec::new()));
    }
    // Only the points: the half-edges take more memory than the next triangulation.
    let points = triangulation.into_points(control)?;
    let (mut kept, mut removals) = (Vec::new(), Vec::new());
    for (point, leaves) in points.into_iter().zip(leaves) {
        if !leaves {
            kept.push(point);
        } else if lists_removals {
            removals.push(Removal { point, change: 0 });
        }
    }
    Ok((Triangulation::new(kept, control)?, removals))
}

/// For each vertex, whether it is far from every feature and not a corner of the image.
fn featureless_vertices(
    image: &Image,
    triangulation: &Triangulation,
    control: &dyn Control,
) -> Result<Vec<bool>, Cancelled> {
    let Triangulation { points, origins, .. } = triangulation;
    let (faces, _) = origins.as_chunks::<3>();
    let poller = &mut Poller::new(control, Stage::Triangulate, points.len(), points.len());
    let mut is_far = collect(repeat_n(true, points.len()), || poller.poll())?;
    for faces in faces.chunks(POINTS_PER_POLL) {
        poller.poll()?;
        for face in faces {
            if !holds_one_color(image, face.map(|v| points[v as usize]), poller)? {
                face.iter().for_each(|&v| is_far[v as usize] = false);
            }
        }
    }
    for _ in 1..LEAST_DISTANCE {
        if !is_far.contains(&true) {
            break;
        }
        let was_far = collect(is_far.iter().copied(), || poller.poll())?;
        for faces in faces.chunks(POINTS_PER_POLL) {
            poller.poll()?;
            for face in faces {
                if face.iter().any(|&v| !was_far[v as usize]) {
                    face.iter().for_each(|&v| is_far[v as usize] = false);
                }
            }
        }
    }
    for corner in corner_points(image.width(), image.height()) {
        if let Ok(v) = points.binary_search(&corner) {
            is_far[v] = false;
        }
    }
    Ok(is_far)
}

/// Whether the vertices of a face and all lattice points that belong to it have one color.
fn holds_one_color(
    image: &Image,
    corners: [Point; 3],
    poller: &mut Poller<'_>,
) -> Result<bool, Cancelled> {
    let width = image.width();
    let (mut is_one, mut components) = (true, image.components().iter());
    while is_one && let Some(samples) = components.next() {
        let [sample, second, third] = corners.map(|p| samples[p.y as usize * width + p.x as usize]);
        is_one = sample == second && sample == third;
        if is_one {
            try_for_each_row(corners, |y, first, end| {
                let row = &samples[y as usize * width..][first as usize..end as usize];
                poller.step(row.len())?;
                is_one = is_one && row.iter().all(|&other| other == sample);
                Ok(())
            })?;
        }
    }
    Ok(is_one)
}

/// Unmarks some of `marked` marks, evenly along an order of all vertices, until `count` are left.
fn thin(marks: &mut [bool], marked: usize, count: usize, order: &[u32]) {
    let marked_before = |i: usize| i as u64 * count as u64 / marked as u64;
    let mut i = 0;
    for &v in order {
        let mark = &mut marks[v as usize];
        if *mark {
            *mark = marked_before(i) < marked_before(i + 1);
            i += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::poller;
    use crate::dynamic_mesh::MeasuredMesh;
    use crate::face_error::{ErrorEvaluator, FaceErrors};
    use crate::parameters::choices::ErrorMetric;
    use proptest::prelude::*;

    const WIDTH: usize = 40;
    const HEIGHT: usize = 30;

    fn image_of(sample: impl Fn(usize, usize) -> u16) -> Image {
        let samples = (0..WIDTH * HEIGHT).map(|i| sample(i % WIDTH, i / WIDTH)).collect();
        Image::from_bottom_up(WIDTH, HEIGHT, 8, vec![samples]).unwrap()
    }

    /// The triangulation of the corners and the points that `is_chosen` says.
    fn triangulation_of(is_chosen: impl Fn(usize) -> bool) -> Triangulation {
        let corners = corner_points(WIDTH, HEIGHT);
        let lattice = (0..WIDTH * HEIGHT)
            .map(|i| (i, Point::new((i % WIDTH) as i32, (i / WIDTH) as i32)))
            .filter(|(i, p)| is_chosen(*i) || corners.contains(p));
        Triangulation::new(lattice.map(|(_, p)| p).collect(), &()).unwrap()
    }

    fn removed(image: &Image, surplus: usize) -> Vec<Point> {
        let triangulation = triangulation_of(|_| true);
        let (_, removals) = remove_featureless(image, triangulation, surplus, true, &()).unwrap();
        removals.into_iter().map(|removal| removal.point).collect()
    }

    #[test]
    fn keeps_vertices_near_features() {
        let dot = image_of(|x, y| u16::from((x, y) == (20, 15)));
        // Each square of the lattice is cut along (1, 1).
        let edges_to_dot = |p: &Point| {
            let (x, y) = (p.x - 20, p.y - 15);
            x.abs().max(y.abs()).max((x - y).abs())
        };
        let corners = corner_points(WIDTH, HEIGHT);
        let mut expected = triangulation_of(|_| true).points;
        expected.retain(|p| !corners.contains(p) && edges_to_dot(p) > LEAST_DISTANCE as i32);
        assert_eq!(removed(&dot, usize::MAX), expected);
    }

    #[test]
    fn keeps_pictures_without_large_areas() {
        for sample in [
            |x: usize, y: usize| (x + y) as u16 % 2,
            |x: usize, _: usize| (x as u16 + 2) / 5,
            |x: usize, y: usize| (3 * x + 2 * y) as u16,
            |x: usize, y: usize| (x * 7919 + y * 104_729) as u16 % 251,
        ] {
            assert_eq!(removed(&image_of(sample), usize::MAX), []);
        }
    }

    #[test]
    fn spreads_vertices_that_stay() {
        let page = image_of(|_, _| 255);
        let removed = removed(&page, WIDTH * HEIGHT - 4 - 100);
        assert_eq!(removed.len(), WIDTH * HEIGHT - 4 - 100);
        for left in (0..WIDTH as i32).step_by(10) {
            let stay = 300 - removed.iter().filter(|p| (left..left + 10).contains(&p.x)).count();
            assert!((15..40).contains(&stay), "{stay} from column {left} on");
        }
    }

    proptest! {
        #[test]
        fn each_removal_changes_no_error(
            spots in prop::collection::vec((0..WIDTH, 0..HEIGHT, 0usize..5, 1u16..255), 0..4),
            (density, seed) in (1usize..20, any::<usize>()),
            surplus in 0..WIDTH * HEIGHT,
            metric in prop::sample::select(&[ErrorMetric::MeanCompSe, ErrorMetric::VecSe][..]),
            weighted in any::<bool>(),
        ) {
            let mut planes = vec![vec![9; WIDTH * HEIGHT]; 3];
            for &(x, y, radius, value) in &spots {
                for i in (0..WIDTH * HEIGHT)
                    .filter(|i| (i % WIDTH).abs_diff(x) + (i / WIDTH).abs_diff(y) <= radius)
                {
                    planes[value as usize % 3][i] = value;
                }
            }
            let image = Image::from_bottom_up(WIDTH, HEIGHT, 8, planes).unwrap();
            let weights: Vec<u8> = (0..WIDTH * HEIGHT).map(|i| (i * 31 % 256) as u8).collect();
            let initial = triangulation_of(|i| i.wrapping_mul(seed | 1) % 20 < density);
            let count = initial.points.len();
            let weights = weighted.then_some(&weights[..]);
            let measure = ErrorEvaluator::new(&image, metric, weights, &mut poller()).unwrap();
            let errors = FaceErrors::new(&measure);
            let points = initial.points.clone();
            let mut mesh =
                MeasuredMesh::new(points.clone(), image.sides(), errors, Stage::Measure, &())
                    .unwrap();
            let (left, removals) = remove_featureless(&image, initial, surplus, true, &()).unwrap();
            prop_assert!(removals.len() <= surplus);
            prop_assert_eq!(left.points.len() + removals.len(), count);
            for Removal { point, change } in removals {
                let vertex = points.binary_search(&point).unwrap();
                prop_assert_eq!((mesh.remove(vertex as u32, &mut poller()), change), (Ok(0), 0));
            }
            let meshed = mesh.triangulation.sorted(&()).unwrap();
            let faces = left.faces(&()).unwrap();
            prop_assert_eq!((meshed.points, meshed.faces), (left.points, faces));
        }
    }
}
