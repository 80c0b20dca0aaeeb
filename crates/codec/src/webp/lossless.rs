//! How much memory the prefix codes of a lossless WebP would take, from its bits.
//!
//! A picture may have 65536 groups of five codes, and a decoder makes a table of some kilobytes for
//! each: a file of four megabytes would become more than a gigabyte, whatever its picture's size.
//! Hence the stream is read here up to its pixels, and the tables are counted instead of made.
//!
//! Literature: RFC 9649, section 3, "Specification for WebP Lossless Bitstream".

use super::container::{ends_early, malformed};
use crate::error::DecodeError;
use crate::wanted::Wanted;

/// Bits of a code that a table resolves at once.
const TABLE_BITS: usize = 10;

/// Bytes of a table's entry, and of a node for what is longer.
const ENTRY_BYTES: usize = 4;
const NODE_BYTES: usize = 16;

/// The order in which the lengths of the code of lengths are stored.
const LENGTH_ORDER: [usize; 19] =
    [17, 18, 0, 1, 2, 3, 4, 5, 16, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Symbols of green and lengths, without those of a colour cache.
const GREEN_SYMBOLS: usize = 256 + 24;

/// Symbols of distances.
const DISTANCE_SYMBOLS: usize = 40;

/// Symbols read from one question to the next whether the picture is wanted.
const POLL_SYMBOLS: usize = 4096;

/// The bytes that the tables of a picture's codes take, counted up to `limit`.
///
/// The stream begins after the header of a picture, or the first byte of alpha.
///
/// # Errors
/// When the stream is broken before its pixels, or no longer wanted.
pub(super) fn table_bytes(
    mut bits: Bits<'_>,
    [width, height]: [u32; 2],
    limit: usize,
) -> Result<usize, DecodeError> {
    let mut width = width as usize;
    let height = height as usize;
    let mut seen = [false; 4];
    while bits.read(1)? == 1 {
        let transform = bits.read(2)?;
        if seen.get_mut(transform).is_some_and(|seen| std::mem::replace(seen, true)) {
            return Err(malformed("a transform is repeated"));
        }
        match transform {
            0 | 1 => {
                let shift = bits.read(3)? + 2;
                read_image(&mut bits, scaled(width, shift), scaled(height, shift))?;
            }
            2 => {}
            _ => {
                let colours = bits.read(8)? + 1;
                read_image(&mut bits, colours, 1)?;
                let packed = match colours {
                    ..=2 => 3,
                    3..=4 => 2,
                    5..=16 => 1,
                    _ => 0,
                };
                width = scaled(width, packed);
            }
        }
    }
    let cache = read_cache_bits(&mut bits)?;
    let groups = if bits.read(1)? == 1 {
        let shift = bits.read(3)? + 2;
        let pixels = read_image(&mut bits, scaled(width, shift), scaled(height, shift))?;
        pixels.iter().map(|pixel| (pixel >> 8 & 0xFFFF) as usize + 1).max().unwrap_or(1)
    } else {
        1
    };
    let mut bytes = 0;
    for _ in 0..groups {
        (bits.wanted)()?;
        bytes += read_group(&mut bits, cache)?.iter().map(Code::table_bytes).sum::<usize>();
        if bytes > limit {
            break;
        }
    }
    Ok(bytes)
}

/// A side of an image that has one pixel for each `2^shift`.
fn scaled(side: usize, shift: usize) -> usize {
    side.div_ceil(1 << shift)
}

/// The least significant bits first.
pub(super) struct Bits<'a> {
    data: &'a [u8],
    position: usize,
    wanted: &'a Wanted<'a>,
}

impl<'a> Bits<'a> {
    /// The bits of `data` from that at `position` on.
    pub(super) fn new(data: &'a [u8], position: usize, wanted: &'a Wanted<'a>) -> Self {
        Self { data, position, wanted }
    }

    fn read(&mut self, count: usize) -> Result<usize, DecodeError> {
        let mut value = 0;
        for i in 0..count {
            let byte = self.data.get(self.position / 8).ok_or_else(ends_early)?;
            value |= usize::from(byte >> (self.position % 8) & 1) << i;
            self.position += 1;
        }
        Ok(value)
    }
}

/// A prefix code.
#[derive(Default)]
struct Code {
    /// Symbols sorted by length, then by value.
    symbols: Vec<u16>,
    /// How many symbols have each length.
    counts: [usize; 16],
}

impl Code {
    /// # Errors
    /// When the lengths do not make a complete code.
    fn new(lengths: &[u8]) -> Result<Self, DecodeError> {
        let mut code = Self::default();
        for length in 1..=15_u8 {
            let of_length = lengths.iter().enumerate().filter(|&(_, &l)| l == length);
            let before = code.symbols.len();
            code.symbols.extend(of_length.map(|(symbol, _)| symbol as u16));
            if let Some(count) = code.counts.get_mut(usize::from(length)) {
                *count = code.symbols.len() - before;
            }
        }
        let used: usize = code.counts.iter().enumerate().map(|(l, n)| n << (15 - l)).sum();
        match code.symbols.len() {
            0 => Err(malformed("a prefix code is empty")),
            1 => Ok(code),
            _ if used == 1 << 15 => Ok(code),
            _ => Err(malformed("a prefix code is not complete")),
        }
    }

