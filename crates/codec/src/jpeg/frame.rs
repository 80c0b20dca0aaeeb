//! What a JPEG says of its picture, and whether its scans can hold it.

use super::segments::{APP0, APP1, APP14, APP15, COM, DNL, EOI, SOI, SOS, Segment, Segments};
use crate::decode::DecodeOptions;
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::limits::Limits;
use crate::orientation::Orientation;

/// The longest side that JPEG decoders agree on, as in the reference library.
const MAX_JPEG_SIDE: usize = 65_500;

/// The most scans of a progressive picture: each takes a pass over all of it.
const MAX_SCANS: usize = 100;

/// The most blocks of a minimum coded unit.
const MAX_UNIT_BLOCKS: usize = 10;

/// The frame header, and the orientation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Frame {
    /// Columns as stored.
    pub(super) width: usize,
    /// Rows as stored.
    pub(super) height: usize,
    /// One, three or four components as stored.
    pub(super) components: Vec<Component>,
    /// The picture comes in several scans of growing detail.
    pub(super) progressive: bool,
    /// What makes the picture upright.
    pub(super) orientation: Orientation,
}

/// One stored component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Component {
    id: u8,
    /// Blocks side by side in one minimum coded unit, 1 to 4.
    horizontal: usize,
    /// Blocks on top of each other in one minimum coded unit, 1 to 4.
    vertical: usize,
    /// A scan has held its blocks' first coefficients.
    seen: bool,
}

impl Frame {
    /// Reads everything up to the first scan, and checks the size against the limits.
    pub(super) fn read(bytes: &[u8], limits: &Limits) -> Result<Self, DecodeError> {
        Ok(read_to_scan(&mut Segments::new(bytes), limits, &mut |_, _| {})?.0)
    }

