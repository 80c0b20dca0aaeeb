//! The planes into which decoders put their rows, upright and one component after the other.
//!
//! The only buffer of the size of the picture that PNG and PNM need: two bytes a sample. A file's
//! pixels go directly to their upright places.

use crate::alpha::Alpha;
use crate::error::DecodeError;
use crate::header::Header;
use crate::orientation::{Orientation, transposes, upright};
use crate::terrain::Terrain;
use crate::wanted::Wanted;
use pixmesh_meshing::Image;

/// An image that is being filled, rows from the top.
pub(crate) struct Canvas {
    header: Header,
    /// Component by component, the upright picture from its bottom row.
    planes: Vec<Vec<u16>>,
    /// Whether the colours are premultiplied by their alpha.
    pub(crate) is_premultiplied: bool,
    /// What the samples mean, where they are heights.
    pub(crate) terrain: Option<Terrain>,
    /// How the file's columns lie on the planes.
    columns: Axis,
    /// How the file's rows lie on the planes.
    rows: Axis,
}

/// Some pixels of one row of the file, equally spaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Row {
    /// The file's row, 0 at the top.
    pub(crate) y: usize,
    /// Column of the first pixel.
    pub(crate) first: usize,
    /// Columns from one pixel to the next, at least 1.
    pub(crate) step: usize,
}

impl Row {
    /// A whole row.
    pub(crate) fn whole(y: usize) -> Self {
        Self { y, first: 0, step: 1 }
    }
}

/// How the steps along one direction of the file lie on a plane.
struct Axis {
    /// Pixels of the file along it.
    count: usize,
    /// Places of the plane from one pixel to the next.
    stride: usize,
    /// The last pixel comes first.
    mirrored: bool,
}

impl Axis {
    /// Offset of the pixel `at`, which is less than `count`.
    fn offset(&self, at: usize) -> usize {
        let at = if self.mirrored { self.count - 1 - at } else { at };
        at * self.stride
    }
}

impl Canvas {
    /// A black canvas of the upright size in `header`, for a file that has `orientation`.
    ///
    /// # Errors
    /// When the picture is no longer wanted: allocating this much memory can take a moment.
    pub(crate) fn new(
        header: Header,
        orientation: Orientation,
        wanted: &Wanted<'_>,
    ) -> Result<Self, DecodeError> {
        // Each by itself: a copy of zeros would touch all of its memory before anything is in it.
        let plane = |_| wanted().map(|()| vec![0; header.width * header.height]);
        let planes = (0..header.component_count).map(plane).collect::<Result<_, _>>()?;
        let (width, height) = upright(orientation, header.width, header.height);
        let transposed = transposes(orientation);
        let (column_stride, row_stride) =
            if transposed { (header.width, 1) } else { (1, header.width) };
        // Rows of an image begin at the bottom: whatever runs along the upright picture's columns is
        // mirrored once more.
        let mirrored = matches!(orientation.to_exif(), 2 | 3 | 7 | 8) != transposed;
        let columns = Axis { count: width, stride: column_stride, mirrored };
        let mirrored = matches!(orientation.to_exif(), 3 | 4 | 6 | 7) == transposed;
        let rows = Axis { count: height, stride: row_stride, mirrored };
        Ok(Self { header, planes, is_premultiplied: false, terrain: None, columns, rows })
    }

    /// Puts pixels, their components side by side, into a row of the file.
    ///
    /// Pixels beyond the file's size are dropped.
    pub(crate) fn put_row<S: Copy + Into<u16>>(&mut self, row: Row, pixels: &[S]) {
        if row.y >= self.rows.count || row.first >= self.columns.count {
            return;
        }
        let start = self.rows.offset(row.y) + self.columns.offset(row.first);
        let stride = row.step * self.columns.stride;
        let room = (self.columns.count - row.first).div_ceil(row.step);
        let component_count = self.planes.len();
        for (component, plane) in self.planes.iter_mut().enumerate() {
            let samples = pixels.iter().skip(component).step_by(component_count).map(|&s| s.into());
            if self.columns.mirrored {
                let places = plane.iter_mut().take(start + 1).rev().step_by(stride).take(room);
                places.zip(samples).for_each(|(place, sample)| *place = sample);
            } else if stride == 1 {
                let places = plane.iter_mut().skip(start).take(room);
                places.zip(samples).for_each(|(place, sample)| *place = sample);
            } else {
                let places = plane.iter_mut().skip(start).step_by(stride).take(room);
                places.zip(samples).for_each(|(place, sample)| *place = sample);
            }
        }
    }

