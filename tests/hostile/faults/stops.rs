//! SIGTERM in every state.

use super::{SLOW, wait_long_for};
use crate::client::connect;
use crate::pictures::{disc, flat, noise};
use crate::server::{Folder, Server, program};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The longest time that a stop may take.
const IN_TIME: Duration = Duration::from_secs(30);

fn begin(server: &Server, head: &str, body: &[u8]) -> TcpStream {
    let mut stream = connect(server.public);
    stream.write_all(&[head.as_bytes(), body].concat()).unwrap();
    stream
}

fn post(target: &str, length: usize) -> String {
    format!("POST {target} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n\r\n")
}

/// Brings the service into a state, and returns the connection that keeps it there.
type Enter = fn(&Server) -> Option<TcpStream>;

/// The states, and what the client of each sees in the end, if anything.
const STATES: [(&str, Enter, &[&str]); 8] = [
    ("idle", |_| None, &[]),
    ("an idle connection", |server| Some(connect(server.public)), &[""]),
    ("half a header", |server| Some(begin(server, "POST /v1/me", b"")), &["", "HTTP/1.1 408"]),
    (
        "half a body",
        |server| Some(begin(server, &post("/v1/meshes", 1000), b"P5")),
        &["HTTP/1.1 503", "HTTP/1.1 408"],
    ),
    (
        "work",
        |server| {
            let image = noise(700);
            let stream = begin(server, &post(&format!("/v1/meshes?{SLOW}"), image.len()), &image);
            server.wait_until("it runs", || server.metric("pixmesh_jobs_in_progress") == 1.0);
            Some(stream)
        },
        &["HTTP/1.1 200", "HTTP/1.1 503"],
    ),
    (
        "an answer that is not read",
        |server| {
            let image = flat(1500, 1500);
            let stream = begin(
                server,
                &post("/v1/meshes?method=med&size=4&format=pnm", image.len()),
                &image,
            );
            server
                .wait_until("it is answered", || server.metric("pixmesh_jobs_in_progress") == 0.0);
            Some(stream)
        },
        &["HTTP/1.1 200", "HTTP/1.1 503"],
    ),
    (
        "a job",
        |server| {
            let job = server.job(SLOW, &noise(700));
            server.wait_for(&job, "running");
            None
        },
        &[],
    ),
    (
        "followed events",
        |server| {
            let job = server.job(SLOW, &noise(700));
            Some(begin(
                server,
                &format!("GET {job}/events HTTP/1.1\r\nHost: localhost\r\n\r\n"),
                b"",
            ))
        },
        &["HTTP/1.1 200"],
    ),
];

#[test]
fn sigterm_in_any_state_ends_the_process_in_time_and_in_order() {
    for (state, enter, expected) in STATES {
        let folder: Arc<Folder> = Arc::default();
        let flags = ["--workers", "1", "--body-timeout", "3s", "--header-timeout", "3s"];
        let mut server = Server::start_in(&folder, &flags);
        let client = enter(&server);
        let jobs = server.get("/v1/jobs").json();
        server.signal("TERM");
        let began = Instant::now();
        // An answer that nobody reads would hold the stop up for as long as it may.
        if let Some(mut client) = client {
            let mut seen = Vec::new();
            let _ = client.read_to_end(&mut seen);
            let start = String::from_utf8_lossy(&seen[..seen.len().min(12)]).into_owned();
            assert!(expected.contains(&start.as_str()), "{state}: {start:?}");
        }
        assert_eq!(server.wait().code(), Some(0), "{state}: {}", server.log());
        assert!(began.elapsed() < IN_TIME, "{state}: {:?}", began.elapsed());
        server.wait_until("the log says so", || server.log().contains("stopped"));
        drop(server);
        let server = Server::start_in(&folder, &flags);
        for job in jobs["jobs"].as_array().unwrap() {
            let path = job["links"]["self"].as_str().unwrap();
            assert_eq!(wait_long_for(&server, path, "completed")["attempt"], 1, "{state}");
        }
    }
}

#[test]
fn sigterm_at_any_moment_of_the_start_leaves_a_folder_that_can_be_used() {
    let folder: Arc<Folder> = Arc::default();
    for delay_ms in [0, 1, 3, 6, 10, 15, 25, 40, 80] {
        let mut child = program()
            .args(["serve", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0"])
            .arg("--data-dir")
            .arg(folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(delay_ms));
        let sent = Command::new("sh").args(["-c", &format!("kill -TERM {}", child.id())]).status();
        assert!(sent.unwrap().success());
        let began = Instant::now();
        child.wait().unwrap();
        assert!(began.elapsed() < IN_TIME);
    }
    let server = Server::start_in(&folder, &[]);
    let job = server.job("size=20", &disc(30, 30, 1));
    server.wait_for(&job, "completed");
}
