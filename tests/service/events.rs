//! The events of a job, as a browser's EventSource would hear them.

use crate::client::connect;
use crate::in_process::Service;
use crate::pictures::{disc, noise};
use crate::server::{Client, Server};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// One event: its id, its kind and its data.
#[derive(Debug)]
struct Event {
    id: u64,
    kind: String,
    data: Value,
}

/// A stream of events.
struct Stream(BufReader<TcpStream>);

impl Stream {
    /// Follows a job, from after an event on.
    fn of(server: &Client, job: &str, last: Option<u64>) -> Self {
        let mut stream = connect(server.public);
        let last = last.map_or_else(String::new, |id| format!("Last-Event-ID: {id}\r\n"));
        let request = format!(
            "GET {job}/events HTTP/1.1\r\nHost: localhost\r\n{last}Connection: close\r\n\r\n"
        );
        stream.write_all(request.as_bytes()).unwrap();
        let mut stream = Self(BufReader::new(stream));
        let head = stream.paragraph().unwrap();
        assert!(head[0].starts_with("HTTP/1.1 200"), "{head:?}");
        assert!(head.contains(&"content-type: text/event-stream".to_owned()), "{head:?}");
        stream
    }

    /// The lines up to an empty one; `None` at the end.
    fn paragraph(&mut self) -> Option<Vec<String>> {
        let mut lines = Vec::new();
        loop {
            let mut line = String::new();
            if self.0.read_line(&mut line).unwrap() == 0 {
                return None;
            }
            let line = line.trim_end();
            if line.is_empty() && !lines.is_empty() {
                return Some(lines);
            }
            // Lengths of chunks stand between the events.
            let is_length = !line.is_empty() && line.bytes().all(|byte| byte.is_ascii_hexdigit());
            if !line.is_empty() && !is_length {
                lines.push(line.to_owned());
            }
        }
    }

    fn next(&mut self) -> Option<Event> {
        let lines = self.paragraph()?;
        let field = |name: &str| {
            lines.iter().find_map(|line| line.strip_prefix(name)?.strip_prefix(": ")).unwrap()
        };
        Some(Event {
            id: field("id").parse().unwrap(),
            kind: field("event").to_owned(),
            data: serde_json::from_str(field("data")).unwrap(),
        })
    }

    /// All events to the end.
    fn rest(mut self) -> Vec<Event> {
        std::iter::from_fn(move || self.next()).collect()
    }
}

fn states(events: &[Event]) -> Vec<&str> {
    let states = events.iter().filter(|event| event.kind == "state");
    states.map(|event| event.data["state"].as_str().unwrap()).collect()
}

#[test]
fn a_job_is_followed_from_its_beginning_to_its_end() {
    let server = Service::start(&["--workers", "1"]);
    let job = server.job("method=mgpr&density=1", &noise(1024));
    let events = Stream::of(&server, &job, None).rest();
    assert_eq!(states(&events), ["queued", "running", "completed"]);
    assert!(events.is_sorted_by(|a, b| a.id < b.id));
    let progress: Vec<_> = events.iter().filter(|event| event.kind == "progress").collect();
    assert!(!progress.is_empty(), "the work takes some seconds");
    for event in &progress {
        let progress = &event.data["progress"];
        assert!(!progress["stage"].as_str().unwrap().is_empty());
        assert!((0.0..=1.0).contains(&progress["fraction"].as_f64().unwrap()), "{progress}");
        assert!((0.0..=1.0).contains(&progress["overall_fraction"].as_f64().unwrap()));
    }
    let overall = |event: &&Event| event.data["progress"]["overall_fraction"].as_f64().unwrap();
    assert!(progress.iter().map(overall).is_sorted(), "the job goes on");
    let rest = |event: &&Event| event.data["progress"]["remaining_s"].as_f64();
    assert!(progress.iter().filter_map(rest).any(|rest| rest > 0.0), "the rest is estimated");
    let last = events.last().unwrap();
    assert_eq!(last.data["links"]["mesh"], format!("{job}/mesh"));
    // Who comes later hears the changes of state, and the stream ends.
    let again = Stream::of(&server, &job, None).rest();
    assert_eq!(states(&again), ["queued", "running", "completed"]);
}

#[test]
fn who_comes_back_hears_what_was_missed_and_nothing_twice() {
    let server = Service::start(&["--workers", "1"]);
    let slow = server.job("method=mgpr&density=1", &noise(1024));
    server.wait_for(&slow, "running");
    let job = server.job("method=med&size=20", &disc(20, 20, 1));
    let mut first = Stream::of(&server, &job, None);
    let queued = first.next().unwrap();
    assert_eq!(queued.data["state"], "queued");
    drop(first);
    crate::client::send(server.public, "DELETE", &slow, &[], &[]);
    server.wait_for(&job, "completed");
    let missed = Stream::of(&server, &job, Some(queued.id)).rest();
    assert_eq!(states(&missed), ["running", "completed"]);
    let last = missed.last().unwrap().id;
    assert!(Stream::of(&server, &job, Some(last)).rest().is_empty());
    assert!(Stream::of(&server, &job, Some(u64::MAX)).rest().is_empty());
    let request = [("Last-Event-ID", "nonsense")];
    let path = format!("{job}/events");
    assert_eq!(crate::client::send(server.public, "GET", &path, &request, &[]).status, 200);
}

#[test]
fn followers_do_not_keep_a_service_from_stopping() {
    let mut server = Server::start(&["--workers", "1"]);
    let running = server.job("method=mgpr&density=1", &noise(1024));
    let waiting = server.job("", &disc(20, 20, 1));
    let streams = [Stream::of(&server, &running, None), Stream::of(&server, &waiting, None)];
    server.wait_for(&running, "running");
    let began = Instant::now();
    server.signal("TERM");
    for stream in streams {
        stream.rest();
    }
    // The running job may take its grace period of 20 s.
    assert!(began.elapsed() < Duration::from_secs(10), "{:?}", began.elapsed());
    assert_eq!(server.wait().code(), Some(0));
}
