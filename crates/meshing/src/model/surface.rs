//! The surface that a mesh models, not rounded to whole samples.

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::face_error::scan_conversion::{Interpolant, try_for_each_row};
use crate::image::{Point, Shape};
use crate::model::mesh::Mesh;

/// Calls `visit(point, samples)` once for each lattice point of the mesh's image, face by face, with
/// what the mesh models there: the linear interpolant of each component, or the face's samples where
/// the faces have [samples](Mesh::face_samples).
///
/// # Errors
/// When the control cancels.
///
/// ```
/// use pixmesh_meshing::{Mesh, Point, Shape, visit_surface};
///
/// let shape = Shape { width: 4, height: 2, component_count: 1, precision: 8 };
/// let corners = [(0, 0), (3, 0), (0, 1), (3, 1)].map(|(x, y)| Point::new(x, y));
/// let faces = vec![[0, 1, 3], [0, 3, 2]];
/// let mesh = Mesh::new(shape, corners.to_vec(), vec![0, 1, 0, 1], faces, &())?;
/// let mut sum = 0.0;
/// visit_surface(&mesh, &(), |_, samples| sum += samples[0])?;
/// assert!((sum - 4.0_f64).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn visit_surface(
    mesh: &Mesh,
    control: &dyn Control,
    mut visit: impl FnMut(Point, &[f64]),
) -> Result<(), Cancelled> {
    let Shape { component_count, .. } = mesh.shape();
    let mut poller = Poller::new(control, Stage::Rasterize, 0, mesh.faces().len());
    let mut samples = vec![0.0; component_count];
    for (f, &face) in mesh.faces().iter().enumerate() {
        let corners = mesh.corners(face);
        let of_corners = |c| face.map(|v| mesh.vertex_samples(v as usize)[c]);
        let interpolants = (0..component_count).map(|c| Interpolant::new(corners, of_corners(c)));
        let interpolants: Vec<Interpolant> = interpolants.collect();
        let own = mesh.face_samples().map(|samples| &samples[f * component_count..]);
        poller.done = f;
        try_for_each_row(corners, |y, first, end| {
            poller.step((end - first) as usize)?;
            for x in first..end {
                for (c, sample) in samples.iter_mut().enumerate() {
                    *sample = match own {
                        Some(own) => own[c].into(),
                        None => interpolants[c].at(x, y),
                    };
                }
                visit(Point::new(x, y), &samples);
            }
            Ok(())
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::corner_points;
    use crate::model::rasterize::rasterize;
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn each_point_is_visited_once_near_its_rebuilt_samples(
            (width, height) in (2usize..40, 2usize..40),
            positions in prop::collection::vec((0i32..40, 0i32..40), 0..30),
            is_flat in any::<bool>(),
        ) {
            let inner = positions.iter().map(|&(x, y)| {
                Point::new(x % width as i32, y % height as i32)
            });
            let mut points: Vec<Point> = inner.chain(corner_points(width, height)).collect();
            points.sort_unstable();
            points.dedup();
            let sample = |i: usize| (i * 40_503 % (1 << 16)) as u16;
            let samples = (0..3 * points.len()).map(sample).collect();
            let shape = Shape { width, height, component_count: 3, precision: 16 };
            let faces = triangulate(&points);
            let of_faces = (0..3 * faces.len()).map(sample).collect();
            let mut mesh = Mesh::new(shape, points, samples, faces, &()).unwrap();
            if is_flat {
                mesh = mesh.with_face_samples(of_faces).unwrap();
            }
            let image = rasterize(&mesh, &()).unwrap();
            let mut visits = vec![0; width * height];
            visit_surface(&mesh, &(), |point, samples| {
                let (x, y) = (point.x as usize, point.y as usize);
                visits[y * width + x] += 1;
                for (c, sample) in samples.iter().enumerate() {
                    let rebuilt = f64::from(image.row(c, y)[x]);
                    assert!((sample - rebuilt).abs() <= 0.5 + 1e-9, "{sample} and {rebuilt}");
                }
            }).unwrap();
            prop_assert!(visits.iter().all(|&count| count == 1));
        }
    }
}
