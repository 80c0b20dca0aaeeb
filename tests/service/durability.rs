//! What is left of jobs when the process is killed, stopped, or short of storage.
//!
//! `PIXMESH_KILLS=200` makes the loop of kills as long as it is promised for; unset, it is short.

use crate::client::{Answer, try_send};
use crate::pictures::{disc, noise};
use crate::server::{Client, Folder, Server, program};
use std::collections::HashMap;
use std::net::SocketAddr;
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

/// Work that takes seconds.
const SLOW: &str = "method=mgpr&density=1";
/// Kills of the short loop.
const FEW_KILLS: usize = 6;
/// The longest time between a kill and the one before it.
const MOST_BETWEEN_KILLS_MS: u64 = 2000;
/// The same in the short loop.
const MOST_BETWEEN_FEW_KILLS_MS: u64 = 700;
/// Submissions between two kills, at most: so many that some are cut off, and so few that all are
/// done in the end.
const MOST_PER_KILL: usize = 25;
/// The longest time in which no job of those left comes to its end.
const MOST_WITHOUT_AN_END: Duration = Duration::from_secs(30);
/// How many different submissions there are.
const KINDS: usize = 24;
/// The longest time from a start to the first job that is resumed.
const MOST_TO_RESUME: Duration = Duration::from_secs(5);

/// Numbers that look random, the same ones each time.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % bound
    }
}

/// One of the things to submit: a query and a picture.
fn kind(number: usize) -> (String, Vec<u8>) {
    let n = number % KINDS;
    let method = ["med", "mgprfs", "mgpr"][n % 3];
    (format!("method={method}&size={}", 40 + n), disc(60 + 10 * n, 80, 1 + 2 * (n % 2)))
}

/// What the clients know: which job each of their words became.
#[derive(Default)]
struct Ledger {
    jobs: Mutex<HashMap<usize, String>>,
    next: AtomicUsize,
    /// So many may be submitted until the next kill.
    allowed: AtomicUsize,
    is_over: AtomicBool,
}

/// Lets the clients stop when it is dropped, also by a failure.
struct Over<'a>(&'a Ledger);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.is_over.store(true, Ordering::Relaxed);
    }
}

impl Ledger {
    /// Submits one thing after the other, each until it is accepted, wherever the service is.
    fn keep(&self, address: &Mutex<SocketAddr>) {
        while !self.is_over.load(Ordering::Relaxed) {
            if self.next.load(Ordering::Relaxed) >= self.allowed.load(Ordering::Relaxed) {
                thread::sleep(Duration::from_millis(5));
                continue;
            }
            let number = self.next.fetch_add(1, Ordering::Relaxed);
            let (query, image) = kind(number);
            let (target, word) = (format!("/v1/jobs?{query}"), format!("submission-{number}"));
            let accepted = loop {
                let to = *address.lock().unwrap();
                match try_send(to, "POST", &target, &[("Idempotency-Key", &word)], &image) {
                    Some(answer) if answer.status == 202 => break answer,
                    Some(answer) => assert!(answer.status == 503, "{}", answer.text()),
                    None => {}
                }
                if self.is_over.load(Ordering::Relaxed) {
                    return;
                }
                thread::sleep(Duration::from_millis(10));
            };
            self.jobs.lock().unwrap().insert(number, accepted.header("location").to_owned());
            thread::sleep(Duration::from_millis(15));
        }
    }
}

