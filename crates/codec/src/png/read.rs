//! The PNG reader, on the decoder of `png`: `image` makes 8 bits of fewer and has no rows to stop at.
//!
//! Samples are taken raw: 1, 2, 4, 8 or 16 bits of gray stay such, gAMA, sRGB and cICP change
//! nothing. A palette becomes RGB of 8 bits; transparency, be it of the palette or of one colour,
//! becomes a component. The orientation in an eXIf chunk is applied when the chunk stands before
//! the pixels. Text and iCCP chunks are skipped and never inflated; all other chunks together may
//! take 8 MiB. Checksums of critical chunks are verified up to the last IDAT; what follows must run
//! up to the end of IEND and is not looked at. Of an animated PNG the default image is decoded, which
//! nearly always is the first frame.

use super::interlace::stored_rows;
use super::pixels::Pixels;
use crate::budget::Budget;
use crate::canvas::Canvas;
use crate::decode::{DecodeOptions, METADATA_BYTES};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::guard::guarded;
use crate::header::Header;
use crate::limits::Limits;
use crate::orientation::Orientation;
use crate::wanted::{Wanted, WantedBytes, always};
use png::{Decoder, DecodingError, Reader};
use std::io::ErrorKind;

/// Bytes before the first chunk.
const SIGNATURE_BYTES: usize = 8;

/// Bytes of a chunk beside its data: length, kind and checksum.
const CHUNK_FRAME_BYTES: usize = 12;

/// The most bytes of a stored pixel: four samples of 16 bits.
const MAX_PIXEL_BYTES: usize = 8;

/// Reads the header, see [`probe`](crate::probe).
pub(crate) fn probe(bytes: &[u8], limits: &Limits) -> Result<Header, DecodeError> {
    Ok(Source::open(bytes, limits, 0, &always)?.header)
}

/// Decodes the picture, see [`decode`](crate::decode()).
pub(crate) fn decode(
    bytes: &[u8],
    options: &DecodeOptions,
    wanted: &Wanted<'_>,
) -> Result<Canvas, DecodeError> {
    if !options.lenient {
        check_chunks(bytes)?;
    }
    guarded(PictureFormat::Png, wanted, |wanted| read_picture(bytes, options, wanted))
}

fn read_picture(
    bytes: &[u8],
    options: &DecodeOptions,
    wanted: &Wanted<'_>,
) -> Result<Canvas, DecodeError> {
    let limits = &options.limits;
    let row_bytes = limits.max_side.saturating_mul(MAX_PIXEL_BYTES);
    let Source { mut reader, mut pixels, header, orientation } =
        Source::open(bytes, limits, row_bytes, wanted)?;
    let (width, height) = orientation.upright(header.width, header.height);
    let interlaced = reader.info().interlaced;
    let budget = Budget::of_decoder(&header, options)?;
    let mut canvas = Canvas::new(header, orientation, budget, wanted)?;
    let mut samples = Vec::new();
    for row in stored_rows(width, height, interlaced) {
        wanted()?;
        let stored = match reader.next_row() {
            Err(error) if options.lenient && is_end(&error) => return Ok(canvas),
            stored => stored.map_err(refusal)?,
        };
        let stored = stored.ok_or_else(|| PictureFormat::Png.malformed("rows are missing"))?;
        let count = (width - row.first).div_ceil(row.step);
        pixels.unpack(stored.data(), count, &mut samples)?;
        canvas.put_row(row, &samples);
    }
    match check_end(&mut reader) {
        Err(_) if options.lenient => {}
        result => result?,
    }
    Ok(canvas)
}

/// Checks that the chunks run up to the last, whatever they hold.
fn check_chunks(bytes: &[u8]) -> Result<(), DecodeError> {
    let early = || PictureFormat::Png.malformed("it ends early");
    let mut rest = bytes.get(SIGNATURE_BYTES..).unwrap_or_default();
    loop {
        let (length, kind) = match rest {
            [a, b, c, d, kind @ ..] => (u32::from_be_bytes([*a, *b, *c, *d]), kind),
            _ => return Err(early()),
        };
        rest = rest.get(CHUNK_FRAME_BYTES + length as usize..).ok_or_else(early)?;
        if kind.starts_with(b"IEND") {
            return Ok(());
        }
    }
}

/// A PNG that is open up to its first pixel.
struct Source<'a> {
    reader: Reader<WantedBytes<'a>>,
    pixels: Pixels,
    header: Header,
    orientation: Orientation,
}

impl<'a> Source<'a> {
    /// Opens a file: its size is checked before anything else is read, and what stands before the
    /// pixels may take [`METADATA_BYTES`] and `row_bytes` more.
    fn open(
        bytes: &'a [u8],
        limits: &Limits,
        row_bytes: usize,
        wanted: &'a Wanted<'a>,
    ) -> Result<Self, DecodeError> {
        let budget = png::Limits { bytes: METADATA_BYTES.saturating_add(row_bytes) };
        let mut decoder = Decoder::new_with_limits(WantedBytes::new(bytes, wanted), budget);
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        let (width, height) = decoder.read_header_info().map_err(refusal)?.size();
        let (width, height) = limits.check(width.into(), height.into())?;
        let reader = decoder.read_info().map_err(refusal)?;
        let pixels = Pixels::new(reader.info())?;
        let exif = reader.info().exif_metadata.as_deref();
        let orientation = exif.map_or_else(Orientation::default, Orientation::from_exif);
        let (width, height) = orientation.upright(width, height);
        let (component_count, precision) = (pixels.component_count(), pixels.precision());
        let format = PictureFormat::Png;
        let header = Header { format, width, height, component_count, precision };
        Ok(Self { reader, pixels, header, orientation })
    }
}

/// Reads the rest of the pixels' chunks, so that their checksums are verified.
fn check_end(reader: &mut Reader<WantedBytes<'_>>) -> Result<(), DecodeError> {
    match reader.next_row().map_err(refusal)? {
        None => Ok(()),
        Some(_) => Err(PictureFormat::Png.malformed("it has more rows than its header says")),
    }
}

/// Tells whether an error is that of a file that ends early.
fn is_end(error: &DecodingError) -> bool {
    matches!(error, DecodingError::IoError(error) if error.kind() == ErrorKind::UnexpectedEof)
}

/// The decoder's error in the terms of this crate.
fn refusal(error: DecodingError) -> DecodeError {
    let format = PictureFormat::Png;
    match error {
        DecodingError::LimitsExceeded => {
            DecodeError::MetadataTooLarge { format, limit: METADATA_BYTES }
        }
        error if is_end(&error) => format.malformed("it ends early"),
        other => format.malformed(other.to_string()),
    }
}
