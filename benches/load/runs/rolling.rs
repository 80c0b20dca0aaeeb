//! Two processes behind a proxy, restarted in turns: requests go on.

use super::capacity::rate;
use super::{Setting, workers};
use crate::driver::{Outcome, Stream, open_loop};
use crate::report::Result;
use crate::row;
use crate::server::{Folder, Server};
use crate::work::Work;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Seconds of the run, and between two restarts.
const PERIOD_S: f64 = 300.0;
const BETWEEN_S: f64 = 20.0;
/// What is offered, in multiples of the capacity of both together.
const LOAD: f64 = 0.6;

/// HAProxy before two processes, whose places it can be told while it runs.
struct Proxy {
    child: Child,
    address: SocketAddr,
    socket: PathBuf,
    _folder: Folder,
}

impl Proxy {
    /// Starts it before two processes; `None` where there is none.
    fn start(servers: &[Server; 2]) -> Option<Self> {
        let folder = Folder::new();
        std::fs::create_dir_all(folder.path()).unwrap();
        let socket = PathBuf::from(format!("/tmp/pixmesh-load-{}.sock", std::process::id()));
        let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let places: String = servers
            .iter()
            .enumerate()
            .map(|(number, server)| {
                let (public, check) = (server.public, server.operations.port());
                format!(
                    "    server s{number} {public} check port {check} inter 200ms fall 1 rise 1\n"
                )
            })
            .collect();
        let settings = format!(
            "global\n    stats socket {} level admin\ndefaults\n    mode http\n    \
             timeout connect 2s\n    timeout client 60s\n    timeout server 60s\n    retries 3\n    \
             option redispatch 1\n    retry-on conn-failure\nfrontend public\n    bind {address}\n    \
             default_backend pool\nbackend pool\n    option httpchk GET /readyz\n{places}",
            socket.display()
        );
        let path = folder.path().join("haproxy.cfg");
        std::fs::write(&path, settings).unwrap();
        let mut command = Command::new("haproxy");
        command.arg("-db").arg("-f").arg(path).stdout(Stdio::null()).stderr(Stdio::null());
        let child = command.spawn().ok()?;
        let proxy = Self { child, address, socket, _folder: folder };
        let began = Instant::now();
        while std::net::TcpStream::connect(address).is_err() {
            assert!(began.elapsed() < Duration::from_secs(10), "the proxy does not start");
            thread::sleep(Duration::from_millis(20));
        }
        Some(proxy)
    }

    /// Tells it where a process is now.
    fn replace(&self, number: usize, server: &Server) {
        let (public, check) = (server.public, server.operations);
        let name = format!("pool/s{number}");
        self.tell(&format!("set server {name} check-port {}", check.port()));
        self.tell(&format!("set server {name} addr {} port {}", public.ip(), public.port()));
    }

    fn tell(&self, command: &str) {
        let mut stream = UnixStream::connect(&self.socket).unwrap();
        writeln!(stream, "{command}").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_file(&self.socket);
    }
}

pub(super) fn run(setting: &Setting) -> Result {
    let mut servers = [Server::start(&[]), Server::start(&[])];
    let Some(proxy) = Proxy::start(&servers) else {
        let notes = vec!["Not run: haproxy is missing.".into()];
        return Result { notes, ..Result::default() };
    };
    let work = Work::usual();
    let capacity = rate(&servers[0], &work, 2 * workers(), setting.period(60.0)).rate;
    let per_second = (LOAD * capacity).max(0.5);
    let period = setting.period(PERIOD_S).max(Duration::from_secs(20));
    let between = period.mul_f64(BETWEEN_S / PERIOD_S).max(Duration::from_secs(4));
    let (is_over, mut restarts) = (AtomicBool::new(false), 0);
    let outcomes = thread::scope(|scope| {
        let (proxy, work, is_over) = (&proxy, &work, &is_over);
        let load = scope.spawn(move || {
            let make = |number| work.request(number);
            let stream = Stream { address: proxy.address, per_second, make: &make };
            let outcomes = open_loop(&[stream], period).remove(0);
            is_over.store(true, Ordering::Relaxed);
            outcomes
        });
        while !is_over.load(Ordering::Relaxed) {
            thread::sleep(between);
            restart(proxy, &mut servers, restarts % 2);
            restarts += 1;
        }
        load.join().unwrap()
    });
    let is_failure = |outcome: &&Outcome| match &outcome.answer {
        Some(answer) if answer.status == 503 => answer.header("retry-after").is_empty(),
        answer => answer.as_ref().is_none_or(|answer| answer.status != 200),
    };
    let failures = outcomes.iter().filter(is_failure).count();
    let count = |status: u16| outcomes.iter().filter(|it| it.status() == status).count();
    Result {
        figures: vec![("S11".into(), failures as f64)],
        rows: vec![
            row!["requests", "restarts", "200", "503", "failures"],
            row![outcomes.len(), restarts, count(200), count(503), failures],
        ],
        notes: vec![
            "Behind HAProxy; a new process is ready before an old one is told to stop.".into(),
        ],
        ..Result::default()
    }
}

/// Replaces one process by a new one, and lets the old one end in peace.
fn restart(proxy: &Proxy, servers: &mut [Server; 2], number: usize) {
    let new = Server::start(&[]);
    proxy.replace(number, &new);
    let mut old = std::mem::replace(&mut servers[number], new);
    old.signal("TERM");
    assert!(old.wait().success());
}
