//! The largest uploads together, then clients that read slowly, in a container's limit.

use super::{Setting, workers};
use crate::client::connect;
use crate::driver::{Outcome, Request, request, together};
use crate::group::{Group, Limits};
use crate::pictures::{flat, noise};
use crate::report::Result;
use crate::row;
use crate::server::Server;
use std::io::{Read, Write};
use std::net::SocketAddr;
use std::thread;
use std::time::{Duration, Instant};

/// The container: a budget of 1 GiB is two thirds of it.
const LIMIT_MIB: u64 = 1536;
/// What the process may take: the budget, and 80 MiB besides.
const MOST_MIB: f64 = 1024.0 + 80.0;
/// A side of the largest picture that fits into the longest body.
const SIDE: usize = 5600;
/// Seconds for which slow readers read.
const READING_S: f64 = 300.0;
/// Bytes that a slow reader takes each second.
const SLOW_BYTES: usize = 1000;

pub(super) fn run(setting: &Setting) -> Result {
    let limits = Limits { memory_mib: Some(LIMIT_MIB), ..Limits::default() };
    let flags = ["--sync-deadline", "5m"];
    // The group is left before it is removed: the server ends first.
    let (_group, server, note) = match Group::make("memory", limits) {
        Ok(group) => {
            let server = group.start(&flags);
            (Some(group), server, format!("In a control group of {LIMIT_MIB} MiB."))
        }
        Err(why) => {
            let flags = [&flags[..], &["--memory-budget", "1GiB"]].concat();
            (None, Server::start(&flags), format!("Without a control group: {why}."))
        }
    };
    let mut rows = vec![row!["phase", "200", "503", "others", "peak resident, MiB"]];
    let clients = 2 * workers();
    rows.push(uploads(&server, clients));
    rows.push(slow_readers(&server, 8 * clients, setting.period(READING_S)));
    server.wait_until_idle();
    let peak_mib = server.memory_kib("VmHWM") as f64 / 1024.0;
    Result {
        figures: vec![("S7".into(), peak_mib - MOST_MIB)],
        rows,
        notes: vec![note, format!("At most {peak_mib:.0} MiB; the process was not killed.")],
        ..Result::default()
    }
}

fn phase(name: &str, server: &Server, statuses: &[u16]) -> Vec<String> {
    let count = |wanted: u16| statuses.iter().filter(|&&status| status == wanted).count();
    let (served, shed) = (count(200), count(503));
    let peak = server.memory_kib("VmHWM") >> 10;
    row![name, served, shed, statuses.len() - served - shed, peak]
}

/// So many clients send the largest pictures that there may be, three times.
fn uploads(server: &Server, clients: usize) -> Vec<String> {
    let target = "/v1/meshes?method=med&density=1";
    let images = [noise(SIDE), flat(3000, 3500)];
    let kinds = images.map(|image| request("largest", "POST", target, &image));
    let requests: Vec<Request> = kinds.iter().cycle().take(clients).cloned().collect();
    let outcomes = [(); 3].map(|()| together(server.public, &requests)).concat();
    phase("the largest uploads", server, &outcomes.iter().map(Outcome::status).collect::<Vec<_>>())
}

/// Clients that ask for large answers and take a little of them each second.
fn slow_readers(server: &Server, clients: usize, period: Duration) -> Vec<String> {
    let image = flat(2000, 2000);
    let statuses: Vec<u16> = thread::scope(|scope| {
        let (image, address) = (&image, server.public);
        let clients: Vec<_> = (0..clients)
            .map(|_| scope.spawn(move || read_slowly(address, image, period)))
            .collect();
        clients.into_iter().map(|client| client.join().unwrap()).collect()
    });
    phase("slow readers", server, &statuses)
}

/// The status of an answer of twelve megabytes that is read slowly for a time, and then given up.
fn read_slowly(address: SocketAddr, image: &[u8], period: Duration) -> u16 {
    let mut stream = connect(address);
    stream.set_read_timeout(Some(Duration::from_secs(300))).unwrap();
    let head = format!(
        "POST /v1/meshes?method=med&size=4&format=pnm HTTP/1.1\r\nHost: localhost\r\n\
         Content-Length: {}\r\n\r\n",
        image.len()
    );
    if stream.write_all(&[head.as_bytes(), image].concat()).is_err() {
        return 0;
    }
    let (mut first, mut buffer) = (Vec::new(), vec![0; SLOW_BYTES]);
    let began = Instant::now();
    while began.elapsed() < period {
        match stream.read(&mut buffer) {
            Ok(count @ 1..) if first.len() < 64 => first.extend_from_slice(&buffer[..count]),
            Ok(1..) => {}
            _ => break,
        }
        thread::sleep(Duration::from_secs(1));
    }
    let head = String::from_utf8_lossy(&first).into_owned();
    head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0)
}
