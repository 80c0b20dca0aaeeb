//! Whether a piece of work is still wanted, asked while a file is read.
//!
//! Decoders of others know nothing of cancellation, and some take a reader's failure for the end of
//! the file and fill up what is missing. Hence [`WantedBytes`] does not fail: where the work is no
//! longer wanted, it unwinds through the decoder up to [`guarded`](crate::guard::guarded), as salsa
//! does with its queries. No hook for panics hears of that.

use pixmesh_meshing::{Cancelled, Control, Stage};
use std::io::{self, BufRead, Read, Seek, SeekFrom};
use std::panic::resume_unwind;

/// Says whether a piece of work is still wanted.
///
/// It is asked every few thousand bytes and for every row, and must answer at once.
pub type Wanted<'a> = dyn Fn() -> Result<(), Cancelled> + Sync + 'a;

/// A control of the kernels that asks whether the work is wanted.
pub(crate) struct While<'a>(pub(crate) &'a Wanted<'a>);

impl Control for While<'_> {
    fn poll(&self, _: Stage, _: usize, _: usize) -> Result<(), Cancelled> {
        (self.0)()
    }
}

/// Wanted in any case.
pub(crate) fn always() -> Result<(), Cancelled> {
    Ok(())
}

/// Bytes read from one question to the next, and at a time. No decoder makes more than some ten million
/// samples of so many, which takes it a few hundredths of a second.
const PIECE_BYTES: usize = 4096;

/// A file's bytes, for as long as the picture within is wanted.
pub(crate) struct WantedBytes<'a> {
    bytes: &'a [u8],
    position: usize,
    /// Bytes, and looks at them, up to the next question.
    left: usize,
    wanted: &'a Wanted<'a>,
}

impl<'a> WantedBytes<'a> {
    pub(crate) fn new(bytes: &'a [u8], wanted: &'a Wanted<'a>) -> Self {
        Self { bytes, position: 0, left: 0, wanted }
    }

    /// The next bytes, one piece at the most.
    fn piece(&self) -> &'a [u8] {
        let rest = self.bytes.get(self.position..).unwrap_or_default();
        rest.get(..PIECE_BYTES).unwrap_or(rest)
    }

    /// Notes that so many bytes have been read, and asks when it is time to.
    #[inline]
    fn spend(&mut self, bytes: usize) {
        match self.left.checked_sub(bytes) {
            Some(left) => self.left = left,
            None => self.ask(),
        }
    }

    #[cold]
    fn ask(&mut self) {
        if let Err(cancelled) = (self.wanted)() {
            resume_unwind(Box::new(cancelled));
        }
        self.left = PIECE_BYTES;
    }
}

impl Read for WantedBytes<'_> {
    #[inline]
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.piece().read(buffer)?;
        self.position += read;
        self.spend(read);
        Ok(read)
    }
}

impl BufRead for WantedBytes<'_> {
    #[inline]
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        // Some decoders look again and again at bytes that they need not read.
        self.spend(1);
        Ok(self.piece())
    }

    #[inline]
    fn consume(&mut self, amount: usize) {
        self.position += amount;
        self.spend(amount);
    }
}

impl Seek for WantedBytes<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let (base, offset) = match to {
            SeekFrom::Start(position) => (position, 0),
            SeekFrom::End(offset) => (self.bytes.len() as u64, offset),
            SeekFrom::Current(offset) => (self.position as u64, offset),
        };
        let position = base.checked_add_signed(offset).and_then(|to| usize::try_from(to).ok());
        self.position = position.ok_or(io::ErrorKind::InvalidInput)?;
        self.spend(1);
        Ok(self.position as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io::Cursor;
    use std::panic::{AssertUnwindSafe, catch_unwind};
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
    fn reading_unwinds_within_a_piece_of_where_it_is_no_longer_wanted() {
        let bytes = vec![0; 100 * PIECE_BYTES];
        let read = AtomicUsize::new(0);
        let position = || read.load(Ordering::Relaxed);
        let wanted = || if position() > 10 * PIECE_BYTES { Err(Cancelled) } else { Ok(()) };
        let unwound = catch_unwind(AssertUnwindSafe(|| {
            let mut file = WantedBytes::new(&bytes, &wanted);
            while file.read(&mut [0; 3]).unwrap() > 0 {
                read.fetch_add(3, Ordering::Relaxed);
            }
        }));
        assert!(unwound.unwrap_err().is::<Cancelled>());
        assert!((10 * PIECE_BYTES..=11 * PIECE_BYTES + 3).contains(&position()), "{}", position());
    }
}
