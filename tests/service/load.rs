//! More work than there are workers: what waits, what is turned away, and who frees what.

use crate::client::{Answer, assert_median_within, connect};
use crate::in_process::Service;
use crate::pictures::{colour_noise, disc, flat, noise};
use crate::server::{Client, Server};
use std::io::Write;
use std::net::TcpStream;
use std::thread;
use std::time::{Duration, Instant};

/// Work that takes seconds: removal from a million points of noise.
const SLOW: &str = "method=mgpr&density=1";

/// Sends slow work, and does not wait for its answer.
fn begin_slow_work(server: &Client, image: &[u8]) -> TcpStream {
    begin_work(server, SLOW, image)
}

/// Sends work, and does not wait for its answer.
fn begin_work(server: &Client, query: &str, image: &[u8]) -> TcpStream {
    let mut stream = connect(server.public);
    let length = image.len();
    let head = format!(
        "POST /v1/meshes?{query} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n\r\n"
    );
    stream.write_all(&[head.as_bytes(), image].concat()).unwrap();
    stream
}

fn wait_for_metric(server: &Server, name: &str, value: f64) {
    server.wait_until(&format!("{name} is {value}"), || server.metric(name) == value);
}

#[test]
fn a_client_that_leaves_frees_its_worker_its_memory_and_its_place() {
    let server = Server::start(&["--workers", "1"]);
    let slow = noise(1024);
    let running = begin_slow_work(&server, &slow);
    wait_for_metric(&server, "pixmesh_jobs_in_progress", 1.0);
    let waiting = begin_slow_work(&server, &slow);
    wait_for_metric(&server, "pixmesh_queue_depth", 1.0);
    assert!(server.metric("pixmesh_memory_permits_mib{state=\"used\"}") > 100.0);
    drop(waiting);
    wait_for_metric(&server, "pixmesh_queue_depth", 0.0);
    assert_eq!(server.metric("pixmesh_jobs_in_progress"), 1.0);
    drop(running);
    server.wait_until_idle();
    assert!(!server.log().contains("meshed"), "it was stopped and not done");
    assert_eq!(server.mesh("", &[], &disc(30, 30, 1)).status, 200);
    server.wait_until("the log says so", || server.log().contains("client disconnected"));
}

#[test]
fn work_whose_client_has_left_stops_within_a_tenth_of_a_second() {
    let server = Server::start(&["--workers", "1"]);
    // At any moment of the work: in the filters, the triangulation, the removal.
    let delays = [5, 30, 60, 100, 200, 300, 400].map(Duration::from_millis);
    assert_stops_soon(&server, "density=4", &noise(1024), delays);
}

#[test]
fn decoding_whose_client_has_left_stops_within_a_tenth_of_a_second() {
    // It takes far longer than that.
    let patient = ["--body-timeout", "5m", "--sync-deadline", "5m"];
    let server =
        Server::start(&[&["--workers", "1", "--max-body", "80MiB"][..], &patient].concat());
    let image = colour_noise(4400, 4000);
    let answer = server.mesh("method=med&size=4", &[], &image);
    assert_eq!(answer.status, 200, "{}", answer.text());
    let timing = answer.header("server-timing");
    let decoding = timing.split(", ").find_map(|stage| stage.strip_prefix("decode;dur=")).unwrap();
    let decoding = Duration::from_secs_f64(decoding.parse::<f64>().unwrap() / 1e3);
    assert!(decoding > Duration::from_millis(150), "{decoding:?}");
    let delays = [1, 2, 3, 4, 5, 6, 7].map(|eighths| eighths * decoding / 8);
    assert_stops_soon(&server, "method=med&size=4", &image, delays);
}

/// Begins work and leaves it, three times after each of the delays, and checks how soon its worker is
/// free: in the median, because other work holds up each try now and then.
fn assert_stops_soon(server: &Server, query: &str, image: &[u8], delays: [Duration; 7]) {
    let stop = |delay| {
        let client = begin_work(server, query, image);
        wait_for_metric(server, "pixmesh_jobs_in_progress", 1.0);
        thread::sleep(delay);
        drop(client);
        let left = Instant::now();
        while server.metric("pixmesh_jobs_in_progress") > 0.0 {
            assert!(left.elapsed() < PATIENCE);
        }
        left.elapsed()
    };
    let mut times: Vec<Duration> =
        delays.into_iter().flat_map(|delay| [(); 3].map(|()| stop(delay))).collect();
    times.sort_unstable();
    assert!(times[times.len() / 2] < Duration::from_millis(100), "{times:?}");
}

/// What is waited for has come within this time, or never comes.
const PATIENCE: Duration = Duration::from_secs(60);

#[test]
fn decoding_past_its_deadline_is_stopped_and_is_no_broken_picture() {
    let flags = ["--workers", "1", "--sync-deadline", "100ms", "--max-body", "80MiB"];
    let server = Server::start(&flags);
    let answer = server.mesh("method=med&size=4", &[], &colour_noise(4400, 4000));
    answer.problem(503, "deadline-exceeded");
    server.wait_until_idle();
    assert_eq!(server.mesh("", &[], &disc(30, 30, 1)).status, 200);
}

