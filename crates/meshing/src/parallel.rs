//! Work shared by threads.
//!
//! Only the calling thread polls the caller's [`Control`]; when that cancels, all threads stop.

use crate::control::{Cancelled, Control, PATIENCE, Stage, Translated};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::thread::{self, Builder};

const LEAST_SHARE: usize = 512;
const LEAST_ROWS: usize = 128;

/// The control of a helper thread: it cancels once the calling thread's work is cancelled.
struct CancelledElsewhere<'a>(&'a AtomicBool);

impl Control for CancelledElsewhere<'_> {
    fn poll(&self, _: Stage, _: usize, _: usize) -> Result<(), Cancelled> {
        if self.0.load(Ordering::Relaxed) { Err(Cancelled) } else { Ok(()) }
    }
}

/// Calls `work` once for each share, on at most `control.threads()` threads, the calling thread
/// among them. Work on the calling thread polls `control`, as does waiting for the others. Work on
/// a helper thread polls whether the calling thread was cancelled. No share begins after a
/// cancellation.
///
/// The result of a share must not depend on its thread. The system may start fewer threads.
pub(crate) fn share_out<S: Send>(
    shares: impl ExactSizeIterator<Item = S> + Send,
    control: &dyn Control,
    work: impl Fn(S, &dyn Control) -> Result<(), Cancelled> + Sync,
) -> Result<(), Cancelled> {
    share_out_on(Builder::new, shares, control, work)
}

/// [`share_out`] on threads made by `new_thread`.
fn share_out_on<S: Send>(
    new_thread: impl Fn() -> Builder,
    shares: impl ExactSizeIterator<Item = S> + Send,
    control: &dyn Control,
    work: impl Fn(S, &dyn Control) -> Result<(), Cancelled> + Sync,
) -> Result<(), Cancelled> {
    let helper_count = shares.len().min(control.threads().get()).saturating_sub(1);
    let shares = Mutex::new(shares);
    let is_cancelled = AtomicBool::new(false);
    let work_on_shares = |control: &dyn Control| {
        let next = || shares.lock().unwrap_or_else(PoisonError::into_inner).next();
        while !is_cancelled.load(Ordering::Relaxed)
            && let Some(share) = next()
        {
            work(share, control)?;
        }
        Ok(())
    };
    // The calling thread returns a cancellation; helper threads only stop.
    let help = || _ = work_on_shares(&CancelledElsewhere(&is_cancelled));
    // The last report of the calling thread, which it repeats while it waits.
    let last = Mutex::new(None);
    let translate = |stage, done, total| {
        *last.lock().unwrap_or_else(PoisonError::into_inner) = Some((stage, done, total));
        (stage, done, total)
    };
    let (working, finished) = channel::<()>();
    thread::scope(|scope| {
        // If one thread does not start, the next one does not either.
        (0..helper_count).all(|_| {
            let working = working.clone();
            let help = move || (help(), drop(working));
            new_thread().spawn_scoped(scope, help).is_ok()
        });
        drop(working);
        let mut result = work_on_shares(&Translated { control, translate });
        while result.is_ok() && finished.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
            let last = *last.lock().unwrap_or_else(PoisonError::into_inner);
            result = last.map_or(Ok(()), |(stage, done, total)| control.poll(stage, done, total));
        }
        result.inspect_err(|_| is_cancelled.store(true, Ordering::Relaxed))
    })
}

/// Calls `work` on corresponding parts of two slices of one length, with the control that
/// [`share_out`] gives its thread. The result of an element must not depend on its part.
pub(crate) fn in_parallel<A: Sync, B: Send>(
    input: &[A],
    output: &mut [B],
    control: &dyn Control,
    work: impl Fn(&[A], &mut [B], &dyn Control) -> Result<(), Cancelled> + Sync,
) -> Result<(), Cancelled> {
    let share = input.len().div_ceil(control.threads().get()).max(LEAST_SHARE);
    let shares = input.chunks(share).zip(output.chunks_mut(share));
    share_out(shares, control, |(input, output), control| work(input, output, control))
}

