//! Nodes: processes of the program under test, killed when dropped.

use crate::client::{Answer, connect, send};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::SocketAddr;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

const PROGRAM: &str = env!("CARGO_BIN_EXE_pixmesh");
/// The longest wait for a condition.
const PATIENCE: Duration = Duration::from_secs(60);

/// The program, without any setting of this environment.
pub(crate) fn program() -> Command {
    let mut command = Command::new(PROGRAM);
    for (name, _) in std::env::vars_os() {
        let name = name.to_string_lossy();
        if name.starts_with("PIXMESH_") || name.starts_with("AWS_") {
            command.env_remove(name.as_ref());
        }
    }
    command
}

/// A process.
pub(crate) struct Node {
    child: Child,
    /// The address for requests; of a worker, the address for operations.
    pub(crate) public: SocketAddr,
    pub(crate) operations: SocketAddr,
    log: Arc<Mutex<String>>,
}

impl Node {
    /// One that takes requests and does no jobs.
    pub(crate) fn serve(command: Command, queue: &str, flags: &[&str]) -> Self {
        let node = Self::start(command, "serve", queue, &[&["--no-worker"], flags].concat());
        node.wait_until("it is ready", || node.operate("/readyz").status == 200);
        node
    }

    /// A worker with one slot.
    pub(crate) fn work(command: Command, queue: &str, flags: &[&str]) -> Self {
        let node = Self::start(command, "worker", queue, &[&["--workers", "1"], flags].concat());
        node.wait_until("it is ready", || node.operate("/readyz").status == 200);
        node
    }

    /// A node of either kind, as soon as it listens.
    pub(crate) fn start(mut command: Command, role: &str, queue: &str, flags: &[&str]) -> Self {
        let mut child = command
            .arg(role)
            .args(["--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0", "--queue", queue])
            .args(flags)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let log = follow(child.stderr.take().unwrap());
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut address = |prefix: &str| -> SocketAddr {
            let line = lines.next().unwrap_or_else(|| panic!("{}", log.lock().unwrap())).unwrap();
            line.strip_prefix(prefix).unwrap().parse().unwrap()
        };
        let public = (role == "serve").then(|| address("listening on http://"));
        let operations = address("operations on http://");
        Self { child, public: public.unwrap_or(operations), operations, log }
    }

    pub(crate) fn get(&self, target: &str) -> Answer {
        send(self.public, "GET", target, &[], &[])
    }

    /// The whole text of an answer that ends with its connection, with the frames of its chunks.
    pub(crate) fn stream(&self, target: &str) -> String {
        let mut connection = connect(self.public);
        let head = format!("GET {target} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
        connection.write_all(head.as_bytes()).unwrap();
        let mut text = String::new();
        connection.read_to_string(&mut text).unwrap();
        text
    }

    pub(crate) fn operate(&self, target: &str) -> Answer {
        send(self.operations, "GET", target, &[], &[])
    }

    pub(crate) fn submit(&self, query: &str, headers: &[(&str, &str)], image: &[u8]) -> Answer {
        send(self.public, "POST", &format!("/v1/jobs?{query}"), headers, image)
    }

    /// Submits a job that is accepted, and returns where it is.
    #[track_caller]
    pub(crate) fn job(&self, query: &str, image: &[u8]) -> String {
        let answer = self.submit(query, &[], image);
        assert_eq!(answer.status, 202, "{}\n{}", answer.text(), self.log());
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

    /// Waits until something holds.
    #[track_caller]
    pub(crate) fn wait_until(&self, what: &str, mut holds: impl FnMut() -> bool) {
        let began = Instant::now();
        while !holds() {
            assert!(began.elapsed() < PATIENCE, "never: {what}\n{}", self.log());
            thread::sleep(Duration::from_millis(20));
        }
    }

    pub(crate) fn log(&self) -> String {
        self.log.lock().unwrap().clone()
    }

    /// The number of completed jobs in its log.
    pub(crate) fn completions(&self) -> usize {
        self.log().matches("state=\"completed\"").count()
    }

    /// Stops the process without ending it, as if its machine hung.
    pub(crate) fn pause(&self) {
        kill_process(Pid::from_child(&self.child), Signal::STOP).unwrap();
    }

    /// Continues a paused process.
    pub(crate) fn resume(&self) {
        kill_process(Pid::from_child(&self.child), Signal::CONT).unwrap();
    }

    /// Ends the process as if the machine had failed.
    pub(crate) fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        if !thread::panicking() {
            assert!(!self.log().contains("panicked"), "{}", self.log());
        }
    }
}

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