    /// Puts all rows of the file, from the top, their components side by side.
    ///
    /// # Errors
    /// When the picture is no longer wanted.
    pub(crate) fn put_rows<S: Copy + Into<u16>>(
        &mut self,
        pixels: &[S],
        wanted: &Wanted<'_>,
    ) -> Result<(), DecodeError> {
        let row_samples = self.columns.count * self.planes.len();
        for (y, row) in pixels.chunks_exact(row_samples).enumerate() {
            wanted()?;
            self.put_row(Row::whole(y), row);
        }
        Ok(())
    }

    /// The finished image, with the choice for its alpha applied.
    ///
    /// # Errors
    /// When a sample is out of range, or the picture is no longer wanted.
    pub(crate) fn into_image(
        mut self,
        alpha: Alpha,
        wanted: &Wanted<'_>,
    ) -> Result<Image, DecodeError> {
        let Header { width, height, precision, .. } = self.header;
        let made = alpha.precision(self.planes.len(), precision);
        alpha.apply(&mut self.planes, precision, self.is_premultiplied, wanted)?;
        wanted()?;
        Ok(Image::from_bottom_up(width, height, made, self.planes)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::PictureFormat;
    use crate::wanted::always;

    fn canvas(header: Header, orientation: Orientation) -> Canvas {
        Canvas::new(header, orientation, &always).unwrap()
    }

    /// The upright picture, from its top, of a file of three columns and two rows
    /// `1 2 3 / 4 5 6` with a value of the orientation tag.
    fn made_upright(tag: u8) -> (usize, Vec<u16>) {
        let orientation = Orientation::from_exif(tag).unwrap();
        let (width, height) = upright(orientation, 3, 2);
        let format = PictureFormat::Pnm;
        let header = Header { format, width, height, component_count: 1, precision: 8 };
        let mut canvas = canvas(header, orientation);
        canvas.put_row(Row::whole(0), &[1_u8, 2, 3]);
        canvas.put_row(Row { y: 1, first: 0, step: 2 }, &[4_u8, 6]);
        canvas.put_row(Row { y: 1, first: 1, step: 2 }, &[5_u8]);
        let image = canvas.into_image(Alpha::Keep, &always).unwrap();
        let rows = (0..height).rev().flat_map(|y| image.row(0, y).to_vec()).collect();
        (width, rows)
    }

    #[test]
    fn each_orientation_makes_the_picture_upright() {
        assert_eq!(made_upright(1), (3, vec![1, 2, 3, 4, 5, 6]));
        assert_eq!(made_upright(2), (3, vec![3, 2, 1, 6, 5, 4]));
        assert_eq!(made_upright(3), (3, vec![6, 5, 4, 3, 2, 1]));
        assert_eq!(made_upright(4), (3, vec![4, 5, 6, 1, 2, 3]));
        assert_eq!(made_upright(5), (2, vec![1, 4, 2, 5, 3, 6]));
        assert_eq!(made_upright(6), (2, vec![4, 1, 5, 2, 6, 3]));
        assert_eq!(made_upright(7), (2, vec![6, 3, 5, 2, 4, 1]));
        assert_eq!(made_upright(8), (2, vec![3, 6, 2, 5, 1, 4]));
    }

    #[test]
    fn what_lies_beyond_the_picture_is_dropped() {
        let format = PictureFormat::Pnm;
        let header = Header { format, width: 2, height: 2, component_count: 2, precision: 8 };
        let mut canvas = canvas(header, Orientation::NoTransforms);
        canvas.is_premultiplied = true;
        canvas.put_row(Row::whole(0), &[1_u16, 2, 3, 4, 5, 6]);
        canvas.put_row(Row::whole(2), &[9_u16; 4]);
        canvas.put_row(Row { y: 1, first: 2, step: 1 }, &[9_u16; 4]);
        let image = canvas.into_image(Alpha::Keep, &always).unwrap();
        assert_eq!(image.components(), [[0, 0, 1, 3], [0, 0, 2, 4]]);
    }
}
