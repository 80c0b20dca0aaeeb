//! A MODEL's words and numbers, with the lines on which they stand.
//!
//! Any white space separates two tokens, and a comment runs from `#` to the end of its line. Lines
//! end with a line feed, a carriage return, or both.

use super::defect::{ModelDefect, ModelError};
use crate::wanted::Wanted;

/// Bytes between two polls of `wanted`.
const POLL_BYTES: usize = 1 << 15;

/// Characters of a token that an error quotes.
const QUOTED: usize = 24;

/// A word or number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Token<'a> {
    pub(super) text: &'a [u8],
    /// Its line, counted from 1.
    pub(super) line: usize,
}

/// Splits a file into its tokens.
#[derive(Clone)]
pub(super) struct Tokens<'a> {
    bytes: &'a [u8],
    position: usize,
    line: usize,
    wanted: &'a Wanted<'a>,
    /// The position of the next poll of `wanted`.
    poll_at: usize,
}

impl<'a> Tokens<'a> {
    /// The tokens of a file, for as long as it is wanted.
    pub(super) fn new(bytes: &'a [u8], wanted: &'a Wanted<'a>) -> Self {
        Self { bytes, position: 0, line: 1, wanted, poll_at: 0 }
    }

    /// How many bytes are not read yet.
    pub(super) fn remaining(&self) -> usize {
        self.bytes.len() - self.position
    }

    /// The bytes that are not read yet.
    pub(super) fn rest(&self) -> &'a [u8] {
        &self.bytes[self.position..]
    }

    /// The next token, which must be there.
    ///
    /// # Errors
    /// [`ModelDefect::Malformed`] at the end of the file, in its last line, and
    /// [`ModelDefect::Cancelled`] when the file is no longer wanted.
    pub(super) fn expect(&mut self, field: &'static str) -> Result<Token<'a>, ModelError> {
        if self.position >= self.poll_at {
            self.poll()?;
        }
        self.next().ok_or_else(|| {
            let defect = format!("the file ends where {field} is expected");
            self.error(ModelDefect::Malformed(defect))
        })
    }

    /// An error in the present line.
    pub(super) fn error(&self, defect: ModelDefect) -> ModelError {
        ModelError { line: self.line, defect }
    }

    #[cold]
    fn poll(&mut self) -> Result<(), ModelError> {
        self.poll_at = self.position + POLL_BYTES;
        (self.wanted)().map_err(|cancelled| self.error(cancelled.into()))
    }

    /// The next token, which must be a whole number within bounds.
    ///
    /// # Errors
    /// When it is missing, no whole number, or out of bounds.
    pub(super) fn number(
        &mut self,
        field: &'static str,
        minimum: u64,
        maximum: u64,
    ) -> Result<u64, ModelError> {
        let token = self.expect(field)?;
        match token.integer(field)? {
            Some(value) if (minimum..=maximum).contains(&value) => Ok(value),
            _ => {
                let found = token.quote();
                let bounds = format!("outside of {minimum} to {maximum}");
                Err(token.malformed(&format!("{field} is {found}, {bounds}")))
            }
        }
    }

    /// The words and numbers of the next comment; `None` where anything else comes next.
    ///
    /// # Errors
    /// [`ModelDefect::Cancelled`] when the file is no longer wanted.
    pub(super) fn comment(&mut self) -> Result<Option<Self>, ModelError> {
        if self.position >= self.poll_at {
            self.poll()?;
        }
        if self.skip_blanks() != Some(b'#') {
            return Ok(None);
        }
        let text = self.skip_comment().get(1..).unwrap_or_default();
        Ok(Some(Self { bytes: text, position: 0, poll_at: usize::MAX, ..*self }))
    }

    /// Skips white space and comments, and counts the lines.
    fn skip_space(&mut self) {
        while self.skip_blanks() == Some(b'#') {
            self.skip_comment();
        }
    }

    /// Skips white space, counts the lines, and returns the byte after it.
    fn skip_blanks(&mut self) -> Option<u8> {
        while let Some(&byte) = self.bytes.get(self.position) {
            match byte {
                b'\n' => self.line += 1,
                b'\r' if self.bytes.get(self.position + 1) != Some(&b'\n') => self.line += 1,
                _ if is_space(byte) => {}
                _ => return Some(byte),
            }
            self.position += 1;
        }
        None
    }

    /// Skips the rest of the line, and returns it.
    fn skip_comment(&mut self) -> &'a [u8] {
        let rest = self.bytes.get(self.position..).unwrap_or_default();
        let end = rest.iter().position(|&byte| byte == b'\n' || byte == b'\r');
        let comment = &rest[..end.unwrap_or(rest.len())];
        self.position += comment.len();
        comment
    }
}

impl<'a> Iterator for Tokens<'a> {
    type Item = Token<'a>;

