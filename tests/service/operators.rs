//! What operators use: the self-test, the settings in force, and traces.

use crate::client::{assert_median_within, connect, send};
use crate::pictures::disc;
use crate::server::{Folder, Server, program};
use std::io::{Read, Write};
use std::net::TcpListener;
use std::process::Output;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

fn doctor(flags: &[&str]) -> Output {
    let free = ["doctor", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0"];
    let folder = concat!(env!("CARGO_TARGET_TMPDIR"), "/doctor");
    program().args(free).env("PIXMESH_DATA_DIR", folder).args(flags).output().unwrap()
}

#[test]
fn the_doctor_finds_a_good_installation_well() {
    let folder = Folder::new();
    let missing = folder.path().join("missing");
    let path = missing.to_str().unwrap();
    let output = doctor(&["--memory-budget", "256MiB", "--workers", "1", "--data-dir", path]);
    let findings = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{findings}");
    assert_eq!(findings.lines().filter(|line| line.starts_with("ok ")).count(), 11, "{findings}");
    assert!(!missing.exists(), "it leaves nothing behind");
    for fact in ["mgprfs", "independent library", "MODEL", "is free", "can be written to"] {
        assert!(findings.contains(fact), "{fact}: {findings}");
    }
}

#[test]
fn the_doctor_says_what_is_wrong() {
    let bad = |flags: &[&str], reason: &str| {
        let output = doctor(flags);
        let findings = String::from_utf8(output.stdout).unwrap();
        assert_eq!(output.status.code(), Some(1), "{findings}");
        let found = findings.lines().any(|line| line.starts_with("BAD ") && line.contains(reason));
        assert!(found, "{reason}: {findings}");
    };
    let held = TcpListener::bind("127.0.0.1:0").unwrap();
    let held_address = held.local_addr().unwrap().to_string();
    let output = program()
        .args(["doctor", "--listen", &held_address, "--ops-listen", "127.0.0.1:0"])
        .output()
        .unwrap();
    assert!(String::from_utf8(output.stdout).unwrap().contains("is in use"));
    bad(&["--memory-budget", "100000GiB"], "--memory-budget");
    bad(&["--workers", "10000"], "--workers");
    bad(&["--data-dir", "/proc/nowhere"], "--data-dir");
    bad(&["--keys-file", "/nowhere"], "--keys-file");
}

#[test]
fn no_command_shows_a_secret() {
    let headers = "authorization=Bearer very-secret";
    for command in ["config", "serve --help", "doctor --help"] {
        let output = program()
            .args(command.split(' '))
            .env("PIXMESH_OTLP_HEADERS", headers)
            .env("PIXMESH_OTLP_ENDPOINT", "http://127.0.0.1:4318")
            .output()
            .unwrap();
        let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
        assert!(output.status.success() && !text.contains("very-secret"), "{text}");
        assert!(command != "config" || text.contains("--otlp-headers (hidden)\n"), "{text}");
    }
    let output =
        program().args(["config", "--otlp-endpoint", "http://user:word@host:1"]).output().unwrap();
    assert!(!output.status.success(), "a password is no part of an address");
}

#[test]
fn traces_reach_a_collector_with_the_callers_span_and_the_stages() {
    let collector = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", collector.local_addr().unwrap());
    let (batches, received) = mpsc::channel();
    thread::spawn(move || {
        for connection in collector.incoming() {
            let mut connection = connection.unwrap();
            let mut bytes = Vec::new();
            let mut buffer = [0; 65536];
            while !is_whole(&bytes) {
                let count = connection.read(&mut buffer).unwrap();
                bytes.extend_from_slice(&buffer[..count]);
            }
            let _ = connection.write_all(b"HTTP/1.1 200 OK\r\ncontent-length: 0\r\n\r\n");
            let _ = batches.send(bytes);
        }
    });
    let flags = ["--otlp-endpoint", &address, "--otlp-headers", "x-token=abc"];
    let mut server = Server::start(&flags);
    let caller = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";
    let image = disc(40, 40, 3);
    let headers = [("traceparent", caller)];
    assert_eq!(send(server.public, "POST", "/v1/meshes", &headers, &image).status, 200);
    server.signal("TERM");
    assert!(server.wait().success());
    let words = ["POST /v1/traces", "x-token: abc", "pixmesh", "request", "/v1/meshes", "simplify"];
    let trace = [0x0a, 0xf7, 0x65, 0x19, 0x16, 0xcd, 0x43, 0xdd];
    let span = [0xb7, 0xad, 0x6b, 0x71, 0x69, 0x20, 0x33, 0x31];
    let parts: Vec<&[u8]> =
        words.iter().map(|word| word.as_bytes()).chain([&trace[..], &span]).collect();
    let mut sent = Vec::new();
    let misses = |sent: &[u8]| {
        let holds = |part: &[u8]| sent.windows(part.len()).any(|seen| seen == part);
        parts
            .iter()
            .find(|part| !holds(part))
            .map(|part| String::from_utf8_lossy(part).into_owned())
    };
    while let Some(part) = misses(&sent) {
        match received.recv_timeout(Duration::from_secs(30)) {
            Ok(batch) => sent.extend(batch),
            Err(_) => panic!("{part} is not in {}", String::from_utf8_lossy(&sent)),
        }
    }
}

/// Whether all of a request has come that announces its length.
fn is_whole(bytes: &[u8]) -> bool {
    let Some(end) = bytes.windows(4).position(|window| window == b"\r\n\r\n") else {
        return false;
    };
    let head = String::from_utf8_lossy(&bytes[..end]).to_ascii_lowercase();
    let length = head.lines().find_map(|line| line.strip_prefix("content-length: "));
    bytes.len() >= end + 4 + length.map_or(0, |length| length.parse().unwrap())
}

#[test]
fn a_collector_that_is_not_there_holds_up_nothing() {
    let mut server = Server::start(&["--otlp-endpoint", "http://127.0.0.1:9"]);
    assert_median_within(Duration::from_secs(2), || {
        let answer = server.mesh("", &[], &disc(30, 30, 1));
        assert_eq!(answer.status, 200);
        answer.took
    });
    drop(connect(server.public));
    server.signal("TERM");
    assert!(server.wait().success());
}
