//! The second reconstruction: one colour for each triangle, the one that fits it best.
//!
//! The colour of least squared error over the points of a face is their mean, rounded to the nearest
//! integer, halves up. Sums over rows come from running sums of samples and of their squares, so a
//! face is measured in a time proportional to its rows, whatever its columns.

use crate::control::{Cancelled, Control, Stage};
use crate::dynamic_mesh::FaceMeasure;
use crate::error::MeshingError;
use crate::face_error::face_rows::for_each_row;
use crate::image::{Image, Point, ShapeMismatch};
use crate::model::mesh::Mesh;
use crate::quality::fidelity::Fidelity;

/// Faces between two polls of the control.
const FACES_PER_POLL: usize = 64;

/// A picture in which every face of a mesh has one colour, and how close that is to the image.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatColors {
    /// Face by face in the mesh's order: component `c` of face `f` is `colors[f * components + c]`.
    /// A face that owns no lattice point has the colour of its first vertex.
    pub colors: Vec<u16>,
    /// The picture.
    pub picture: Image,
    /// How close it is to the image.
    pub fidelity: Fidelity,
}

impl FlatColors {
    /// The best colour of each face of a mesh for an image of its shape.
    ///
    /// # Errors
    /// When the image has another shape than the mesh's, or the control cancels.
    pub fn new(image: &Image, mesh: &Mesh, control: &dyn Control) -> Result<Self, MeshingError> {
        ShapeMismatch::check(image.shape(), mesh.shape())?;
        Ok(Self::of_mesh(image, mesh, control)?)
    }

    /// The colours for an image that has the mesh's shape.
    pub(crate) fn of_mesh(
        image: &Image,
        mesh: &Mesh,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let sums = RowSums::new(image);
        let (count, width) = (image.component_count(), image.width());
        let mut colors = Vec::with_capacity(mesh.faces().len() * count);
        let mut components = vec![vec![0; image.pixel_count()]; count];
        let mut squared_error = 0;
        for (f, &face) in mesh.faces().iter().enumerate() {
            if f % FACES_PER_POLL == 0 {
                control.poll(Stage::Rasterize, f, mesh.faces().len())?;
            }
            let corners = mesh.corners(face);
            for (c, component) in components.iter_mut().enumerate() {
                let sum = sums.of_face(c, corners);
                let color = sum.mean().unwrap_or_else(|| mesh.vertex_samples(face[0] as usize)[c]);
                squared_error += sum.squared_error(color);
                colors.push(color);
                for_each_row(corners, |y, first, end| {
                    component[y as usize * width..][first as usize..end as usize].fill(color);
                });
            }
        }
        let picture = image.with_components(components);
        Ok(Self { colors, picture, fidelity: Fidelity::of_sum(squared_error, image) })
    }
}

/// Sums over the points of a face.
#[derive(Clone, Copy, Default)]
struct Sum {
    points: u64,
    samples: u64,
    squares: u64,
}

impl Sum {
    /// The mean sample, rounded to nearest, halves up.
    fn mean(self) -> Option<u16> {
        let mean = (2 * self.samples + self.points).checked_div(2 * self.points)?;
        u16::try_from(mean).ok()
    }

    /// The squared error of one value for all points.
    fn squared_error(self, value: u16) -> u64 {
        let value = u64::from(value);
        // Not below 0, being a sum of squares.
        self.squares + self.points * value * value - 2 * value * self.samples
    }
}

/// Running sums along each row: place `x` has the sums of the samples left of column `x`.
pub(crate) struct RowSums {
    /// Columns of the image and one more.
    stride: usize,
    /// For each component the sums of samples and of their squares.
    components: Vec<Vec<(u64, u64)>>,
}

impl RowSums {
    pub(crate) fn new(image: &Image) -> Self {
        let running = |samples: &Vec<u16>| {
            let mut sums = Vec::with_capacity(samples.len() + image.height());
            for row in samples.chunks_exact(image.width()) {
                let (mut sum, mut squares) = (0, 0);
                sums.push((0, 0));
                for &sample in row {
                    sum += u64::from(sample);
                    squares += u64::from(sample) * u64::from(sample);
                    sums.push((sum, squares));
                }
            }
            sums
        };
        Self {
            stride: image.width() + 1,
            components: image.components().iter().map(running).collect(),
        }
    }

    fn of_face(&self, c: usize, corners: [Point; 3]) -> Sum {
        let (sums, mut total) = (&self.components[c], Sum::default());
        for_each_row(corners, |y, first, end| {
            let row = y as usize * self.stride;
            let (left, right) = (sums[row + first as usize], sums[row + end as usize]);
            total.points += (end - first) as u64;
            total.samples += right.0 - left.0;
            total.squares += right.1 - left.1;
        });
        total
    }
}

