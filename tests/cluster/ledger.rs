//! What a client knows: which jobs were accepted, and what must become of each.

use crate::client::{send, try_send};
use crate::node::Node;
use crate::pictures::disc;
use std::collections::HashMap;
use std::net::SocketAddr;
use std::thread;
use std::time::{Duration, Instant};

/// The longest time in which all jobs of a ledger come to their end.
const PATIENCE: Duration = Duration::from_secs(120);
/// Work that takes about a second.
const QUERY: &str = "method=mgpr&size=200";

/// The accepted jobs, with the number of the picture of each.
#[derive(Default)]
pub(crate) struct Ledger {
    jobs: HashMap<String, usize>,
}

fn picture(number: usize) -> Vec<u8> {
    disc(120 + number % 8, 120, 1)
}

impl Ledger {
    /// Submits jobs in turn to nodes, each with a word, again and again until it is accepted.
    pub(crate) fn submit(&mut self, nodes: &[&Node], numbers: std::ops::Range<usize>) {
        for number in numbers {
            let began = Instant::now();
            let (image, word) = (picture(number), format!("word-{number}"));
            let location = loop {
                let node = nodes[number % nodes.len()];
                let headers = [("Idempotency-Key", word.as_str())];
                let target = format!("/v1/jobs?{QUERY}");
                match try_send(node.public, "POST", &target, &headers, &image) {
                    Some(answer) if answer.status == 202 => {
                        break answer.header("location").to_owned();
                    }
                    Some(answer) => assert_eq!(answer.status, 503, "{}", answer.text()),
                    None => {}
                }
                assert!(began.elapsed() < PATIENCE, "never accepted: {number}\n{}", node.log());
                thread::sleep(Duration::from_millis(50));
            };
            let known = self.jobs.insert(location, number);
            assert!(known.is_none_or(|known| known == number), "two words, one job");
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.jobs.len()
    }

    /// How many have come to their end.
    pub(crate) fn ended(&self, node: &Node) -> usize {
        self.jobs.keys().filter(|job| node.get(job).json()["state"] == "completed").count()
    }

    /// Waits until every job is completed, with the mesh that its picture has, in at most three
    /// attempts, and that no other job is there.
    pub(crate) fn check(&self, node: &Node) {
        let began = Instant::now();
        let mut meshes: HashMap<usize, Vec<u8>> = HashMap::new();
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
            let mesh = node.get(&format!("{job}/mesh")).body;
            let expected = meshes.entry(number % 8).or_insert_with(|| direct(node.public, *number));
            assert_eq!(mesh, *expected, "{job}");
        }
        assert_eq!(count_listed(node), self.jobs.len());
    }
}

/// The mesh of a picture, made in one call.
fn direct(node: SocketAddr, number: usize) -> Vec<u8> {
    let target = format!("/v1/meshes?{QUERY}");
    let answer = send(node, "POST", &target, &[], &picture(number));
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.body
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
