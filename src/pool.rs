//! One piece of work on a thread of its own: its ticket moves in, and it ends at its deadline.
//!
//! The threads are a pool of their own, which yields to the threads that answer requests and write
//! jobs: these have little to do and must not wait for it, while work takes every core. How many
//! pieces work at a time, the tickets of [`crate::admission`] decide; while there are fewer, kernels
//! start threads of their own, as many as are the work's share of the cores. When the deadline passes
//! or the client goes away, the waiting future is dropped, and with it a guard that raises the work's
//! flag; kernels, decoders and encoders look at it through [`Watch`] and stop within milliseconds.
//! Only then is the ticket given back.
//!
//! Three decoders, which are others' code, do not read while they work, and cannot be stopped there:
//! large pictures of those kinds are decoded by processes that are killed instead, see
//! [`crate::decoding`].

mod threads;
mod watch;

pub use watch::Watch;

use crate::admission::Ticket;
use crate::problem::{Kind, Problem};
use crate::telemetry::{self, Shed};
use rustix::process::{getpriority_process, setpriority_process};
use std::io;
use std::sync::Arc;
use std::thread::Builder;
use std::time::{Duration, Instant};
use threads::{Threads, Work};
use tokio::sync::oneshot::{self, Receiver};
use tokio::time::{sleep, timeout_at};
use tracing::Span;

/// Runs `work` and waits for it until `deadline`; the work may keep memory of its ticket.
///
/// # Errors
/// The work's own refusal, `deadline-exceeded`, `overloaded` when the system has no thread for it, or
/// `internal` when it panicked.
pub async fn run<T: Send + 'static>(
    ticket: Ticket,
    deadline: Instant,
    work: impl FnOnce(&Watch, &mut Ticket) -> Result<T, Problem> + Send + 'static,
) -> Result<T, Problem> {
    let watch = Arc::new(Watch::new(deadline));
    let _guard = CancelOnDrop(Arc::clone(&watch));
    let (work, heard) = reporting(ticket, watch, work);
    THREADS.run(work).map_err(|refusal| no_thread(&refusal.error))?;
    result(heard, deadline).await
}

/// The same under a watch that others look at too, of work that nobody waits for at the moment: while
/// the system has no thread for it, it is tried again and again until the deadline, ticket in hand.
///
/// # Errors
/// As [`run`].
pub async fn run_patiently<T: Send + 'static>(
    ticket: Ticket,
    watch: Arc<Watch>,
    deadline: Instant,
    work: impl FnOnce(&Watch, &mut Ticket) -> Result<T, Problem> + Send + 'static,
) -> Result<T, Problem> {
    let _guard = CancelOnDrop(Arc::clone(&watch));
    let (mut work, heard) = reporting(ticket, watch, work);
    while let Err(refusal) = THREADS.run(work) {
        let problem = no_thread(&refusal.error);
        if Instant::now() + PAUSE_WITHOUT_THREAD >= deadline {
            return Err(problem);
        }
        sleep(PAUSE_WITHOUT_THREAD).await;
        work = refusal.work;
    }
    result(heard, deadline).await
}

/// The work as a thread does it, and where its result is heard of.
fn reporting<T: Send + 'static>(
    mut ticket: Ticket,
    watch: Arc<Watch>,
    work: impl FnOnce(&Watch, &mut Ticket) -> Result<T, Problem> + Send + 'static,
) -> (Work, Receiver<Result<T, Problem>>) {
    watch.share_threads(ticket.share());
    let span = Span::current();
    let (said, heard) = oneshot::channel();
    let work = move || {
        let result = span.in_scope(|| {
            watch.record("queue", ticket.waited);
            let result = work(&watch, &mut ticket);
            match &result {
                Ok(_) => ticket.completed(),
                Err(_) => ticket.stopped(),
            }
            result
        });
        drop((ticket, span));
        // Whoever waited for it may have gone away.
        let _ = said.send(result);
    };
    (Box::new(work), heard)
}

/// What comes of work that has begun, or of its deadline.
async fn result<T>(heard: Receiver<Result<T, Problem>>, deadline: Instant) -> Result<T, Problem> {
    match timeout_at(deadline.into(), heard).await {
        Ok(Ok(Err(problem))) if problem.kind() == Kind::DeadlineExceeded => Err(too_slow()),
        Ok(heard) => heard.unwrap_or_else(|_| Err(panicked())),
        Err(_) => Err(too_slow()),
    }
}

/// When a client should try again whose work found no thread, in seconds.
const RETRY_AFTER_S: u64 = 5;

/// The pause before work that found no thread is tried again.
const PAUSE_WITHOUT_THREAD: Duration = Duration::from_secs(1);

