//! Work on slices shared out to threads.

use crate::control::Cancelled;
use std::num::NonZeroUsize;
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

/// Calls `work` on bands of whole rows of a field: with the first row of each, the band, and whether
/// it is the caller's own, the only one that may poll a control and be cancelled.
pub(crate) fn in_row_bands<T: Send>(
    field: &mut [T],
    width: usize,
    threads: NonZeroUsize,
    work: impl Fn(usize, &mut [T], bool) -> Result<(), Cancelled> + Sync,
) -> Result<(), Cancelled> {
    let rows = (field.len() / width).div_ceil(threads.get()).max(LEAST_ROWS);
    let mut bands = field.chunks_mut(rows * width).enumerate();
    let own = bands.next();
    thread::scope(|scope| {
        for (i, band) in bands {
            let work = &work;
            scope.spawn(move || work(i * rows, band, false));
        }
        own.map_or(Ok(()), |(_, band)| work(0, band, true))
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
    fn every_row_is_in_one_band_and_the_caller_s_own_tells_of_the_end() {
        for threads in [1, 2, 5] {
            let threads = NonZeroUsize::new(threads).unwrap();
            let mut field = vec![0; 3 * 1000];
            let number = |first: usize, band: &mut [usize], is_own| {
                for (y, row) in (first..).zip(band.chunks_exact_mut(3)) {
                    row.iter_mut().for_each(|place| *place += y);
                }
                if is_own { Err(Cancelled) } else { Ok(()) }
            };
            assert_eq!(in_row_bands(&mut field, 3, threads, number), Err(Cancelled));
            assert!(field.iter().enumerate().all(|(i, &y)| y == i / 3));
        }
    }
}
