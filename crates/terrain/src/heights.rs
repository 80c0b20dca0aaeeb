//! The decoded samples of an elevation model, as heights.

use crate::tags::Elevation;
use std::io::{Read, Seek};
use tiff::decoder::{Decoder, DecodingResult};
use tiff::{TiffError, TiffFormatError, TiffResult};

/// The heights of a model, row by row from the top, in the units of the file.
#[derive(Debug)]
pub struct Heights {
    elevation: Elevation,
    stored: DecodingResult,
}

impl Elevation {
    /// Decodes the samples. The decoder's own limit says how many bytes they may take.
    ///
    /// # Errors
    /// When the file is broken or ends early, or uses what is not read.
    pub fn heights<R: Read + Seek>(self, decoder: &mut Decoder<R>) -> TiffResult<Heights> {
        let mut stored = DecodingResult::U8(Vec::new());
        decoder.read_image_to_buffer(&mut stored)?;
        let heights = Heights { elevation: self, stored };
        if heights.count() < heights.elevation.width * heights.elevation.height {
            return Err(TiffError::FormatError(TiffFormatError::InconsistentSizesEncountered));
        }
        Ok(heights)
    }
}

impl Heights {
    /// What the file says of its samples.
    #[must_use]
    pub fn elevation(&self) -> &Elevation {
        &self.elevation
    }

    /// The heights of a row, counted from the top; `None` where there is none.
    ///
    /// # Panics
    /// When there is no such row.
    pub fn row(&self, y: usize) -> impl Iterator<Item = Option<f64>> {
        let width = self.elevation.width;
        (y * width..(y + 1) * width).map(|i| self.height(i))
    }

    /// The height at a column and a row, counted from the top; `None` where there is none.
    ///
    /// # Panics
    /// When there is no such column or row.
    #[must_use]
    pub fn at(&self, column: usize, row: usize) -> Option<f64> {
        assert!(column < self.elevation.width, "column {column}");
        self.height(row * self.elevation.width + column)
    }

    /// Bytes that the samples take.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.count() as u64 * u64::from(self.elevation.bits / 8)
    }

    /// All heights, row by row from the top.
    pub(crate) fn all(&self) -> impl Iterator<Item = Option<f64>> {
        (0..self.elevation.width * self.elevation.height).map(|i| self.height(i))
    }

    fn count(&self) -> usize {
        match &self.stored {
            DecodingResult::U8(samples) => samples.len(),
            DecodingResult::U16(samples) => samples.len(),
            DecodingResult::U32(samples) => samples.len(),
            DecodingResult::U64(samples) => samples.len(),
            DecodingResult::F16(samples) => samples.len(),
            DecodingResult::F32(samples) => samples.len(),
            DecodingResult::F64(samples) => samples.len(),
            DecodingResult::I8(samples) => samples.len(),
            DecodingResult::I16(samples) => samples.len(),
            DecodingResult::I32(samples) => samples.len(),
            DecodingResult::I64(samples) => samples.len(),
        }
    }

    /// The height of sample `i`. A sample is missing if it is not finite or of the value of nodata,
    /// which is rounded to the type of the samples.
    fn height(&self, i: usize) -> Option<f64> {
        let nodata = self.elevation.nodata;
        let (sample, missing) = match &self.stored {
            DecodingResult::U8(samples) => (samples[i].into(), nodata),
            DecodingResult::U16(samples) => (samples[i].into(), nodata),
            DecodingResult::U32(samples) => (samples[i].into(), nodata),
            DecodingResult::U64(samples) => (samples[i] as f64, nodata),
            DecodingResult::F16(samples) => (samples[i].to_f64(), nodata),
            DecodingResult::F32(samples) => {
                (samples[i].into(), nodata.map(|value| f64::from(value as f32)))
            }
            DecodingResult::F64(samples) => (samples[i], nodata),
            DecodingResult::I8(samples) => (samples[i].into(), nodata),
            DecodingResult::I16(samples) => (samples[i].into(), nodata),
            DecodingResult::I32(samples) => (samples[i].into(), nodata),
            DecodingResult::I64(samples) => (samples[i] as f64, nodata),
        };
        let Elevation { scale, offset, .. } = self.elevation;
        let height = sample * scale + offset;
        (height.is_finite() && missing != Some(sample)).then_some(height)
    }

    /// Whether all samples are whole numbers before they are scaled.
    pub(crate) fn are_whole(&self) -> bool {
        !matches!(
            self.stored,
            DecodingResult::F16(_) | DecodingResult::F32(_) | DecodingResult::F64(_)
        )
    }
}
