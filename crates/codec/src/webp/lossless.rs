//! How much memory the prefix codes of a lossless WebP take.
//!
//! A picture may have 65536 groups of five codes, and the decoder makes a table of some kilobytes
//! for each: a file of 4 MB becomes more than 1 GB. This module reads the stream up to its pixels
//! and counts the tables. It reads everything that takes bits of the stream, ignores what only changes
//! colours, and leaves the refusal of broken streams to the decoder.
//!
//! Literature: RFC 9649, section 3, "Specification for WebP Lossless Bitstream".

use super::ends_early;
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::wanted::Wanted;

/// The most bytes that the tables of a picture's prefix codes may take. Encoders make some hundreds
/// of groups at the most, which take far less.
pub(crate) const CODE_BYTES: usize = 32 << 20;

/// Bits of a code that a table resolves at once.
const TABLE_BITS: u8 = 10;

/// Bytes of a table's entry, and of the two nodes of a symbol whose code is longer.
const ENTRY_BYTES: usize = 4;
const NODE_BYTES: usize = 32;

/// The order in which the lengths of the code of lengths are stored.
const LENGTH_ORDER: [usize; 19] =
    [17, 18, 0, 1, 2, 3, 4, 5, 16, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Symbols of the five codes of a group: green and lengths, without those of a colour cache; red;
/// blue; alpha; distances.
const SYMBOLS: [usize; 5] = [256 + 24, 256, 256, 256, 40];

/// Symbols between two polls of `wanted`.
const POLL_SYMBOLS: usize = 4096;

/// A stream of a picture without loss, or of alpha compressed like one.
pub(super) struct Stream<'a> {
    pub(super) data: &'a [u8],
    /// Bits before the stream.
    pub(super) start: usize,
    /// Columns and rows of the picture.
    pub(super) size: [u32; 2],
}

/// Refuses a stream whose prefix codes take more than [`CODE_BYTES`].
pub(super) fn check_codes(stream: &Stream<'_>, wanted: &Wanted<'_>) -> Result<(), DecodeError> {
    let &Stream { data, start, size: [width, height] } = stream;
    let mut bits = Bits { data, position: start, wanted };
    let (mut width, height) = (width as usize, height as usize);
    while bits.read(1)? == 1 {
        match bits.read(2)? {
            0 | 1 => {
                let shift = bits.read(3)? + 2;
                bits.skip_image(scaled(width, shift) * scaled(height, shift))?;
            }
            2 => {}
            _ => {
                let colours = bits.read(8)? + 1;
                bits.skip_image(colours)?;
                let packed = [2, 4, 16].iter().filter(|&&most| colours <= most).count();
                width = scaled(width, packed);
            }
        }
    }
    let cached = bits.read_cache_symbols()?;
    let mut groups = 1;
    if bits.read(1)? == 1 {
        let shift = bits.read(3)? + 2;
        groups = 1 + bits.skip_image(scaled(width, shift) * scaled(height, shift))?;
    }
    let mut bytes = 0;
    for _ in 0..groups {
        wanted()?;
        for lengths in bits.read_group(cached)? {
            bytes += table_bytes(&lengths);
        }
        if bytes > CODE_BYTES {
            let (format, limit) = (PictureFormat::WebP, CODE_BYTES);
            return Err(DecodeError::MetadataTooLarge { format, limit });
        }
    }
    Ok(())
}

/// A side of an image that has one pixel for each `2^shift`.
fn scaled(side: usize, shift: usize) -> usize {
    side.div_ceil(1 << shift)
}

/// The bytes of the decoder's table for a code of these lengths.
fn table_bytes(lengths: &[u8]) -> usize {
    if lengths.iter().filter(|&&length| length > 0).count() < 2 {
        return 0;
    }
    let longest = lengths.iter().copied().max().unwrap_or(0);
    let long = lengths.iter().filter(|&&length| length > TABLE_BITS).count();
    (ENTRY_BYTES << longest.min(TABLE_BITS)) + long * NODE_BYTES
}

/// A prefix code.
struct Code {
    /// Symbols sorted by length, then by value.
    symbols: Vec<u16>,
    /// How many symbols have each length from 1 on.
    counts: [usize; 15],
}

impl Code {
    fn new(lengths: &[u8]) -> Self {
        let mut symbols = Vec::new();
        let counts = std::array::from_fn(|i| {
            let before = symbols.len();
            let of_length = (0_u16..).zip(lengths).filter(|&(_, &l)| usize::from(l) == i + 1);
            symbols.extend(of_length.map(|(symbol, _)| symbol));
            symbols.len() - before
        });
        Self { symbols, counts }
    }

    /// Reads a symbol; the only one of a code takes no bits.
    fn read(&self, bits: &mut Bits<'_>) -> Result<usize, DecodeError> {
        if let [symbol] = self.symbols[..] {
            return Ok(symbol.into());
        }
        let mut word = bits.peek();
        let (mut code, mut first, mut index) = (0, 0, 0);
        for (length, count) in (1..).zip(self.counts) {
            code = code << 1 | (word & 1) as usize;
            word >>= 1;
            if code < first + count {
                bits.skip(length)?;
                return self
                    .symbols
                    .get(index + code - first)
                    .map_or_else(broken, |&s| Ok(s.into()));
            }
            index += count;
            first = (first + count) << 1;
        }
        broken()
    }
}

