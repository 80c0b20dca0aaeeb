//! What is seen of a mesh where there is alpha: its straight colours, and the faces that show.

use crate::alpha::{has_alpha, straight_near, straighten_vectors};
use crate::image::{Shape, largest_sample};
use crate::model::mesh::Mesh;
use std::borrow::Cow;

impl Mesh {
    /// The vertices' samples with straight colours, as files hold them; those of
    /// [`samples`](Self::samples) where there is no alpha.
    ///
    /// Several straight colours premultiply to the same one, and all do where alpha is 0. Of these
    /// each vertex has the one nearest to its neighbours' mean, so that viewers, which interpolate
    /// straight colours, show no fringe.
    #[must_use]
    pub fn straight_samples(&self) -> Cow<'_, [u16]> {
        let Shape { component_count: count, precision, .. } = self.shape();
        if !has_alpha(count) {
            return Cow::Borrowed(self.samples());
        }
        let largest = largest_sample(precision);
        // Sums over the corners of each vertex's faces.
        let mut sums = vec![0_u64; self.samples().len()];
        for &face in self.faces() {
            for c in 0..count {
                let samples = face.map(|v| u64::from(self.vertex_samples(v as usize)[c]));
                let sum = samples.iter().sum::<u64>();
                face.iter().for_each(|&v| sums[v as usize * count + c] += sum);
            }
        }
        let mut samples = self.samples().to_vec();
        for (sample, sums) in samples.chunks_exact_mut(count).zip(sums.chunks_exact(count)) {
            let (alpha, alphas) = (sample[count - 1], sums[count - 1]);
            for (color, &colors) in sample[..count - 1].iter_mut().zip(sums) {
                let mean = (colors * u64::from(largest)).checked_div(alphas).unwrap_or_default();
                *color = straight_near(mean.min(largest.into()) as u16, *color, alpha, largest);
            }
        }
        Cow::Owned(samples)
    }

    /// The samples of the faces with straight colours, where each face has one colour.
    #[must_use]
    pub fn straight_face_samples(&self) -> Option<Cow<'_, [u16]>> {
        let Shape { component_count: count, precision, .. } = self.shape();
        let mut samples = Cow::Borrowed(self.face_samples()?);
        if has_alpha(count) {
            straighten_vectors(samples.to_mut(), count, largest_sample(precision));
        }
        Some(samples)
    }

    /// Whether face `face` has an alpha over 0: at a vertex, or of a colour of its own.
    ///
    /// # Panics
    /// When there is no such face.
    #[must_use]
    pub fn is_seen(&self, face: usize) -> bool {
        let count = self.shape().component_count;
        let own = self.face_samples().map(|samples| &samples[face * count..][..count]);
        let corners = self.faces()[face].iter().map(|&v| self.vertex_samples(v as usize));
        !has_alpha(count) || corners.chain(own).any(|samples| samples[count - 1] > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::alpha::premultiply_vectors;
    use crate::image::Point;

    /// A fan of four faces around an opaque vertex and beside it a transparent corner.
    fn fan() -> Mesh {
        let shape = Shape { width: 3, height: 3, component_count: 2, precision: 8 };
        let points = [(0, 0), (2, 0), (0, 2), (2, 2), (1, 1)].map(|(x, y)| Point::new(x, y));
        let samples = vec![0, 0, 1, 1, 0, 0, 100, 255, 200, 255];
        let faces = vec![[0, 1, 4], [1, 3, 4], [3, 2, 4], [2, 0, 4]];
        Mesh::new(shape, points.to_vec(), samples, faces, &()).unwrap()
    }

    #[test]
    fn transparent_vertices_take_the_colors_of_their_neighbours() {
        let mesh = fan();
        let straight = mesh.straight_samples();
        assert_eq!(straight[..2], [200, 0], "of the middle alone");
        assert!((150..200).contains(&straight[4]), "between 100 and 200: {}", straight[4]);
        assert_eq!(straight[6..], [100, 255, 200, 255], "opaque colours stay");
        assert!(straight[2] >= 128, "one that premultiplies to 1: {}", straight[2]);
        let mut again = straight.into_owned();
        premultiply_vectors(&mut again, 2, 255);
        assert_eq!(again, mesh.samples());
    }

    #[test]
    fn a_face_is_seen_where_it_is_not_transparent() {
        let mesh = fan();
        assert!((0..4).all(|face| mesh.is_seen(face)));
        let clear = vec![0, 0, 1, 1, 0, 0, 0, 0, 0, 0];
        let clear = Mesh::new(mesh.shape(), mesh.points().into(), clear, mesh.faces().into(), &());
        let flat = clear.unwrap().with_face_samples(vec![0, 0, 0, 0, 0, 0, 9, 9]).unwrap();
        assert_eq!([0, 1, 2, 3].map(|face| flat.is_seen(face)), [true, true, false, true]);
        assert_eq!(flat.straight_face_samples().unwrap()[6..], [255, 9]);
    }
}