/// Calls `work` on bands of whole rows of a field, with the number of the band's first row, the
/// band, and the control that [`share_out`] gives its thread.
pub(crate) fn in_row_bands<T: Send>(
    field: &mut [T],
    width: usize,
    control: &dyn Control,
    work: impl Fn(usize, &mut [T], &dyn Control) -> Result<(), Cancelled> + Sync,
) -> Result<(), Cancelled> {
    let rows = (field.len() / width).div_ceil(control.threads().get()).max(LEAST_ROWS);
    let bands = field.chunks_mut(rows * width).enumerate();
    share_out(bands, control, |(i, band): (usize, &mut [T]), control| work(i * rows, band, control))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::OnThreads;
    use crate::control::tests::Recorder;
    use std::num::NonZeroUsize;
    use std::sync::Barrier;
    use std::sync::atomic::AtomicUsize;

    const THREADS: NonZeroUsize = NonZeroUsize::new(8).unwrap();

    /// A thread with a stack larger than the memory of any system.
    fn never_starting() -> Builder {
        Builder::new().stack_size(1 << 60)
    }

    #[test]
    fn caller_works_alone_if_no_thread_starts() {
        assert!(never_starting().spawn(|| ()).is_err());
        for count in [0, 1, 2, 7] {
            let done = Mutex::new(Vec::new());
            let work = |share: usize, _: &dyn Control| {
                done.lock().unwrap().push(share);
                Ok(())
            };
            let control = OnThreads((), THREADS);
            assert_eq!(share_out_on(never_starting, 0..count, &control, work), Ok(()));
            assert_eq!(done.into_inner().unwrap(), (0..count).collect::<Vec<_>>());
        }
    }

    #[test]
    fn no_share_begins_after_a_cancellation() {
        let control = OnThreads(Recorder::cancelling_at(2), THREADS);
        let poll = |i, control: &dyn Control| control.poll(Stage::Density, i, 5);
        assert_eq!(share_out_on(never_starting, 0..5, &control, poll), Err(Cancelled));
        assert_eq!(control.0.done(Stage::Density, 5), [0, 1, 2]);
    }

    #[test]
    fn caller_polls_while_it_waits() {
        let (caller, both) = (thread::current().id(), Barrier::new(2));
        let control = OnThreads(Recorder::cancelling_at(3), THREADS);
        let work = |_, control: &dyn Control| {
            control.poll(Stage::Density, 1, 2)?;
            both.wait();
            // Only the cancellation ends the helper's share.
            while thread::current().id() != caller {
                control.poll(Stage::Density, 0, 2)?;
                thread::yield_now();
            }
            Ok(())
        };
        assert_eq!(share_out(0..2, &control, work), Err(Cancelled));
        assert_eq!(control.0.done(Stage::Density, 2), [1; 4]);
    }

    #[test]
    fn helper_threads_take_shares() {
        let caller = thread::current().id();
        let is_helped = AtomicBool::new(false);
        let work = |_, _: &dyn Control| {
            if thread::current().id() != caller {
                is_helped.store(true, Ordering::Relaxed);
            }
            while !is_helped.load(Ordering::Relaxed) {
                thread::yield_now();
            }
            Ok(())
        };
        assert_eq!(share_out(0..2, &OnThreads((), THREADS), work), Ok(()));
    }

    #[test]
    fn every_element_is_worked_on_once() {
        let input: Vec<u32> = (0..5000).collect();
        for threads in [1, 2, 3, 16] {
            let mut output = vec![0; input.len()];
            let control = OnThreads((), NonZeroUsize::new(threads).unwrap());
            let double = |from: &[u32], to: &mut [u32], _: &dyn Control| {
                from.iter().zip(to).for_each(|(&from, to)| *to += 2 * from);
                Ok(())
            };
            assert_eq!(in_parallel(&input, &mut output, &control, double), Ok(()));
            assert!(output.iter().zip(&input).all(|(&to, &from)| to == 2 * from));
        }
    }

    #[test]
    fn every_row_is_in_one_band() {
        for (threads, bands) in [(1, 1), (2, 2), (5, 5), (16, 8)] {
            let (mut field, begun) = (vec![0; 3 * 1000], AtomicUsize::new(0));
            let control = OnThreads((), NonZeroUsize::new(threads).unwrap());
            let number = |first: usize, band: &mut [usize], _: &dyn Control| {
                begun.fetch_add(1, Ordering::Relaxed);
                for (y, row) in (first..).zip(band.chunks_exact_mut(3)) {
                    row.iter_mut().for_each(|element| *element += y);
                }
                Ok(())
            };
            assert_eq!(in_row_bands(&mut field, 3, &control, number), Ok(()));
            assert!(field.iter().enumerate().all(|(i, &y)| y == i / 3));
            assert_eq!(begun.into_inner(), bands);
        }
    }

    #[test]
    fn cancellation_stops_all_bands() {
        for threads in [1, 2, 5] {
            let mut field = vec![0; 3 * 1000];
            let threads = NonZeroUsize::new(threads).unwrap();
            let control = OnThreads(Recorder::cancelling_at(10), threads);
            // Ends by cancellation only.
            let wait = |_, _: &mut [usize], control: &dyn Control| {
                for y in 0.. {
                    control.poll(Stage::Density, y, 0)?;
                    thread::yield_now();
                }
                Ok(())
            };
            assert_eq!(in_row_bands(&mut field, 3, &control, wait), Err(Cancelled));
        }
    }
}
