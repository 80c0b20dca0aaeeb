//! Faces that show nothing, over pixels that are not transparent.
//!
//! A mesh without its transparent faces is to cover every pixel of an alpha over 0: a texture may
//! show what the mesh itself has lost. Where a transparent face owns such a pixel, one of its
//! vertices gets the least alpha there is, which keeps the face in every format, and cannot be
//! seen.

use crate::alpha::{has_alpha, premultiply_vectors};
use crate::control::{Cancelled, Control, Poller, Stage};
use crate::face_error::scan_conversion::try_for_each_row;
use crate::image::Image;
use crate::model::mesh::Mesh;

/// The least alpha over 0.
const LEAST_ALPHA: u16 = 1;

impl Mesh {
    /// The mesh in which every pixel of an alpha over 0 belongs to a face that
    /// [is seen](Self::is_seen); `None` where that is so already.
    pub(crate) fn covering(
        &self,
        image: &Image,
        control: &dyn Control,
    ) -> Result<Option<Self>, Cancelled> {
        let (count, largest) = (image.component_count(), image.max_sample());
        if !has_alpha(count) {
            return Ok(None);
        }
        let straight = self.straight_samples();
        let mut samples = self.samples().to_vec();
        let mut is_changed = false;
        let poller = &mut Poller::new(control, Stage::Measure, 0, self.faces().len());
        for face in (0..self.faces().len()).filter(|&face| !self.is_seen(face)) {
            let vertices = self.faces()[face].map(|v| v as usize * count);
            if vertices.iter().any(|v| samples[v + count - 1] > 0)
                || !self.owns_visible_pixels(face, image, poller)?
            {
                continue;
            }
            let vertex = vertices[0]..vertices[0] + count;
            let marked = &mut samples[vertex.clone()];
            marked.copy_from_slice(&straight[vertex]);
            marked[count - 1] = LEAST_ALPHA;
            premultiply_vectors(marked, count, largest);
            is_changed = true;
        }
        Ok(is_changed.then(|| self.clone().with_kernel_samples(samples)))
    }

    fn owns_visible_pixels(
        &self,
        face: usize,
        image: &Image,
        poller: &mut Poller<'_>,
    ) -> Result<bool, Cancelled> {
        let corners = self.corners(self.faces()[face]);
        let mut is_visible = false;
        try_for_each_row(corners, |y, first, end| {
            poller.step((end - first) as usize)?;
            let alphas = image.row(image.component_count() - 1, y as usize);
            is_visible |= alphas[first as usize..end as usize].iter().any(|&alpha| alpha > 0);
            Ok(())
        })?;
        Ok(is_visible)
    }
}