    /// Reads a symbol; the only one of a code takes no bits.
    fn read(&self, bits: &mut Bits<'_>) -> Result<usize, DecodeError> {
        if let [symbol] = self.symbols[..] {
            return Ok(symbol.into());
        }
        let (mut code, mut first, mut index) = (0, 0, 0);
        for &count in self.counts.get(1..).unwrap_or_default() {
            code = code << 1 | bits.read(1)?;
            if code < first + count {
                let symbol = self.symbols.get(index + code - first);
                return symbol.map(|&s| s.into()).ok_or_else(|| malformed("a code is unknown"));
            }
            index += count;
            first = (first + count) << 1;
        }
        Err(malformed("a code is unknown"))
    }

    /// About the bytes of a decoder's table.
    fn table_bytes(&self) -> usize {
        if self.symbols.len() < 2 {
            return 0;
        }
        let longest = self.counts.iter().rposition(|&count| count > 0).unwrap_or(0);
        let long = self.counts.get(TABLE_BITS + 1..).unwrap_or_default().iter().sum::<usize>();
        (ENTRY_BYTES << longest.min(TABLE_BITS)) + 2 * long * NODE_BYTES
    }
}

/// Reads the bits of the colour cache's size, 0 for none.
fn read_cache_bits(bits: &mut Bits<'_>) -> Result<usize, DecodeError> {
    if bits.read(1)? == 0 {
        return Ok(0);
    }
    match bits.read(4)? {
        size @ 1..=11 => Ok(size),
        size => Err(malformed(&format!("a colour cache has {size} bits"))),
    }
}

/// Reads the five codes of a group: green, red, blue, alpha and distances.
fn read_group(bits: &mut Bits<'_>, cache_bits: usize) -> Result<[Code; 5], DecodeError> {
    let cached = if cache_bits == 0 { 0 } else { 1 << cache_bits };
    Ok([
        read_code(bits, GREEN_SYMBOLS + cached)?,
        read_code(bits, 256)?,
        read_code(bits, 256)?,
        read_code(bits, 256)?,
        read_code(bits, DISTANCE_SYMBOLS)?,
    ])
}

/// Reads a code of so many symbols.
fn read_code(bits: &mut Bits<'_>, symbols: usize) -> Result<Code, DecodeError> {
    let mut lengths = vec![0; symbols];
    if bits.read(1)? == 1 {
        let two = bits.read(1)? == 1;
        let wide = bits.read(1)? == 1;
        let first = bits.read(if wide { 8 } else { 1 })?;
        let second = if two { Some(bits.read(8)?) } else { None };
        let chosen: Vec<usize> = [Some(first), second].into_iter().flatten().collect();
        if chosen.iter().any(|&symbol| symbol >= symbols) {
            return Err(malformed("a symbol is unknown"));
        }
        // The two keep their order, as in the decoder.
        let mut code = Code::default();
        code.symbols.extend(chosen.iter().map(|&symbol| symbol as u16));
        if let Some(count) = code.counts.get_mut(1) {
            *count = chosen.len();
        }
        return Ok(code);
    }
    let mut of_lengths = [0; 19];
    let count = 4 + bits.read(4)?;
    for &place in LENGTH_ORDER.iter().take(count) {
        if let Some(length) = of_lengths.get_mut(place) {
            *length = bits.read(3)? as u8;
        }
    }
    let of_lengths = Code::new(&of_lengths)?;
    let mut left = if bits.read(1)? == 1 {
        let size = 2 + 2 * bits.read(3)?;
        2 + bits.read(size)?
    } else {
        symbols
    };
    let (mut symbol, mut previous) = (0, 8);
    while symbol < symbols && left > 0 {
        left -= 1;
        let (length, repeat) = match of_lengths.read(bits)? {
            16 => (previous, 3 + bits.read(2)?),
            17 => (0, 3 + bits.read(3)?),
            18 => (0, 11 + bits.read(7)?),
            length => (length as u8, 1),
        };
        if length != 0 {
            previous = length;
        }
        let places = lengths.get_mut(symbol..symbol + repeat);
        places.ok_or_else(|| malformed("there are too many code lengths"))?.fill(length);
        symbol += repeat;
    }
    Code::new(&lengths)
}

