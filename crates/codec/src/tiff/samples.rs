//! From the stored samples of a TIFF to those of the image.

use super::page::{Meaning, Page};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::packed::unpack;
use crate::rounding::rounded_quotient;
use tiff::decoder::DecodingResult;

/// The rows of a decoded page.
pub(super) struct Samples<'a> {
    page: &'a Page,
    stored: &'a DecodingResult,
    /// Samples of a pixel that the decoder has kept.
    stored_count: usize,
    /// Components lie one after the other.
    planar: bool,
    /// The samples of a row of bytes.
    unpacked: Vec<u16>,
    row: Vec<u16>,
}

impl<'a> Samples<'a> {
    /// # Errors
    /// When there are fewer samples than the directory promised.
    pub(super) fn new(page: &'a Page, stored: &'a DecodingResult) -> Result<Self, DecodeError> {
        let &Page { width, height, depth, ref meaning, .. } = page;
        let stored_count = match meaning {
            Meaning::Plain(count) => *count,
            Meaning::Indexed(_) => 1,
            Meaning::Cmyk => 4,
        };
        let planar = page.planar && stored_count > 1;
        let row = if planar { width } else { width * stored_count };
        let rows = if planar { height * stored_count } else { height };
        let (needed, actual) = match stored {
            DecodingResult::U8(bytes) => (packed(row, depth) * rows, bytes.len()),
            DecodingResult::U16(words) => (row * rows, words.len()),
            _ => (usize::MAX, 0),
        };
        if actual < needed {
            return Err(PictureFormat::Tiff.malformed("samples are missing"));
        }
        Ok(Self { page, stored, stored_count, planar, unpacked: Vec::new(), row: Vec::new() })
    }

    /// The samples of row `y` from the top, the components side by side.
    pub(super) fn row(&mut self, y: usize) -> &[u16] {
        self.row.clear();
        if self.planar {
            self.read_planes(y);
        } else {
            self.read_row(y, self.page.width * self.stored_count);
        }
        match &self.page.meaning {
            Meaning::Plain(_) => {}
            Meaning::Indexed(palette) => self.expand(palette),
            Meaning::Cmyk => self.convert_cmyk(),
        }
        &self.row
    }

    /// Appends a row of `count` stored samples.
    fn read_row(&mut self, y: usize, count: usize) {
        match self.stored {
            DecodingResult::U16(words) => {
                self.row.extend(words.iter().skip(y * count).take(count));
            }
            DecodingResult::U8(bytes) => {
                let length = packed(count, self.page.depth);
                let row = bytes.chunks_exact(length).nth(y).unwrap_or_default();
                unpack(row, self.page.depth, &mut self.unpacked);
                self.row.extend(self.unpacked.iter().take(count));
            }
            _ => {}
        }
    }

    /// Puts the rows of all components side by side.
    fn read_planes(&mut self, y: usize) {
        let (width, count) = (self.page.width, self.stored_count);
        for component in 0..count {
            self.read_row(component * self.page.height + y, width);
        }
        let planes = self.row.clone();
        for (place, sample) in self.row.iter_mut().enumerate() {
            *sample = planes[place % count * width + place / count];
        }
    }

    /// Replaces indices by their colours: the palette has one for each value of an index.
    fn expand(&mut self, palette: &[u16]) {
        let count = palette.len() / 3;
        let indices = std::mem::take(&mut self.row);
        let colour = |index: u16| [0, 1, 2].map(|part| palette[part * count + usize::from(index)]);
        self.row.extend(indices.into_iter().flat_map(colour));
    }

    /// Replaces inks by red, green and blue: the product of what each ink and black let through.
    fn convert_cmyk(&mut self) {
        let largest = u64::from(u16::MAX >> (16 - self.page.depth));
        let inks = std::mem::take(&mut self.row);
        self.row.reserve(inks.len());
        for &[cyan, magenta, yellow, black] in inks.as_chunks().0 {
            let through = |ink: u16| {
                let product = (largest - u64::from(ink)) * (largest - u64::from(black));
                rounded_quotient(product, largest) as u16
            };
            self.row.extend([cyan, magenta, yellow].map(through));
        }
    }
}

/// Bytes of a row of `count` packed samples.
fn packed(count: usize, depth: u8) -> usize {
    (count * usize::from(depth)).div_ceil(8)
}
