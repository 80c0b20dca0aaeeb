//! From start to stop: settings, readiness, signals.

use crate::client::{assert_median_within, connect, receive, send};
use crate::in_process::Service;
use crate::pictures::{disc, noise};
use crate::server::{Folder, Server, program};
use serde_json::Value;
use std::fs::{self, File};
use std::io::Write;
use std::net::TcpStream;
use std::process::Command;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

#[test]
fn sigterm_lets_running_work_end_and_exits_0() {
    let mut server = Server::start(&["--workers", "1"]);
    let image = noise(512);
    let (public, operations) = (server.public, server.operations);
    let idle = connect(public);
    thread::scope(|scope| {
        let running = scope.spawn(|| server.mesh("method=mgpr&density=1", &[], &image));
        server.wait_until("it runs", || server.metric("pixmesh_jobs_in_progress") == 1.0);
        server.signal("TERM");
        server.wait_until("it is not ready", || server.operate("/readyz").status == 503);
        server.operate("/readyz").problem(503, "shutting-down");
        assert_eq!(server.operate("/livez").status, 200);
        server.wait_until("it takes no more", || TcpStream::connect(public).is_err());
        let answer = running.join().unwrap();
        assert_eq!(answer.status, 200, "{}", answer.text());
    });
    let began = Instant::now();
    assert_eq!(server.wait().code(), Some(0));
    assert!(began.elapsed() < Duration::from_secs(15), "{:?}", began.elapsed());
    assert!(TcpStream::connect(operations).is_err());
    assert!(server.log().contains("stopped"));
    drop(idle);
}

#[test]
fn sigint_stops_an_idle_service_at_once() {
    assert_median_within(Duration::from_secs(2), || {
        let mut server = Server::start(&[]);
        let began = Instant::now();
        server.signal("INT");
        assert_eq!(server.wait().code(), Some(0));
        began.elapsed()
    });
}

#[test]
fn a_hangup_stops_nothing_and_a_second_signal_waits_for_nothing() {
    let mut server = Server::start(&["--workers", "1"]);
    server.signal("HUP");
    server.wait_until("it says so", || server.log().contains("SIGHUP ignored"));
    let image = noise(1400);
    let job = server.job("method=mgpr&density=1", &image);
    server.wait_for(&job, "running");
    let public = server.public;
    let request = thread::spawn(move || {
        send(public, "POST", "/v1/meshes?method=mgpr&density=1", &[], &image)
    });
    server.wait_until("it waits", || server.metric("pixmesh_requests_in_progress") >= 1.0);
    let began = Instant::now();
    server.signal("TERM");
    server.wait_until("it is not ready", || server.operate("/readyz").status == 503);
    server.signal("TERM");
    assert_eq!(server.wait().code(), Some(0));
    assert!(began.elapsed() < Duration::from_secs(10), "{:?}", began.elapsed());
    request.join().unwrap().problem(503, "shutting-down");
}

#[test]
fn a_log_that_nobody_reads_stops_nothing() {
    let folder = Folder::new();
    fs::create_dir_all(folder.path()).unwrap();
    let pipe = folder.path().join("log");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    // Open for both, so that the other end need not be open yet.
    let unread = File::options().read(true).write(true).open(&pipe).unwrap();
    let mut server = Server::start_with_unread_log(&pipe);
    let mut stream = connect(server.public);
    for _ in 0..12_000 {
        stream.write_all(b"GET /v1/methods HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        assert_eq!(receive(&mut stream, Instant::now()).status, 200);
    }
    assert_eq!(server.operate("/readyz").status, 200);
    assert!(server.metric("pixmesh_log_lines_dropped_total") > 0.0);
    server.kill();
    drop(unread);
}

#[test]
fn the_log_says_why_and_for_whom_a_request_was_refused() {
    let server = Server::start(&["--log-format", "json", "--trusted-proxies", "127.0.0.0/8"]);
    let headers = [("X-Forwarded-For", "6.6.6.6, 192.0.2.7")];
    server.mesh("density=101", &headers, &disc(20, 20, 1)).problem(422, "parameter-out-of-range");
    let line = || {
        let log = server.log();
        let line = log.lines().find(|line| line.contains("\"code\":422"));
        line.map(|line| serde_json::from_str::<Value>(line).unwrap())
    };
    server.wait_until("it is logged", || line().is_some());
    let line = line().unwrap();
    assert_eq!(
        (&line["problem"], &line["param"]),
        (&"parameter-out-of-range".into(), &"density".into())
    );
    assert_eq!((&line["peer"], &line["forwarded"]), (&"127.0.0.1".into(), &"192.0.2.7".into()));
    assert!(line["received"].as_u64().unwrap() > 0, "{line}");
    let level =
        |level: &str| send(server.operations, "PUT", &format!("/log-level/{level}"), &[], &[]);
    level("loud").problem(422, "unknown-value");
    assert_eq!(level("warn").status, 204);
    server.wait_until("it is told", || server.log().contains("log level changed"));
    assert_eq!(server.get("/v1/methods").status, 200);
    assert_eq!(level("info").status, 204);
    assert_eq!(server.get("/v1/nothing").status, 404);
    server.wait_until("it is logged again", || server.log().contains("not-found"));
    assert!(!server.log().contains("\"code\":200,"), "{}", server.log());
}

#[test]
fn health_asks_a_running_service() {
    let server = Service::start(&[]);
    let ask = |address: String| {
        program().args(["health", "--ops-listen", &address]).output().unwrap().status.code()
    };
    assert_eq!(ask(server.operations.to_string()), Some(0));
    assert_eq!(ask(server.public.to_string()), Some(1), "that listener has no /readyz");
    let operations = server.operations.to_string();
    drop(server);
    assert_eq!(ask(operations), Some(1));
}

#[test]
fn a_wrong_setting_stops_the_start_with_a_reason() {
    let refused = |flags: &[&str], variable: Option<(&str, &str)>, reason: &str| {
        let mut command = program();
        command.arg("serve").args(["--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0"]);
        let output = command.args(flags).envs(variable).output().unwrap();
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains(reason), "{flags:?}: {message}");
        assert!(output.stdout.is_empty(), "it never listens");
    };
    refused(&["--max-bdoy", "1MiB"], None, "--max-body");
    refused(&[], Some(("PIXMESH_MAX_BDOY", "1MiB")), "PIXMESH_MAX_BODY");
    refused(&[], Some(("PIXMESH_MAX_BODY", "lots")), "PIXMESH_MAX_BODY is wrong");
    refused(&[], Some(("PIXMESH_WORKERS", "100000")), "(PIXMESH_WORKERS) 100000 is over 1024");
    refused(&["--memory-budget", "99999GiB"], None, "is over");
    refused(&["--memory-budget", "1"], None, "is under 4MiB");
    for flag in ["--sync-deadline", "--header-timeout", "--job-deadline", "--result-ttl"] {
        refused(&[flag, "1000000h"], None, flag);
    }
    for flag in [
        "--max-body",
        "--max-pixels",
        "--max-side",
        "--memory-budget",
        "--workers",
        "--queue-seconds",
        "--sync-deadline",
        "--header-timeout",
        "--keep-alive-timeout",
        "--max-stored-bytes",
        "--min-free-space",
        "--body-timeout",
        "--max-connections",
        "--job-deadline",
        "--result-ttl",
        "--max-queued-jobs",
    ] {
        refused(&[flag, "0"], None, flag);
    }
    let elsewhere = program().args(["serve", "--listen", "0.0.0.0:0"]).output().unwrap();
    let message = String::from_utf8_lossy(&elsewhere.stderr).into_owned();
    assert!(!elsewhere.status.success() && message.contains("--insecure-no-auth"), "{message}");
}