    /// Reads the whole file, and gives back what a decoder needs of it: no metadata, nothing
    /// between the segments, nothing after the end of the image. When the options are lenient, the
    /// file may end within any scan.
    pub(super) fn read_all(
        bytes: &[u8],
        options: &DecodeOptions,
    ) -> Result<(Self, Vec<u8>), DecodeError> {
        let mut essence = Vec::with_capacity(bytes.len());
        essence.extend([0xFF, SOI]);
        let mut keep = |segment: Segment<'_>, entropy_coded: &[u8]| {
            let end = segment.at + 4 + segment.payload.len();
            essence.extend_from_slice(bytes.get(segment.at..end).unwrap_or_default());
            essence.extend_from_slice(entropy_coded);
        };
        let mut segments = Segments::new(bytes);
        let (mut frame, first) = read_to_scan(&mut segments, &options.limits, &mut keep)?;
        frame.read_scans(&mut segments, first, options.lenient, &mut keep)?;
        essence.extend([0xFF, EOI]);
        Ok((frame, essence))
    }

    /// Reads the scans up to the end-of-image marker, and checks that they hold the picture; when
    /// lenient, up to the end of the file at the latest, and takes what there is.
    fn read_scans<'a>(
        &mut self,
        segments: &mut Segments<'a>,
        first: Segment<'a>,
        lenient: bool,
        keep: &mut impl FnMut(Segment<'a>, &[u8]),
    ) -> Result<(), DecodeError> {
        let mut segment = first;
        let mut scan_count = 0;
        loop {
            match segment.marker {
                SOS => {
                    scan_count += 1;
                    if scan_count > MAX_SCANS {
                        return Err(malformed(format!("it has more than {MAX_SCANS} scans")));
                    }
                    let entropy_coded = if lenient {
                        segments.take_entropy_coded()
                    } else {
                        segments.skip_entropy_coded()?
                    };
                    let length = if lenient { usize::MAX } else { entropy_coded.len() };
                    self.check_scan(segment, length)?;
                    keep(segment, entropy_coded);
                }
                EOI => break,
                DNL | 0xC0..=0xC3 | 0xC5..=0xC7 | 0xC9..=0xCF => {
                    let reason = format!("a second frame starts at byte {}", segment.at);
                    return Err(malformed(reason));
                }
                marker if is_essential(marker) => keep(segment, &[]),
                _ => {}
            }
            segment = match segments.next() {
                Err(_) if lenient => return Ok(()),
                next => next?,
            };
        }
        match self.components.iter().find(|component| !component.seen) {
            Some(Component { id, .. }) if !lenient => {
                Err(malformed(format!("component {id} has no scan")))
            }
            _ => Ok(()),
        }
    }

    /// Checks a scan of so many bytes of entropy-coded data, and notes whose blocks it holds.
    fn check_scan(&mut self, scan: Segment<'_>, length: usize) -> Result<(), DecodeError> {
        let (chosen, first_coefficient) = self.read_scan_header(scan)?;
        self.check_coverage(&chosen)?;
        if self.progressive && first_coefficient != 0 {
            return Ok(());
        }
        for &index in &chosen {
            let Some(component) = self.components.get_mut(index) else { continue };
            if component.seen && !self.progressive {
                let reason = format!("the scan at byte {} repeats a component", scan.at);
                return Err(malformed(reason));
            }
            component.seen = true;
        }
        self.check_length(scan, &chosen, length)
    }

    /// Reads which components a scan holds, by their indices, and from which coefficient on.
    fn read_scan_header(&self, scan: Segment<'_>) -> Result<(Vec<usize>, u8), DecodeError> {
        let broken = || malformed(format!("the scan header at byte {} is broken", scan.at));
        let (&count, rest) = scan.payload.split_first().ok_or_else(broken)?;
        let (selectors, bands) =
            rest.split_at_checked(2 * usize::from(count)).ok_or_else(broken)?;
        let &[first_coefficient, _, _] = bands else { return Err(broken()) };
        let mut chosen = Vec::with_capacity(self.components.len());
        for selector in selectors.chunks_exact(2) {
            let with_id = |component: &Component| selector.first() == Some(&component.id);
            let index = self.components.iter().position(with_id).ok_or_else(broken)?;
            if chosen.contains(&index) {
                return Err(broken());
            }
            chosen.push(index);
        }
        if chosen.is_empty() { Err(broken()) } else { Ok((chosen, first_coefficient)) }
    }

    /// Checks that a scan's entropy-coded data can hold its blocks.
    ///
    /// No code is shorter than one bit, so each block takes at least one bit for its constant
    /// coefficient and, unless the picture is progressive, one for the others.
    fn check_length(
        &self,
        scan: Segment<'_>,
        chosen: &[usize],
        length: usize,
    ) -> Result<(), DecodeError> {
        let blocks = self.block_count(chosen);
        let bits = if self.progressive { blocks } else { 2 * blocks };
        if length as u64 >= bits.div_ceil(8) {
            return Ok(());
        }
        let Self { width, height, .. } = *self;
        Err(malformed(format!(
            "the scan at byte {} has {length} bytes, too few for {blocks} blocks of \
             {width}x{height} pixels",
            scan.at
        )))
    }

    /// Refuses a sequential picture in several scans where the decoder would put the blocks of
    /// sampled components into wrong places.
    fn check_coverage(&self, chosen: &[usize]) -> Result<(), DecodeError> {
        let whole = self.progressive || chosen.len() == self.components.len();
        let [h_max, v_max] = self.most_blocks();
        if whole || (v_max == 1 && (h_max == 1 || chosen.len() == 1)) {
            return Ok(());
        }
        let reason = "several scans of sampled components are only supported in progressive files";
        Err(PictureFormat::Jpeg.unsupported(reason))
    }

    /// The most blocks that a component has side by side, and on top of each other.
    fn most_blocks(&self) -> [usize; 2] {
        let components = &self.components;
        [
            components.iter().map(|component| component.horizontal).max().unwrap_or(1),
            components.iter().map(|component| component.vertical).max().unwrap_or(1),
        ]
    }

    /// Refuses samplings that the decoder gets wrong: a first component coarser than another, and
    /// minimum coded units of more blocks than the standard allows in one scan.
    fn check_sampling(&self) -> Result<(), DecodeError> {
        let [h_max, v_max] = self.most_blocks();
        let blocks: usize = self.components.iter().map(|c| c.horizontal * c.vertical).sum();
        let first_is_finest = self
            .components
            .first()
            .is_some_and(|first| [first.horizontal, first.vertical] == [h_max, v_max]);
        if self.components.len() == 1 || (first_is_finest && blocks <= MAX_UNIT_BLOCKS) {
            return Ok(());
        }
        let samplings = self.components.iter().map(|c| format!("{}x{}", c.horizontal, c.vertical));
        let samplings: Vec<String> = samplings.collect();
        let reason = format!("the samplings {} are not supported", samplings.join(", "));
        Err(PictureFormat::Jpeg.unsupported(reason))
    }

    /// Blocks of 8x8 coefficients that a scan of the chosen components holds.
    fn block_count(&self, chosen: &[usize]) -> u64 {
        let [h_max, v_max] = self.most_blocks();
        let chosen = chosen.iter().filter_map(|&index| self.components.get(index));
        let blocks: Vec<(usize, usize)> = chosen.map(|c| (c.horizontal, c.vertical)).collect();
        if let [(horizontal, vertical)] = blocks[..] {
            let columns = (self.width * horizontal).div_ceil(h_max).div_ceil(8);
            let rows = (self.height * vertical).div_ceil(v_max).div_ceil(8);
            return columns as u64 * rows as u64;
        }
        let units = self.width.div_ceil(8 * h_max) as u64 * self.height.div_ceil(8 * v_max) as u64;
        units
            * blocks
                .iter()
                .map(|(horizontal, vertical)| (horizontal * vertical) as u64)
                .sum::<u64>()
    }
}

