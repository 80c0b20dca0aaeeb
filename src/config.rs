//! Every setting: its flag, environment variable, default and check, each declared once.
//!
//! The environment variable of `--max-body` is `PIXMESH_MAX_BODY`, and so on; a flag wins over its
//! variable. Zero is refused wherever it could be taken to mean "without limit", and a variable
//! that begins with `PIXMESH_` but is no setting stops the start.

mod access;
mod container;
mod quantity;
mod trace;

pub use access::{AccessSettings, Visitors};
pub use container::{BESIDE_BUDGET, machine_memory, memory_limit};
use pixmesh_jobs::Caps;
use pixmesh_jobs::Terms;
use pixmesh_jobs::blobs::BlobEngine;
use pixmesh_jobs::settings::QueueSettings;
pub use quantity::{ByteSize, Period};
pub use trace::TraceSettings;

use clap::error::ContextKind;
use clap::{Args, CommandFactory, Parser, ValueEnum};
use ipnet::IpNet;
use pixmesh_engine::scheduler;
use serde::Serialize;
use serde_json::Value;
use std::error::Error;
use std::ffi::OsString;
use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::num::{NonZeroU64, NonZeroUsize};
use std::path::PathBuf;
use std::thread::available_parallelism;
use std::time::Duration;

/// The settings of `pixmesh serve`.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Settings {
    /// Address of the public listener; port 0 is any free one.
    #[arg(long, env = "PIXMESH_LISTEN", default_value = "127.0.0.1:8080")]
    pub listen: SocketAddr,
    /// Address of the listener for health and metrics; port 0 is any free one.
    #[arg(long, env = "PIXMESH_OPS_LISTEN", default_value = OPS_LISTEN)]
    pub ops_listen: SocketAddr,
    /// Allow --listen on an address that other hosts reach without --keys-file: anyone who reaches it
    /// may then use the service.
    #[arg(long, env = "PIXMESH_INSECURE_NO_AUTH")]
    pub insecure_no_auth: bool,
    /// Most tasks that run at the same time; while fewer run, they share all cores [default: the number
    /// of cores, or of those that the container's quota allows].
    #[arg(long, env = "PIXMESH_WORKERS", hide_env_values = true)]
    pub workers: Option<NonZeroUsize>,
    /// Memory for request bodies (a quarter), and for tasks and responses not sent yet (the rest)
    /// [default: 1GiB, or two thirds of the container's limit].
    #[arg(long, env = "PIXMESH_MEMORY_BUDGET", hide_env_values = true)]
    pub memory_budget: Option<ByteSize>,
    /// Longest queue, in seconds of work; further requests are refused with 503.
    #[arg(long, env = "PIXMESH_QUEUE_SECONDS", default_value = "10", value_parser = quantity::seconds)]
    pub queue_seconds: f64,
    /// Longest time from the end of an upload to the response.
    #[arg(long, env = "PIXMESH_SYNC_DEADLINE", default_value = "30s")]
    pub sync_deadline: Period,
    /// Format of the log on standard error.
    #[arg(long, env = "PIXMESH_LOG_FORMAT", default_value = "human")]
    pub log_format: LogFormat,
    /// Lowest level that is logged; PUT /log-level/LEVEL on the listener for operations changes it.
    #[arg(long, env = "PIXMESH_LOG_LEVEL", default_value = "info")]
    pub log_level: LogLevel,
    /// Where traces go.
    #[command(flatten)]
    #[serde(flatten)]
    pub traces: TraceSettings,
    /// What a client may send, and how slowly.
    #[command(flatten)]
    #[serde(flatten)]
    pub limits: Limits,
    /// Who may use the service, and how much of it.
    #[command(flatten)]
    #[serde(flatten)]
    pub access: AccessSettings,
    /// Where and how jobs are kept.
    #[command(flatten)]
    #[serde(flatten)]
    pub jobs: JobSettings,
}