/// The bits of a stream, the least significant of each byte first.
struct Bits<'a> {
    data: &'a [u8],
    position: usize,
    wanted: &'a Wanted<'a>,
}

impl Bits<'_> {
    /// The next 25 bits or more, zeros after the end.
    fn peek(&self) -> u32 {
        let bytes = self.data.get(self.position / 8..).unwrap_or_default();
        let word = match bytes {
            [a, b, c, d, ..] => u32::from_le_bytes([*a, *b, *c, *d]),
            _ => bytes.iter().rev().fold(0, |word, &byte| word << 8 | u32::from(byte)),
        };
        word >> (self.position % 8)
    }

    fn skip(&mut self, count: usize) -> Result<(), DecodeError> {
        self.position += count;
        if self.position > 8 * self.data.len() { Err(ends_early()) } else { Ok(()) }
    }

    /// Reads a number of up to 18 bits.
    fn read(&mut self, count: usize) -> Result<usize, DecodeError> {
        let value = self.peek() & ((1 << count) - 1);
        self.skip(count)?;
        Ok(value as usize)
    }

    /// Reads how many symbols a colour cache adds to the first code.
    fn read_cache_symbols(&mut self) -> Result<usize, DecodeError> {
        if self.read(1)? == 0 { Ok(0) } else { Ok(1 << self.read(4)?) }
    }

    /// Reads the lengths of the five codes of a group.
    fn read_group(&mut self, cached: usize) -> Result<[Vec<u8>; 5], DecodeError> {
        let mut lengths = SYMBOLS.map(|_| Vec::new());
        for (index, lengths) in lengths.iter_mut().enumerate() {
            *lengths = self.read_lengths(SYMBOLS[index] + if index == 0 { cached } else { 0 })?;
        }
        Ok(lengths)
    }

    /// Reads a code's length for each symbol, 0 for those that it does not have.
    fn read_lengths(&mut self, symbols: usize) -> Result<Vec<u8>, DecodeError> {
        let mut lengths = vec![0; symbols];
        if self.read(1)? == 1 {
            let two = self.read(1)? == 1;
            let width = if self.read(1)? == 1 { 8 } else { 1 };
            let first = self.read(width)?;
            *lengths.get_mut(first).map_or_else(broken, Ok)? = 1;
            if two {
                // The decoder takes two symbols in the order of the stream, others in their own:
                // those that encoders write are in both.
                let second = self.read(8)?;
                let length = lengths.get_mut(second).filter(|_| second > first);
                *length.map_or_else(broken, Ok)? = 1;
            }
            return Ok(lengths);
        }
        let mut of_lengths = [0; LENGTH_ORDER.len()];
        let count = 4 + self.read(4)?;
        for &place in LENGTH_ORDER.iter().take(count) {
            *of_lengths.get_mut(place).map_or_else(broken, Ok)? = self.read(3)? as u8;
        }
        let of_lengths = Code::new(&of_lengths);
        let mut left = symbols;
        if self.read(1)? == 1 {
            let size = 2 + 2 * self.read(3)?;
            left = 2 + self.read(size)?;
        }
        let (mut symbol, mut previous) = (0, 8);
        while symbol < symbols && left > 0 {
            left -= 1;
            let (length, repeat) = match of_lengths.read(self)? {
                16 => (previous, 3 + self.read(2)?),
                17 => (0, 3 + self.read(3)?),
                18 => (0, 11 + self.read(7)?),
                length => (length as u8, 1),
            };
            if length != 0 {
                previous = length;
            }
            lengths.get_mut(symbol..symbol + repeat).map_or_else(broken, Ok)?.fill(length);
            symbol += repeat;
        }
        Ok(lengths)
    }

    /// Skips an image of one group of codes, and returns the largest number in the red and green of its
    /// pixels. Copies and the cache only repeat pixels, so the largest number is that of a literal.
    fn skip_image(&mut self, pixels: usize) -> Result<usize, DecodeError> {
        let cached = self.read_cache_symbols()?;
        let [green, red, blue, alpha, distance] =
            self.read_group(cached)?.map(|lengths| Code::new(&lengths));
        let (mut left, mut largest) = (pixels, 0);
        for symbol_count in 0_usize.. {
            if left == 0 {
                break;
            }
            if symbol_count.is_multiple_of(POLL_SYMBOLS) {
                (self.wanted)()?;
            }
            let symbol = green.read(self)?;
            let taken = match symbol {
                0..256 => {
                    largest = largest.max(red.read(self)? << 8 | symbol);
                    blue.read(self)?;
                    alpha.read(self)?;
                    1
                }
                256..280 => {
                    let length = self.read_extra(symbol - 256)?;
                    let code = distance.read(self)?;
                    self.read_extra(code)?;
                    length
                }
                _ => 1,
            };
            left = left.saturating_sub(taken);
        }
        Ok(largest)
    }

    /// The length or distance that a symbol and some bits after it stand for.
    fn read_extra(&mut self, symbol: usize) -> Result<usize, DecodeError> {
        if symbol < 4 {
            return Ok(symbol + 1);
        }
        let extra = (symbol - 2) >> 1;
        let offset = (2 + (symbol & 1)) << extra;
        Ok(offset + self.read(extra)? + 1)
    }
}

fn broken<T>() -> Result<T, DecodeError> {
    Err(PictureFormat::WebP.malformed("its prefix codes are broken"))
}
