//! Durable jobs: how soon they are accepted, and how soon one of many is found.

use super::{Setting, workers};
use crate::client::send;
use crate::driver::{Outcome, closed_loop, request};
use crate::pictures::{disc, noise};
use crate::report::Result;
use crate::row;
use crate::server::Server;
use crate::statistics::{ms, percentile};
use std::time::{Duration, Instant};

/// Jobs that are stored when one of them is asked for.
const STORED: usize = 10_000;
/// Submissions of a megapixel.
const LARGE: usize = 300;
/// Clients that submit tiny jobs together.
const CLIENTS: usize = 32;

pub(super) fn run(setting: &Setting) -> Result {
    let server = Server::start(&["--max-queued-jobs", "100000"]);
    let large = submissions_ms(&server, setting.count(LARGE, 50));
    let (per_second, accepted) = tiny_submissions(&server, STORED);
    let status = statuses_ms(&server);
    let figures = vec![
        ("S14".into(), percentile(&large, 0.99)),
        ("S14b".into(), percentile(&status, 0.99)),
        ("S14c".into(), per_second),
    ];
    let rows = vec![
        row!["", "count", "p50, ms", "p99, ms", "per s"],
        row![
            "submissions of a megapixel",
            large.len(),
            format!("{:.1}", percentile(&large, 0.5)),
            format!("{:.1}", percentile(&large, 0.99)),
            "",
        ],
        row!["submissions of tiny jobs", accepted, "", "", format!("{per_second:.0}")],
        row![
            "status of a job",
            status.len(),
            format!("{:.1}", percentile(&status, 0.5)),
            format!("{:.1}", percentile(&status, 0.99)),
            "",
        ],
    ];
    let notes = vec![format!(
        "{STORED} jobs and more were stored; {} workers were busy with them.",
        workers()
    )];
    Result { figures, rows, notes, ..Result::default() }
}

/// How long it takes until a megapixel is accepted, one after another.
fn submissions_ms(server: &Server, count: usize) -> Vec<f64> {
    let mut image = noise(1000);
    let submission = |number: usize| {
        let last = image.len() - 2;
        image[last..].copy_from_slice(&(number as u16).to_le_bytes());
        let answer = server.submit("method=med&density=0.5", &[], &image);
        assert_eq!(answer.status, 202, "{}", answer.text());
        ms(answer.took)
    };
    (0..count).map(submission).collect()
}

/// Tiny jobs that are accepted per second, until so many are stored.
fn tiny_submissions(server: &Server, stored: usize) -> (f64, usize) {
    let (began, mut accepted) = (Instant::now(), 0);
    let images: Vec<Vec<u8>> = (0..64).map(|n| disc(16 + n, 16, 1)).collect();
    let make = |number: usize| {
        request("tiny", "POST", "/v1/jobs?method=med&size=8", &images[number % images.len()])
    };
    while accepted < stored {
        let outcomes = closed_loop(server.public, CLIENTS, Duration::from_secs(1), &make);
        let such = outcomes.iter().filter(|outcome: &&Outcome| outcome.status() == 202);
        let more = such.count();
        assert!(more > 0, "nothing is accepted: {:?}", outcomes.first());
        accepted += more;
    }
    (accepted as f64 / began.elapsed().as_secs_f64(), accepted)
}

/// How long it takes to learn the state of one job after another.
fn statuses_ms(server: &Server) -> Vec<f64> {
    let page = server.get("/v1/jobs?limit=100").json();
    let jobs = page["jobs"].as_array().unwrap();
    let targets: Vec<_> =
        jobs.iter().map(|job| job["links"]["self"].as_str().unwrap().to_owned()).collect();
    let ask = |number: usize| {
        let target = &targets[number % targets.len()];
        let answer = send(server.public, "GET", target, &[], &[]);
        assert_eq!(answer.status, 200, "{}", answer.text());
        ms(answer.took)
    };
    (0..1000).map(ask).collect()
}
