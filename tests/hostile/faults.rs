//! What the machine does to the service: full, read-only and lying disks, clocks that jump, clients
//! by the thousand, signals at any moment, memory that grows.

mod clients;
mod clocks;
mod disks;
mod failing_disk;
mod growth;
mod stops;

use crate::server::Server;
use std::process::Command;
use std::time::{Duration, Instant};

/// Work that takes seconds.
const SLOW: &str = "method=mgpr&density=1";

/// Fails a test whose preparation this machine does not allow, with advice.
#[track_caller]
fn require_success(command: &mut Command, advice: &str) {
    let why = match command.output() {
        Ok(output) if output.status.success() => return,
        Ok(output) => String::from_utf8_lossy(&output.stderr).into_owned(),
        Err(error) => error.to_string(),
    };
    panic!("{command:?}: {why}; {advice}");
}

/// Waits for a job in a state, longer than a service that has nothing else to do may take.
fn wait_long_for(server: &Server, job: &str, state: &str) -> serde_json::Value {
    let began = Instant::now();
    loop {
        let document = server.get(job).json();
        if document["state"] == state {
            return document;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "{job} is never {state}: {document}");
        std::thread::sleep(Duration::from_millis(20));
    }
}
