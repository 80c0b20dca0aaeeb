//! A client's record of the accepted jobs, against which the service is checked.

use crate::client::{Answer, send, try_send};
use crate::node::Node;
use crate::pictures::disc;
use std::collections::HashMap;
use std::net::SocketAddr;
use std::thread;
use std::time::{Duration, Instant};

/// The longest time in which all jobs of a ledger end.
const PATIENCE: Duration = Duration::from_secs(120);
/// Parameters, and the picture of each job by its number.
#[derive(Clone, Copy)]
pub(crate) struct Work {
    pub(crate) query: &'static str,
    pub(crate) picture: fn(usize) -> Vec<u8>,
}

/// Work that takes about a second.
pub(crate) const SECOND: Work =
    Work { query: "method=mgpr&size=200", picture: |n| disc(120 + n % 8, 120, 1) };

/// The accepted jobs, with the number of the picture of each.
pub(crate) struct Ledger {
    work: Work,
    jobs: HashMap<String, usize>,
}

impl Default for Ledger {
    fn default() -> Self {
        Self::of(SECOND)
    }
}

impl Ledger {
    pub(crate) fn of(work: Work) -> Self {
        Self { work, jobs: HashMap::new() }
    }

    /// Submits a job with its idempotency key once; `None` without an answer. The ledger does not record
    /// the job.
    pub(crate) fn attempt(work: Work, node: SocketAddr, number: usize) -> Option<Answer> {
        let key = format!("key-{number}");
        let headers = [("Idempotency-Key", key.as_str())];
        let target = format!("/v1/jobs?{}", work.query);
        try_send(node, "POST", &target, &headers, &(work.picture)(number))
    }

    /// Submits a job once, and records it if it is accepted.
    pub(crate) fn submit_once(&mut self, node: &Node, number: usize) -> Option<Answer> {
        let answer = Self::attempt(self.work, node.public, number)?;
        if answer.status == 202 {
            let location = answer.header("location").to_owned();
            let known = self.jobs.insert(location, number);
            assert!(known.is_none_or(|known| known == number), "two keys, one job");
        }
        Some(answer)
    }

    /// Submits jobs to the nodes in turn, each again and again until it is accepted.
    pub(crate) fn submit(&mut self, nodes: &[&Node], numbers: std::ops::Range<usize>) {
        for number in numbers {
            let began = Instant::now();
            let node = nodes[number % nodes.len()];
            loop {
                match self.submit_once(node, number) {
                    Some(answer) if answer.status == 202 => break,
                    Some(answer) => assert_eq!(answer.status, 503, "{}", answer.text()),
                    None => {}
                }
                assert!(began.elapsed() < PATIENCE, "never accepted: {number}\n{}", node.log());
                thread::sleep(Duration::from_millis(50));
            }
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.jobs.len()
    }

    /// The number of completed jobs.
    pub(crate) fn ended(&self, node: &Node) -> usize {
        self.jobs.keys().filter(|job| node.get(job).json()["state"] == "completed").count()
    }

    /// The sum of the attempts of all jobs.
    pub(crate) fn attempts(&self, node: &Node) -> usize {
        let attempts = |job| node.get(job).json()["attempt"].as_u64().unwrap();
        self.jobs.keys().map(|job| attempts(job) as usize).sum()
    }

    /// Waits until every job is completed, and checks its mesh, that it had at most three attempts, and
    /// that there are no other jobs.
    pub(crate) fn check(&self, node: &Node) {
        let began = Instant::now();
        let mut meshes: HashMap<Vec<u8>, Vec<u8>> = HashMap::new();
        for (job, number) in &self.jobs {
            let document = loop {
                let document = node.get(job).json();
                match document["state"].as_str() {
                    Some("completed") => break document,
                    Some("queued" | "running") => {}
                    _ => panic!("{document}"),
                }
                assert!(began.elapsed() < PATIENCE, "never ended: {document}\n{}", node.log());
                thread::sleep(Duration::from_millis(50));
            };
            assert!(document["attempt"].as_u64().unwrap() <= 3);
            let mesh = loop {
                let mesh = node.get(&format!("{job}/mesh"));
                if mesh.status == 200 {
                    break mesh;
                }
                // A 503 asks for another try.
                assert_eq!(mesh.status, 503, "{job}: {}", mesh.text());
                assert!(began.elapsed() < PATIENCE, "{job}: {}\n{}", mesh.text(), node.log());
                thread::sleep(Duration::from_millis(50));
            };
            let picture = (self.work.picture)(*number);
            let expected = meshes.entry(picture.clone()).or_insert_with(|| {
                let target = format!("/v1/meshes?{}", self.work.query);
                let answer = send(node.public, "POST", &target, &[], &picture);
                assert_eq!(answer.status, 200, "{}", answer.text());
                answer.body
            });
            let lengths = (mesh.body.len(), expected.len());
            assert!(mesh.body == *expected, "{job} has another mesh: {lengths:?}\n{}", node.log());
        }
        assert_eq!(count_listed(node), self.jobs.len());
    }
}

fn count_listed(node: &Node) -> usize {
    let (mut count, mut target) = (0, Some("/v1/jobs?limit=100".to_owned()));
    while let Some(page) = target {
        let page = node.get(&page).json();
        count += page["jobs"].as_array().unwrap().len();
        target = page["links"]["next"].as_str().map(str::to_owned);
    }
    count
}