/// Where and how jobs are kept.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct JobSettings {
    /// Folder of the jobs, their pictures and results; only one process may use it at a time.
    #[arg(long, env = "PIXMESH_DATA_DIR", default_value = "./pixmesh-data")]
    pub data_dir: PathBuf,
    /// The engine of the queue and its connection.
    #[command(flatten)]
    #[serde(flatten)]
    pub queue: QueueSettings,
    /// Store of pictures and results: `file` in the data folder of one process; file:///FOLDER or
    /// s3://BUCKET, gs://BUCKET or az://CONTAINER for many nodes.
    #[arg(long, env = "PIXMESH_BLOBS", default_value = "file")]
    pub blobs: BlobEngine,
    /// Accept jobs but do not run them: workers of the same queue do.
    #[arg(long, env = "PIXMESH_NO_WORKER")]
    pub no_worker: bool,
    /// Lease of a running job: another worker takes over a job whose worker has not renewed it for this
    /// long.
    #[arg(long, env = "PIXMESH_JOB_LEASE", default_value = "30s")]
    pub job_lease: Period,
    /// Longest time of one attempt at a job.
    #[arg(long, env = "PIXMESH_JOB_DEADLINE", default_value = "10m")]
    pub job_deadline: Period,
    /// How long a job and its result are kept after the job has ended.
    #[arg(long, env = "PIXMESH_RESULT_TTL", default_value = "24h")]
    pub result_ttl: Period,
    /// Most queued jobs; further ones are refused with 503.
    #[arg(long, env = "PIXMESH_MAX_QUEUED_JOBS", default_value = "10000")]
    pub max_queued_jobs: NonZeroUsize,
    /// Most bytes of stored pictures and meshes; further jobs are refused with 507 [default: no limit].
    #[arg(long, env = "PIXMESH_MAX_STORED_BYTES", hide_env_values = true)]
    pub max_stored_bytes: Option<ByteSize>,
    /// Free space to leave on the disk of the data folder: new jobs are refused below it; at most an
    /// eighth of the disk.
    #[arg(long, env = "PIXMESH_MIN_FREE_SPACE", default_value = "256MiB")]
    pub min_free_space: ByteSize,
}

/// What a client may send, and how slowly.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Limits {
    /// Longest request body; never more than a quarter of --memory-budget.
    #[arg(long, env = "PIXMESH_MAX_BODY", default_value = "32MiB")]
    pub max_body: ByteSize,
    /// Most pixels of an image.
    #[arg(long, env = "PIXMESH_MAX_PIXELS", default_value = "40000000")]
    pub max_pixels: NonZeroU64,
    /// Most columns and most rows of an image.
    #[arg(long, env = "PIXMESH_MAX_SIDE", default_value = "16384")]
    pub max_side: NonZeroUsize,
    /// Longest time for the header of a request to arrive.
    #[arg(long, env = "PIXMESH_HEADER_TIMEOUT", default_value = "10s")]
    pub header_timeout: Period,
    /// Longest idle time of a connection between requests; set it higher than that of a proxy in front.
    #[arg(long, env = "PIXMESH_KEEP_ALIVE_TIMEOUT", default_value = "75s")]
    pub keep_alive_timeout: Period,
    /// Longest time for a request body to arrive, and for a client to read nothing of a response.
    #[arg(long, env = "PIXMESH_BODY_TIMEOUT", default_value = "30s")]
    pub body_timeout: Period,
    /// Networks or addresses of proxies whose X-Forwarded-For is trusted for the log, such as 10.0.0.0/8.
    #[arg(long, env = "PIXMESH_TRUSTED_PROXIES", value_delimiter = ',', num_args = 1.., value_parser = network)]
    pub trusted_proxies: Vec<IpNet>,
    /// Most open connections; fewer where the limit on open files is lower [default: two for each MiB of
    /// the memory budget, 1024 to 16384].
    #[arg(long, env = "PIXMESH_MAX_CONNECTIONS", hide_env_values = true)]
    pub max_connections: Option<NonZeroUsize>,
    /// Most open connections from one address; behind a proxy all connections have its address [default:
    /// three quarters of --max-connections].
    #[arg(long, env = "PIXMESH_CONNECTIONS_PER_ADDRESS", hide_env_values = true)]
    pub connections_per_address: Option<NonZeroUsize>,
}

