//! Clocks that jump.

use super::wait_long_for;
use crate::pictures::{disc, noise};
use crate::server::{Folder, Server, program};
use std::path::PathBuf;
use std::sync::Arc;

/// Where Debian's package `faketime` has its library.
fn library() -> PathBuf {
    let folders = ["/usr/lib/x86_64-linux-gnu/faketime", "/usr/lib/aarch64-linux-gnu/faketime"];
    folders
        .iter()
        .map(|folder| PathBuf::from(folder).join("libfaketime.so.1"))
        .find(|path| path.exists())
        .expect("libfaketime is missing; ./test installs it")
}

/// The time of day that a service sees; the clock that only counts on is the machine's.
struct Clock(PathBuf);

impl Clock {
    fn new(folder: &Folder) -> Self {
        std::fs::create_dir_all(folder.path()).unwrap();
        let clock = Self(folder.path().join("clock"));
        clock.jump("+0");
        clock
    }

    /// Moves the time by an offset, such as `+1h` or `-30m`.
    fn jump(&self, offset: &str) {
        let next = self.0.with_extension("next");
        std::fs::write(&next, format!("{offset}\n")).unwrap();
        std::fs::rename(&next, &self.0).unwrap();
    }

    fn start(&self, folder: &Arc<Folder>, library: &PathBuf, flags: &[&str]) -> Server {
        let mut command = program();
        command.env("LD_PRELOAD", library).env("FAKETIME_TIMESTAMP_FILE", &self.0);
        command.env("FAKETIME_NO_CACHE", "1").env("DONT_FAKE_MONOTONIC", "1");
        Server::start_as(command, flags, Arc::clone(folder))
    }
}

#[test]
fn a_clock_that_jumps_neither_loses_jobs_nor_runs_them_twice() {
    let library = library();
    let (folder, times): (Arc<Folder>, Folder) = (Arc::default(), Folder::new());
    let clock = Clock::new(&times);
    let server = clock.start(&folder, &library, &["--workers", "1"]);
    let image = disc(40, 40, 1);
    for (n, offset) in ["+1h", "-1h", "+20h", "-2h", "+0"].into_iter().enumerate() {
        let running = server.job(super::SLOW, &noise(500 + n));
        server.wait_for(&running, "running");
        let waiting = server.job("size=30", &disc(40 + n, 40, 1));
        clock.jump(offset);
        assert_eq!(server.mesh("", &[], &image).status, 200, "{offset}: deadlines do not jump");
        for job in [&running, &waiting] {
            let document = wait_long_for(&server, job, "completed");
            assert_eq!(document["attempt"], 1, "{offset}: {document}");
            assert_eq!(server.get(&format!("{job}/mesh")).status, 200, "{offset}");
        }
        assert_eq!(server.operate("/readyz").status, 200);
    }
}

#[test]
fn results_are_kept_by_the_time_of_day() {
    let library = library();
    let (folder, times): (Arc<Folder>, Folder) = (Arc::default(), Folder::new());
    let clock = Clock::new(&times);
    let server = clock.start(&folder, &library, &["--result-ttl", "24h"]);
    let job = server.job("size=30", &disc(40, 40, 1));
    server.wait_for(&job, "completed");
    clock.jump("+23h");
    assert_eq!(server.get(&job).status, 200);
    clock.jump("+25h");
    server.get(&job).problem(410, "gone");
    let next = server.job("size=31", &disc(40, 40, 1));
    server.wait_for(&next, "completed");
}
