//! Memory that grows with the number of requests, and a check that would see it.

use crate::client::{send, try_send};
use crate::pictures::disc;
use crate::server::Server;
use std::io::Write;
use std::net::TcpStream;

/// Rounds before memory counts: allocators and pools take theirs at first.
const WARMING_UP: usize = 60;
/// Rounds in each of the measured stretches.
const ROUNDS: usize = 48;
/// Stretches that are measured; the median counts.
const STRETCHES: usize = 5;
/// By how much a stretch may grow without being a leak. The planted leak grows by 3 MiB.
const NOISE_KIB: u64 = 1024;

/// The resident memory of a process in KiB.
fn resident_kib(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

/// By how much a process grows in each stretch of rounds, once it is warm.
fn growth_kib(process: u32, mut round: impl FnMut()) -> Vec<u64> {
    (0..WARMING_UP).for_each(|_| round());
    let mut last = resident_kib(process);
    let mut stretch = || {
        (0..ROUNDS).for_each(|_| round());
        let now = resident_kib(process);
        let grown = now.saturating_sub(last);
        last = now;
        grown
    };
    (0..STRETCHES).map(|_| stretch()).collect()
}

/// Whether a process grows in most of the stretches.
fn leaks(growth_kib: &[u64]) -> bool {
    let mut sorted = growth_kib.to_vec();
    sorted.sort_unstable();
    sorted[sorted.len() / 2] > NOISE_KIB
}

#[test]
fn a_planted_leak_of_a_picture_a_round_is_seen() {
    let server = Server::start(&["--workers", "1", "--body-timeout", "5m"]);
    let mut kept = Vec::new();
    let growth = growth_kib(server.process_id(), || {
        // The least that a request could leak: one small picture, here of a body that never ends.
        let mut stream = TcpStream::connect(server.public).unwrap();
        let head = "POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999\r\n\r\n";
        stream.write_all(&[head.as_bytes(), &[b'x'; 64 * 1024]].concat()).unwrap();
        kept.push(stream);
        assert_eq!(server.get("/nothing").status, 404);
    });
    assert!(leaks(&growth), "{growth:?}");
}

#[test]
fn requests_of_every_kind_leave_no_memory_behind() {
    let server = Server::start(&["--workers", "1", "--result-ttl", "20s"]);
    let (good, broken) = (disc(64, 64, 3), disc(64, 64, 3)[..300].to_vec());
    let growth = growth_kib(server.process_id(), || {
        assert_eq!(server.mesh("format=glb", &[], &good).status, 200);
        assert_eq!(server.mesh("", &[], &broken).status, 422);
        assert_eq!(server.mesh("density=-1", &[], &good).status, 422);
        assert_eq!(server.get("/nothing").status, 404);
        let job = server.job("size=40", &good);
        server.wait_for(&job, "completed");
        assert_eq!(server.get(&format!("{job}/mesh?format=png")).status, 200);
        send(server.public, "DELETE", &job, &[], &[]);
        let _ = try_send(server.public, "BREW", "/v1/meshes", &[], &[]);
        if let Ok(mut stream) = TcpStream::connect(server.public) {
            let _ = stream.write_all(
                b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9999\r\n\r\nP5",
            );
        }
    });
    println!("KiB more in each {ROUNDS} rounds: {growth:?}");
    assert!(!leaks(&growth), "{growth:?}");
}
