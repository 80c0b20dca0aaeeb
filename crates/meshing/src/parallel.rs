//! Work on slices shared out to threads.

use crate::control::Cancelled;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::{self, Builder};

/// Less than this many elements are not worth a thread.
const LEAST_SHARE: usize = 512;

/// Less than this many rows are not worth one.
const LEAST_ROWS: usize = 128;

/// Calls `own` on this thread and `other` on more of them, each on some of the shares, until every
/// share has had one of the two; once `own` is cancelled none is begun any more. There are as many
/// threads as are allowed and as there are shares for, or as many as the system gives: none but this
/// one, if it must be. Which thread takes a share must not matter.
pub(crate) fn share_out<S: Send>(
    threads: NonZeroUsize,
    shares: impl ExactSizeIterator<Item = S> + Send,
    own: impl FnMut(S) -> Result<(), Cancelled>,
    other: impl Fn(S) + Sync,
) -> Result<(), Cancelled> {
    share_out_on(Builder::new, threads, shares, own, other)
}

/// The same on threads built as is said.
fn share_out_on<S: Send>(
    new_thread: impl Fn() -> Builder,
    threads: NonZeroUsize,
    shares: impl ExactSizeIterator<Item = S> + Send,
    mut own: impl FnMut(S) -> Result<(), Cancelled>,
    other: impl Fn(S) + Sync,
) -> Result<(), Cancelled> {
    let helpers = shares.len().min(threads.get()).saturating_sub(1);
    let shares = Mutex::new(shares);
    let next = || shares.lock().unwrap_or_else(PoisonError::into_inner).next();
    let help = || {
        while let Some(share) = next() {
            other(share);
        }
    };
    thread::scope(|scope| {
        // Where no thread starts, the next one would not either, and its share is left to the rest.
        (0..helpers).all(|_| new_thread().spawn_scoped(scope, help).is_ok());
        while let Some(share) = next() {
            own(share).inspect_err(|_| while next().is_some() {})?;
        }
        Ok(())
    })
}

/// The same with one kind of work that nobody cancels.
pub(crate) fn share_out_all<S: Send>(
    threads: NonZeroUsize,
    shares: impl ExactSizeIterator<Item = S> + Send,
    work: impl Fn(S) + Sync,
) {
    let own = |share| {
        work(share);
        Ok(())
    };
    let _ = share_out(threads, shares, own, &work);
}

/// Calls `work` on corresponding parts of two slices of one length, on as many threads as are
/// allowed and worth it. What `work` makes of an element must not depend on its part.
pub(crate) fn in_parallel<A: Sync, B: Send>(
    input: &[A],
    output: &mut [B],
    threads: NonZeroUsize,
    work: impl Fn(&[A], &mut [B]) + Sync,
) {
    let share = input.len().div_ceil(threads.get()).max(LEAST_SHARE);
    let shares = input.chunks(share).zip(output.chunks_mut(share));
    let work = |(input, output): (&[A], &mut [B])| work(input, output);
    share_out_all(threads, shares, work);
}

/// What a band asks before each of its rows: whether to go on.
pub(crate) type Poll<'a> = &'a dyn Fn(usize) -> Result<(), Cancelled>;

/// Calls `work` on bands of whole rows of a field: with the first row of each, the band, and what to
/// ask before each row. In the bands of the caller's own thread that is `poll`, and in the others
/// whether it has cancelled the work.
pub(crate) fn in_row_bands<T: Send>(
    field: &mut [T],
    width: usize,
    threads: NonZeroUsize,
    poll: impl Fn(usize) -> Result<(), Cancelled>,
    work: impl Fn(usize, &mut [T], Poll<'_>) -> Result<(), Cancelled> + Sync,
) -> Result<(), Cancelled> {
    let rows = (field.len() / width).div_ceil(threads.get()).max(LEAST_ROWS);
    let bands = field.chunks_mut(rows * width).enumerate();
    let is_cancelled = AtomicBool::new(false);
    let hear = |_| if is_cancelled.load(Ordering::Relaxed) { Err(Cancelled) } else { Ok(()) };
    let ask = |y| poll(y).inspect_err(|_| is_cancelled.store(true, Ordering::Relaxed));
    let own = |(i, band): (usize, &mut [T])| work(i * rows, band, &ask);
    // Only a cancelled work ends early, and of that the caller's own thread tells.
    let other = |(i, band): (usize, &mut [T])| _ = work(i * rows, band, &hear);
    share_out(threads, bands, own, other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicUsize;

    const THREADS: NonZeroUsize = NonZeroUsize::new(8).unwrap();

    /// A thread that no system has the memory to start.
    fn that_never_starts() -> Builder {
        Builder::new().stack_size(1 << 60)
    }

    #[test]
    fn where_no_thread_starts_the_caller_does_the_work_of_all() {
        assert!(that_never_starts().spawn(|| ()).is_err());
        for shares in [0, 1, 2, 7] {
            let mut done = Vec::new();
            let own = |share: usize| {
                done.push(share);
                Ok(())
            };
            let other = |_| unreachable!();
            assert_eq!(share_out_on(that_never_starts, THREADS, 0..shares, own, other), Ok(()));
            assert_eq!(done, (0..shares).collect::<Vec<_>>());
        }
    }

    #[test]
    fn no_share_is_begun_after_a_cancellation() {
        let mut begun = 0;
        let own = |_| {
            begun += 1;
            Err(Cancelled)
        };
        let result = share_out_on(that_never_starts, THREADS, 0..5, own, |_: usize| unreachable!());
        assert_eq!((result, begun), (Err(Cancelled), 1));
    }

    #[test]
    fn where_threads_start_they_take_shares_that_the_caller_is_too_busy_for() {
        let taken = AtomicBool::new(false);
        let wait = |_| {
            while !taken.load(Ordering::Relaxed) {
                thread::yield_now();
            }
            Ok(())
        };
        let take = |_: usize| taken.store(true, Ordering::Relaxed);
        assert_eq!(share_out(THREADS, 0..2, wait, take), Ok(()));
    }

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
    fn there_is_a_band_for_each_thread_and_each_knows_its_first_row() {
        let caller = thread::current().id();
        for (threads, bands) in [(2, 2), (5, 5), (16, 8)] {
            let mut field: Vec<usize> = (0..3 * 1000).map(|i| i / 3).collect();
            let (is_shared, begun) = (AtomicBool::new(false), AtomicUsize::new(0));
            let work = |first: usize, band: &mut [usize], poll: Poll<'_>| {
                assert_eq!(band[0], first);
                begun.fetch_add(1, Ordering::Relaxed);
                if thread::current().id() != caller {
                    is_shared.store(true, Ordering::Relaxed);
                }
                poll(first)
            };
            // The caller lets others take bands.
            let wait = |_| {
                while !is_shared.load(Ordering::Relaxed) {
                    thread::yield_now();
                }
                Ok(())
            };
            let threads = NonZeroUsize::new(threads).unwrap();
            assert_eq!(in_row_bands(&mut field, 3, threads, wait, work), Ok(()));
            assert_eq!(begun.into_inner(), bands);
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