#[test]
fn a_full_queue_is_told_at_once_and_cheap_answers_stay_quick() {
    let server = Server::start(&["--workers", "1", "--queue-seconds", "3"]);
    let slow = noise(1024);
    let first = begin_slow_work(&server, &slow);
    wait_for_metric(&server, "pixmesh_jobs_in_progress", 1.0);
    let second = begin_slow_work(&server, &slow);
    wait_for_metric(&server, "pixmesh_queue_depth", 1.0);
    let image = disc(30, 30, 1);
    let mut shed = 0.0;
    assert_quick(|| {
        let answer = server.mesh("", &[], &image);
        let problem = answer.problem(503, "overloaded");
        let seconds: u64 = answer.header("retry-after").parse().unwrap();
        assert_eq!(problem["retry_after_s"], seconds);
        assert!((1..=300).contains(&seconds));
        assert_eq!(problem["setting"], "--queue-seconds");
        shed += 1.0;
        answer
    });
    assert_quick(|| server.mesh("density=-1", &[], &image));
    assert_quick(|| server.mesh("", &[], b"no picture"));
    for target in ["/livez", "/readyz", "/metrics"] {
        assert_quick(|| {
            let answer = server.operate(target);
            assert_eq!(answer.status, 200);
            answer
        });
    }
    assert_eq!(server.metric("pixmesh_requests_shed_total{reason=\"queue_full\"}"), shed);
    drop((first, second));
    server.wait_until_idle();
    assert_eq!(server.mesh("", &[], &image).status, 200);
}

#[track_caller]
fn assert_quick(ask: impl FnMut() -> Answer) {
    let mut ask = ask;
    assert_median_within(Duration::from_millis(500), || ask().took);
}

#[test]
fn work_past_its_deadline_is_stopped_and_so_is_work_that_waits_too_long() {
    let server = Server::start(&["--workers", "1", "--sync-deadline", "700ms"]);
    let slow = noise(1024);
    let (running, waiting) = thread::scope(|scope| {
        let running = scope.spawn(|| server.mesh(SLOW, &[], &slow));
        wait_for_metric(&server, "pixmesh_jobs_in_progress", 1.0);
        let hold = begin_slow_work(&server, &slow);
        let waiting = scope.spawn(|| server.mesh(SLOW, &[], &slow));
        let answers = (running.join().unwrap(), waiting.join().unwrap());
        drop(hold);
        answers
    });
    for answer in [running, waiting] {
        answer.problem(503, "deadline-exceeded");
        assert!(answer.took < Duration::from_secs(20), "{:?}", answer.took);
    }
    assert!(!server.log().contains("meshed"), "none was done");
    server.wait_until_idle();
    assert!(server.metric("pixmesh_requests_shed_total{reason=\"deadline\"}") >= 2.0);
    assert_eq!(server.mesh("", &[], &disc(30, 30, 1)).status, 200);
}

#[test]
fn no_more_work_runs_than_there_are_workers_even_when_clients_leave() {
    let server = Server::start(&["--workers", "2"]);
    let slow = noise(300);
    let mut most = 0.0_f64;
    for _ in 0..10 {
        let clients: Vec<_> = (0..8).map(|_| begin_slow_work(&server, &slow)).collect();
        thread::sleep(Duration::from_millis(20));
        most = most.max(server.metric("pixmesh_jobs_in_progress"));
        drop(clients);
        most = most.max(server.metric("pixmesh_jobs_in_progress"));
    }
    assert!((1.0..=2.0).contains(&most), "{most} at once");
    server.wait_until_idle();
}

/// The threads of a process that run tasks or wait for one: the workers and the helpers of kernels.
fn worker_threads(process: u32) -> usize {
    let names = std::fs::read_dir(format!("/proc/{process}/task")).unwrap().flatten();
    let names = names.filter_map(|task| std::fs::read_to_string(task.path().join("comm")).ok());
    names.filter(|name| name.trim_end() == "worker").count()
}

#[test]
fn a_request_that_is_alone_uses_the_other_workers_cores_too_and_its_mesh_is_the_same() {
    let image = noise(600);
    let [alone, helped] = ["1", "2"].map(|workers| {
        let server = Server::start(&["--workers", workers]);
        thread::scope(|scope| {
            let request = scope.spawn(|| server.mesh("effort=1&density=4", &[], &image));
            let mut most = 0;
            while !request.is_finished() {
                most = most.max(worker_threads(server.process_id()));
                thread::sleep(Duration::from_millis(1));
            }
            let answer = request.join().unwrap();
            assert_eq!(answer.status, 200, "{}", answer.text());
            (answer.body, most)
        })
    });
    assert!(alone.0 == helped.0, "the meshes differ");
    assert_eq!(alone.1, 1);
    let has_cores = thread::available_parallelism().is_ok_and(|cores| cores.get() > 1);
    assert_eq!(helped.1 > 2, has_cores, "{} threads, two of which are workers", helped.1);
}

/// What answers and work hold of the memory budget, in MiB.
const USED_MIB: &str = "pixmesh_memory_permits_mib{state=\"used\"}";