#[test]
fn a_second_service_is_refused_the_folder_of_the_first() {
    let folder = Arc::default();
    let first = Server::start_in(&folder, &[]);
    let second = || {
        let mut command = program();
        command.args(["serve", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0"]);
        command.arg("--data-dir").arg(folder.path()).output().unwrap()
    };
    let message = String::from_utf8_lossy(&second().stderr).into_owned();
    assert!(message.contains("--data-dir") && message.contains("another process"), "{message}");
    assert_eq!(first.get("/v1/jobs").status, 200);
    drop(first);
    Server::start_in(&folder, &[]);
}

#[test]
fn a_folder_that_cannot_be_used_stops_the_start_with_a_reason() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml");
    for folder in [file.to_owned(), format!("{file}/below"), "/proc/jobs".to_owned()] {
        let output = program().args(["serve", "--data-dir", &folder]).output().unwrap();
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains(&folder), "{message}");
    }
    let refused = program().args(["serve", "--queue", "carrier-pigeon"]).output().unwrap();
    assert!(!refused.status.success());
}

#[test]
fn config_prints_the_settings_in_force() {
    let output = program()
        .args(["config", "--max-body", "2MiB"])
        .env("PIXMESH_WORKERS", "3")
        .env("PIXMESH_MAX_BODY", "1MiB")
        .output()
        .unwrap();
    let settings = String::from_utf8(output.stdout).unwrap();
    assert!(settings.contains("--workers 3\n"), "{settings}");
    assert!(settings.contains("--max-body 2MiB\n"), "the flag wins: {settings}");
    assert!(settings.contains("--queue-seconds 10\n"), "{settings}");
    let small = program().args(["config", "--memory-budget", "40MiB"]).output().unwrap();
    let settings = String::from_utf8(small.stdout).unwrap();
    assert!(settings.contains("--max-body 10MiB\n"), "no more is in force: {settings}");
    assert!(settings.contains("--max-connections 1024\n"), "{settings}");
    let large = program().args(["config", "--memory-budget", "2GiB"]).output().unwrap();
    let settings = String::from_utf8(large.stdout).unwrap();
    assert!(settings.contains("--max-connections 4096\n"), "two for each MiB: {settings}");
}

#[test]
fn the_log_can_be_json_with_the_request_id_and_the_stages() {
    let server = Server::start(&["--log-format", "json"]);
    let headers = [("X-Request-ID", "trace-me")];
    assert_eq!(server.mesh("", &headers, &disc(30, 30, 3)).status, 200);
    server.wait_until("the answer is logged", || server.log().contains("answered"));
    let log = server.log();
    let lines: Vec<Value> = log.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let meshed = lines.iter().find(|line| line["message"] == "meshed").unwrap();
    assert_eq!(meshed["span"]["id"], "trace-me", "{meshed}");
    assert!(meshed["stages"].as_str().unwrap().contains("simplify;dur="), "{meshed}");
}
