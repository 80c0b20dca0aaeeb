//! The image rebuilt from a mesh.

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::face_error::scan_conversion::{
    Interpolant, PLANE_PRECISION, Plane, ROWS, SmallFace, try_for_each_row,
};
use crate::image::{Image, Shape};
use crate::model::mesh::Mesh;
use crate::triangulation::Face;
use fearless_simd::{Level, Simd, dispatch, f32x8, i32x8, mask16x8, prelude::*, u16x8, u32x8};

/// Faces between two polls of the control; rows of large faces poll too.
const FACES_PER_POLL: usize = 64;
const LANES: usize = 8;

/// Rebuilds the image that a mesh models: in each face each component is the linear interpolant
/// of its vertices' samples, rounded to the nearest integer, halves up; or the face's sample where
/// the faces have [samples](Mesh::face_samples).
///
/// # Errors
/// When the control cancels.
///
/// ```
/// use pixmesh_meshing::{Mesh, Point, Shape, rasterize};
///
/// let shape = Shape { width: 3, height: 2, component_count: 1, precision: 8 };
/// let corners = [(0, 0), (2, 0), (0, 1), (2, 1)].map(|(x, y)| Point::new(x, y));
/// let faces = vec![[0, 1, 3], [0, 3, 2]];
/// let mesh = Mesh::new(shape, corners.to_vec(), vec![10, 20, 10, 20], faces, &())?;
/// assert_eq!(rasterize(&mesh, &())?.row(0, 1), [10, 15, 20]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn rasterize(mesh: &Mesh, control: &dyn Control) -> Result<Image, Cancelled> {
    let Shape { width, height, component_count, precision } = mesh.shape();
    let (total, level) = (mesh.faces().len(), Level::new());
    let mut canvas = Canvas {
        mesh,
        width,
        // Each allocated as zeros, which costs nothing until it is written.
        components: (0..component_count).map(|_| vec![0; width * height + LANES]).collect(),
        poller: Poller::new(control, Stage::Rasterize, 0, total),
    };
    for (chunk, faces) in mesh.faces().chunks(FACES_PER_POLL).enumerate() {
        canvas.poller.done = chunk * FACES_PER_POLL;
        control.poll(Stage::Rasterize, canvas.poller.done, total)?;
        if let Some(samples) = mesh.face_samples() {
            let samples = samples.chunks_exact(component_count).skip(canvas.poller.done);
            faces.iter().zip(samples).try_for_each(|(&face, s)| canvas.fill_flat_face(face, s))?;
        } else if precision <= PLANE_PRECISION {
            dispatch!(level, simd => canvas.fill_small_faces(simd, faces))?;
        } else {
            faces.iter().try_for_each(|&face| canvas.fill_face(face))?;
        }
    }
    let mut components = canvas.components;
    components.iter_mut().for_each(|samples| samples.truncate(width * height));
    Ok(Image::from_kernel(width, height, precision, components))
}

struct Canvas<'a> {
    mesh: &'a Mesh,
    width: usize,
    /// The samples of each component, with space for a vector that begins at the last one.
    components: Vec<Vec<u16>>,
    poller: Poller<'a>,
}

impl Canvas<'_> {
    fn fill_flat_face(&mut self, face: Face, face_samples: &[u16]) -> Result<(), Cancelled> {
        let corners = self.mesh.corners(face);
        for (samples, &sample) in self.components.iter_mut().zip(face_samples) {
            try_for_each_row(corners, |y, first, end| {
                self.poller.step((end - first) as usize)?;
                let row = &mut samples[y as usize * self.width..];
                row[first as usize..end as usize].fill(sample);
                Ok(())
            })?;
        }
        Ok(())
    }

    fn fill_face(&mut self, face: Face) -> Result<(), Cancelled> {
        let corners = self.mesh.corners(face);
        for (c, samples) in self.components.iter_mut().enumerate() {
            let at_corners = face.map(|v| self.mesh.vertex_samples(v as usize)[c]);
            let interpolant = Interpolant::new(corners, at_corners);
            try_for_each_row(corners, |y, first, end| {
                self.poller.step((end - first) as usize)?;
                let row = &mut samples[y as usize * self.width..];
                interpolant.fill(first, y, &mut row[first as usize..end as usize]);
                Ok(())
            })?;
        }
        Ok(())
    }

    #[inline(always)]
    fn fill_small_faces<S: Simd>(&mut self, simd: S, faces: &[Face]) -> Result<(), Cancelled> {
        for &face in faces {
            match SmallFace::new(self.mesh.corners(face)) {
                Some(small) if !small.touches_axes() => self.fill_small_face(simd, face, small),
                _ => self.fill_face(face)?,
            }
        }
        Ok(())
    }

    #[inline(always)]
    fn fill_small_face<S: Simd>(&mut self, simd: S, face: Face, small: SmallFace) {
        let offsets = i32x8::simd_from(simd, [0, 1, 2, 3, 4, 5, 6, 7]);
        let lanes = u16x8::simd_from(simd, [0, 1, 2, 3, 4, 5, 6, 7]);
        let (corners, width) = (self.mesh.corners(face), self.width);
        let vertices = face.map(|v| self.mesh.vertex_samples(v as usize));
        for first_row in (0..small.rows).step_by(ROWS) {
            let rows = small.rows(simd, first_row);
            let row_count = ROWS.min((small.rows - first_row) as usize);
            let y = small.bottom + 1 + first_row;
            for (c, samples) in self.components.iter_mut().enumerate() {
                let at_corners = vertices.map(|samples| f32x8::splat(simd, samples[c].into()));
                let plane = Plane::new(simd, corners, at_corners, offsets);
                let (mut numerators, mut start) = (plane.row(y), y as usize * width);
                for (&first, &count) in rows.firsts.iter().zip(&rows.counts).take(row_count) {
                    if count > 0 {
                        let ahead = (first - plane.a.x) as f32;
                        let from_first = numerators + plane.per_column * ahead;
                        let samples = &mut samples[start + first as usize..];
                        fill_row(&plane, from_first, lanes, samples, count as usize);
                    }
                    numerators += plane.per_row;
                    start += width;
                }
            }
        }
    }
}