    fn next(&mut self) -> Option<Token<'a>> {
        self.skip_space();
        let rest = self.bytes.get(self.position..).unwrap_or_default();
        let end = rest.iter().position(|&byte| is_space(byte) || byte == b'#');
        let text = rest.get(..end.unwrap_or(rest.len())).unwrap_or_default();
        self.position += text.len();
        (!text.is_empty()).then_some(Token { text, line: self.line })
    }
}

impl Token<'_> {
    /// The error at this token.
    pub(super) fn error(&self, defect: ModelDefect) -> ModelError {
        ModelError { line: self.line, defect }
    }

    /// The error for what breaks the format's rules at this token.
    pub(super) fn malformed(&self, defect: &str) -> ModelError {
        self.error(ModelDefect::Malformed(defect.to_owned()))
    }

    /// The error for a token that stands where `field` is expected.
    pub(super) fn unexpected(&self, field: &str) -> ModelError {
        self.malformed(&format!("{field} is expected, not '{}'", self.quote()))
    }

    /// The token's first characters, printable.
    pub(super) fn quote(&self) -> String {
        let start = self.text.get(..QUOTED).unwrap_or(self.text).escape_ascii().to_string();
        if self.text.len() > QUOTED { start + "..." } else { start }
    }

    /// The token as a whole number; `None` when it is negative or does not fit 64 bits.
    ///
    /// # Errors
    /// When it is no number, or not a whole one.
    pub(super) fn integer(&self, field: &'static str) -> Result<Option<u64>, ModelError> {
        if let Some(value) = small_integer(self.text) {
            return Ok(Some(value));
        }
        let digits = self.text.strip_prefix(b"-").or_else(|| self.text.strip_prefix(b"+"));
        let digits = digits.unwrap_or(self.text);
        if digits.is_empty() || !digits.iter().all(u8::is_ascii_digit) {
            return Err(self.no_integer(field));
        }
        let text = std::str::from_utf8(self.text).unwrap_or_default();
        let is_zero = digits.iter().all(|&digit| digit == b'0');
        Ok(if is_zero { Some(0) } else { text.parse().ok() })
    }

    /// The error for a token that is not a whole number.
    fn no_integer(&self, field: &'static str) -> ModelError {
        let found = self.quote();
        let number = std::str::from_utf8(self.text).ok().and_then(|text| text.parse::<f64>().ok());
        match number {
            Some(number) if number.is_finite() => {
                self.malformed(&format!("{field} must be a whole number, not '{found}'"))
            }
            Some(_) => self.error(ModelDefect::NotFinite { field, found }),
            None => self.unexpected(field),
        }
    }
}

/// The value of one to nine digits: nearly every token, and read fast.
fn small_integer(text: &[u8]) -> Option<u64> {
    if text.is_empty() || text.len() > 9 {
        return None;
    }
    text.iter().try_fold(0, |value, &digit| {
        digit.is_ascii_digit().then(|| value * 10 + u64::from(digit - b'0'))
    })
}

/// White space in the sense of C's `isspace`.
fn is_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_counted_whatever_ends_them() {
        let tokens = Tokens::new(b"a\nb\r\nc\rd # x\re # y\n\n\x0bf#z\r\n g", &|| Ok(()));
        let found: Vec<(char, usize)> =
            tokens.map(|token| (char::from(token.text[0]), token.line)).collect();
        assert_eq!(found, [('a', 1), ('b', 2), ('c', 3), ('d', 4), ('e', 5), ('f', 7), ('g', 8)]);
    }

    #[test]
    fn integers_are_told_from_other_numbers_and_from_words() {
        let integer = |text: &'static [u8]| Token { text, line: 1 }.integer("n");
        assert_eq!(integer(b"0"), Ok(Some(0)));
        assert_eq!(integer(b"-0"), Ok(Some(0)));
        assert_eq!(integer(b"+00000000017"), Ok(Some(17)));
        assert_eq!(integer(b"18446744073709551615"), Ok(Some(u64::MAX)));
        assert_eq!(integer(b"18446744073709551616"), Ok(None));
        assert_eq!(integer(b"-1"), Ok(None));
        let defect = |text| integer(text).unwrap_err().defect;
        for text in [&b"1.0"[..], b"1e3", b".5", b"-2.5"] {
            assert!(defect(text).to_string().contains("n must be a whole number, not"));
        }
        for text in [&b"nan"[..], b"inf", b"-infinity", b"1e999"] {
            assert!(matches!(defect(text), ModelDefect::NotFinite { .. }));
        }
        for text in [&b"x"[..], b"-", b"+-1", b"0x10", b"1,2", b"\xFF"] {
            assert!(defect(text).to_string().contains("n is expected, not"));
        }
    }

    #[test]
    fn long_tokens_are_quoted_in_part_and_printable() {
        let token = Token { text: &[b'\x07'; 1000], line: 1 };
        assert_eq!(token.quote().len(), 24 * "\\x07".len() + 3);
    }
}
