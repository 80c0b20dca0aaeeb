//! The text of a portable anymap: numbers and words, white space, comments.

use crate::error::DecodeError;
use crate::format::PictureFormat;

/// Reads the textual part of a file from its start.
///
/// White space is blank, tab, carriage return and line feed. A comment runs from `#` to the end of
/// its line and counts as the line feed that ends it.
#[derive(Clone)]
pub(super) struct Scanner<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl<'a> Scanner<'a> {
    /// Starts at an offset.
    pub(super) fn new(bytes: &'a [u8], position: usize) -> Self {
        Self { bytes, position }
    }

    /// The bytes not read yet.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.position..).unwrap_or_default()
    }

    /// Reads the next number; what does not fit 64 bits becomes the largest that does.
    ///
    /// # Errors
    /// When the file ends or something else comes.
    pub(super) fn number(&mut self, what: &str) -> Result<u64, DecodeError> {
        self.skip_space();
        let (start, mut value) = (self.position, 0_u64);
        while let Some(digit) = self.peek().filter(u8::is_ascii_digit) {
            value = value.saturating_mul(10).saturating_add(u64::from(digit - b'0'));
            self.position += 1;
        }
        if self.position == start { Err(self.unexpected(what)) } else { Ok(value) }
    }

    /// Reads the next bit of a plain bitmap, where no white space need stand between two.
    ///
    /// # Errors
    /// When the file ends or something other than `0` and `1` comes.
    pub(super) fn bit(&mut self) -> Result<u64, DecodeError> {
        self.skip_space();
        match self.peek() {
            Some(bit @ (b'0' | b'1')) => {
                self.position += 1;
                Ok(u64::from(bit - b'0'))
            }
            _ => Err(self.unexpected("a bit")),
        }
    }

    /// Reads the next word, up to white space or a comment.
    ///
    /// # Errors
    /// When the file ends.
    pub(super) fn word(&mut self, what: &str) -> Result<&'a [u8], DecodeError> {
        self.skip_space();
        let rest = self.rest();
        let end = rest.iter().position(|&byte| is_space(byte) || byte == b'#');
        let word = rest.get(..end.unwrap_or(rest.len())).unwrap_or_default();
        self.position += word.len();
        if word.is_empty() { Err(self.unexpected(what)) } else { Ok(word) }
    }

    /// Skips the one white space, or the comment, that stands between header and raster.
    ///
    /// # Errors
    /// When there is none.
    pub(super) fn end_header(&mut self) -> Result<(), DecodeError> {
        match self.peek() {
            Some(b'#') => self.skip_line(),
            Some(byte) if is_space(byte) => self.position += 1,
            _ => return Err(self.unexpected("white space after the header")),
        }
        Ok(())
    }

    /// Skips the rest of the line, its line feed included.
    pub(super) fn skip_line(&mut self) {
        let rest = self.rest();
        let end = rest.iter().position(|&byte| byte == b'\n' || byte == b'\r');
        self.position += end.map_or(rest.len(), |end| end + 1);
    }

    fn skip_space(&mut self) {
        while let Some(byte) = self.peek() {
            match byte {
                b'#' => self.skip_line(),
                _ if is_space(byte) => self.position += 1,
                _ => break,
            }
        }
    }

    fn peek(&self) -> Option<u8> {
        self.bytes.get(self.position).copied()
    }

    /// The error for anything other than `what` at this position.
    fn unexpected(&self, what: &str) -> DecodeError {
        let at = self.position;
        PictureFormat::Pnm.malformed(match self.peek() {
            Some(byte) => {
                format!("{what} is expected at byte {at}, not '{}'", byte.escape_ascii())
            }
            None => format!("it ends early: {what} is expected at byte {at}"),
        })
    }
}

/// White space in the sense of Netpbm.
fn is_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r' | b'\n')
}