/// Writes the interpolant to the first `count` samples; the samples after them keep their values.
#[inline(always)]
fn fill_row<S: Simd>(
    plane: &Plane<S>,
    mut numerators: f32x8<S>,
    lanes: u16x8<S>,
    samples: &mut [u16],
    count: usize,
) {
    for i in (0..count).step_by(LANES) {
        let part = &mut samples[i..i + LANES];
        let values: u32x8<S> = plane.rounded(numerators).to_int();
        let (low, high) = values.split();
        let is_inside: mask16x8<S> = lanes.simd_lt((count - i) as u16);
        let before = u16x8::from_slice(plane.simd, part);
        is_inside.select(low.narrow(high), before).store_slice(part);
        numerators += plane.per_column * LANES as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::Recorder;
    use crate::image::{Point, corner_points};
    use crate::triangulation::triangulate;
    use proptest::prelude::*;

    const SHAPE: Shape = Shape { width: 5, height: 3, component_count: 2, precision: 8 };

    /// A mesh of the corners alone, whose samples are 0.
    fn two_faces(shape: Shape) -> Mesh {
        let points = corner_points(shape.width, shape.height).to_vec();
        let samples = vec![0; 4 * shape.component_count];
        Mesh::new(shape, points, samples, vec![[0, 1, 3], [0, 3, 2]], &()).unwrap()
    }

    #[test]
    fn polls_within_large_faces() {
        for precision in [8, 16] {
            let shape = Shape { width: 2000, height: 1000, precision, ..SHAPE };
            let recorder = Recorder::default();
            rasterize(&two_faces(shape), &recorder).unwrap();
            let count = recorder.done(Stage::Rasterize, 2).len();
            assert!(count > 2 * 2_000_000 / 70_000, "{count} polls");
        }
    }

    #[test]
    fn two_triangles_rebuild_a_plane() {
        let points = corner_points(5, 3).to_vec();
        let samples = vec![0, 9, 40, 9, 20, 9, 60, 9];
        let mesh = Mesh::new(SHAPE, points, samples, vec![[0, 1, 3], [0, 3, 2]], &()).unwrap();
        let image = rasterize(&mesh, &()).unwrap();
        assert_eq!(image.row(0, 0), [0, 10, 20, 30, 40]);
        assert_eq!(image.row(0, 1), [10, 20, 30, 40, 50]);
        assert_eq!(image.row(0, 2), [20, 30, 40, 50, 60]);
        assert_eq!(image.components()[1], [9; 15]);
    }

    proptest! {
        #[test]
        fn vectors_fill_faces_as_single_samples_do(
            (width, height) in (2usize..90, 2usize..90),
            positions in prop::collection::vec((0i32..90, 0i32..90), 0..60),
            component_count in 1usize..5,
            precision in prop::sample::select(vec![3, 8, 9, 16]),
        ) {
            let inner = positions.iter().map(|&(x, y)| {
                Point::new(x % width as i32, y % height as i32)
            });
            let mut points: Vec<Point> = inner.chain(corner_points(width, height)).collect();
            points.sort_unstable();
            points.dedup();
            let count = points.len() * component_count;
            let samples = (0..count).map(|i| (i * 40_503 % (1 << precision)) as u16).collect();
            let shape = Shape { width, height, component_count, precision };
            let faces = triangulate(&points);
            let mesh = Mesh::new(shape, points, samples, faces, &()).unwrap();
            let vectors = rasterize(&mesh, &()).unwrap();
            let components = vec![vec![0; width * height]; component_count];
            let poller = Poller::new(&(), Stage::Rasterize, 0, 1);
            let mut canvas = Canvas { mesh: &mesh, width, components, poller };
            mesh.faces().iter().for_each(|&face| canvas.fill_face(face).unwrap());
            prop_assert_eq!(vectors.components(), canvas.components);
        }
    }
}
