//! The threads that run tasks: as many as there are workers, started at boot.
//!
//! A task takes its ticket along and gives it back when it ends, so there is always a free thread for
//! a task with a ticket. The threads have a lower priority than those that serve requests and write
//! jobs, which have little to do and must not wait. While fewer tasks run than there are cores, the
//! meshing kernels start as many further threads as the ticket grants.
//!
//! When the deadline passes or the client goes away, the waiting future is dropped and the task's
//! [`Context`] is cancelled. Kernels, decoders and encoders poll it and stop within milliseconds; three
//! decoders need up to 0.6 s, see [`pixmesh_codec::DecodeOptions::decode_while`].

use crate::context::Context;
use crate::error::EngineError;
use crate::scheduler::Ticket;
use crate::telemetry::{self, Shed};
use rustix::process::{getpriority_process, setpriority_process};
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Builder;
use std::time::Instant;
use tokio::sync::oneshot;
use tokio::time::timeout_at;
use tracing::Span;

/// By how much the priority of the threads is below the process's.
const NICENESS: i32 = 5;

type Task = Box<dyn FnOnce() + Send>;

/// The threads that run tasks.
#[derive(Clone, Debug)]
pub struct Workers {
    tasks: Sender<Task>,
}

impl Workers {
    /// Starts `count` threads. They end when the last clone of this is dropped.
    ///
    /// # Errors
    /// When the system does not start a thread.
    pub fn start(count: usize) -> io::Result<Self> {
        let (tasks, received) = channel();
        let received = Arc::new(Mutex::new(received));
        for _ in 0..count {
            let received = Arc::clone(&received);
            Builder::new().name("worker".into()).spawn(move || {
                lower_priority();
                while let Some(task) = next(&received) {
                    // A panic ends the task, not the thread; the hook has logged it.
                    let _ = catch_unwind(AssertUnwindSafe(task));
                }
            })?;
        }
        Ok(Self { tasks })
    }

    /// Runs `task` and waits for it until `deadline`; the task may keep memory of its ticket.
    ///
    /// # Errors
    /// The task's own error, [`EngineError::DeadlineExceeded`], or [`EngineError::Panicked`].
    pub async fn run<T: Send + 'static>(
        &self,
        ticket: Ticket,
        deadline: Instant,
        task: impl FnOnce(&Context, &mut Ticket) -> Result<T, EngineError> + Send + 'static,
    ) -> Result<T, EngineError> {
        self.run_watched(ticket, Arc::new(Context::new(deadline)), deadline, task).await
    }

    /// Runs `task` as [`run`](Self::run) does, under a context that others observe too.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub async fn run_watched<T: Send + 'static>(
        &self,
        mut ticket: Ticket,
        context: Arc<Context>,
        deadline: Instant,
        task: impl FnOnce(&Context, &mut Ticket) -> Result<T, EngineError> + Send + 'static,
    ) -> Result<T, EngineError> {
        let _guard = CancelOnDrop(Arc::clone(&context));
        context.grant(&ticket);
        let span = Span::current();
        let (sender, receiver) = oneshot::channel();
        let task = move || {
            let result = span.in_scope(|| {
                context.record("queue", ticket.waited);
                let result = task(&context, &mut ticket);
                match &result {
                    Ok(_) => ticket.completed(),
                    Err(_) => ticket.stopped(),
                }
                result
            });
            drop((ticket, span));
            // The receiver is gone when the client is.
            let _ = sender.send(result);
        };
        // Without threads the task is dropped and the receiver fails as after a panic.
        let _ = self.tasks.send(Box::new(task));
        match timeout_at(deadline.into(), receiver).await {
            Ok(Ok(Err(error))) if error.is_cancelled() => Err(too_slow()),
            Ok(received) => received.unwrap_or(Err(EngineError::Panicked)),
            Err(_) => Err(too_slow()),
        }
    }
}

/// The next task, or `None` when no more can come.
fn next(received: &Mutex<Receiver<Task>>) -> Option<Task> {
    received.lock().unwrap_or_else(PoisonError::into_inner).recv().ok()
}

/// Lowers the priority of the calling thread, where the system has priorities of threads.
fn lower_priority() {
    let present = getpriority_process(None).unwrap_or(0);
    let _ = setpriority_process(None, present.saturating_add(NICENESS));
}

/// Cancels the task when nobody waits for it any more.
struct CancelOnDrop(Arc<Context>);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.cancel();
    }
}

