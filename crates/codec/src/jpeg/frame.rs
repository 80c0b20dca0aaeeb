//! What a JPEG says of its picture, and whether its scans can hold it.

use super::segments::{Segment, Segments};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::limits::Limits;
use crate::orientation::{Orientation, from_exif};

/// The longest side that JPEG decoders agree on, as in the reference library.
const MAX_JPEG_SIDE: usize = 65_500;

/// The most scans: each takes a pass over all of the picture.
const MAX_SCANS: usize = 100;

/// The most blocks of a minimum coded unit.
const MAX_UNIT_BLOCKS: usize = 10;

/// Markers: the start and the end of the image, of a scan, and EXIF data or XMP.
const START: [u8; 2] = [0xFF, 0xD8];
const END: u8 = 0xD9;
const SCAN: u8 = 0xDA;
const APP1: u8 = 0xE1;

/// The frame header, and the orientation.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    /// Columns as stored.
    pub(super) width: usize,
    /// Rows as stored.
    pub(super) height: usize,
    /// Of one, three or four stored components the blocks side by side and on top of each other in a
    /// minimum coded unit, 1 to 4.
    pub(super) samplings: Vec<[usize; 2]>,
    /// The picture comes in several scans of growing detail.
    progressive: bool,
    /// What makes the picture upright.
    pub(super) orientation: Orientation,
}

impl Frame {
    /// Components whose first coefficients a scan holds. Refuses a sequential picture in several
    /// scans where the decoder would put the blocks of sampled components into wrong places.
    fn scanned_components(&self, scan: Segment<'_>) -> Result<usize, DecodeError> {
        let &[count, .., first_coefficient, _, approximation] = scan.payload() else {
            return Err(malformed(format!("the scan header at byte {} is broken", scan.at)));
        };
        let count = usize::from(count);
        let [h_max, v_max] = self.most_blocks();
        let whole = self.progressive || count == self.samplings.len();
        if !whole && (v_max > 1 || (h_max > 1 && count > 1)) {
            let reason =
                "several scans of sampled components are only supported in progressive files";
            return Err(PictureFormat::Jpeg.unsupported(reason));
        }
        let refines = self.progressive && (first_coefficient > 0 || approximation >> 4 > 0);
        Ok(if refines { 0 } else { count })
    }

    /// Checks that every component has a scan, and that their entropy-coded data can hold all blocks.
    ///
    /// No code is shorter than one bit, so each block takes at least one bit for its constant
    /// coefficient and, unless the picture is progressive, one for the others.
    fn check_scans(&self, component_count: usize, length: usize) -> Result<(), DecodeError> {
        let components = self.samplings.len();
        if component_count < components {
            let reason = format!("only {component_count} of {components} components have a scan");
            return Err(malformed(reason));
        }
        let Self { width, height, .. } = *self;
        let [h_max, v_max] = self.most_blocks();
        let blocks: usize = self
            .samplings
            .iter()
            .map(|[h, v]| (width * h).div_ceil(8 * h_max) * (height * v).div_ceil(8 * v_max))
            .sum();
        let bits = if self.progressive { blocks } else { 2 * blocks };
        if length >= bits.div_ceil(8) {
            return Ok(());
        }
        Err(malformed(format!(
            "its scans have {length} bytes, too few for {blocks} blocks of {width}x{height} pixels"
        )))
    }

    /// The most blocks that a component has side by side, and on top of each other.
    fn most_blocks(&self) -> [usize; 2] {
        self.samplings.iter().fold([1, 1], |[h_max, v_max], &[h, v]| [h_max.max(h), v_max.max(v)])
    }

    /// Refuses samplings that the decoder gets wrong: a first component coarser than another, and
    /// minimum coded units of more blocks than the standard allows in one scan.
    fn check_sampling(&self) -> Result<(), DecodeError> {
        let blocks: usize = self.samplings.iter().map(|[h, v]| h * v).sum();
        let first_is_finest = self.samplings.first() == Some(&self.most_blocks());
        if self.samplings.len() == 1 || (first_is_finest && blocks <= MAX_UNIT_BLOCKS) {
            return Ok(());
        }
        let samplings = self.samplings.iter().map(|[h, v]| format!("{h}x{v}"));
        let samplings: Vec<String> = samplings.collect();
        let reason = format!("the samplings {} are not supported", samplings.join(", "));
        Err(PictureFormat::Jpeg.unsupported(reason))
    }
}

/// A file that is read up to its first scan.
pub(super) struct Jpeg<'a> {
    pub(super) frame: Frame,
    segments: Segments<'a>,
    first_scan: Segment<'a>,
    /// What decoding needs of the part that is read.
    stripped: Vec<u8>,
}

impl<'a> Jpeg<'a> {
    /// Reads up to the first scan header, and checks the size against the limits.
    pub(super) fn open(bytes: &'a [u8], limits: &Limits) -> Result<Self, DecodeError> {
        let mut segments = Segments::new(bytes);
        let mut stripped = START.to_vec();
        let (mut frame, mut orientation) = (None, None);
        loop {
            let segment = segments.next()?;
            match segment.marker {
                0xC0..=0xC2 if frame.is_none() => frame = Some(read_frame(segment, limits)?),
                0xC0..=0xC2 => return Err(second_frame(segment)),
                0xC3 | 0xC5..=0xC7 | 0xC9..=0xCB | 0xCD..=0xCF => {
                    return Err(unsupported_coding(segment));
                }
                END => {
                    let reason = format!("it ends at byte {} without a scan", segment.at);
                    return Err(malformed(reason));
                }
                APP1 if segment.payload().starts_with(b"Exif\0\0") => {
                    orientation.get_or_insert(from_exif(segment.payload()));
                }
                SCAN => {
                    let mut frame =
                        frame.ok_or_else(|| malformed("a scan comes before its frame"))?;
                    frame.orientation = orientation.unwrap_or(Orientation::NoTransforms);
                    return Ok(Self { frame, segments, first_scan: segment, stripped });
                }
                _ => {}
            }
            keep(segment, &mut stripped);
        }
    }