/// Reads up to the first scan header, which is given back too; `keep` hears of each segment before
/// it that decoding needs.
fn read_to_scan<'a>(
    segments: &mut Segments<'a>,
    limits: &Limits,
    keep: &mut impl FnMut(Segment<'a>, &[u8]),
) -> Result<(Frame, Segment<'a>), DecodeError> {
    let mut frame = None;
    let mut orientation = None;
    loop {
        let segment = segments.next()?;
        match segment.marker {
            0xC0..=0xC2 if frame.is_none() => frame = Some(read_frame(segment, limits)?),
            0xC0..=0xC2 => {
                return Err(malformed(format!("a second frame starts at byte {}", segment.at)));
            }
            0xC3 | 0xC5..=0xC7 | 0xC9..=0xCB | 0xCD..=0xCF => {
                return Err(unsupported_coding(segment));
            }
            EOI => return Err(malformed(format!("it ends at byte {} without a scan", segment.at))),
            APP1 => orientation = orientation.or_else(|| exif_orientation(segment.payload)),
            SOS => {
                let mut frame = frame.ok_or_else(|| malformed("a scan comes before its frame"))?;
                frame.orientation = orientation.unwrap_or_default();
                return Ok((frame, segment));
            }
            _ => {}
        }
        if is_essential(segment.marker) {
            keep(segment, &[]);
        }
    }
}

/// Tells whether decoding needs segments of this marker: tables, the frame, and what tells the
/// colours; not metadata, and no marker that stands alone.
fn is_essential(marker: u8) -> bool {
    match marker {
        APP0 | APP14 => true,
        0x01..=0xBF | 0xD0..=SOS | APP1..=APP15 | COM => false,
        _ => true,
    }
}

/// Reads the frame header, and checks its size against the limits.
fn read_frame(segment: Segment<'_>, limits: &Limits) -> Result<Frame, DecodeError> {
    let [precision, h1, h0, w1, w0, count, components @ ..] = segment.payload else {
        return Err(malformed("the frame header ends early"));
    };
    let width = u16::from_be_bytes([*w1, *w0]);
    let height = u16::from_be_bytes([*h1, *h0]);
    if height == 0 {
        return Err(PictureFormat::Jpeg.unsupported("its height follows its pixels"));
    }
    if width == 0 {
        return Err(malformed("its width is 0"));
    }
    let limits = Limits { max_side: limits.max_side.min(MAX_JPEG_SIDE), ..*limits };
    let (width, height) = limits.check(width.into(), height.into())?;
    if *precision != 8 {
        let reason = format!("{precision} bits per sample are not supported, only 8 are");
        return Err(PictureFormat::Jpeg.unsupported(reason));
    }
    if !matches!(count, 1 | 3 | 4) {
        let reason = format!("{count} components are not supported, only 1, 3 and 4 are");
        return Err(PictureFormat::Jpeg.unsupported(reason));
    }
    if components.len() != 3 * usize::from(*count) {
        return Err(malformed("the frame header has a wrong length"));
    }
    let progressive = segment.marker == 0xC2;
    let components = components.chunks_exact(3).map(read_component).collect::<Result<_, _>>()?;
    let orientation = Orientation::default();
    let frame = Frame { width, height, components, progressive, orientation };
    frame.check_sampling()?;
    Ok(frame)
}

/// Reads the three bytes of a component in the frame header.
fn read_component(bytes: &[u8]) -> Result<Component, DecodeError> {
    let [id, sampling, _] = *bytes else {
        return Err(malformed("the frame header has a wrong length"));
    };
    let (horizontal, vertical) = (usize::from(sampling >> 4), usize::from(sampling & 15));
    if !(1..=4).contains(&horizontal) || !(1..=4).contains(&vertical) {
        let reason = format!("component {id} has the sampling {horizontal}x{vertical}");
        return Err(malformed(reason));
    }
    Ok(Component { id, horizontal, vertical, seen: false })
}

/// The orientation in an APP1 segment, if that holds EXIF data.
fn exif_orientation(payload: &[u8]) -> Option<Orientation> {
    payload.strip_prefix(b"Exif\0\0").map(Orientation::from_exif)
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