/// How much nicer than the process the threads that work are.
const NICENESS: i32 = 5;

/// The threads that work.
static THREADS: Threads = Threads::new(|| Builder::new().name("work".into()), be_nicer);

/// Lets other threads of the process go first, as far as the system knows of that.
fn be_nicer() {
    // On Linux this is the priority of the calling thread alone.
    let present = getpriority_process(None).unwrap_or(0);
    let _ = setpriority_process(None, present.saturating_add(NICENESS));
}

/// Raises the flag when the one who waits for the work goes away.
struct CancelOnDrop(Arc<Watch>);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.cancel();
    }
}

fn too_slow() -> Problem {
    telemetry::shed(Shed::Deadline);
    let detail = "the work was not done by its deadline: send a smaller image, or ask for fewer \
                  vertices or a faster method such as med";
    Problem::new(Kind::DeadlineExceeded, detail).setting("--sync-deadline")
}

fn no_thread(error: &io::Error) -> Problem {
    tracing::error!(%error, "no thread could be started");
    let detail = "the system has no thread for the work now";
    Problem::new(Kind::Overloaded, detail).retry_after_s(RETRY_AFTER_S)
}

/// The panic itself is in the log already, by the hook.
fn panicked() -> Problem {
    Problem::new(Kind::Internal, "the log has the reason under this request's id")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::admission::{Admission, Cost, Limits};
    use crate::extract::accept::Format;
    use crate::extract::owner::Owner;
    use pixmesh_codec::probe;
    use pixmesh_meshing::{Control, Method, Target};
    use std::sync::atomic::{AtomicBool, Ordering};

    const PICTURE: &[u8] = b"P2\n2 2\n255\n0 1 2 3\n";

    fn gate() -> Admission {
        Admission::new(&Limits {
            workers: 1,
            threads: 1,
            memory_bytes: 1 << 20,
            queue_s: 1.0,
            running_per_key: 1,
            queued_per_key: 1,
        })
    }

    fn cost() -> Cost {
        let header = probe(PICTURE, &pixmesh_codec::Limits::default()).unwrap();
        let parameters = Method::Med.parameters(Target::Size(4));
        let plan = parameters.plan(header.shape()).unwrap();
        Cost::of_mesh(&header, &plan, &parameters, Format::Model)
    }

    #[tokio::test]
    async fn a_panic_is_an_internal_failure_and_gives_the_ticket_back() {
        let gate = gate();
        let deadline = Instant::now() + Duration::from_secs(60);
        for _ in 0..3 {
            let ticket = gate.admit(&Owner::anonymous(), cost(), deadline).await.unwrap();
            let result: Result<(), _> = run(ticket, deadline, |_, _| panic!("on purpose")).await;
            let problem = result.unwrap_err();
            assert_eq!(problem.kind(), Kind::Internal);
            assert!(!problem.document(None).contains("on purpose"));
        }
    }

    #[tokio::test]
    async fn work_uses_the_threads_of_workers_that_have_none() {
        let gate = Admission::new(&Limits {
            workers: 4,
            threads: 3,
            memory_bytes: 4 << 20,
            queue_s: 1.0,
            running_per_key: 4,
            queued_per_key: 1,
        });
        let deadline = Instant::now() + Duration::from_secs(60);
        let admit = async || gate.admit(&Owner::anonymous(), cost(), deadline).await;
        let threads = async |ticket| {
            run(ticket, deadline, |watch, _| Ok(watch.threads().get())).await.unwrap()
        };
        assert_eq!(threads(admit().await.unwrap()).await, 3);
        let other = admit().await.unwrap();
        assert_eq!(threads(admit().await.unwrap()).await, 1);
        drop(other);
        assert_eq!(threads(admit().await.unwrap()).await, 3);
        assert_eq!(Watch::new(deadline).threads().get(), 1, "without a ticket");
    }

    #[tokio::test]
    async fn dropping_the_wait_stops_the_work_and_only_then_gives_the_ticket_back() {
        let gate = gate();
        let deadline = Instant::now() + Duration::from_secs(60);
        let ticket = gate.admit(&Owner::anonymous(), cost(), deadline).await.unwrap();
        let has_ended = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&has_ended);
        let work = run(ticket, deadline, move |watch, _| -> Result<(), Problem> {
            while watch.check().is_ok() {
                std::thread::sleep(Duration::from_millis(1));
            }
            std::thread::sleep(Duration::from_millis(50));
            ends.store(true, Ordering::SeqCst);
            Ok(())
        });
        assert!(tokio::time::timeout(Duration::from_millis(50), work).await.is_err());
        gate.admit(&Owner::anonymous(), cost(), deadline).await.unwrap();
        assert!(has_ended.load(Ordering::SeqCst));
    }
}