#[test]
fn no_accepted_job_is_lost_or_doubled_however_often_the_process_is_killed() {
    let given = std::env::var("PIXMESH_KILLS").ok().and_then(|kills| kills.parse().ok());
    let most_between =
        if given.is_some() { MOST_BETWEEN_KILLS_MS } else { MOST_BETWEEN_FEW_KILLS_MS };
    let kills: usize = given.unwrap_or(FEW_KILLS);
    let (folder, ledger) = (Arc::default(), Ledger::default());
    let mut server = Server::start_in(&folder, &[]);
    let address = Mutex::new(server.public);
    let (mut random, mut longest) = (Random(1), Duration::ZERO);
    ledger.allowed.store(MOST_PER_KILL, Ordering::Relaxed);
    thread::scope(|scope| {
        let _over = Over(&ledger);
        for _ in 0..3 {
            scope.spawn(|| ledger.keep(&address));
        }
        for kill in 1..=kills {
            thread::sleep(Duration::from_millis(random.below(most_between)));
            server.kill();
            let started = Instant::now();
            server = Server::start_in(&folder, &[]);
            *address.lock().unwrap() = server.public;
            assert_eq!(server.metric("pixmesh_transactions_lost"), 0.0, "a kill is no damage");
            // Where all jobs were done already, there is a new one to take up.
            ledger.allowed.store((kill + 1) * MOST_PER_KILL, Ordering::Relaxed);
            server.wait_until("a job is taken up again", || {
                server.metric("pixmesh_job_attempts_total") > 0.0
            });
            longest = longest.max(started.elapsed());
        }
    });
    assert!(longest < MOST_TO_RESUME, "{longest:?}");
    let jobs = ledger.jobs.lock().unwrap();
    let exhausted = check(&server, &jobs);
    println!(
        "{} jobs, {kills} kills: {exhausted} were killed in all their attempts; the first job was \
         resumed within {:.0} ms",
        jobs.len(),
        1000.0 * longest.as_secs_f64()
    );
    // One whose acknowledgement was cut off may be there beside those that the clients know of.
    let listed = count_listed(&server);
    let known = jobs.len();
    assert!((known..=known + 3).contains(&listed), "{listed} jobs for {known} submissions");
}

/// Checks that each job ended with the mesh that a request gets, and returns how many ended without
/// because each of their attempts was killed.
fn check(server: &Server, jobs: &HashMap<usize, String>) -> usize {
    let mut tags = HashMap::new();
    let mut exhausted = 0;
    wait_for_ends(server);
    for (number, job) in jobs {
        let document = server.get(job).json();
        if document["state"] == "failed" {
            assert_eq!(document["error"]["type"], "/problems/attempts-exhausted", "{document}");
            assert_eq!(document["attempt"], 3);
            exhausted += 1;
            continue;
        }
        assert_eq!(document["state"], "completed", "{document}");
        let tag = tags.entry(number % KINDS).or_insert_with(|| {
            let (query, image) = kind(*number);
            server.mesh(&query, &[], &image).header("etag").to_owned()
        });
        let mesh = server.get(&format!("{job}/mesh"));
        assert_eq!((mesh.status, mesh.header("etag")), (200, tag.as_str()), "{job}");
    }
    exhausted
}

/// Waits until no job waits or runs, as long as there is an end now and then.
fn wait_for_ends(server: &Server) {
    let count = || {
        ["queued", "running"].map(|state| {
            let page = server.get(&format!("/v1/jobs?limit=100&state={state}")).json();
            page["jobs"].as_array().unwrap().len()
        })
    };
    let ended = || server.metric("pixmesh_jobs_total{state=\"completed\"}");
    let (mut last, mut since) = (0.0, Instant::now());
    while count() != [0, 0] {
        if ended() > last {
            (last, since) = (ended(), Instant::now());
        }
        assert!(since.elapsed() < MOST_WITHOUT_AN_END, "{:?} wait and run for ever", count());
        thread::sleep(Duration::from_millis(50));
    }
}

fn count_listed(server: &Client) -> usize {
    let (mut count, mut next) = (0, Some("/v1/jobs?limit=100".to_owned()));
    while let Some(target) = next {
        let page = server.get(&target).json();
        count += page["jobs"].as_array().unwrap().len();
        next = page["links"]["next"].as_str().map(str::to_owned);
    }
    count
}

#[test]
fn a_job_that_takes_its_process_down_is_failed_as_such_and_the_others_go_on() {
    let folder = Arc::default();
    let mut server = Server::start_in(&folder, &["--workers", "2"]);
    let poison = server.job(SLOW, &noise(1024));
    let innocent = server.job(SLOW, &noise(600));
    for attempt in 1..=3 {
        let document = server.wait_for(&poison, "running");
        assert_eq!(document["attempt"], attempt);
        server.kill();
        server = Server::start_in(&folder, &["--workers", "2"]);
    }
    let document = server.wait_for(&poison, "failed");
    assert_eq!(document["error"]["type"], "/problems/attempts-exhausted");
    assert_eq!(document["error"]["attempts"], 3);
    server.wait_for(&innocent, "completed");
}

