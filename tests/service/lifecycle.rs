//! From start to stop: settings, readiness, signals.

use crate::client::{assert_median_within, connect};
use crate::pictures::{disc, noise};
use crate::server::{Server, program};
use std::net::TcpStream;
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
fn health_asks_a_running_service() {
    let server = Server::start(&[]);
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
    refused(&[], Some(("PIXMESH_MAX_BODY", "lots")), "lots");
    for flag in [
        "--max-body",
        "--max-pixels",
        "--max-side",
        "--memory-budget",
        "--workers",
        "--queue-seconds",
        "--sync-deadline",
        "--header-timeout",
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
}

#[test]
fn the_log_can_be_json_with_the_request_id_and_the_stages() {
    let server = Server::start(&["--log-format", "json"]);
    let headers = [("X-Request-ID", "trace-me")];
    assert_eq!(server.mesh("", &headers, &disc(30, 30, 3)).status, 200);
    server.wait_until("the answer is logged", || server.log().contains("answered"));
    let log = server.log();
    let lines: Vec<serde_json::Value> =
        log.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let meshed = lines.iter().find(|line| line["message"] == "meshed").unwrap();
    assert_eq!(meshed["span"]["id"], "trace-me", "{meshed}");
    assert!(meshed["stages"].as_str().unwrap().contains("simplify;dur="), "{meshed}");
}