/// A picture whose answer as PNM has 12 million bytes, more than the system buffers.
fn large() -> Vec<u8> {
    flat(2000, 2000)
}

/// Asks for a large answer, and reads nothing of it.
fn ask_for_large_answer(server: &Client, image: &[u8]) -> TcpStream {
    let mut stream = connect(server.public);
    let head = format!(
        "POST /v1/meshes?method=med&size=4&format=pnm HTTP/1.1\r\nHost: localhost\r\n\
         Content-Length: {}\r\n\r\n",
        image.len()
    );
    stream.write_all(&[head.as_bytes(), image].concat()).unwrap();
    stream
}

#[test]
fn an_answer_holds_its_memory_until_it_is_sent_or_its_client_has_left() {
    let server = Server::start(&["--workers", "1"]);
    let image = large();
    let mut reader = ask_for_large_answer(&server, &image);
    server.wait_until("nothing but the answer is left", || {
        server.metric("pixmesh_jobs_in_progress") == 0.0 && server.metric(USED_MIB) == 12.0
    });
    thread::sleep(Duration::from_millis(100));
    assert_eq!(server.metric(USED_MIB), 12.0);
    assert_eq!(crate::client::receive(&mut reader, Instant::now()).body.len(), image.len());
    wait_for_metric(&server, USED_MIB, 0.0);
    let leaver = ask_for_large_answer(&server, &image);
    wait_for_metric(&server, USED_MIB, 12.0);
    drop(leaver);
    wait_for_metric(&server, USED_MIB, 0.0);
}

#[test]
fn clients_that_read_nothing_stay_within_the_budget_and_are_cut() {
    let flags = ["--workers", "2", "--memory-budget", "256MiB", "--body-timeout", "5s"];
    let server = Server::start(&flags);
    let image = large();
    let readers: Vec<_> = (0..16).map(|_| ask_for_large_answer(&server, &image)).collect();
    server.wait_until("answers hold memory", || server.metric(USED_MIB) >= 12.0);
    server.wait_until("those that stall are cut", || {
        assert!(server.metric(USED_MIB) <= 192.0);
        server.metric("pixmesh_requests_in_progress") == 0.0 && server.metric(USED_MIB) == 0.0
    });
    let peak_mib = server.memory_kib("VmHWM") >> 10;
    assert!(peak_mib < 256 + 80, "{peak_mib} MiB");
    assert_eq!(server.mesh("", &[], &disc(30, 30, 1)).status, 200);
    drop(readers);
}

#[test]
fn tiny_requests_do_not_let_in_more_large_ones_than_can_be_served() {
    let (tiny, larger) = (disc(20, 20, 1), noise(400));
    assert_median_within(Duration::from_millis(2100), || {
        let server = Service::start(&["--workers", "1", "--queue-seconds", "1"]);
        for _ in 0..200 {
            assert_eq!(server.mesh("", &[], &tiny).status, 200);
        }
        longest_wait_of_sixteen(&server, &larger)
    });
}

/// The longest that any of sixteen clients at once waited, for a worker or to be refused.
fn longest_wait_of_sixteen(server: &Client, larger: &[u8]) -> Duration {
    let answers: Vec<_> = thread::scope(|scope| {
        let send = || server.mesh("method=mgpr&density=1", &[], larger);
        let clients: Vec<_> = (0..16).map(|_| scope.spawn(send)).collect();
        clients.into_iter().map(|client| client.join().unwrap()).collect()
    });
    let queue = |answer: &Answer| {
        let timing = answer.header("server-timing").strip_prefix("queue;dur=").unwrap().to_owned();
        Duration::from_secs_f64(timing.split(',').next().unwrap().parse::<f64>().unwrap() / 1e3)
    };
    let (served, refused): (Vec<_>, Vec<_>) =
        answers.iter().partition(|answer| answer.status == 200);
    assert!(!served.is_empty() && !refused.is_empty(), "{} served", served.len());
    for answer in &refused {
        answer.problem(503, "overloaded");
        assert!(!answer.header("retry-after").is_empty());
    }
    let waits = served.iter().map(|answer| queue(answer));
    waits.chain(refused.iter().map(|answer| answer.took)).max().unwrap()
}

#[test]
fn what_waits_for_twice_as_long_as_the_queue_should_take_is_refused() {
    let server = Server::start(&["--workers", "1", "--queue-seconds", "0.2"]);
    let slow = noise(1024);
    let running = begin_slow_work(&server, &slow);
    wait_for_metric(&server, "pixmesh_jobs_in_progress", 1.0);
    assert_median_within(Duration::from_millis(1500), || {
        let answer = server.mesh("", &[], &disc(30, 30, 1));
        let problem = answer.problem(503, "overloaded");
        assert!(answer.took >= Duration::from_millis(400), "{:?}", answer.took);
        assert_eq!(problem["setting"], "--queue-seconds");
        assert!(problem["retry_after_s"].as_u64().unwrap() >= 1);
        answer.took
    });
    drop(running);
    server.wait_until_idle();
}
