//! How soon the service is ready, and what it takes when nobody asks for anything.

use super::Setting;
use crate::report::Result;
use crate::row;
use crate::server::Server;
use std::thread;
use std::time::{Duration, Instant};

pub(super) fn run(setting: &Setting) -> Result {
    let count = setting.count(20, 3);
    let mut slowest = 0.0_f64;
    for _ in 0..count {
        let began = Instant::now();
        drop(Server::start(&[]));
        slowest = slowest.max(began.elapsed().as_secs_f64());
    }
    let server = Server::start(&[]);
    thread::sleep(Duration::from_secs(2));
    let idle_mib = server.memory_kib("VmRSS") as f64 / 1024.0;
    Result {
        figures: vec![("S13".into(), slowest), ("S13b".into(), idle_mib)],
        rows: vec![
            row!["starts", "slowest, s", "idle memory, MiB"],
            row![count, format!("{slowest:.3}"), format!("{idle_mib:.1}")],
        ],
        ..Result::default()
    }
}
