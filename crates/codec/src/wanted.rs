//! Cancellation of decoders, encoders and readers.
//!
//! Decoders from other crates know nothing of cancellation. [`WantedBytes`] returns an error from the
//! next read once the work is no longer wanted, and [`guarded`](crate::guard::guarded) turns whatever
//! the decoder makes of that error into [`DecodeError::Cancelled`](crate::DecodeError::Cancelled).

use pixmesh_meshing::{Cancelled, Control, Stage};
use std::io::{self, BufRead, Cursor, Read, Seek, SeekFrom};

/// Returns `Err(Cancelled)` once the result is no longer wanted.
///
/// It is called every few thousand bytes and for every row, and must return at once.
pub type Wanted<'a> = dyn Fn() -> Result<(), Cancelled> + Sync + 'a;

/// Control of the meshing kernels that polls a [`Wanted`].
pub(crate) struct While<'a>(pub(crate) &'a Wanted<'a>);

impl Control for While<'_> {
    fn poll(&self, _: Stage, _: usize, _: usize) -> Result<(), Cancelled> {
        (self.0)()
    }
}

/// The result is always wanted.
pub(crate) fn always() -> Result<(), Cancelled> {
    Ok(())
}

/// Bytes between two polls, and the most that one read returns. No decoder makes more than about ten
/// million samples of 4096 bytes, which takes it a few hundredths of a second.
const PIECE_BYTES: usize = 4096;

/// A reader of a file in memory that fails once the picture is no longer wanted.
pub(crate) struct WantedBytes<'a> {
    file: Cursor<&'a [u8]>,
    /// Bytes, and calls of `fill_buf` and `seek`, left before the next poll.
    left: usize,
    wanted: &'a Wanted<'a>,
}

impl<'a> WantedBytes<'a> {
    pub(crate) fn new(bytes: &'a [u8], wanted: &'a Wanted<'a>) -> Self {
        Self { file: Cursor::new(bytes), left: 0, wanted }
    }

    /// Counts `bytes` read and polls when [`PIECE_BYTES`] have been.
    #[inline]
    fn spend(&mut self, bytes: usize) -> io::Result<()> {
        match self.left.checked_sub(bytes) {
            Some(left) => self.left = left,
            None => self.poll()?,
        }
        Ok(())
    }

    #[cold]
    fn poll(&mut self) -> io::Result<()> {
        (self.wanted)().map_err(io::Error::other)?;
        self.left = PIECE_BYTES;
        Ok(())
    }
}

impl Read for WantedBytes<'_> {
    #[inline]
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let most = buffer.len().min(PIECE_BYTES);
        self.spend(most)?;
        self.file.read(&mut buffer[..most])
    }
}

impl BufRead for WantedBytes<'_> {
    #[inline]
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        // Some decoders look at the same bytes many times without consuming them.
        self.spend(1)?;
        let rest = self.file.fill_buf()?;
        Ok(rest.get(..PIECE_BYTES).unwrap_or(rest))
    }

    #[inline]
    fn consume(&mut self, amount: usize) {
        self.file.consume(amount);
        // The next `fill_buf` or `read` polls.
        self.left = self.left.saturating_sub(amount);
    }
}

impl Seek for WantedBytes<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.spend(1)?;
        self.file.seek(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[derive(Clone, Debug)]
    enum Step {
        Read(usize),
        ReadExact(usize),
        Line,
        Seek(SeekFrom),
    }

    fn steps() -> impl Strategy<Value = Step> {
        let length = 0..9000_usize;
        prop_oneof![
            length.clone().prop_map(Step::Read),
            length.prop_map(Step::ReadExact),
            Just(Step::Line),
            (0..11_000_u64).prop_map(|at| Step::Seek(SeekFrom::Start(at))),
            (-11_000..100_i64).prop_map(|by| Step::Seek(SeekFrom::End(by))),
            (-9000..9000_i64).prop_map(|by| Step::Seek(SeekFrom::Current(by))),
        ]
    }

    proptest! {
        #[test]
        fn bytes_are_read_as_from_a_cursor(steps in prop::collection::vec(steps(), 1..20)) {
            let bytes: Vec<u8> = (0..10_000_u32).map(|i| ((i * 40_503) >> 7) as u8).collect();
            let mut cursor = Cursor::new(&bytes);
            let mut wanted = WantedBytes::new(&bytes, &always);
            for step in steps {
                match step {
                    Step::Read(count) => {
                        let (mut some, mut most) = (vec![0; count], vec![0; count]);
                        let read = wanted.read(&mut some).unwrap();
                        cursor.read_exact(&mut most[..read]).unwrap();
                        prop_assert!(read > 0 || cursor.fill_buf().unwrap().is_empty() || count == 0);
                        prop_assert_eq!(some, most);
                    }
                    Step::ReadExact(count) => {
                        let (mut one, mut other) = (vec![0; count], vec![0; count]);
                        let read = cursor.read_exact(&mut other).is_ok();
                        prop_assert_eq!(wanted.read_exact(&mut one).is_ok(), read);
                        if read {
                            prop_assert_eq!(one, other);
                        } else {
                            // Where a failure leaves its reader is not said.
                            cursor.set_position(wanted.stream_position().unwrap());
                        }
                    }
                    Step::Line => {
                        let (mut one, mut other) = (Vec::new(), Vec::new());
                        wanted.read_until(7, &mut one).unwrap();
                        cursor.read_until(7, &mut other).unwrap();
                        prop_assert_eq!(one, other);
                    }
                    Step::Seek(to) => {
                        prop_assert_eq!(wanted.seek(to).ok(), cursor.seek(to).ok());
                    }
                }
                prop_assert_eq!(wanted.stream_position().unwrap(), cursor.position());
            }
        }
    }

    #[test]
    fn reading_fails_within_one_piece_of_the_cancellation() {
        let bytes = vec![0; 100 * PIECE_BYTES];
        let read = AtomicUsize::new(0);
        let position = || read.load(Ordering::Relaxed);
        let wanted = || if position() > 10 * PIECE_BYTES { Err(Cancelled) } else { Ok(()) };
        let mut file = WantedBytes::new(&bytes, &wanted);
        while file.read(&mut [0; 3]).is_ok_and(|count| count > 0) {
            read.fetch_add(3, Ordering::Relaxed);
        }
        assert!((10 * PIECE_BYTES..=11 * PIECE_BYTES + 3).contains(&position()), "{}", position());
    }
}
