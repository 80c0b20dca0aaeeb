//! Threads that are started when there is work for them and none is without, and that end when there
//! has been none for a while.
//!
//! Unlike a runtime's pool for blocking calls, this one tells when the system has no thread to give,
//! and then gives the work back, with its memory and its ticket.

use std::collections::VecDeque;
use std::io;
use std::sync::mpsc::sync_channel;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::Builder;
use std::time::Duration;

/// How long a thread waits for more work. At its end its memory goes back to the system.
const KEPT_FOR: Duration = Duration::from_secs(10);

/// What a thread does.
pub(super) type Work = Box<dyn FnOnce() + Send>;

/// Work that the system had no thread for.
pub(super) struct NoThread {
    pub(super) error: io::Error,
    pub(super) work: Work,
}

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
    /// The work itself, when the system starts no thread.
    pub(super) fn run(&'static self, work: Work) -> Result<(), NoThread> {
        let mut state = self.state();
        if state.idle > state.given.len() {
            state.given.push_back(work);
            self.arrival.notify_one();
            return Ok(());
        }
        drop(state);
        // Only a thread that has started gets the work.
        let (give, take) = sync_channel::<Work>(1);
        let serve = move || {
            (self.on_start)();
            if let Ok(work) = take.recv() {
                work();
            }
            while let Some(work) = self.next() {
                work();
            }
        };
        match (self.new_thread)().spawn(serve) {
            Ok(_) => {
                // It takes what it is given, whatever comes of it.
                let _ = give.send(work);
                Ok(())
            }
            Err(error) => Err(NoThread { error, work }),
        }
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
    use std::sync::mpsc::{RecvError, TryRecvError, channel};
    use std::thread;

    #[test]
    fn a_thread_that_has_done_its_work_takes_the_next() {
        static THREADS: Threads = Threads::new(Builder::new, || {});
        let (said, hear) = channel();
        let mut last = None;
        for _ in 0..5 {
            let said = said.clone();
            assert!(
                THREADS.run(Box::new(move || said.send(thread::current().id()).unwrap())).is_ok()
            );
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
                assert!(THREADS.run(Box::new(work)).is_ok());
                release
            })
            .collect();
        let mut begun: Vec<i32> = (0..8).map(|_| hear.recv().unwrap()).collect();
        begun.sort_unstable();
        assert_eq!(begun, (0..8).collect::<Vec<_>>());
        drop(releases);
    }

    #[test]
    fn where_no_thread_starts_that_is_said_and_the_work_is_given_back() {
        // No system has the memory for such a stack.
        static THREADS: Threads = Threads::new(|| Builder::new().stack_size(1 << 60), || {});
        let (said, hear) = channel();
        let NoThread { work, .. } =
            THREADS.run(Box::new(move || said.send(7).unwrap())).err().unwrap();
        assert_eq!(hear.try_recv(), Err(TryRecvError::Empty));
        work();
        assert_eq!(hear.recv(), Ok(7));
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
            assert!(THREADS.run(Box::new(work)).is_ok());
            assert_eq!(hear.recv(), Err(RecvError));
        }
        let (said, hear) = channel();
        assert!(THREADS.run(Box::new(move || said.send(()).unwrap())).is_ok());
        assert_eq!(hear.recv(), Ok(()));
    }
}
