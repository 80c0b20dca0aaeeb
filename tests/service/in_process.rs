//! The service in the process of the tests, on free ports; stopped when dropped. What belongs to a
//! process (its log, metrics, signals, memory) needs a [`Server`](crate::server::Server).

use crate::server::{Client, Folder};
use clap::{CommandFactory, FromArgMatches, Parser};
use metrics_exporter_prometheus::PrometheusBuilder;
use pixmesh::config::Settings;
use pixmesh::lifecycle::Shutdown;
use pixmesh::server::{Listeners, Role, open_jobs, serve};
use std::ops::Deref;
use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;
use tokio::runtime::Builder;

/// How long threads may take to end after a service has stopped.
const REMAINING_THREADS: Duration = Duration::from_secs(1);
/// The name of the threads of services, beside those of workers and operations.
const THREAD: &str = "service";

/// Panics of services in this process.
static PANICS: AtomicUsize = AtomicUsize::new(0);

#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    settings: Settings,
}

/// A running service.
pub(crate) struct Service {
    client: Client,
    shutdown: Shutdown,
    thread: Option<JoinHandle<()>>,
    _folder: Folder,
}

impl Service {
    /// Starts the service with flags beside those for the ports.
    pub(crate) fn start(flags: &[&str]) -> Self {
        count_panics();
        let folder = Folder::new();
        let settings = settings(&folder, flags);
        let listeners = Listeners::bind(&settings, Role::Serve).unwrap();
        let client = Client {
            public: listeners.public.as_ref().unwrap().local_addr().unwrap(),
            operations: listeners.operations.local_addr().unwrap(),
        };
        let shutdown = Shutdown::default();
        let stopped = shutdown.clone();
        let run = move || {
            let runtime =
                Builder::new_multi_thread().enable_all().thread_name(THREAD).build().unwrap();
            let served = runtime.block_on(async {
                let jobs = open_jobs(&settings).await?;
                // Metrics are of the process, and nothing counts them here.
                let metrics = PrometheusBuilder::new().build_recorder().handle();
                serve(listeners, &settings, jobs, metrics, stopped).await
            });
            runtime.shutdown_timeout(REMAINING_THREADS);
            served.map_err(|error| error.to_string()).unwrap();
        };
        let thread = thread::Builder::new().name(THREAD.into()).spawn(run).unwrap();
        client.wait_until("it is ready", || client.operate("/readyz").status == 200);
        Self { client, shutdown, thread: Some(thread), _folder: folder }
    }
}

impl Deref for Service {
    type Target = Client;

    fn deref(&self) -> &Client {
        &self.client
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.shutdown.stop.cancel();
        self.shutdown.cut.cancel();
        let ended = self.thread.take().map(JoinHandle::join);
        if !thread::panicking() {
            assert!(ended.is_some_and(|ended| ended.is_ok()));
            assert_eq!(PANICS.load(Ordering::Relaxed), 0, "a service panicked");
        }
    }
}

/// The settings of these flags alone.
fn settings(folder: &Folder, flags: &[&str]) -> Settings {
    let command = Arguments::command();
    for variable in command.get_arguments().filter_map(|argument| argument.get_env()) {
        assert!(
            std::env::var_os(variable).is_none(),
            "unset {variable:?}: tests read settings too"
        );
    }
    let own = ["service", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0", "--data-dir"];
    let own = own.into_iter().chain(folder.path().to_str());
    let matches = command.try_get_matches_from(own.chain(flags.iter().copied())).unwrap();
    Arguments::from_arg_matches(&matches).unwrap().settings.checked().unwrap()
}

/// Counts the panics of services from now on, beside what is done with them already.
fn count_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            let is_service = |name| [THREAD, "worker", "operations"].contains(&name);
            if thread::current().name().is_some_and(is_service) {
                PANICS.fetch_add(1, Ordering::Relaxed);
            }
            before(panic);
        }));
    });
}
