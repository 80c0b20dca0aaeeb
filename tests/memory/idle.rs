//! Memory that is given back to the system when there is nothing to do.

use crate::pictures::noise;
use crate::server::Server;
use std::thread;

/// What an idle process may keep beside what it takes at its start: with the 20 MiB of that in a release
/// build, 80 MiB.
const MOST_KIB: u64 = 60 << 10;

#[test]
fn idle_process_gives_back_what_requests_took() {
    let server = Server::start(&["--workers", "2", "--sync-deadline", "5m"]);
    let (at_start, picture) = (server.memory_kib("VmRSS"), noise(1700));
    let mesh = || assert_eq!(server.mesh("method=med&density=1", &[], &picture).status, 200);
    thread::scope(|scope| (0..2).for_each(|_| drop(scope.spawn(|| (mesh(), mesh())))));
    let after = server.memory_kib("VmHWM") - at_start;
    assert!(after > MOST_KIB, "the load takes memory: {after} KiB");
    server.wait_until("memory is given back", || server.memory_kib("VmRSS") < at_start + MOST_KIB);
}