fn too_slow() -> EngineError {
    telemetry::shed(Shed::Deadline);
    EngineError::DeadlineExceeded
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::owner::Owner;
    use crate::params::ParameterSet;
    use crate::pipeline::mesh;
    use crate::scheduler::{Limits, Scheduler};
    use crate::task::{Cost, Weighed};
    use pixmesh_codec::{DecodeError, Format, WeightsError, probe};
    use pixmesh_meshing::{Control, Method, Target};
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::Duration;

    const PICTURE: &[u8] = b"P2\n2 2\n255\n0 1 2 3\n";

    fn gate() -> Scheduler {
        Scheduler::new(&Limits {
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
        let (gate, workers) = (gate(), Workers::start(1).unwrap());
        let deadline = Instant::now() + Duration::from_secs(60);
        for _ in 0..3 {
            let ticket = gate.admit(&Owner::Anonymous, cost(), deadline).await.unwrap();
            let result: Result<(), _> =
                workers.run(ticket, deadline, |_, _| panic!("on purpose")).await;
            assert!(matches!(result, Err(EngineError::Panicked)));
        }
    }

    #[tokio::test]
    async fn decoding_takes_no_more_memory_than_the_ticket_reserved() {
        let (gate, workers) = (gate(), Workers::start(1).unwrap());
        let deadline = Instant::now() + Duration::from_secs(60);
        let gray = [&b"P5 1000 1000 255\n"[..], &[7; 1_000_000]].concat();
        let tiny = [&b"P5 100 100 255\n"[..], &[7; 10_000]].concat();
        let decode = async |image: Vec<u8>, weights: Option<Vec<u8>>| {
            let ticket = gate.admit(&Owner::Anonymous, cost(), deadline).await.unwrap();
            assert_eq!(ticket.memory_bytes(), 1 << 20);
            let options = ParameterSet::of_query(Some("size=4")).unwrap().finish().unwrap();
            let task = move |context: &Context, _: &mut Ticket| {
                let limits = pixmesh_codec::Limits::default();
                mesh(Weighed { image, weights }, &options, Format::Model, &limits, context)
            };
            workers.run(ticket, deadline, task).await
        };
        let refused = |error| match error {
            EngineError::Decode(DecodeError::TooMuchMemory { needed, allowed })
            | EngineError::Weights(WeightsError::Picture(DecodeError::TooMuchMemory {
                needed,
                allowed,
            })) => (needed, allowed),
            other => panic!("{other}"),
        };
        let (needed, allowed) = refused(decode(gray.clone(), None).await.unwrap_err());
        assert!(needed > 2_000_000 && allowed == 1 << 20, "{needed} of {allowed}");
        let (needed, allowed) = refused(decode(tiny.clone(), Some(gray)).await.unwrap_err());
        assert!(needed > 2_000_000 && allowed == (1 << 20) - 20_000, "{needed} of {allowed}");
        assert_eq!(decode(tiny.clone(), Some(tiny)).await.unwrap().vertices, 4);
    }

    #[tokio::test]
    async fn work_uses_the_threads_of_workers_that_have_none() {
        let gate = Scheduler::new(&Limits {
            workers: 4,
            threads: 3,
            memory_bytes: 4 << 20,
            queue_s: 1.0,
            running_per_key: 4,
            queued_per_key: 1,
        });
        let workers = Workers::start(4).unwrap();
        let deadline = Instant::now() + Duration::from_secs(60);
        let admit = async || gate.admit(&Owner::Anonymous, cost(), deadline).await;
        let threads = async |ticket| {
            workers.run(ticket, deadline, |context, _| Ok(context.threads().get())).await.unwrap()
        };
        assert_eq!(threads(admit().await.unwrap()).await, 3);
        let other = admit().await.unwrap();
        assert_eq!(threads(admit().await.unwrap()).await, 1);
        drop(other);
        assert_eq!(threads(admit().await.unwrap()).await, 3);
        assert_eq!(Context::new(deadline).threads().get(), 1, "without a ticket");
    }

    #[tokio::test]
    async fn dropping_the_wait_stops_the_work_and_only_then_gives_the_ticket_back() {
        let (gate, workers) = (gate(), Workers::start(1).unwrap());
        let deadline = Instant::now() + Duration::from_secs(60);
        let ticket = gate.admit(&Owner::Anonymous, cost(), deadline).await.unwrap();
        let has_ended = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&has_ended);
        let work = workers.run(ticket, deadline, move |context, _| -> Result<(), EngineError> {
            while context.check().is_ok() {
                std::thread::sleep(Duration::from_millis(1));
            }
            std::thread::sleep(Duration::from_millis(50));
            ends.store(true, Ordering::SeqCst);
            Ok(())
        });
        assert!(tokio::time::timeout(Duration::from_millis(50), work).await.is_err());
        gate.admit(&Owner::Anonymous, cost(), deadline).await.unwrap();
        assert!(has_ended.load(Ordering::SeqCst));
    }
}
