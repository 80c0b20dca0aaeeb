//! The program under test as a process of its own, on free ports; killed when dropped. What needs no
//! log, metrics, signals or memory of its own runs in the process of the tests instead
//! (`in_process.rs`).

use crate::client::{Answer, send};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::net::SocketAddr;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

const PROGRAM: &str = env!("CARGO_BIN_EXE_pixmesh");

/// The program, without anything of this environment that could change it.
pub(crate) fn program() -> Command {
    without_settings(Command::new(PROGRAM))
}

/// A command that sees none of the settings in this environment.
fn without_settings(mut command: Command) -> Command {
    for (name, _) in std::env::vars_os() {
        if name.to_string_lossy().starts_with("PIXMESH_") {
            command.env_remove(name);
        }
    }
    command
}

/// A folder of its own for a test's jobs; removed when dropped.
#[derive(Debug)]
pub(crate) struct Folder(PathBuf);

impl Folder {
    pub(crate) fn new() -> Self {
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("jobs-{}-{count}", std::process::id());
        Self(Path::new(env!("CARGO_TARGET_TMPDIR")).join(name))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.0
    }
}

impl Default for Folder {
    fn default() -> Self {
        Self::new()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Asks a service at these addresses.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Client {
    pub(crate) public: SocketAddr,
    pub(crate) operations: SocketAddr,
}

/// A running program.
pub(crate) struct Server {
    child: Child,
    client: Client,
    log: Arc<Mutex<String>>,
    /// Shared by those that are started one after another with the same jobs.
    _folder: Arc<Folder>,
}

impl Server {
    /// Starts the service with flags beside those for the ports.
    pub(crate) fn start(flags: &[&str]) -> Self {
        Self::start_as(program(), flags, Arc::default())
    }

    /// Starts the service with the jobs of one that was started before.
    pub(crate) fn start_in(folder: &Arc<Folder>, flags: &[&str]) -> Self {
        Self::start_as(program(), flags, Arc::clone(folder))
    }

    /// Starts the service where it may open no more than so many files and connections.
    pub(crate) fn start_with_descriptors(count: usize, flags: &[&str]) -> Self {
        let mut shell = without_settings(Command::new("sh"));
        shell.args(["-c", &format!("ulimit -n {count} && exec \"$0\" \"$@\"")]);
        shell.arg(PROGRAM);
        Self::start_as(shell, flags, Arc::default())
    }

    /// Starts the service with a log that nobody reads, in a named pipe that the caller keeps.
    pub(crate) fn start_with_unread_log(pipe: &Path) -> Self {
        let mut shell = without_settings(Command::new("sh"));
        shell.args(["-c", "exec \"$0\" \"$@\" 2>\"$UNREAD_LOG\""]).env("UNREAD_LOG", pipe);
        shell.arg(PROGRAM);
        Self::start_as(shell, &[], Arc::default())
    }

    pub(crate) fn start_as(mut command: Command, flags: &[&str], folder: Arc<Folder>) -> Self {
        let mut child = command
            .args(["serve", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0"])
            .arg("--data-dir")
            .arg(folder.path())
            .args(flags)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let log = follow(child.stderr.take().unwrap());
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut address = |prefix: &str| {
            let line = lines.next().unwrap().unwrap();
            line.strip_prefix(prefix).unwrap().parse().unwrap()
        };
        let public = address("listening on http://");
        let operations = address("operations on http://");
        let client = Client { public, operations };
        let server = Self { child, client, log, _folder: folder };
        server.wait_until("it is ready", || server.operate("/readyz").status == 200);
        server
    }

    /// The value of a metric, by its name with labels; 0 when it was never counted.
    pub(crate) fn metric(&self, name: &str) -> f64 {
        let metrics = self.operate("/metrics").text();
        let line = metrics.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        line.map_or(0.0, |value| value.parse().unwrap())
    }

    /// Waits as [`Client::wait_until`] does, and shows the log when it was in vain.
    #[track_caller]
    pub(crate) fn wait_until(&self, what: &str, holds: impl FnMut() -> bool) {
        wait_until(what, holds, || self.log());
    }

    /// Waits until nothing waits, runs or holds memory.
    #[track_caller]
    pub(crate) fn wait_until_idle(&self) {
        let idle = [
            "pixmesh_requests_in_progress",
            "pixmesh_jobs_in_progress",
            "pixmesh_queue_depth",
            "pixmesh_memory_permits_mib{state=\"used\"}",
        ];
        self.wait_until("it is idle", || idle.iter().all(|name| self.metric(name) == 0.0));
    }

    /// A line of `/proc/<pid>/status` in KiB, such as `VmRSS` or `VmHWM`.
    pub(crate) fn memory_kib(&self, name: &str) -> u64 {
        let status =
            std::fs::read_to_string(format!("/proc/{}/status", self.process_id())).unwrap();
        let line = status.lines().find(|line| line.starts_with(name)).unwrap();
        line.split_whitespace().nth(1).unwrap().parse().unwrap()
    }

    pub(crate) fn process_id(&self) -> u32 {
        self.child.id()
    }

    /// Begins a new peak of memory.
    pub(crate) fn forget_peak(&self) {
        let file = format!("/proc/{}/clear_refs", self.process_id());
        let begun = std::fs::write(&file, "5");
        assert!(begun.is_ok(), "run this test on Linux, where it may write {file}: {begun:?}");
    }

    pub(crate) fn log(&self) -> String {
        self.log.lock().unwrap().clone()
    }

    /// Ends the process as if the machine had failed.
    pub(crate) fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Sends a signal by name, such as `TERM`.
    pub(crate) fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        let sent = Command::new("sh").args(["-c", &format!("kill -{name} {id}")]).status().unwrap();
        assert!(sent.success());
    }

    /// Waits for the end of the process.
    pub(crate) fn wait(&mut self) -> ExitStatus {
        self.child.wait().unwrap()
    }
}

impl Deref for Server {
    type Target = Client;

    fn deref(&self) -> &Client {
        &self.client
    }
}

impl Client {
    /// Sends an image with a query and headers.
    pub(crate) fn mesh(&self, query: &str, headers: &[(&str, &str)], image: &[u8]) -> Answer {
        send(self.public, "POST", &format!("/v1/meshes?{query}"), headers, image)
    }

    /// Submits a job with a query and headers.
    pub(crate) fn submit(&self, query: &str, headers: &[(&str, &str)], image: &[u8]) -> Answer {
        send(self.public, "POST", &format!("/v1/jobs?{query}"), headers, image)
    }

    /// Submits a job that is accepted, and returns where it is.
    #[track_caller]
    pub(crate) fn job(&self, query: &str, image: &[u8]) -> String {
        let answer = self.submit(query, &[], image);
        assert_eq!(answer.status, 202, "{}", answer.text());
        answer.header("location").to_owned()
    }

    /// Waits until a job is in a state, and returns its document.
    #[track_caller]
    pub(crate) fn wait_for(&self, job: &str, state: &str) -> Value {
        let mut document = Value::Null;
        self.wait_until(&format!("{job} is {state}"), || {
            document = self.get(job).json();
            document["state"] == state
        });
        document
    }

    pub(crate) fn get(&self, target: &str) -> Answer {
        send(self.public, "GET", target, &[], &[])
    }

    /// Asks the listener for operations.
    pub(crate) fn operate(&self, target: &str) -> Answer {
        send(self.operations, "GET", target, &[], &[])
    }

    /// Waits until something holds, for 30 s at most: other tests run beside.
    #[track_caller]
    pub(crate) fn wait_until(&self, what: &str, holds: impl FnMut() -> bool) {
        wait_until(what, holds, String::new);
    }
}

#[track_caller]
fn wait_until(what: &str, mut holds: impl FnMut() -> bool, log: impl Fn() -> String) {
    let began = Instant::now();
    while !holds() {
        assert!(began.elapsed() < Duration::from_secs(30), "never: {what}\n{}", log());
        thread::sleep(Duration::from_millis(10));
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        if !thread::panicking() {
            assert!(!self.log().contains("panicked"), "{}", self.log());
        }
    }
}

/// Collects what the process logs.
fn follow(mut output: impl Read + Send + 'static) -> Arc<Mutex<String>> {
    let log = Arc::new(Mutex::new(String::new()));
    let shared = Arc::clone(&log);
    thread::spawn(move || {
        let mut buffer = [0; 4096];
        while let Ok(count @ 1..) = output.read(&mut buffer) {
            shared.lock().unwrap().push_str(&String::from_utf8_lossy(&buffer[..count]));
        }
    });
    log
}
