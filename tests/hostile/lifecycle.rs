//! 6.8: jobs.

use crate::client::{Answer, send};
use crate::pictures::{disc, noise};
use crate::server::{Folder, Server, program};
use crate::table::{Row, check};
use rusqlite::Connection;
use std::sync::Arc;
use std::time::Duration;

/// Work that takes seconds.
const SLOW: &str = "method=mgpr&density=1";

fn delete(server: &Server, job: &str) -> Answer {
    send(server.public, "DELETE", job, &[], &[])
}

fn rows_of_clients() -> Vec<Row> {
    vec![
        Row::steps(
            "J01",
            "the same Idempotency-Key again, with other content, while it runs, malformed",
            "the same job; 422 `idempotency-key-reused`; the same job; 400 `parameter-malformed`",
            |server| {
                let image = disc(30, 30, 1);
                let key = [("Idempotency-Key", "hostile-1")];
                let first = server.submit("size=50", &key, &image);
                assert_eq!(first.status, 202, "{}", first.text());
                let again = server.submit("size=50", &key, &image);
                assert_eq!(
                    (again.status, again.header("location")),
                    (202, first.header("location"))
                );
                server.submit("size=51", &key, &image).problem(422, "idempotency-key-reused");
                server
                    .submit("size=50", &key, &disc(31, 30, 1))
                    .problem(422, "idempotency-key-reused");
                for wrong in ["", "two words", &"x".repeat(256)] {
                    server
                        .submit("", &[("Idempotency-Key", wrong)], &image)
                        .problem(400, "parameter-malformed");
                }
                server.wait_for(first.header("location"), "completed");
                assert_eq!(delete(server, first.header("location")).status, 204);
            },
        ),
        Row::steps(
            "J02",
            "DELETE of a job that waits, runs, is done, is gone",
            "202 and cancelled; 202 and stopped; 204 and deleted; 404 `not-found`",
            |server| {
                let running = server.job(SLOW, &noise(700));
                server.wait_for(&running, "running");
                let waiting: Vec<String> =
                    (0..4).map(|n| server.job(SLOW, &noise(690 + n))).collect();
                let last = waiting.last().unwrap();
                assert_eq!(delete(server, last).status, 202);
                server.wait_for(last, "cancelled");
                assert_eq!(delete(server, &running).status, 202);
                server.wait_for(&running, "cancelled");
                for job in &waiting[..3] {
                    assert_eq!(delete(server, job).status, 202);
                    server.wait_for(job, "cancelled");
                }
                for job in waiting.iter().chain([&running]) {
                    assert_eq!(delete(server, job).status, 204);
                    delete(server, job).problem(404, "not-found");
                }
            },
        )
        .taking(256),
        Row::steps(
            "J03",
            "the mesh of a job that is not done, has failed, has expired",
            "409 `job-unfinished` with Retry-After; 409 `job-without-mesh`; 410 `gone`",
            |_| {
                let server = Server::start(&["--result-ttl", "1s", "--workers", "1"]);
                let slow = server.job(SLOW, &noise(700));
                let unfinished = server.get(&format!("{slow}/mesh"));
                unfinished.problem(409, "job-unfinished");
                assert!(!unfinished.header("retry-after").is_empty());
                delete(&server, &slow);
                let picture = disc(40, 40, 3);
                let broken = server.job("", &picture[..picture.len() / 2]);
                server.wait_for(&broken, "failed");
                server.get(&format!("{broken}/mesh")).problem(409, "job-without-mesh");
                let done = server.job("size=20", &disc(20, 20, 1));
                server.wait_for(&done, "completed");
                server.wait_until("it expires", || server.get(&done).status == 410);
                for target in [done.clone(), format!("{done}/mesh"), format!("{done}/events")] {
                    server.get(&target).problem(410, "gone");
                }
            },
        ),
        Row::steps(
            "J04",
            "more jobs than may wait; pages of the list beyond its ends",
            "503 `overloaded` with Retry-After; the list goes by pages",
            |_| {
                let server = Server::start(&["--workers", "1", "--max-queued-jobs", "20"]);
                let running = server.job(SLOW, &noise(700));
                server.wait_for(&running, "running");
                let image = disc(20, 20, 1);
                let answers: Vec<_> =
                    (0..40).map(|_| server.submit("size=10", &[], &image)).collect();
                let accepted = answers.iter().filter(|answer| answer.status == 202).count();
                assert_eq!(accepted, 20);
                let refused = answers.last().unwrap();
                refused.problem(503, "overloaded");
                assert!(!refused.header("retry-after").is_empty());
                assert!(refused.took < Duration::from_secs(1), "{:?}", refused.took);
                for query in [
                    "limit=0",
                    "limit=-1",
                    "limit=1000000",
                    "cursor=x",
                    "state=lost",
                    "limit=5&limit=6",
                    "page=2",
                ] {
                    let answer = server.get(&format!("/v1/jobs?{query}"));
                    assert!([400, 422].contains(&answer.status), "{query}: {}", answer.text());
                }
                assert_eq!(
                    server.get("/v1/jobs?limit=5").json()["jobs"].as_array().unwrap().len(),
                    5
                );
            },
        ),
        Row::steps(
            "J10",
            "the mesh of a job in sizes that cannot be, twice, of a job without an order",
            "422 `parameter-out-of-range`; 400 `parameter-malformed`; 400 `duplicate-parameter`; 409 `job-without-order`",
            |server| {
                let job = server.job("size=60", &disc(40, 40, 1));
                server.wait_for(&job, "completed");
                let refused = |query: &str, status: u16, slug: &str| {
                    server.get(&format!("{job}/mesh?{query}")).problem(status, slug);
                };
                for size in ["0", "3", "61", "-1", "18446744073709551616"] {
                    refused(&format!("size={size}"), 422, "parameter-out-of-range");
                }
                for size in ["", "1e1", "10.0", "%205", "0x10"] {
                    refused(&format!("size={size}"), 400, "parameter-malformed");
                }
                refused("size=10&size=10", 400, "duplicate-parameter");
                refused("sise=10", 400, "unknown-parameter");
                for size in [4, 5, 59, 60] {
                    let answer = server.get(&format!("{job}/mesh?size={size}"));
                    assert_eq!(
                        answer.header("mesh-vertices"),
                        size.to_string(),
                        "{}",
                        answer.text()
                    );
                }
                let plain = server.job("size=60&method=med", &disc(40, 40, 1));
                server.wait_for(&plain, "completed");
                server.get(&format!("{plain}/mesh?size=10")).problem(409, "job-without-order");
            },
        ),
        Row::steps(
            "J11",
            "the events of a job after Last-Event-IDs of nonsense and of the far future",
            "200: from the first event on, or none",
            |server| {
                let job = server.job("size=20", &disc(20, 20, 1));
                server.wait_for(&job, "completed");
                for id in ["", "-1", "x", "18446744073709551615", "99999999999999999999999", "1e3"]
                {
                    let headers = [("Last-Event-ID", id)];
                    let target = format!("{job}/events");
                    let answer = send(server.public, "GET", &target, &headers, &[]);
                    assert_eq!(answer.status, 200, "{id}: {}", answer.text());
                }
            },
        ),
    ]
}

