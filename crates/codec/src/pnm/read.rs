//! The PNM reader.
//!
//! Samples are kept as they stand: the precision is the number of bits of the largest sample that
//! the header allows (maxval), so maxval 100 gives 7 bits, and a sample above maxval is an error.
//! In a bitmap 1 means black, so the samples are the bits' complements. Memory is taken only when
//! the file is long enough to hold the pixels that its header claims.

use super::scanner::Scanner;
use crate::canvas::{Canvas, Row};
use crate::decode::{DecodeOptions, Opened};
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::header::Header;
use crate::limits::Limits;
use crate::orientation::Orientation;
use crate::packed::unpack;
use crate::wanted::Wanted;

/// The largest maxval.
const MAX_MAXVAL: u64 = 65_535;

/// Reads the header.
pub(crate) fn open<'a>(
    bytes: &'a [u8],
    options: &'a DecodeOptions,
    wanted: &'a Wanted<'a>,
) -> Result<Opened<'a>, DecodeError> {
    let mut anymap = Anymap::read_header(bytes, &options.limits)?;
    let header = anymap.header;
    Ok(Opened::new(header, move || {
        if !options.lenient {
            anymap.check_length()?;
        }
        let mut canvas = Canvas::new(header, Orientation::NoTransforms, wanted)?;
        match anymap.coding {
            Coding::RawBits | Coding::RawNumbers => anymap.read_raw(&mut canvas, wanted)?,
            _ => match anymap.read_plain(&mut canvas, wanted) {
                Err(_) if options.lenient && anymap.raster.rest().is_empty() => {}
                result => result?,
            },
        }
        Ok(canvas)
    }))
}

/// How the samples are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coding {
    /// Bits as digits, 1 for black.
    PlainBits,
    /// Decimal numbers.
    PlainNumbers,
    /// Eight bits a byte, 1 for black, each row filled up to whole bytes.
    RawBits,
    /// One byte a sample, or two, the more significant first, where maxval is over 255.
    RawNumbers,
}

/// A file that is read up to its raster.
struct Anymap<'a> {
    coding: Coding,
    header: Header,
    maxval: u16,
    raster: Scanner<'a>,
}

impl<'a> Anymap<'a> {
    fn read_header(bytes: &'a [u8], limits: &Limits) -> Result<Self, DecodeError> {
        let mut scanner = Scanner::new(bytes, 2);
        let (coding, component_count) = match bytes {
            [b'P', b'1', ..] => (Coding::PlainBits, 1),
            [b'P', b'2', ..] => (Coding::PlainNumbers, 1),
            [b'P', b'3', ..] => (Coding::PlainNumbers, 3),
            [b'P', b'4', ..] => (Coding::RawBits, 1),
            [b'P', b'5', ..] => (Coding::RawNumbers, 1),
            [b'P', b'6', ..] => (Coding::RawNumbers, 3),
            _ => return Self::read_pam_header(scanner, limits),
        };
        let (width, height) = (scanner.number("the width")?, scanner.number("the height")?);
        let maxval = match coding {
            Coding::PlainBits | Coding::RawBits => 1,
            Coding::PlainNumbers | Coding::RawNumbers => scanner.number("maxval")?,
        };
        scanner.end_header()?;
        Self::new(coding, [width, height, component_count, maxval], scanner, limits)
    }

    /// Reads the header of a PAM: lines of a name and a value, the last of them ENDHDR.
    fn read_pam_header(mut scanner: Scanner<'a>, limits: &Limits) -> Result<Self, DecodeError> {
        let mut values = [None; 4];
        loop {
            let word = scanner.word("ENDHDR")?;
            let field = match word {
                b"WIDTH" => 0,
                b"HEIGHT" => 1,
                b"DEPTH" => 2,
                b"MAXVAL" => 3,
                b"ENDHDR" => break,
                b"TUPLTYPE" => {
                    scanner.skip_line();
                    continue;
                }
                _ => {
                    let name = word[..word.len().min(16)].escape_ascii();
                    let reason = format!("the header has an unknown '{name}'");
                    return Err(PictureFormat::Pnm.malformed(reason));
                }
            };
            values[field] = Some(scanner.number(&word.escape_ascii().to_string())?);
        }
        scanner.skip_line();
        let [Some(width), Some(height), Some(depth), Some(maxval)] = values else {
            return Err(PictureFormat::Pnm.malformed("the header lacks a size, depth or maxval"));
        };
        Self::new(Coding::RawNumbers, [width, height, depth, maxval], scanner, limits)
    }

