//! Work on slices shared out to threads.

use crate::control::Cancelled;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

/// Less than this many elements are not worth a thread.
const LEAST_SHARE: usize = 512;

/// Less than this many rows are not worth one.
const LEAST_ROWS: usize = 128;

/// Calls `work` on corresponding parts of two slices of one length, on as many threads as are
/// allowed and worth it. What `work` makes of an element must not depend on its part.
pub(crate) fn in_parallel<A: Sync, B: Send>(
    input: &[A],
    output: &mut [B],
    threads: NonZeroUsize,
    work: impl Fn(&[A], &mut [B]) + Sync,
) {
    let share = input.len().div_ceil(threads.get()).max(LEAST_SHARE);
    let mut shares = input.chunks(share).zip(output.chunks_mut(share));
    let own = shares.next();
    thread::scope(|scope| {
        for (input, output) in shares {
            scope.spawn(|| work(input, output));
        }
        if let Some((input, output)) = own {
            work(input, output);
        }
    });
}

/// What a band asks before each of its rows: whether to go on.
pub(crate) type Poll<'a> = &'a dyn Fn(usize) -> Result<(), Cancelled>;

/// Calls `work` on bands of whole rows of a field: with the first row of each, the band, and what to
/// ask before each row. In the caller's own band, the first, that is `poll`, and in the others
/// whether it has cancelled the work.
pub(crate) fn in_row_bands<T: Send>(
    field: &mut [T],
    width: usize,
    threads: NonZeroUsize,
    poll: impl Fn(usize) -> Result<(), Cancelled>,
    work: impl Fn(usize, &mut [T], Poll<'_>) -> Result<(), Cancelled> + Sync,
) -> Result<(), Cancelled> {
    let rows = (field.len() / width).div_ceil(threads.get()).max(LEAST_ROWS);
    let mut bands = field.chunks_mut(rows * width).enumerate();
    let own = bands.next();
    let is_cancelled = AtomicBool::new(false);
    let hear = &|_| if is_cancelled.load(Ordering::Relaxed) { Err(Cancelled) } else { Ok(()) };
    let ask = |y| poll(y).inspect_err(|_| is_cancelled.store(true, Ordering::Relaxed));
    thread::scope(|scope| {
        for (i, band) in bands {
            let work = &work;
            scope.spawn(move || work(i * rows, band, hear));
        }
        own.map_or(Ok(()), |(_, band)| work(0, band, &ask))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_element_is_worked_on_once_whatever_the_number_of_threads() {
        let input: Vec<u32> = (0..5000).collect();
        for threads in [1, 2, 3, 16] {
            let mut output = vec![0; input.len()];
            in_parallel(&input, &mut output, NonZeroUsize::new(threads).unwrap(), |from, to| {
                for (&from, to) in from.iter().zip(to) {
                    *to += 2 * from;
                }
            });
            assert!(output.iter().zip(&input).all(|(&to, &from)| to == 2 * from));
        }
    }

    #[test]
    fn every_row_is_in_one_band() {
        for threads in [1, 2, 5] {
            let mut field = vec![0; 3 * 1000];
            let threads = NonZeroUsize::new(threads).unwrap();
            let number = |first: usize, band: &mut [usize], poll: Poll<'_>| {
                for (y, row) in (first..).zip(band.chunks_exact_mut(3)) {
                    poll(y)?;
                    row.iter_mut().for_each(|place| *place += y);
                }
                Ok(())
            };
            assert_eq!(in_row_bands(&mut field, 3, threads, |_| Ok(()), number), Ok(()));
            assert!(field.iter().enumerate().all(|(i, &y)| y == i / 3));
        }
    }

    #[test]
    fn all_bands_end_when_the_caller_s_own_is_cancelled() {
        for threads in [1, 2, 5] {
            let mut field = vec![0; 3 * 1000];
            let threads = NonZeroUsize::new(threads).unwrap();
            let cancel = |y| if y < 10 { Ok(()) } else { Err(Cancelled) };
            // The others would never end by themselves.
            let wait = |_, _: &mut [usize], poll: Poll<'_>| {
                for y in 0.. {
                    poll(y)?;
                    thread::yield_now();
                }
                Ok(())
            };
            assert_eq!(in_row_bands(&mut field, 3, threads, cancel, wait), Err(Cancelled));
        }
    }
}
