//! The two listeners, from the start to the graceful stop.
//!
//! The public listener and the work share one runtime; the listener for operations has a thread
//! and a runtime of its own, so that health and metrics answer while every core is busy. On
//! SIGTERM or SIGINT the service says at once that it is not ready, takes no more connections, and
//! lets the running requests end: after [`GRACE`], or a second signal, those that are left are told
//! 503, after [`LAST_WORDS`] more the process exits all the same.

mod descriptors;
mod listener;
mod stream;

use crate::access::KeyRing;
use crate::config::{self, BESIDE_BUDGET, Settings};
use crate::lifecycle::{Lifecycle, Shutdown};
use crate::problem;
use crate::routes;
use crate::routes::operating::Operators;
use crate::service::{Operations, Service};
use crate::telemetry;
use descriptors::OPERATIONS_CONNECTIONS;
use listener::Listener;
use metrics_exporter_prometheus::PrometheusHandle;
use pixmesh_engine::Workers;
use pixmesh_engine::pipeline;
use pixmesh_jobs::Jobs;
use pixmesh_jobs::retention;
use pixmesh_jobs::worker::Worker;
use std::error::Error;
use std::io::{self, Write};
use std::net::TcpListener;
use std::sync::Arc;
use std::thread;
use std::time::Duration;
use stream::Timeouts;
use tokio::runtime::Builder;
use tokio::signal::unix::{SignalKind, signal};
use tokio::task::{JoinHandle, spawn_blocking};
use tokio_util::sync::CancellationToken;

/// How long running requests may take to end, once the service stops.
pub const GRACE: Duration = Duration::from_secs(25);
/// How long running jobs may take to end: so long that one that is handed back is written down
/// before the process ends.
const GRACE_OF_JOBS: Duration = Duration::from_secs(20);
/// How long the refusal of the rest may take to be sent.
pub const LAST_WORDS: Duration = Duration::from_secs(2);
/// How long threads may take to end, once nobody waits for them.
const REMAINING_THREADS: Duration = Duration::from_secs(1);
/// How often the runtime of the public listener shows that it runs.
const HEARTBEAT: Duration = Duration::from_millis(500);
/// How often the samples of histograms are sorted into buckets, scraped or not.
const UPKEEP: Duration = Duration::from_secs(5);

/// What a node does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// It takes requests, and does jobs unless it is told not to.
    Serve,
    /// It does jobs of a queue that nodes share, and takes no requests but for operations.
    Work,
}

/// The addresses that a node listens on.
#[derive(Debug)]
pub struct Listeners {
    /// That for requests; `None` where the node only does jobs.
    pub public: Option<TcpListener>,
    /// That for health and metrics.
    pub operations: TcpListener,
}

impl Listeners {
    /// Listens on the addresses of the settings.
    ///
    /// # Errors
    /// When an address cannot be listened on.
    pub fn bind(settings: &Settings, role: Role) -> Result<Self, String> {
        let public = (role == Role::Serve).then(|| bind(settings.listen)).transpose()?;
        Ok(Self { public, operations: bind(settings.ops_listen)? })
    }

    /// Says on standard output where the service listens, whichever ports were free.
    fn announce(&self) -> io::Result<()> {
        let mut output = io::stdout().lock();
        if let Some(public) = &self.public {
            writeln!(output, "listening on http://{}", public.local_addr()?)?;
        }
        writeln!(output, "operations on http://{}", self.operations.local_addr()?)?;
        output.flush()
    }
}

/// The program: serves or works until SIGTERM or SIGINT, with a log, metrics and a runtime of its
/// own.
///
/// # Errors
/// When an address cannot be listened on, a runtime cannot be started, or jobs cannot be kept.
pub fn run(settings: &Settings, role: Role) -> Result<(), Box<dyn Error>> {
    let _log = telemetry::start_log(settings.log_format, settings.log_level, &settings.traces)?;
    warn_of_settings_not_in_force(settings);
    let metrics = telemetry::start_metrics(settings.worker_count())?;
    let runtime = Builder::new_multi_thread().enable_all().build()?;
    let result = runtime.block_on(async {
        let jobs = open_jobs(settings).await?;
        let listeners = Listeners::bind(settings, role)?;
        listeners.announce()?;
        let shutdown = Shutdown::default();
        shut_down_on_signals(shutdown.clone())?;
        serve(listeners, settings, jobs, metrics, shutdown).await
    });
    runtime.shutdown_timeout(REMAINING_THREADS);
    result
}

