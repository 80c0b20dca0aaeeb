//! From the packed bytes of a PNG's row to samples, palettes and transparent colours resolved.

use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::packed::unpack;
use png::{ColorType, Info};

/// How a row's bytes become samples.
pub(super) struct Pixels {
    /// Bits per stored sample: 1, 2, 4, 8 or 16.
    depth: u8,
    /// What the stored samples mean.
    meaning: Meaning,
    /// The stored samples of the current row.
    stored: Vec<u16>,
}

/// What stored samples mean.
enum Meaning {
    /// They are the image's.
    Plain { component_count: usize },
    /// They are the image's, and one colour stands for full transparency.
    Keyed { transparent: Vec<u16> },
    /// They are indices of colours, 3 or 4 samples each.
    Indexed { palette: Vec<u16>, component_count: usize },
}

impl Pixels {
    /// Reads from the file's header and palette what its pixels mean.
    ///
    /// # Errors
    /// When an indexed picture has no palette.
    pub(super) fn new(info: &Info<'_>) -> Result<Self, DecodeError> {
        let depth = info.bit_depth as u8;
        let component_count = info.color_type.samples();
        let meaning = match (info.color_type, &info.trns) {
            (ColorType::Indexed, alphas) => {
                let colours = info
                    .palette
                    .as_deref()
                    .ok_or_else(|| PictureFormat::Png.malformed("it has no palette"))?;
                indexed(colours, alphas.as_deref())
            }
            (ColorType::Grayscale | ColorType::Rgb, Some(colour)) => {
                let mut transparent = Vec::new();
                unpack(colour, if depth == 16 { 16 } else { 8 }, &mut transparent);
                transparent.resize(component_count, 0);
                Meaning::Keyed { transparent }
            }
            _ => Meaning::Plain { component_count },
        };
        Ok(Self { depth, meaning, stored: Vec::new() })
    }

    /// Components of the decoded image: 1 to 4.
    pub(super) fn component_count(&self) -> usize {
        match &self.meaning {
            Meaning::Keyed { transparent } => transparent.len() + 1,
            Meaning::Plain { component_count } | Meaning::Indexed { component_count, .. } => {
                *component_count
            }
        }
    }

    /// Bits per sample of the decoded image: those of a colour of the palette, else the stored.
    pub(super) fn precision(&self) -> u8 {
        if matches!(self.meaning, Meaning::Indexed { .. }) { 8 } else { self.depth }
    }

    /// Turns the bytes of `count` pixels into `samples`, the components side by side.
    ///
    /// # Errors
    /// When a pixel names a colour that the palette does not have.
    pub(super) fn unpack(
        &mut self,
        bytes: &[u8],
        count: usize,
        samples: &mut Vec<u16>,
    ) -> Result<(), DecodeError> {
        samples.clear();
        match &self.meaning {
            Meaning::Plain { component_count } => {
                unpack(bytes, self.depth, samples);
                samples.truncate(count * component_count);
            }
            Meaning::Keyed { transparent } => {
                unpack(bytes, self.depth, &mut self.stored);
                let opaque = u16::MAX >> (16 - self.depth);
                for colour in self.stored.chunks_exact(transparent.len()).take(count) {
                    samples.extend_from_slice(colour);
                    samples.push(if colour == transparent { 0 } else { opaque });
                }
            }
            Meaning::Indexed { palette, component_count } => {
                unpack(bytes, self.depth, &mut self.stored);
                for &index in self.stored.iter().take(count) {
                    let first = usize::from(index) * component_count;
                    let colour = palette.get(first..first + component_count).ok_or_else(|| {
                        let count = palette.len() / component_count;
                        let reason = format!("a pixel has colour {index} of a palette of {count}");
                        PictureFormat::Png.malformed(reason)
                    })?;
                    samples.extend_from_slice(colour);
                }
            }
        }
        Ok(())
    }
}

/// The palette, with alpha where the file has it: colours beyond the list of alphas are opaque.
fn indexed(colours: &[u8], alphas: Option<&[u8]>) -> Meaning {
    let mut palette = Vec::with_capacity(colours.len() / 3 * 4);
    for (i, colour) in colours.chunks_exact(3).enumerate() {
        palette.extend(colour.iter().map(|&sample| u16::from(sample)));
        if let Some(alphas) = alphas {
            palette.push(alphas.get(i).map_or(255, |&alpha| u16::from(alpha)));
        }
    }
    Meaning::Indexed { palette, component_count: if alphas.is_some() { 4 } else { 3 } }
}