/// The settings of `pixmesh health`.
#[derive(Args, Clone, Debug)]
pub struct HealthSettings {
    /// Address of the listener for health and metrics of the running service.
    #[arg(long, env = "PIXMESH_OPS_LISTEN", default_value = OPS_LISTEN)]
    pub ops_listen: SocketAddr,
}

/// How the log is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum LogFormat {
    /// Lines to read.
    Human,
    /// One JSON object per line.
    Json,
}

/// The lowest level that is logged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum LogLevel {
    /// Failures of the service.
    Error,
    /// Also what an operator should look at.
    Warn,
    /// Also every response.
    Info,
    /// Everything.
    Debug,
}

impl fmt::Display for LogLevel {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Error => "error",
            Self::Warn => "warn",
            Self::Info => "info",
            Self::Debug => "debug",
        })
    }
}

/// The shortest lease; a worker renews its lease three times in this time.
const SHORTEST_LEASE: Duration = Duration::from_secs(2);
const OPS_LISTEN: &str = "127.0.0.1:8081";
/// The most worker threads.
const MOST_WORKERS: usize = 1024;
/// The least memory budget that a small picture fits in.
const LEAST_BUDGET: ByteSize = ByteSize(4 << 20);

impl Settings {
    /// The settings, after the checks that need more than one of them.
    ///
    /// # Errors
    /// When the public listener could be reached from elsewhere and nothing allows that, or the
    /// file of keys is not good.
    pub fn checked(self) -> Result<Self, Box<dyn Error>> {
        let is_open = self.access.keys_file.is_none() && !self.insecure_no_auth;
        if !self.listen.ip().is_loopback() && is_open {
            return Err(format!(
                "--listen {} can be reached from other hosts, and anyone could use the service: \
                 listen on 127.0.0.1, name a --keys-file, or say --insecure-no-auth",
                self.listen
            )
            .into());
        }
        self.check_ranges()?;
        self.access.check()?;
        self.jobs.check()?;
        Ok(self)
    }

    /// Refuses values outside of sensible ranges.
    fn check_ranges(&self) -> Result<(), Box<dyn Error>> {
        let Self { limits, jobs, .. } = self;
        let (hour, year) = (Duration::from_hours(1), Duration::from_hours(24 * 365));
        let periods = [
            ("sync-deadline", self.sync_deadline, hour),
            ("header-timeout", limits.header_timeout, hour),
            ("keep-alive-timeout", limits.keep_alive_timeout, hour),
            ("body-timeout", limits.body_timeout, hour),
            ("job-lease", jobs.job_lease, hour),
            ("job-deadline", jobs.job_deadline, 24 * hour),
            ("result-ttl", jobs.result_ttl, 10 * year),
        ];
        for (name, period, most) in periods {
            if period.0 > most {
                return Err(out_of_range(name, period, Period(most)));
            }
        }
        if self.worker_count() > MOST_WORKERS {
            return Err(out_of_range("workers", self.worker_count(), MOST_WORKERS));
        }
        if self.queue_seconds > hour.as_secs_f64() {
            return Err(out_of_range("queue-seconds", self.queue_seconds, hour.as_secs()));
        }
        let Some(budget) = self.memory_budget else { return Ok(()) };
        if let Some(machine) = machine_memory().filter(|machine| *machine < budget) {
            let machine = format!("{}MiB, what this machine has", machine.0 >> 20);
            return Err(out_of_range("memory-budget", budget, machine));
        }
        if budget < LEAST_BUDGET {
            let variable = variable_of("memory-budget");
            let reason = format!("--memory-budget ({variable}) {budget} is under {LEAST_BUDGET}");
            return Err(format!("{reason}: no picture could be meshed").into());
        }
        Ok(())
    }