/// Measures faces by the squared error of their best colours.
pub(crate) struct FlatFaces<'a> {
    sums: &'a RowSums,
}

impl<'a> FlatFaces<'a> {
    pub(crate) fn new(sums: &'a RowSums) -> Self {
        Self { sums }
    }
}

impl FaceMeasure for FlatFaces<'_> {
    fn error(&mut self, corners: [Point; 3]) -> u64 {
        let components = 0..self.sums.components.len();
        let error = |c| {
            let sum = self.sums.of_face(c, corners);
            sum.mean().map_or(0, |value| sum.squared_error(value))
        };
        components.map(error).sum()
    }

    fn another(&self) -> Self {
        Self::new(self.sums)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::Recorder;
    use crate::image::corner_points;
    use crate::triangulation::{Face, triangulate};
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    #[test]
    fn the_control_is_told_of_every_64_faces() {
        let image = Image::from_bottom_up(20, 15, 9, vec![(0..300).collect()]).unwrap();
        let inner: Vec<(usize, usize)> = (0..300).map(|i| (i % 20, i / 20)).collect();
        let (mesh, recorder) = (mesh_of(&image, &inner), Recorder::default());
        FlatColors::new(&image, &mesh, &recorder).unwrap();
        let multiples: Vec<usize> = (0..mesh.faces().len()).step_by(64).collect();
        assert!(multiples.len() > 4);
        assert_eq!(recorder.done(Stage::Rasterize, mesh.faces().len()), multiples);
    }

    /// A mesh of the corners and other points, which carries the image's samples.
    fn mesh_of(image: &Image, inner: &[(usize, usize)]) -> Mesh {
        let (width, height) = (image.width(), image.height());
        let inner = inner.iter().map(|&(x, y)| Point::new((x % width) as i32, (y % height) as i32));
        let points: BTreeSet<Point> = inner.chain(corner_points(width, height)).collect();
        let points: Vec<Point> = points.into_iter().collect();
        let sample = |p: &Point| {
            let (x, y) = (p.x as usize, p.y as usize);
            (0..image.component_count()).map(move |c| image.sample(c, x, y)).collect::<Vec<u16>>()
        };
        let samples = points.iter().flat_map(sample).collect();
        let faces: Vec<Face> = triangulate(&points);
        Mesh::new(image.shape(), points, samples, faces).unwrap()
    }

    proptest! {
        #[test]
        fn no_other_colour_of_a_face_is_better_and_the_sums_are_those_of_the_picture(
            (width, height) in (2usize..9, 2usize..9),
            samples in prop::collection::vec(any::<u16>(), 162),
            inner in prop::collection::vec((0usize..9, 0usize..9), 0..9),
        ) {
            let count = width * height;
            let components = vec![samples[..count].to_vec(), samples[81..81 + count].to_vec()];
            let image = Image::from_bottom_up(width, height, 16, components).unwrap();
            let mesh = mesh_of(&image, &inner);
            let flat = FlatColors::new(&image, &mesh, &()).unwrap();
            prop_assert_eq!(Fidelity::between(&image, &flat.picture).unwrap(), flat.fidelity);
            let sums = RowSums::new(&image);
            let mut total = 0;
            for (f, &face) in mesh.faces().iter().enumerate() {
                let corners = mesh.corners(face);
                for c in 0..2 {
                    let mut owned: Vec<u16> = Vec::new();
                    for_each_row(corners, |y, first, end| {
                        owned.extend(&image.row(c, y as usize)[first as usize..end as usize]);
                    });
                    let mean = owned.iter().map(|&s| f64::from(s)).sum::<f64>() / owned.len() as f64;
                    let color = if owned.is_empty() {
                        mesh.vertex_samples(face[0] as usize)[c]
                    } else {
                        (mean + 0.5).floor() as u16
                    };
                    prop_assert_eq!(flat.colors[2 * f + c], color);
                }
                let error = FlatFaces::new(&sums).error(corners);
                total += error;
                for c in 0..2 {
                    let sum = sums.of_face(c, corners);
                    let Some(best) = sum.mean() else { continue };
                    for other in [best.saturating_sub(1), best.saturating_add(1)] {
                        prop_assert!(sum.squared_error(best) <= sum.squared_error(other));
                    }
                }
            }
            prop_assert_eq!(total, flat.fidelity.squared_error);
        }
    }
}