    /// Checks the header's numbers: columns, rows, components, maxval.
    fn new(
        coding: Coding,
        [width, height, component_count, maxval]: [u64; 4],
        raster: Scanner<'a>,
        limits: &Limits,
    ) -> Result<Self, DecodeError> {
        let format = PictureFormat::Pnm;
        let (width, height) = limits.check(width, height)?;
        if !(1..=MAX_MAXVAL).contains(&maxval) {
            return Err(format.malformed(format!("maxval {maxval} is not 1 to {MAX_MAXVAL}")));
        }
        if !(1..=4).contains(&component_count) {
            let reason = format!("{component_count} components are not supported, only 1 to 4 are");
            return Err(format.unsupported(reason));
        }
        let precision = (u64::BITS - maxval.leading_zeros()) as u8;
        let component_count = component_count as usize;
        let header = Header { format, width, height, component_count, precision };
        Ok(Self { coding, header, maxval: maxval as u16, raster })
    }

    /// Samples of one row.
    fn row_samples(&self) -> usize {
        self.header.width * self.header.component_count
    }

    /// Bytes that a row takes at least; a plain number needs a digit and white space.
    fn row_bytes(&self) -> usize {
        match self.coding {
            Coding::PlainBits => self.row_samples(),
            Coding::PlainNumbers => 2 * self.row_samples(),
            Coding::RawBits => self.row_samples().div_ceil(8),
            Coding::RawNumbers if self.maxval > 255 => 2 * self.row_samples(),
            Coding::RawNumbers => self.row_samples(),
        }
    }

    /// Checks that the file can hold the pixels that the header claims.
    fn check_length(&self) -> Result<(), DecodeError> {
        let needed = self.row_bytes() as u64 * self.header.height as u64;
        let unwritten = u64::from(self.coding == Coding::PlainNumbers);
        let actual = self.raster.rest().len();
        if (actual as u64) < needed - unwritten {
            let Header { width, height, .. } = self.header;
            let reason = format!(
                "it ends early: {width}x{height} pixels need {needed} bytes, and {actual} follow \
                 the header"
            );
            return Err(PictureFormat::Pnm.malformed(reason));
        }
        Ok(())
    }

    fn read_plain(&mut self, canvas: &mut Canvas, wanted: &Wanted<'_>) -> Result<(), DecodeError> {
        let mut row = vec![0; self.row_samples()];
        for y in 0..self.header.height {
            wanted()?;
            for sample in &mut row {
                let value = match self.coding {
                    Coding::PlainBits => 1 - self.raster.bit()?,
                    _ => self.raster.number("a sample")?,
                };
                *sample = u16::try_from(value).unwrap_or(u16::MAX);
                if value > u64::from(self.maxval) {
                    return Err(self.too_large(value, y));
                }
            }
            canvas.put_row(Row::whole(y), &row);
        }
        Ok(())
    }

    fn read_raw(&self, canvas: &mut Canvas, wanted: &Wanted<'_>) -> Result<(), DecodeError> {
        let mut row = Vec::with_capacity(self.row_samples());
        let rows = self.raster.rest().chunks_exact(self.row_bytes());
        for (y, bytes) in rows.take(self.header.height).enumerate() {
            wanted()?;
            match self.coding {
                Coding::RawBits => {
                    unpack(bytes, 1, &mut row);
                    row.truncate(self.header.width);
                    row.iter_mut().for_each(|bit| *bit = 1 - *bit);
                }
                _ => unpack(bytes, if self.maxval > 255 { 16 } else { 8 }, &mut row),
            }
            if let Some(&sample) = row.iter().find(|&&sample| sample > self.maxval) {
                return Err(self.too_large(sample.into(), y));
            }
            canvas.put_row(Row::whole(y), &row);
        }
        Ok(())
    }

    /// The error for a sample above maxval in row `y` from the top.
    fn too_large(&self, sample: u64, y: usize) -> DecodeError {
        let maxval = self.maxval;
        let reason = format!("row {y} from the top has the sample {sample}, more than {maxval}");
        PictureFormat::Pnm.malformed(reason)
    }
}