/// Opens the queue and the store of the settings.
///
/// # Errors
/// When they cannot be used.
pub async fn open_jobs(settings: &Settings) -> Result<Jobs, String> {
    Jobs::open(&settings.of_jobs()).await.map_err(|error| error.to_string())
}

/// Serves until `shutdown`: the public routes where there is a listener for them, operations, and
/// jobs unless the settings say otherwise. Several may run in one process, which share its log and
/// its metrics.
///
/// # Errors
/// When a thread cannot be started, or a listener or the file of keys fails.
pub async fn serve(
    listeners: Listeners,
    settings: &Settings,
    jobs: Jobs,
    metrics: PrometheusHandle,
    shutdown: Shutdown,
) -> Result<(), Box<dyn Error>> {
    let lifecycle = Lifecycle::new(shutdown.stop.clone());
    let keys = KeyRing::of(&settings.access)?.map(Arc::new);
    let operators = Operators {
        keys: keys.clone(),
        visitors: Arc::new(settings.visitors()),
        is_private: settings.ops_listen.ip().is_loopback(),
    };
    let shared = Operations { lifecycle: lifecycle.clone(), jobs: jobs.clone(), metrics };
    let operations =
        OperationsThread::start(listeners.operations, shared, operators, timeouts(settings))?;
    let served = serve_public(listeners.public, settings, keys, jobs, &lifecycle, shutdown).await;
    operations.stop().await;
    served
}

/// Says in the log which settings do not mean what they say.
fn warn_of_settings_not_in_force(settings: &Settings) {
    let (asked, longest) = (settings.limits.max_body, settings.longest_body());
    if longest < asked {
        let (asked, longest) = (asked.to_string(), longest.to_string());
        tracing::warn!(asked, longest, "a quarter of --memory-budget is less than --max-body");
    }
    let (budget, limit) = (settings.memory_budget(), config::memory_limit());
    if let Some(limit) = limit.filter(|limit| limit.0 < budget.0 + BESIDE_BUDGET.0) {
        let (budget, limit) = (budget.to_string(), limit.to_string());
        tracing::warn!(budget, limit, "--memory-budget leaves too little of the container's limit");
    }
}

/// How slow clients may be.
fn timeouts(settings: &Settings) -> Timeouts {
    let limits = &settings.limits;
    Timeouts {
        header: limits.header_timeout.0,
        keep_alive: limits.keep_alive_timeout.0,
        stall: limits.body_timeout.0,
    }
}

fn bind(address: std::net::SocketAddr) -> Result<TcpListener, String> {
    let listener = TcpListener::bind(address)
        .and_then(|listener| listener.set_nonblocking(true).map(|()| listener));
    listener.map_err(|error| format!("{address} cannot be listened on: {error}"))
}

/// The thread for operations, with a runtime of its own.
struct OperationsThread {
    stop: CancellationToken,
    thread: thread::JoinHandle<()>,
}

impl OperationsThread {
    fn start(
        socket: TcpListener,
        shared: Operations,
        operators: Operators,
        timeouts: Timeouts,
    ) -> io::Result<Self> {
        let runtime = Builder::new_current_thread().enable_all().build()?;
        let (stop, metrics) = (CancellationToken::new(), shared.metrics.clone());
        let routes = routes::operations(shared, operators);
        let listener = Listener::new(socket, routes, OPERATIONS_CONNECTIONS, timeouts);
        let stopped = stop.clone();
        let thread = thread::Builder::new().name("operations".into()).spawn(move || {
            let served = runtime.block_on(async {
                tokio::spawn(keep_up(metrics));
                let mut draining = listener.serve(stopped).await?;
                draining.finish(LAST_WORDS).await;
                io::Result::Ok(())
            });
            if let Err(error) = served {
                tracing::error!(%error, "operations listener failed");
            }
        })?;
        Ok(Self { stop, thread })
    }

    /// Ends it, after the responses that it is sending.
    async fn stop(self) {
        self.stop.cancel();
        let _ = spawn_blocking(move || self.thread.join()).await;
    }
}

/// Sorts the samples of histograms into their buckets for ever, because they would pile up where nobody
/// asks for the metrics.
async fn keep_up(metrics: PrometheusHandle) {
    let mut ticks = tokio::time::interval(UPKEEP);
    loop {
        ticks.tick().await;
        metrics.run_upkeep();
    }
}

