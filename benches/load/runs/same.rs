//! The same requests again and again, side by side: the same bytes each time.

use super::{Setting, workers};
use crate::driver::closed_loop;
use crate::report::Result;
use crate::row;
use crate::server::Server;
use crate::work::Work;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// Answers that are compared.
const REPEATS: usize = 1000;
/// The same in the short form.
const SHORT_REPEATS: usize = 40;
/// Different requests.
const KINDS: usize = 4;
/// Their classes, by which the answers are told apart.
const CLASSES: [&str; KINDS] = ["a", "b", "c", "d"];
const QUERIES: [&str; KINDS] =
    ["density=2", "method=med&format=glb", "method=med&format=png", "density=1&format=svg"];

pub(super) fn run(setting: &Setting) -> Result {
    let server = Server::start(&[]);
    let works: Vec<Work> =
        CLASSES.iter().zip(QUERIES).map(|(class, query)| Work::new(class, 0.1, query, 1)).collect();
    let make = |number: usize| works[number % KINDS].request(0);
    let mut tags: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    let wanted = if setting.is_short { SHORT_REPEATS } else { REPEATS };
    let mut compared = 0;
    while compared < wanted {
        let clients = 3 * workers();
        for outcome in closed_loop(server.public, clients, Duration::from_secs(1), &make) {
            let answer = outcome.answer.unwrap();
            assert_eq!(answer.status, 200);
            tags.entry(outcome.class).or_default().insert(answer.header("etag").to_owned());
            compared += 1;
        }
    }
    let different: usize = tags.values().map(|tags| tags.len() - 1).sum();
    assert!(tags.values().flatten().all(|tag| tag.len() > 40), "tags are digests of the bytes");
    Result {
        figures: vec![("S15".into(), different as f64)],
        rows: vec![row!["answers", "requests", "different"], row![compared, KINDS, different]],
        notes: vec![
            "Answers are compared by their entity tags, the digests of their bytes.".into(),
        ],
        ..Result::default()
    }
}
