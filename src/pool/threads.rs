//! Threads that are started when there is work for them and none is without, and that end when there
//! has been none for a while.
//!
//! Unlike a runtime's pool for blocking calls, this one tells when the system has no thread to give,
//! and then keeps nothing of the work: neither its memory nor its ticket.

use std::collections::VecDeque;
use std::io;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::Builder;
use std::time::Duration;

/// How long a thread waits for more work. At its end its memory goes back to the system.
const KEPT_FOR: Duration = Duration::from_secs(10);

/// What a thread does.
type Work = Box<dyn FnOnce() + Send>;

/// A pool of threads.
pub(super) struct Threads {
    new_thread: fn() -> Builder,
    /// What each thread does first.
    on_start: fn(),
    state: Mutex<State>,
    arrival: Condvar,
}

struct State {
    /// Threads that wait for work.
    idle: usize,
    /// Work that they have not begun yet: never more than there are of them.
    given: VecDeque<Work>,
}

impl Threads {
    /// A pool that has none yet.
    pub(super) const fn new(new_thread: fn() -> Builder, on_start: fn()) -> Self {
        let state = Mutex::new(State { idle: 0, given: VecDeque::new() });
        Self { new_thread, on_start, state, arrival: Condvar::new() }
    }

    /// Gives work to a thread that has none, or to a new one. Work that panics ends its thread and
    /// nothing else.
    ///
    /// # Errors
    /// The system's, when it starts no thread; the work is dropped by then.
    pub(super) fn run(&'static self, work: Work) -> io::Result<()> {
        let mut state = self.state();
        if state.idle > state.given.len() {
            state.given.push_back(work);
            self.arrival.notify_one();
            return Ok(());
        }
        drop(state);
        let serve = move || {
            (self.on_start)();
            work();
            while let Some(work) = self.next() {
                work();
            }
        };
        (self.new_thread)().spawn(serve).map(drop)
    }

    /// The next work, or `None` when there is none for so long.
    fn next(&self) -> Option<Work> {
        let mut state = self.state();
        state.idle += 1;
        let nothing = |state: &mut State| state.given.is_empty();
        let waited = self.arrival.wait_timeout_while(state, KEPT_FOR, nothing);
        (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        state.idle -= 1;
        state.given.pop_front()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::{RecvError, channel};
    use std::thread;

    #[test]
    fn a_thread_that_has_done_its_work_takes_the_next() {
        static THREADS: Threads = Threads::new(Builder::new, || {});
        let (said, hear) = channel();
        let mut last = None;
        for _ in 0..5 {
            let said = said.clone();
            THREADS.run(Box::new(move || said.send(thread::current().id()).unwrap())).unwrap();
            let worked = hear.recv().unwrap();
            assert!(last.is_none_or(|last| last == worked));
            last = Some(worked);
            while THREADS.state().idle == 0 {
                thread::yield_now();
            }
        }
    }

    #[test]
    fn work_never_waits_for_other_work() {
        static THREADS: Threads = Threads::new(Builder::new, || {});
        let (said, hear) = channel();
        let releases: Vec<_> = (0..8)
            .map(|n| {
                let (release, released) = channel::<()>();
                let said = said.clone();
                let work = move || {
                    said.send(n).unwrap();
                    let _ = released.recv();
                };
                THREADS.run(Box::new(work)).unwrap();
                release
            })
            .collect();
        let mut begun: Vec<i32> = (0..8).map(|_| hear.recv().unwrap()).collect();
        begun.sort_unstable();
        assert_eq!(begun, (0..8).collect::<Vec<_>>());
        drop(releases);
    }

    #[test]
    fn where_no_thread_starts_that_is_said_and_the_work_is_dropped() {
        // No system has the memory for such a stack.
        static THREADS: Threads = Threads::new(|| Builder::new().stack_size(1 << 60), || {});
        let (said, hear) = channel::<()>();
        assert!(THREADS.run(Box::new(move || drop(said))).is_err());
        assert_eq!(hear.recv(), Err(RecvError));
    }

    #[test]
    fn work_that_panics_takes_nothing_with_it() {
        static THREADS: Threads = Threads::new(Builder::new, || {});
        for _ in 0..3 {
            let (said, hear) = channel::<()>();
            let work = move || {
                let _said = said;
                panic!("on purpose");
            };
            THREADS.run(Box::new(work)).unwrap();
            assert_eq!(hear.recv(), Err(RecvError));
        }
        let (said, hear) = channel();
        THREADS.run(Box::new(move || said.send(()).unwrap())).unwrap();
        assert_eq!(hear.recv(), Ok(()));
    }
}