    /// Most connections of the public listener.
    #[must_use]
    pub fn max_connections(&self) -> usize {
        let by_memory = || (self.memory_budget().0 >> 19).clamp(1024, 16384) as usize;
        self.limits.max_connections.map_or_else(by_memory, NonZeroUsize::get)
    }

    /// Most of them from one address.
    #[must_use]
    pub fn connections_per_address(&self) -> usize {
        let most = || (self.max_connections() * 3).div_ceil(4);
        self.limits.connections_per_address.map_or_else(most, NonZeroUsize::get)
    }

    /// Most clients that follow events at the same time, of one key's name or of all without keys.
    #[must_use]
    pub fn event_streams(&self) -> usize {
        let is_open = self.access.keys_file.is_none();
        if is_open { self.max_connections() / 2 } else { self.access.key_event_streams.get() }
    }

    /// Which origins and host names are accepted: without keys and without --insecure-no-auth only the
    /// names of this machine.
    #[must_use]
    pub fn visitors(&self) -> Visitors {
        let AccessSettings { cors_origins: origins, allowed_hosts: hosts, .. } = &self.access;
        let is_private = self.access.keys_file.is_none() && !self.insecure_no_auth;
        let hosts = (is_private || !hosts.is_empty()).then(|| hosts.clone());
        Visitors { origins: origins.clone(), hosts }
    }

    /// The settings of a node that only works, after the checks that need more than one of them.
    ///
    /// # Errors
    /// When the queue is none that nodes share.
    pub fn checked_for_work(self) -> Result<Self, Box<dyn Error>> {
        self.check_ranges()?;
        self.jobs.check()?;
        if !self.jobs.queue.is_shared() {
            return Err(
                "a worker needs a queue that nodes share: --queue postgres://HOST:PORT/DATABASE"
                    .into(),
            );
        }
        if self.jobs.no_worker {
            return Err("a worker cannot be told --no-worker".into());
        }
        Ok(self)
    }

    /// Meshes made at the same time.
    #[must_use]
    pub fn worker_count(&self) -> usize {
        self.workers.map_or_else(cores, NonZeroUsize::get)
    }

