//! The picture rebuilt from a mesh.

use crate::control::{Cancelled, Control, Stage};
use crate::face_error::interpolant::{Interpolant, PLANE_PRECISION, Plane};
use crate::face_error::pixels_of_face::{ROWS, SmallFace, for_each_row};
use crate::image::{Image, Point, Shape};
use crate::model::mesh::Mesh;
use crate::triangulation::Face;
use fearless_simd::{Level, Simd, dispatch, f32x8, i32x8, mask16x8, prelude::*, u16x8, u32x8};

/// Faces between two polls of the control.
const FACES_PER_POLL: usize = 64;

/// Samples side by side in a vector.
const LANES: usize = 8;

/// Rebuilds the picture that a mesh models: in each face each component is the linear interpolant
/// of its vertices' samples, rounded to the nearest integer, halves up.
///
/// Every lattice point is written exactly once, by the face that owns it.
///
/// # Errors
/// When the control cancels.
pub fn rasterize(mesh: &Mesh, control: &dyn Control) -> Result<Image, Cancelled> {
    let Shape { width, height, component_count, precision } = mesh.shape();
    let mut canvas = Canvas {
        mesh,
        width,
        // A vector is read and written at each point.
        components: vec![vec![0; width * height + LANES]; component_count],
    };
    let level = Level::new();
    for (f, faces) in mesh.faces().chunks(FACES_PER_POLL).enumerate() {
        control.poll(Stage::Rasterize, f * FACES_PER_POLL, mesh.faces().len())?;
        if precision <= PLANE_PRECISION {
            dispatch!(level, simd => canvas.fill_small_faces(simd, faces));
        } else {
            faces.iter().for_each(|&face| canvas.fill_face(face));
        }
    }
    let mut components = canvas.components;
    components.iter_mut().for_each(|samples| samples.truncate(width * height));
    Ok(Image::from_kernel(width, height, precision, components))
}

/// A picture in work.
struct Canvas<'a> {
    mesh: &'a Mesh,
    width: usize,
    /// The samples of each component, and room for a vector at the last one.
    components: Vec<Vec<u16>>,
}

impl Canvas<'_> {
    /// Fills a face of any size.
    fn fill_face(&mut self, face: Face) {
        let corners = self.mesh.corners(face);
        for (c, samples) in self.components.iter_mut().enumerate() {
            let at_corners = face.map(|v| self.mesh.vertex_samples(v as usize)[c]);
            let interpolant = Interpolant::new(corners, at_corners);
            for_each_row(corners, |y, first, end| {
                let row = &mut samples[y as usize * self.width..];
                interpolant.fill(first, y, &mut row[first as usize..end as usize]);
            });
        }
    }

    /// Fills faces over samples of up to 8 bits.
    #[inline(always)]
    fn fill_small_faces<S: Simd>(&mut self, simd: S, faces: &[Face]) {
        for &face in faces {
            let corners = self.mesh.corners(face);
            match SmallFace::new(corners) {
                Some(small) if !small.touches_axes() => {
                    self.fill_small_face(simd, face, corners, small);
                }
                _ => self.fill_face(face),
            }
        }
    }

    #[inline(always)]
    fn fill_small_face<S: Simd>(
        &mut self,
        simd: S,
        face: Face,
        corners: [Point; 3],
        small: SmallFace,
    ) {
        let offsets = i32x8::simd_from(simd, [0, 1, 2, 3, 4, 5, 6, 7]);
        let lanes = u16x8::simd_from(simd, [0, 1, 2, 3, 4, 5, 6, 7]);
        let vertices = face.map(|v| self.mesh.vertex_samples(v as usize));
        for first_row in (0..small.rows).step_by(ROWS) {
            let rows = small.rows(simd, first_row);
            let count = ROWS.min((small.rows - first_row) as usize);
            let y = small.bottom + 1 + first_row;
            for (c, samples) in self.components.iter_mut().enumerate() {
                let at_corners = vertices.map(|samples| f32x8::splat(simd, samples[c].into()));
                let plane = Plane::new(simd, corners, at_corners, offsets);
                let mut numerators = plane.row(y);
                let mut start = y as usize * self.width;
                for (&first, &points) in rows.firsts.iter().zip(&rows.counts).take(count) {
                    if points > 0 {
                        let ahead = (first - plane.a.x) as f32;
                        let from_first = numerators + plane.per_column * ahead;
                        let samples = &mut samples[start + first as usize..];
                        fill_row(&plane, from_first, lanes, samples, points as usize);
                    }
                    numerators += plane.per_row;
                    start += self.width;
                }
            }
        }
    }
}

/// Writes the interpolant to the first `points` samples; what follows stays as it is.
#[inline(always)]
fn fill_row<S: Simd>(
    plane: &Plane<S>,
    mut numerators: f32x8<S>,
    lanes: u16x8<S>,
    samples: &mut [u16],
    points: usize,
) {
    for at in (0..points).step_by(LANES) {
        let place = &mut samples[at..at + LANES];
        let values: u32x8<S> = plane.rounded(numerators).to_int();
        let (low, high) = values.split();
        let is_inside: mask16x8<S> = lanes.simd_lt((points - at) as u16);
        let there = u16x8::from_slice(plane.simd, place);
        is_inside.select(low.narrow(high), there).store_slice(place);
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

    #[test]
    fn the_control_is_told_of_every_64_faces() {
        let points: Vec<Point> = (0..300).map(|i| Point::new(i % 20, i / 20)).collect();
        let faces = triangulate(&points);
        let (count, samples) = (faces.len(), vec![0; points.len()]);
        let shape = Shape { width: 20, height: 15, component_count: 1, precision: 8 };
        let mesh = Mesh::new(shape, points, samples, faces, &()).unwrap();
        let recorder = Recorder::default();
        rasterize(&mesh, &recorder).unwrap();
        let multiples: Vec<usize> = (0..count).step_by(64).collect();
        assert_eq!(recorder.done(Stage::Rasterize, count), multiples);
    }

    #[test]
    fn two_triangles_rebuild_a_plane() {
        let shape = Shape { width: 5, height: 3, component_count: 2, precision: 8 };
        let points = [(0, 0), (4, 0), (0, 2), (4, 2)].map(|(x, y)| Point::new(x, y)).to_vec();
        let samples = vec![0, 9, 40, 9, 20, 9, 60, 9];
        let mesh = Mesh::new(shape, points, samples, vec![[0, 1, 3], [0, 3, 2]], &()).unwrap();
        let image = rasterize(&mesh, &()).unwrap();
        assert_eq!(image.row(0, 0), [0, 10, 20, 30, 40]);
        assert_eq!(image.row(0, 1), [10, 20, 30, 40, 50]);
        assert_eq!(image.row(0, 2), [20, 30, 40, 50, 60]);
        assert_eq!(image.components()[1], [9; 15]);
    }

    proptest! {
        #[test]
        fn faces_in_vectors_are_filled_as_all_others_are(
            (width, height) in (2usize..90, 2usize..90),
            places in prop::collection::vec((0i32..90, 0i32..90), 0..60),
            component_count in 1usize..5,
            precision in prop::sample::select(vec![3, 8, 9, 16]),
        ) {
            let inner = places.iter().map(|&(x, y)| {
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
            let mut canvas = Canvas { mesh: &mesh, width, components };
            mesh.faces().iter().for_each(|&face| canvas.fill_face(face));
            prop_assert_eq!(vectors.components(), canvas.components);
        }
    }
}
