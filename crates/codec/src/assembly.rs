//! An image that is put together from samples that were decoded elsewhere.

use crate::alpha::Alpha;
use crate::canvas::{Canvas, Row};
use crate::error::DecodeError;
use crate::wanted::Wanted;
use pixmesh_meshing::Image;

/// An image to which samples come as they are decoded elsewhere, see
/// [`DecodeOptions::assemble`](crate::DecodeOptions::assemble).
pub struct Assembly {
    canvas: Canvas,
    alpha: Alpha,
    /// Rows that are whole.
    rows: usize,
    /// Samples of the next row.
    begun: Vec<u8>,
}

impl Assembly {
    pub(crate) fn new(canvas: Canvas, alpha: Alpha) -> Self {
        Self { canvas, alpha, rows: 0, begun: Vec::new() }
    }

    /// How many samples are still to come.
    #[must_use]
    pub fn missing(&self) -> usize {
        let come = self.rows * self.canvas.row_samples() + self.begun.len();
        self.canvas.sample_count().saturating_sub(come)
    }

    /// Takes the next samples, in pieces of any length; those beyond the last are dropped.
    pub fn put(&mut self, mut samples: &[u8]) {
        let row_samples = self.canvas.row_samples();
        if !self.begun.is_empty() {
            let (first, rest) = split_at_most(samples, row_samples - self.begun.len());
            self.begun.extend_from_slice(first);
            samples = rest;
            if self.begun.len() < row_samples {
                return;
            }
            self.canvas.put_row(Row::whole(self.rows), &self.begun);
            self.rows += 1;
            self.begun.clear();
        }
        let rows = samples.chunks_exact(row_samples);
        let last = rows.remainder();
        for row in rows {
            self.canvas.put_row(Row::whole(self.rows), row);
            self.rows += 1;
        }
        self.begun.extend_from_slice(last);
    }

    /// The finished image, as long as it is wanted.
    ///
    /// # Errors
    /// When samples are [missing](Self::missing), or it is no longer wanted.
    pub fn finish(self, wanted: &Wanted<'_>) -> Result<Image, DecodeError> {
        match self.missing() {
            0 => self.canvas.into_image(self.alpha, wanted),
            missing => {
                Err(self.canvas.format().malformed(format!("{missing} samples are missing")))
            }
        }
    }
}

fn split_at_most(samples: &[u8], count: usize) -> (&[u8], &[u8]) {
    samples.split_at(count.min(samples.len()))
}