    /// Where jobs are kept, and what is asked of their queue.
    #[must_use]
    pub fn of_jobs(&self) -> pixmesh_jobs::Settings<'_> {
        let Self { jobs, access, .. } = self;
        let caps = Caps {
            queued: jobs.max_queued_jobs.get(),
            queued_per_owner: access.key_queued_jobs.get(),
            running_per_owner: access.running(self.worker_count()),
            stored_bytes: jobs.max_stored_bytes.map_or(u64::MAX, |size| size.0),
            stored_bytes_per_owner: access.key_stored_bytes.0,
        };
        pixmesh_jobs::Settings {
            data_dir: &jobs.data_dir,
            least_free_bytes: jobs.min_free_space.0,
            queue: &jobs.queue,
            blobs: jobs.blobs.clone(),
            terms: Terms::new(caps, jobs.job_lease.0, jobs.result_ttl.0),
        }
    }

    /// The settings with what is chosen where none is given, and limited where others say so.
    fn in_force(&self) -> Self {
        let mut settings = self.clone();
        settings.workers = NonZeroUsize::new(self.worker_count());
        settings.memory_budget = Some(self.memory_budget());
        settings.limits.max_body = self.longest_body();
        settings.limits.max_connections = NonZeroUsize::new(self.max_connections());
        settings.limits.connections_per_address = NonZeroUsize::new(self.connections_per_address());
        settings.access.key_running = NonZeroUsize::new(self.access.running(self.worker_count()));
        settings
    }

    /// Memory for bodies, work and answers.
    #[must_use]
    pub fn memory_budget(&self) -> ByteSize {
        self.memory_budget.unwrap_or_else(|| container::budget_within(memory_limit()))
    }

    /// Memory for request bodies: a quarter of the budget, in whole KiB.
    #[must_use]
    pub fn body_budget(&self) -> ByteSize {
        let kib = (self.memory_budget().0 / 4 / 1024).max(1);
        ByteSize(kib * 1024)
    }

    /// The longest body that is received: one that all the memory for bodies could not hold would
    /// never be.
    #[must_use]
    pub fn longest_body(&self) -> ByteSize {
        self.limits.max_body.min(self.body_budget())
    }

    /// The setting that makes it no longer.
    #[must_use]
    pub fn setting_of_longest_body(&self) -> &'static str {
        if self.limits.max_body <= self.body_budget() { "--max-body" } else { "--memory-budget" }
    }

    /// Memory for work: what the bodies leave of the budget.
    #[must_use]
    pub fn work_budget(&self) -> ByteSize {
        ByteSize(self.memory_budget().0.saturating_sub(self.body_budget().0))
    }

    /// What work may take of this machine.
    #[must_use]
    pub fn of_scheduler(&self) -> scheduler::Limits {
        let workers = self.worker_count();
        scheduler::Limits {
            workers,
            threads: workers.min(cores()),
            memory_bytes: self.work_budget().0,
            queue_s: self.queue_seconds,
            running_per_key: self.access.running(workers),
            queued_per_key: self.access.key_queued.get(),
        }
    }

    /// The longest time from the end of the upload to the answer.
    #[must_use]
    pub fn deadline(&self) -> Duration {
        self.sync_deadline.0
    }
}

/// The refusal of a setting that is too large.
fn out_of_range(name: &str, value: impl fmt::Display, most: impl fmt::Display) -> Box<dyn Error> {
    format!("--{name} ({}) {value} is over {most}", variable_of(name)).into()
}

/// The environment variable of a setting.
fn variable_of(name: &str) -> String {
    format!("PIXMESH_{}", name.replace('-', "_").to_ascii_uppercase())
}

/// A network, or one address.
fn network(text: &str) -> Result<IpNet, String> {
    let address = || text.parse::<IpAddr>().map(IpNet::from);
    text.parse::<IpNet>()
        .or_else(|_| address())
        .map_err(|_| format!("'{text}' is neither an address nor a network such as 10.0.0.0/8"))
}

/// The processor's cores, or the part of them that a container's quota leaves.
fn cores() -> usize {
    available_parallelism().map_or(1, NonZeroUsize::get)
}

impl JobSettings {
    /// Refuses settings that contradict each other.
    fn check(&self) -> Result<(), Box<dyn Error>> {
        let Self { queue, blobs, .. } = self;
        let (is_shared, queue) = (queue.is_shared(), &queue.queue);
        match (is_shared, *blobs == BlobEngine::File) {
            (true, true) => Err(format!(
                "--blobs file is a store of one node, and --queue {queue} is shared by many: name a \
                 store that all nodes use with --blobs s3://BUCKET or --blobs file:///FOLDER"
            )
            .into()),
            (false, false) => Err(format!(
                "--blobs {blobs} is a store of many nodes, and --queue embedded is the queue of one: \
                 name a shared queue with --queue postgres://HOST:PORT/DATABASE"
            )
            .into()),
            (false, true) if self.no_worker => {
                Err("--no-worker leaves the jobs of --queue embedded undone: name a shared queue \
                     with --queue postgres://HOST:PORT/DATABASE"
                    .into())
            }
            _ if self.job_lease.0 < SHORTEST_LEASE => {
                Err(format!("--job-lease must be {SHORTEST_LEASE:?} or more").into())
            }
            _ => Ok(()),
        }
    }
}