/// Serves the public routes and does jobs until the service stops, then lets what runs end.
async fn serve_public(
    listener: Option<TcpListener>,
    settings: &Settings,
    keys: Option<Arc<KeyRing>>,
    jobs: Jobs,
    lifecycle: &Lifecycle,
    shutdown: Shutdown,
) -> Result<(), Box<dyn Error>> {
    if let Some(keys) = &keys {
        tokio::spawn(Arc::clone(keys).keep_up());
    }
    let workers = Workers::start(settings.worker_count()).map_err(|error| {
        format!(
            "the worker threads cannot be started: {error}; lower --workers or allow more threads"
        )
    })?;
    let service = Arc::new(Service::new(settings, jobs, keys, workers, shutdown));
    tokio::spawn(keep_alive(lifecycle.clone()));
    let work = start_jobs(&service, settings);
    lifecycle.set_ready();
    tracing::info!(workers = settings.worker_count(), "ready");
    match listener {
        Some(listener) => serve_connections(listener, settings, &service).await?,
        None => service.shutdown.stop.cancelled().await,
    }
    tokio::select! {
        _ = work => {}
        () = service.shutdown.cut.cancelled() => {}
    }
    tracing::info!("stopped");
    Ok(())
}

/// Serves the public routes until the service stops.
async fn serve_connections(
    listener: TcpListener,
    settings: &Settings,
    service: &Arc<Service>,
) -> io::Result<()> {
    let connections = descriptors::public_connections(settings.max_connections());
    let routes = routes::public(Arc::clone(service));
    // A quarter is left to others also where there are fewer than asked for.
    let each = settings.connections_per_address().min((3 * connections).div_ceil(4));
    let each = settings.limits.connections_per_address.map_or(each, |asked| asked.get());
    let listener = Listener::new(listener, routes, connections, timeouts(settings)).public(each);
    let Shutdown { stop, cut } = &service.shutdown;
    let mut draining = listener.serve(stop.clone()).await?;
    let has_ended = tokio::select! {
        has_ended = draining.finish(GRACE) => has_ended,
        () = cut.cancelled() => false,
    };
    if !has_ended {
        cut.cancel();
        draining.finish(LAST_WORDS).await;
    }
    Ok(())
}

/// Starts what is done on jobs beside requests, until the service stops.
fn start_jobs(service: &Service, settings: &Settings) -> JoinHandle<()> {
    let jobs = service.jobs.clone();
    let worker = Worker {
        jobs: jobs.clone(),
        scheduler: service.scheduler.clone(),
        workers: service.workers.clone(),
        pictures: service.pictures,
        deadline: settings.jobs.job_deadline.0,
        make: pipeline::mesh_of_job,
        describe: problem::of_attempt,
        lease: settings.jobs.job_lease.0,
    };
    let stop = service.shutdown.stop.clone();
    tokio::spawn(async move {
        if let Err(error) = retention::clean_up(&jobs).await {
            tracing::warn!(%error, "orphan blobs not deleted");
        }
        retention::run(jobs, stop).await;
    });
    let (stop, is_idle) = (service.shutdown.stop.clone(), settings.jobs.no_worker);
    tokio::spawn(async move {
        match is_idle {
            true => stop.cancelled().await,
            false => worker.run(stop, GRACE_OF_JOBS).await,
        }
    })
}

/// Shows that the runtime of the public listener runs.
async fn keep_alive(lifecycle: Lifecycle) {
    let mut ticks = tokio::time::interval(HEARTBEAT);
    loop {
        ticks.tick().await;
        lifecycle.beat();
    }
}

/// Stops the service at the first SIGTERM or SIGINT; at a second one nothing is waited for any
/// longer. SIGHUP stops nothing: the file of keys is read again by itself.
fn shut_down_on_signals(shutdown: Shutdown) -> io::Result<()> {
    let mut terminate = signal(SignalKind::terminate())?;
    let mut interrupt = signal(SignalKind::interrupt())?;
    let mut hangup = signal(SignalKind::hangup())?;
    tokio::spawn(async move {
        loop {
            tokio::select! {
                _ = terminate.recv() => {}
                _ = interrupt.recv() => {}
                _ = hangup.recv() => {
                    tracing::info!("SIGHUP ignored; the keys file is read again when it changes");
                    continue;
                }
            }
            if shutdown.stop.is_cancelled() {
                tracing::info!("second signal; stopping without waiting for running work");
                shutdown.cut.cancel();
                return;
            }
            tracing::info!("stopping");
            shutdown.stop.cancel();
        }
    });
    Ok(())
}
