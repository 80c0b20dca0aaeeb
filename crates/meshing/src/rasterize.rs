//! The picture rebuilt from a mesh.

use crate::control::{Cancelled, Control, Stage};
use crate::face_rows::for_each_row;
use crate::image::Image;
use crate::interpolant::Interpolant;
use crate::mesh::{Mesh, Shape};

/// Faces between two polls of the control.
const FACES_PER_POLL: usize = 64;

/// Rebuilds the picture that a mesh models: in each face each component is the linear interpolant
/// of its vertices' samples, rounded to the nearest integer, halves up.
///
/// Every lattice point is written exactly once, by the face that owns it.
///
/// # Errors
/// When the control cancels.
pub fn rasterize(mesh: &Mesh, control: &dyn Control) -> Result<Image, Cancelled> {
    let Shape { width, height, component_count, precision } = mesh.shape();
    let mut components = vec![vec![0u16; width * height]; component_count];
    for (f, &face) in mesh.faces().iter().enumerate() {
        if f % FACES_PER_POLL == 0 {
            control.poll(Stage::Rasterize, f, mesh.faces().len())?;
        }
        let corners = mesh.corners(face);
        for (c, samples) in components.iter_mut().enumerate() {
            let interpolant =
                Interpolant::new(corners, face.map(|v| mesh.vertex_samples(v as usize)[c]));
            for_each_row(corners, |y, first, end| {
                let row = &mut samples[y as usize * width..];
                interpolant.fill(first, y, &mut row[first as usize..end as usize]);
            });
        }
    }
    Ok(Image::from_kernel(width, height, precision, components))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Unattended;
    use crate::mesh::Point;

    #[test]
    fn two_triangles_rebuild_a_plane() {
        let shape = Shape { width: 5, height: 3, component_count: 2, precision: 8 };
        let points = [(0, 0), (4, 0), (0, 2), (4, 2)].map(|(x, y)| Point::new(x, y)).to_vec();
        let samples = vec![0, 9, 40, 9, 20, 9, 60, 9];
        let mesh = Mesh::new(shape, points, samples, vec![[0, 1, 3], [0, 3, 2]]).unwrap();
        let image = rasterize(&mesh, &Unattended).unwrap();
        assert_eq!(image.row(0, 0), [0, 10, 20, 30, 40]);
        assert_eq!(image.row(0, 1), [10, 20, 30, 40, 50]);
        assert_eq!(image.row(0, 2), [20, 30, 40, 50, 60]);
        assert_eq!(image.components()[1], [9; 15]);
    }
}
