//! Lines of text with numbers on their way out.

use std::io::{self, Write};

/// Bytes that are collected before they are written.
const BUFFER_BYTES: usize = 1 << 16;

/// Text that is collected in one buffer and written when that is full.
pub(crate) struct Lines<'a, W> {
    out: &'a mut W,
    buffer: Vec<u8>,
}

impl<'a, W: Write> Lines<'a, W> {
    pub(crate) fn new(out: &'a mut W) -> Self {
        Self { out, buffer: Vec::with_capacity(BUFFER_BYTES + 1024) }
    }

    /// Appends a piece of text.
    pub(crate) fn text(&mut self, text: &str) {
        self.buffer.extend_from_slice(text.as_bytes());
    }

    /// Appends a whole number.
    pub(crate) fn integer(&mut self, number: impl itoa::Integer) {
        self.text(itoa::Buffer::new().format(number));
    }

    /// Appends a number in the fewest digits that read back as the same.
    pub(crate) fn decimal(&mut self, number: f64) {
        if number.fract() == 0.0 && number.abs() < 1e15 {
            self.integer(number as i64);
        } else {
            self.text(ryu::Buffer::new().format(number));
        }
    }

    /// Ends a line, or anything after which the buffer may be written.
    pub(crate) fn end(&mut self, text: &str) -> io::Result<()> {
        self.text(text);
        if self.buffer.len() > BUFFER_BYTES { self.flush() } else { Ok(()) }
    }
}

impl<W: Write> Write for Lines<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.buffer.write(bytes)
    }

    /// Writes what is left.
    fn flush(&mut self) -> io::Result<()> {
        self.out.write_all(&self.buffer)?;
        self.buffer.clear();
        Ok(())
    }
}