fn rows_of_machines() -> Vec<Row> {
    vec![
        Row::steps(
            "J05",
            "a job that takes its process down each time",
            "failed as `attempts-exhausted` after 3 attempts; others complete",
            |_| {
                let folder = Arc::default();
                let mut server = Server::start_in(&folder, &["--workers", "2"]);
                let poison = server.job(SLOW, &noise(900));
                for _ in 1..=3 {
                    server.wait_for(&poison, "running");
                    server.kill();
                    server = Server::start_in(&folder, &["--workers", "2"]);
                }
                let document = server.wait_for(&poison, "failed");
                assert_eq!(document["error"]["type"], "/problems/attempts-exhausted");
                let innocent = server.job("size=20", &disc(20, 20, 1));
                server.wait_for(&innocent, "completed");
            },
        ),
        Row::steps(
            "J06",
            "the disk is full at any write",
            "507 `storage-full` or 503 `storage-unavailable`; nothing half-written is seen; see the tests of faults",
            |_| {},
        ),
        Row::steps(
            "J07",
            "the clock jumps",
            "leases and deadlines go by the process's own clock; see the tests of faults",
            |_| {},
        ),
        Row::steps(
            "J08",
            "records of jobs that are damaged in every column",
            "each fails, or is 500 `storage-damaged`; the start and the other jobs go on",
            damaged_records,
        ),
        Row::steps(
            "J09",
            "a second process on the folder of the first",
            "it does not start, and says why",
            |_| {
                let folder: Arc<Folder> = Arc::default();
                let first = Server::start_in(&folder, &[]);
                let mut second = program();
                second.args(["serve", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0"]);
                let output = second.arg("--data-dir").arg(folder.path()).output().unwrap();
                let message = String::from_utf8_lossy(&output.stderr).into_owned();
                assert!(
                    !output.status.success() && message.contains("another process"),
                    "{message}"
                );
                assert_eq!(first.get("/v1/jobs").status, 200);
            },
        ),
    ]
}

/// What a column of a job may hold after the disk has lied.
const DAMAGES: [(&str, &str); 10] = [
    ("options", "'no=such&parameter'"),
    ("options", "'%zz'"),
    ("image_digest", "'../../etc/passwd'"),
    ("image_digest", "'0000000000000000000000000000000000000000000000000000000000000000'"),
    ("image_shape", "'{'"),
    ("image_shape", "'{\"width\":18446744073709551615}'"),
    ("image_bytes", "-1"),
    ("attempt", "-1"),
    ("attempt", "4000000000000"),
    ("state", "9"),
];

fn damaged_records(_: &Server) {
    let folder: Arc<Folder> = Arc::default();
    let mut server = Server::start_in(&folder, &["--workers", "1"]);
    let running = server.job(SLOW, &noise(900));
    server.wait_for(&running, "running");
    let damaged: Vec<String> =
        (0..DAMAGES.len()).map(|n| server.job("size=20", &disc(20 + n, 20, 1))).collect();
    let innocent = server.job("size=20", &disc(50, 20, 1));
    server.kill();
    let connection = Connection::open(folder.path().join("jobs.sqlite3")).unwrap();
    for (job, (column, value)) in damaged.iter().zip(DAMAGES) {
        let id = job.rsplit('/').next().unwrap().replace('-', "");
        let sql = format!("UPDATE jobs SET {column} = {value} WHERE id = x'{id}'");
        assert_eq!(connection.execute(&sql, []).unwrap(), 1);
    }
    drop(connection);
    let server = Server::start_in(&folder, &["--workers", "1"]);
    delete(&server, &running);
    server.wait_for(&innocent, "completed");
    assert_eq!(server.operate("/readyz").status, 200);
    assert_eq!(server.get("/v1/jobs").status, 200);
    for (job, damage) in damaged.iter().zip(DAMAGES) {
        let answer = server.get(job);
        if answer.status != 200 {
            answer.problem(500, "storage-damaged");
        } else {
            let document = answer.json();
            assert!(
                ["failed", "completed"].contains(&document["state"].as_str().unwrap()),
                "{damage:?}: {document}"
            );
        }
    }
    for job in &damaged {
        assert!(
            [202, 204].contains(&delete(&server, job).status),
            "what is damaged can be deleted"
        );
    }
    let next = server.job("size=20", &disc(60, 20, 1));
    server.wait_for(&next, "completed");
}

/// The rows of this chapter.
pub(crate) fn rows() -> Vec<Row> {
    [rows_of_clients(), rows_of_machines()].into_iter().flatten().collect()
}

#[test]
fn jobs_outlive_their_clients_their_process_and_their_disk() {
    check(&["--workers", "1"], &rows());
}