/// Reads an image of one group of codes: a part of the stream that says how the rest is stored.
fn read_image(bits: &mut Bits<'_>, width: usize, height: usize) -> Result<Vec<u32>, DecodeError> {
    let cache_bits = read_cache_bits(bits)?;
    let mut cache = vec![0_u32; if cache_bits == 0 { 0 } else { 1 << cache_bits }];
    let slot =
        |pixel: u32| (0x1E35_A7BD_u32.wrapping_mul(pixel) >> (32 - cache_bits.max(1))) as usize;
    let [green, red, blue, alpha, distance] = read_group(bits, cache_bits)?;
    let mut pixels: Vec<u32> = Vec::with_capacity(width * height);
    for symbol_count in 0_usize.. {
        if pixels.len() >= width * height {
            break;
        }
        if symbol_count.is_multiple_of(POLL_SYMBOLS) {
            (bits.wanted)()?;
        }
        let symbol = green.read(bits)?;
        let start = pixels.len();
        if symbol < 256 {
            let [r, b, a] = [red.read(bits)?, blue.read(bits)?, alpha.read(bits)?];
            pixels.push((a << 24 | r << 16 | symbol << 8 | b) as u32);
        } else if symbol < GREEN_SYMBOLS {
            let length = read_extra(bits, symbol - 256)?;
            let code = distance.read(bits)?;
            let back = distance_of(read_extra(bits, code)?, width);
            for _ in 0..length.min(width * height - start) {
                let from = pixels.len().checked_sub(back);
                let pixel = from.and_then(|from| pixels.get(from).copied());
                pixels.push(pixel.ok_or_else(|| malformed("a copy begins before the picture"))?);
            }
        } else {
            let pixel = cache.get(symbol - GREEN_SYMBOLS).copied();
            pixels.push(pixel.ok_or_else(|| malformed("a colour is not in the cache"))?);
        }
        for &pixel in pixels.get(start..).unwrap_or_default() {
            if let Some(place) = cache.get_mut(slot(pixel)) {
                *place = pixel;
            }
        }
    }
    Ok(pixels)
}

/// The length or distance that a symbol and some bits after it stand for.
fn read_extra(bits: &mut Bits<'_>, symbol: usize) -> Result<usize, DecodeError> {
    if symbol < 4 {
        return Ok(symbol + 1);
    }
    let extra = (symbol - 2) >> 1;
    let offset = (2 + (symbol & 1)) << extra;
    Ok(offset + bits.read(extra)? + 1)
}

/// How many pixels back a distance is: the first 120 are places nearby, by rows and columns.
fn distance_of(distance: usize, width: usize) -> usize {
    match NEARBY.get(distance.wrapping_sub(1)) {
        Some(&(x, y)) => {
            let back = i64::from(x) + i64::from(y) * width as i64;
            usize::try_from(back).unwrap_or(1).max(1)
        }
        None => distance.saturating_sub(NEARBY.len()).max(1),
    }
}

/// Columns to the left and rows above of the distances 1 to 120.
const NEARBY: [(i8, i8); 120] = [
    (0, 1),
    (1, 0),
    (1, 1),
    (-1, 1),
    (0, 2),
    (2, 0),
    (1, 2),
    (-1, 2),
    (2, 1),
    (-2, 1),
    (2, 2),
    (-2, 2),
    (0, 3),
    (3, 0),
    (1, 3),
    (-1, 3),
    (3, 1),
    (-3, 1),
    (2, 3),
    (-2, 3),
    (3, 2),
    (-3, 2),
    (0, 4),
    (4, 0),
    (1, 4),
    (-1, 4),
    (4, 1),
    (-4, 1),
    (3, 3),
    (-3, 3),
    (2, 4),
    (-2, 4),
    (4, 2),
    (-4, 2),
    (0, 5),
    (3, 4),
    (-3, 4),
    (4, 3),
    (-4, 3),
    (5, 0),
    (1, 5),
    (-1, 5),
    (5, 1),
    (-5, 1),
    (2, 5),
    (-2, 5),
    (5, 2),
    (-5, 2),
    (4, 4),
    (-4, 4),
    (3, 5),
    (-3, 5),
    (5, 3),
    (-5, 3),
    (0, 6),
    (6, 0),
    (1, 6),
    (-1, 6),
    (6, 1),
    (-6, 1),
    (2, 6),
    (-2, 6),
    (6, 2),
    (-6, 2),
    (4, 5),
    (-4, 5),
    (5, 4),
    (-5, 4),
    (3, 6),
    (-3, 6),
    (6, 3),
    (-6, 3),
    (0, 7),
    (7, 0),
    (1, 7),
    (-1, 7),
    (5, 5),
    (-5, 5),
    (7, 1),
    (-7, 1),
    (4, 6),
    (-4, 6),
    (6, 4),
    (-6, 4),
    (2, 7),
    (-2, 7),
    (7, 2),
    (-7, 2),
    (3, 7),
    (-3, 7),
    (7, 3),
    (-7, 3),
    (5, 6),
    (-5, 6),
    (6, 5),
    (-6, 5),
    (8, 0),
    (4, 7),
    (-4, 7),
    (7, 4),
    (-7, 4),
    (8, 1),
    (8, 2),
    (6, 6),
    (-6, 6),
    (8, 3),
    (5, 7),
    (-5, 7),
    (7, 5),
    (-7, 5),
    (8, 4),
    (6, 7),
    (-6, 7),
    (7, 6),
    (-7, 6),
    (8, 5),
    (7, 7),
    (-7, 7),
    (8, 6),
    (8, 7),
];
