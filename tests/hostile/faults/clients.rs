//! Clients by the thousand, slow ones and such that vanish, and more work than there is memory.

use crate::client::{connect, try_send};
use crate::pictures::{disc, noise};
use crate::server::Server;
use std::io::Write;
use std::net::TcpStream;
use std::thread;
use std::time::Duration;

/// How far clients get before they vanish.
const PARTS: [&[u8]; 6] = [
    b"",
    b"POST /v1/mes",
    b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\n",
    b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100000\r\n\r\nP5",
    b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n400\r\nP5",
    b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n",
];

#[test]
fn thousands_of_clients_that_vanish_leave_nothing_behind() {
    let server = Server::start(&["--body-timeout", "2s", "--header-timeout", "2s"]);
    let image = disc(40, 40, 1);
    let wave = || {
        thread::scope(|scope| {
            for thread in 0..8 {
                let (server, image) = (&server, &image);
                scope.spawn(move || {
                    for n in 0..250 {
                        let Ok(mut stream) = TcpStream::connect(server.public) else { continue };
                        let _ = stream.write_all(PARTS[(n + thread) % PARTS.len()]);
                        if n % 50 == 0 {
                            try_send(server.public, "POST", "/v1/meshes", &[], image);
                        }
                    }
                });
            }
        });
        server.wait_until_idle();
    };
    wave();
    let (before_kib, open) = (server.memory_kib("VmRSS"), server.metric("process_open_fds"));
    for _ in 0..2 {
        wave();
        assert_eq!(server.operate("/livez").status, 200);
    }
    let grown_kib = server.memory_kib("VmRSS").saturating_sub(before_kib);
    assert!(grown_kib < 32 * 1024, "{grown_kib} KiB more after 4000 clients");
    server.wait_until("all connections are closed", || {
        server.metric("process_open_fds") <= open + 16.0
    });
    assert_eq!(server.mesh("", &[], &image).status, 200);
}

#[test]
fn hundreds_of_slow_clients_hold_up_nobody() {
    let server = Server::start(&["--workers", "1", "--body-timeout", "5s"]);
    let head = b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100000\r\n\r\n";
    let mut slow: Vec<TcpStream> = (0..400).map(|_| connect(server.public)).collect();
    for stream in &mut slow {
        stream.write_all(head).unwrap();
    }
    let image = disc(40, 40, 1);
    let mut times: Vec<Duration> = (0..10)
        .map(|_| {
            for stream in &mut slow {
                let _ = stream.write_all(b"x");
            }
            let answer = server.mesh("", &[], &image);
            assert_eq!(answer.status, 200);
            answer.took
        })
        .collect();
    times.sort();
    // One or two may fall into a moment in which the machine does something else.
    assert!(times[7] < Duration::from_secs(2), "{times:?}");
    drop(slow);
    server.wait_until_idle();
}

#[test]
fn more_work_than_there_is_memory_for_is_refused_and_the_rest_is_served() {
    let flags = ["--memory-budget", "96MiB", "--queue-seconds", "1", "--sync-deadline", "15s"];
    let server = Server::start(&flags);
    let image = noise(300);
    let answers = thread::scope(|scope| {
        let send = || server.mesh("method=mgpr&density=1", &[], &image);
        let clients: Vec<_> = (0..24).map(|_| scope.spawn(send)).collect();
        clients.into_iter().map(|client| client.join().unwrap()).collect::<Vec<_>>()
    });
    let served = answers.iter().filter(|answer| answer.status == 200).count();
    assert!(served > 0);
    for answer in answers.iter().filter(|answer| answer.status != 200) {
        assert_eq!(answer.status, 503, "{}", answer.text());
        assert!(!answer.header("retry-after").is_empty());
    }
    let peak_mib = server.memory_kib("VmHWM") >> 10;
    assert!(peak_mib < 96 + 80, "{peak_mib} MiB");
    server.wait_until_idle();
    assert_eq!(server.mesh("", &[], &disc(40, 40, 1)).status, 200);
}

#[test]
fn jobs_survive_a_process_without_descriptors_to_spare() {
    let server = Server::start_with_descriptors(128, &["--workers", "1"]);
    let idle: Vec<TcpStream> =
        (0..200).map_while(|_| TcpStream::connect(server.public).ok()).collect();
    assert_eq!(server.operate("/livez").status, 200);
    drop(idle);
    let image = disc(40, 40, 1);
    server.wait_until("jobs are taken again", || {
        let answer = try_send(server.public, "POST", "/v1/jobs?size=20", &[], &image);
        answer.is_some_and(|answer| answer.status == 202)
    });
    let jobs = server.get("/v1/jobs").json();
    let job = jobs["jobs"][0]["links"]["self"].as_str().unwrap().to_owned();
    server.wait_for(&job, "completed");
}