    /// Reads the scans up to the end-of-image marker, checks that they hold the picture, and gives
    /// what a decoder needs of the file: no metadata, nothing between the segments, nothing after
    /// the end of the image. A lenient reader takes what there is of a file that ends in a scan.
    pub(super) fn strip(self, lenient: bool) -> Result<Vec<u8>, DecodeError> {
        let Self { frame, mut segments, first_scan: mut segment, mut stripped } = self;
        stripped.reserve_exact(segment.bytes.len() + segments.remaining() + 2);
        // What the scans of first coefficients have.
        let (mut scan_count, mut component_count, mut length) = (0, 0, 0);
        loop {
            match segment.marker {
                SCAN => {
                    scan_count += 1;
                    if scan_count > MAX_SCANS {
                        return Err(malformed(format!("it has more than {MAX_SCANS} scans")));
                    }
                    let components = frame.scanned_components(segment)?;
                    let entropy_coded = segments.entropy_coded(lenient)?;
                    if components > 0 {
                        component_count += components;
                        length += entropy_coded.len();
                    }
                    stripped.extend_from_slice(segment.bytes);
                    stripped.extend_from_slice(entropy_coded);
                }
                END => break,
                0xC0..=0xC3 | 0xC5..=0xC7 | 0xC9..=0xCF | 0xDC => {
                    return Err(second_frame(segment));
                }
                _ => keep(segment, &mut stripped),
            }
            segment = match segments.next() {
                Err(_) if lenient => break,
                next => next?,
            };
        }
        if !lenient {
            frame.check_scans(component_count, length)?;
        }
        stripped.extend([0xFF, END]);
        Ok(stripped)
    }
}

/// Keeps segments that decoding needs: tables, the frame, and the kind of colours (APP0 and
/// APP14); no other application data, no comments, and no marker that stands alone.
fn keep(segment: Segment<'_>, stripped: &mut Vec<u8>) {
    if !matches!(segment.marker, 0x01..=0xBF | 0xD0..=SCAN | APP1..=0xED | 0xEF | 0xFE) {
        stripped.extend_from_slice(segment.bytes);
    }
}

/// Reads the frame header, and checks its size against the limits.
fn read_frame(segment: Segment<'_>, limits: &Limits) -> Result<Frame, DecodeError> {
    let &[precision, h1, h0, w1, w0, count, ref components @ ..] = segment.payload() else {
        return Err(malformed("the frame header ends early"));
    };
    let (width, height) = (u16::from_be_bytes([w1, w0]), u16::from_be_bytes([h1, h0]));
    if height == 0 {
        return Err(PictureFormat::Jpeg.unsupported("its height follows its pixels"));
    }
    if width == 0 {
        return Err(malformed("its width is 0"));
    }
    let limits = Limits { max_side: limits.max_side.min(MAX_JPEG_SIDE), ..*limits };
    let (width, height) = limits.check(width.into(), height.into())?;
    if precision != 8 {
        let reason = format!("{precision} bits per sample are not supported, only 8 are");
        return Err(PictureFormat::Jpeg.unsupported(reason));
    }
    if !matches!(count, 1 | 3 | 4) {
        let reason = format!("{count} components are not supported, only 1, 3 and 4 are");
        return Err(PictureFormat::Jpeg.unsupported(reason));
    }
    let (components, rest) = components.as_chunks();
    if components.len() != usize::from(count) || !rest.is_empty() {
        return Err(malformed("the frame header has a wrong length"));
    }
    let samplings = components.iter().map(read_sampling).collect::<Result<_, _>>()?;
    let (progressive, orientation) = (segment.marker == 0xC2, Orientation::NoTransforms);
    let frame = Frame { width, height, samplings, progressive, orientation };
    frame.check_sampling()?;
    Ok(frame)
}

/// The sampling in the three bytes of a component.
fn read_sampling(&[id, sampling, _]: &[u8; 3]) -> Result<[usize; 2], DecodeError> {
    let [horizontal, vertical] = [sampling >> 4, sampling & 15].map(usize::from);
    if (1..=4).contains(&horizontal) && (1..=4).contains(&vertical) {
        return Ok([horizontal, vertical]);
    }
    Err(malformed(format!("component {id} has the sampling {horizontal}x{vertical}")))
}

fn second_frame(segment: Segment<'_>) -> DecodeError {
    malformed(format!("a second frame starts at byte {}", segment.at))
}

/// The error for a frame that is neither baseline, extended sequential nor progressive Huffman.
fn unsupported_coding(segment: Segment<'_>) -> DecodeError {
    let coding = match segment.marker {
        0xC3 => "lossless",
        0xC5..=0xC7 => "hierarchical",
        _ => "arithmetic",
    };
    PictureFormat::Jpeg.unsupported(format!("{coding} coding is not supported"))
}

fn malformed(reason: impl Into<String>) -> DecodeError {
    PictureFormat::Jpeg.malformed(reason)
}
