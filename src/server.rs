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
use crate::lifecycle::{Lifecycle, Stage};
use crate::problem;
use crate::routes;
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
use tokio::runtime::{Builder, Runtime};
use tokio::signal::unix::{SignalKind, signal};
use tokio::task::JoinHandle;
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

/// Serves or works until SIGTERM or SIGINT.
///
/// # Errors
/// When an address cannot be listened on, a runtime cannot be started, or jobs cannot be kept.
pub fn run(settings: &Settings, role: Role) -> Result<(), Box<dyn Error>> {
    let _log = telemetry::start_log(settings.log_format, settings.log_level, &settings.traces)?;
    warn_of_settings_not_in_force(settings);
    let metrics = telemetry::start_metrics(settings.worker_count())?;
    let runtime = Builder::new_multi_thread().enable_all().build()?;
    let jobs =
        runtime.block_on(Jobs::open(&settings.of_jobs())).map_err(|error| error.to_string())?;
    let lifecycle = Lifecycle::default();
    let public = match role {
        Role::Serve => Some(bind(settings.listen)?),
        Role::Work => None,
    };
    let operations = bind(settings.ops_listen)?;
    announce(public.as_ref(), &operations)?;

    let stop_operations = CancellationToken::new();
    let upkeep = metrics.clone();
    let routes = routes::operations(Operations {
        lifecycle: lifecycle.clone(),
        jobs: jobs.clone(),
        metrics,
    });
    let listener = Listener::new(operations, routes, OPERATIONS_CONNECTIONS, timeouts(settings));
    let operations = start_operations(listener, upkeep, stop_operations.clone())?;

    let result = runtime.block_on(serve(public, settings, jobs, &lifecycle));
    runtime.shutdown_timeout(REMAINING_THREADS);
    stop_operations.cancel();
    let _ = operations.join();
    result
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

/// Says on standard output where the service listens, whichever ports were free.
fn announce(public: Option<&TcpListener>, operations: &TcpListener) -> io::Result<()> {
    let mut output = io::stdout().lock();
    if let Some(public) = public {
        writeln!(output, "listening on http://{}", public.local_addr()?)?;
    }
    writeln!(output, "operations on http://{}", operations.local_addr()?)?;
    output.flush()
}

/// Starts the thread for operations.
fn start_operations(
    listener: Listener,
    metrics: PrometheusHandle,
    stop: CancellationToken,
) -> io::Result<thread::JoinHandle<()>> {
    let runtime: Runtime = Builder::new_current_thread().enable_all().build()?;
    thread::Builder::new().name("operations".into()).spawn(move || {
        let served = runtime.block_on(async {
            tokio::spawn(keep_up(metrics));
            let mut draining = listener.serve(stop).await?;
            draining.finish(LAST_WORDS).await;
            io::Result::Ok(())
        });
        if let Err(error) = served {
            tracing::error!(%error, "the listener for operations failed");
        }
    })
}

/// Sorts the samples of histograms into their buckets for ever: they would pile up where nobody
/// asks for the metrics.
async fn keep_up(metrics: PrometheusHandle) {
    let mut ticks = tokio::time::interval(UPKEEP);
    loop {
        ticks.tick().await;
        metrics.run_upkeep();
    }
}

/// Serves the public routes, if there are any, until a signal, then lets what runs end.
async fn serve(
    listener: Option<TcpListener>,
    settings: &Settings,
    jobs: Jobs,
    lifecycle: &Lifecycle,
) -> Result<(), Box<dyn Error>> {
    let keys = KeyRing::of(&settings.access)?.map(Arc::new);
    if let Some(keys) = &keys {
        tokio::spawn(Arc::clone(keys).keep_up());
    }
    let workers = Workers::start(settings.worker_count()).map_err(|error| {
        format!(
            "the worker threads cannot be started: {error}; lower --workers or allow more threads"
        )
    })?;
    let service = Arc::new(Service::new(settings, jobs, keys, workers));
    let stop = stop_on_signal(lifecycle.clone(), service.stop.clone(), service.cut.clone())?;
    tokio::spawn(keep_alive(lifecycle.clone()));
    let work = start_jobs(&service, settings);
    lifecycle.enter(Stage::Ready);
    tracing::info!(workers = settings.worker_count(), "ready");
    match listener {
        Some(listener) => serve_public(listener, settings, &service, stop).await?,
        None => stop.cancelled().await,
    }
    tokio::select! {
        _ = work => {}
        () = service.cut.cancelled() => {}
    }
    tracing::info!("stopped");
    Ok(())
}

/// Serves the public routes until the service stops.
async fn serve_public(
    listener: TcpListener,
    settings: &Settings,
    service: &Arc<Service>,
    stop: CancellationToken,
) -> io::Result<()> {
    let connections = descriptors::public_connections(settings.max_connections());
    let routes = routes::public(Arc::clone(service));
    // A quarter is left to others also where there are fewer than asked for.
    let each = settings.connections_per_address().min((3 * connections).div_ceil(4));
    let each = settings.limits.connections_per_address.map_or(each, |asked| asked.get());
    let listener = Listener::new(listener, routes, connections, timeouts(settings)).public(each);
    let mut draining = listener.serve(stop).await?;
    let has_ended = tokio::select! {
        has_ended = draining.finish(GRACE) => has_ended,
        () = service.cut.cancelled() => false,
    };
    if !has_ended {
        service.cut.cancel();
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
    let stop = service.stop.clone();
    tokio::spawn(async move {
        if let Err(error) = retention::clean_up(&jobs).await {
            tracing::warn!(%error, "blobs that no job has could not be deleted");
        }
        retention::run(jobs, stop).await;
    });
    let (stop, is_idle) = (service.stop.clone(), settings.jobs.no_worker);
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

/// The token, once the first SIGTERM or SIGINT is to raise it, after the service has said that it
/// stops. A second one raises `cut`: nothing is waited for any longer. SIGHUP stops nothing: the
/// file of keys is read again by itself.
fn stop_on_signal(
    lifecycle: Lifecycle,
    stop: CancellationToken,
    cut: CancellationToken,
) -> io::Result<CancellationToken> {
    let mut terminate = signal(SignalKind::terminate())?;
    let mut interrupt = signal(SignalKind::interrupt())?;
    let mut hangup = signal(SignalKind::hangup())?;
    let raised = stop.clone();
    tokio::spawn(async move {
        loop {
            tokio::select! {
                _ = terminate.recv() => {}
                _ = interrupt.recv() => {}
                _ = hangup.recv() => {
                    tracing::info!("a hangup stops nothing; the file of keys is read every second");
                    continue;
                }
            }
            if raised.is_cancelled() {
                tracing::info!("stopping at once");
                cut.cancel();
                return;
            }
            lifecycle.enter(Stage::Stopping);
            tracing::info!("stopping");
            raised.cancel();
        }
    });
    Ok(stop)
}