impl Limits {
    /// Those that the codec checks.
    #[must_use]
    pub fn of_pictures(&self) -> pixmesh_codec::Limits {
        pixmesh_codec::Limits { max_pixels: self.max_pixels.get(), max_side: self.max_side.get() }
    }
}

impl fmt::Display for Settings {
    /// One line `--flag value` for each setting in force, without secrets.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let settings = serde_json::to_value(self.in_force()).map_err(|_| fmt::Error)?;
        for (flag, value) in settings.as_object().into_iter().flatten() {
            writeln!(formatter, "--{flag} {}", shown(value))?;
        }
        Ok(())
    }
}

/// A setting as its flag takes it: several values with commas, and nothing for none.
fn shown(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        Value::Array(values) => values.iter().map(shown).collect::<Vec<_>>().join(","),
        Value::Number(number) if number.is_f64() => number.as_f64().unwrap_or_default().to_string(),
        other => other.to_string(),
    }
}

/// Variables of clients, which an operator's shell may have too.
const CLIENT_VARIABLES: [&str; 2] = ["PIXMESH_URL", "PIXMESH_KEY"];
/// How the variables begin that Kubernetes sets in every pod beside a Service named `pixmesh`.
const SERVICE_LINKS: [&str; 2] = ["PIXMESH_SERVICE_", "PIXMESH_PORT"];

/// Refuses variables that look like settings and are none.
///
/// # Errors
/// The first such variable, with the setting that is most like it.
pub fn check_environment(
    variables: impl Iterator<Item = (OsString, OsString)>,
) -> Result<(), Box<dyn Error>> {
    let known = known_variables();
    for (name, _) in variables {
        let name = name.to_string_lossy();
        let is_foreign = CLIENT_VARIABLES.contains(&&*name)
            || SERVICE_LINKS.iter().any(|start| name.starts_with(start));
        if name.starts_with("PIXMESH_") && !is_foreign && !known.iter().any(|known| *known == name)
        {
            let nearest =
                pixmesh_engine::params::nearest_name(&name, known.iter().map(String::as_str));
            return Err(format!(
                "there is no setting {name}: did you mean {}?",
                nearest.unwrap_or("PIXMESH_LISTEN")
            )
            .into());
        }
    }
    Ok(())
}

/// The environment variable that a value comes from which the parser of the command line refused;
/// `None` for a value of the command line.
#[must_use]
pub fn variable_of_error(
    error: &clap::Error,
    mut arguments: impl Iterator<Item = String>,
) -> Option<String> {
    let shown = error.get(ContextKind::InvalidArg)?.to_string();
    let flag = shown.split_whitespace().next()?;
    let variable = variable_of(flag.strip_prefix("--")?);
    let is_given = |argument: String| argument.split('=').next() == Some(flag);
    (!arguments.any(is_given) && known_variables().contains(&variable)).then_some(variable)
}

/// The environment variable of every setting.
fn known_variables() -> Vec<String> {
    #[derive(Parser)]
    struct Declared {
        #[command(flatten)]
        _settings: Settings,
    }
    let command = Declared::command();
    let names = command.get_arguments().filter_map(|argument| argument.get_env());
    names.map(|name| name.to_string_lossy().into_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn environment(name: &str) -> Result<(), String> {
        let variables = [(OsString::from(name), OsString::from("1"))];
        check_environment(variables.into_iter()).map_err(|error| error.to_string())
    }

    #[test]
    fn a_misspelt_variable_is_refused_with_the_nearest_name() {
        assert_eq!(environment("PIXMESH_MAX_BODY"), Ok(()));
        for foreign in ["PATH", "PIXMESH_URL", "PIXMESH_PORT_8080_TCP", "PIXMESH_SERVICE_HOST"] {
            assert_eq!(environment(foreign), Ok(()), "{foreign}");
        }
        let error = environment("PIXMESH_MAXBODY").unwrap_err();
        assert!(error.contains("PIXMESH_MAXBODY") && error.contains("PIXMESH_MAX_BODY"), "{error}");
    }
}