#[test]
fn sigterm_at_saturation_breaks_nothing_that_was_accepted() {
    let folder = Arc::default();
    let flags = ["--workers", "2", "--sync-deadline", "20s"];
    let mut server = Server::start_in(&folder, &flags);
    let (large, small) = (noise(400), disc(40, 40, 1));
    let jobs: Vec<String> = (0..12).map(|_| server.job(SLOW, &large)).collect();
    let public = server.public;
    let (answers, took) = thread::scope(|scope| {
        let send = |image: &[u8]| -> Option<Answer> {
            try_send(public, "POST", &format!("/v1/meshes?{SLOW}"), &[], image)
        };
        let clients: Vec<_> = (0..6)
            .map(|n| if n % 2 == 0 { &large } else { &small })
            .map(|image| scope.spawn(move || send(image)))
            .collect();
        server.wait_until("all have arrived", || {
            server.metric("pixmesh_requests_in_progress") >= 3.0
        });
        server.signal("TERM");
        let began = Instant::now();
        server.wait_until("it is not ready", || {
            try_send(server.operations, "GET", "/readyz", &[], &[]).is_none_or(|a| a.status == 503)
        });
        // Its work alone would keep it for longer.
        assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
        assert_eq!(server.wait().code(), Some(0));
        let took = began.elapsed();
        (clients.into_iter().map(|client| client.join().unwrap()).collect::<Vec<_>>(), took)
    });
    assert!(took < Duration::from_secs(30), "{took:?}");
    for answer in answers {
        let answer = answer.expect("an accepted request has an answer");
        assert!(answer.status == 200 || answer.status == 503, "{}", answer.text());
    }
    drop(server);
    let server = Server::start_in(&folder, &flags);
    for job in &jobs {
        let document = wait_long_for(&server, job, "completed");
        assert_eq!(
            document["attempt"], 1,
            "the attempt of a job that is handed back is no attempt"
        );
    }
}

/// Waits for a job in a queue of others.
fn wait_long_for(server: &Client, job: &str, state: &str) -> serde_json::Value {
    let began = Instant::now();
    loop {
        let document = server.get(job).json();
        if document["state"] == state {
            return document;
        }
        assert!(began.elapsed() < Duration::from_secs(120), "{job} is never {state}: {document}");
        thread::sleep(Duration::from_millis(20));
    }
}

/// A service whose files can have so many KiB; beyond that, writing fails as on a full disk.
fn start_with_short_files(kib: usize, folder: &Arc<Folder>) -> Server {
    let mut shell = Command::new("bash");
    for (name, _) in std::env::vars_os() {
        if name.to_string_lossy().starts_with("PIXMESH_") {
            shell.env_remove(name);
        }
    }
    let script = format!("trap '' XFSZ; ulimit -f {kib}; exec \"$0\" \"$@\"");
    shell.args(["-c", &script]).arg(program().get_program());
    Server::start_as(shell, &[], Arc::clone(folder))
}

#[test]
fn storage_that_takes_no_more_is_told_and_nothing_half_written_is_seen() {
    let folder = Arc::default();
    let mut server = start_with_short_files(700, &folder);
    let large = noise(1000);
    let refused = server.submit("method=med", &[], &large);
    refused.problem(507, "storage-full");
    assert!(server.get("/v1/jobs").json()["jobs"].as_array().unwrap().is_empty());
    assert_eq!(server.mesh("method=med", &[], &large).status, 200, "requests need no storage");
    // The database fills up, too.
    let mut accepted = Vec::new();
    let refused = loop {
        let answer = server.submit("method=med&size=20", &[], &disc(20, 20, 1));
        if answer.status != 202 {
            break answer;
        }
        accepted.push(answer.header("location").to_owned());
        assert!(accepted.len() < 2000, "it never fills up");
    };
    assert!([503, 507].contains(&refused.status), "{}", refused.text());
    server.wait_until("it says so", || server.operate("/readyz").status == 503);
    assert_eq!(server.operate("/livez").status, 200);
    assert_eq!(server.mesh("method=med", &[], &large).status, 200);
    server.kill();
    let server = Server::start_in(&folder, &[]);
    for job in &accepted {
        wait_long_for(&server, job, "completed");
    }
    assert_eq!(count_listed(&server), accepted.len());
    assert_eq!(server.operate("/readyz").status, 200);
}
