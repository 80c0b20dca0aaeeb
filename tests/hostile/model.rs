//! Random sequences of calls against a model of the jobs' states.
//!
//! Time is not in the model: a job that waits may run a moment later. So what is seen of a job must
//! be reachable from what was seen of it before, and what a call answers must fit one of the states
//! that the job can have been in.

use crate::client::{Answer, send};
use crate::pictures::{disc, noise};
use crate::server::Server;
use proptest::prelude::*;
use proptest_state_machine::{ReferenceStateMachine, StateMachineTest, prop_state_machine};

/// What is submitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Done in moments.
    Quick,
    /// Takes minutes.
    Slow,
    /// Fails: the picture is broken behind its header.
    Broken,
}

/// A call; jobs are counted in the order in which they were made.
#[derive(Clone, Debug)]
enum Call {
    Submit {
        kind: Kind,
        word: Option<u8>,
    },
    Look {
        job: usize,
    },
    Mesh {
        job: usize,
    },
    Delete {
        job: usize,
    },
    List,
    /// Waits until no quick or broken job is held up.
    Settle,
}

/// What the calls so far must have led to, whatever the time they took.
#[derive(Clone, Debug, Default)]
struct Expected {
    /// The kind of each job, and the word it was submitted with.
    jobs: Vec<(Kind, Option<u8>)>,
}

/// What a submission with a word becomes.
enum Became {
    New,
    Same(usize),
    /// Refused: the word stands for another job.
    Reused,
    /// Refused: the word's job is deleted.
    Gone,
}

struct Calls;

impl ReferenceStateMachine for Calls {
    type State = Expected;
    type Transition = Call;

    fn init_state() -> BoxedStrategy<Expected> {
        Just(Expected::default()).boxed()
    }

    fn transitions(state: &Expected) -> BoxedStrategy<Call> {
        let kind =
            prop_oneof![6 => Just(Kind::Quick), 2 => Just(Kind::Slow), 1 => Just(Kind::Broken)];
        let word = prop_oneof![3 => Just(None), 2 => (0..3_u8).prop_map(Some)];
        let submit = (kind, word).prop_map(|(kind, word)| Call::Submit { kind, word }).boxed();
        if state.jobs.is_empty() {
            return submit;
        }
        let job = 0..state.jobs.len();
        prop_oneof![
            4 => submit,
            3 => job.clone().prop_map(|job| Call::Look { job }),
            2 => job.clone().prop_map(|job| Call::Mesh { job }),
            3 => job.prop_map(|job| Call::Delete { job }),
            1 => Just(Call::List),
            1 => Just(Call::Settle),
        ]
        .boxed()
    }

    fn apply(mut state: Expected, call: &Call) -> Expected {
        if let Call::Submit { kind, word } = call {
            // A word that was used stays with its job here; the service decides whether it is new.
            state.jobs.push((*kind, *word));
        }
        state
    }

    fn preconditions(state: &Expected, call: &Call) -> bool {
        match call {
            Call::Look { job } | Call::Mesh { job } | Call::Delete { job } => {
                *job < state.jobs.len()
            }
            _ => true,
        }
    }
}

/// What is known of a job.
#[derive(Clone, Debug)]
struct Known {
    path: String,
    kind: Kind,
    word: Option<u8>,
    /// The last state that was seen; `None` once it is deleted.
    seen: Option<String>,
    cancelled: bool,
}

struct Service {
    server: Server,
    /// The job that each submission became; `None` where it was refused.
    submissions: Vec<Option<usize>>,
    jobs: Vec<Known>,
}

fn is_final(state: &str) -> bool {
    ["completed", "failed", "cancelled"].contains(&state)
}

/// The rank of a state: a job only ever goes up.
fn rank(state: &str) -> u8 {
    match state {
        "queued" => 0,
        "running" => 1,
        _ => 2,
    }
}

impl Service {
    fn became(&self, kind: Kind, word: Option<u8>) -> Became {
        let earlier = self.jobs.iter().position(|job| word.is_some() && job.word == word);
        match earlier {
            None => Became::New,
            Some(job) if self.jobs[job].seen.is_none() => Became::Gone,
            Some(job) if self.jobs[job].kind == kind => Became::Same(job),
            Some(_) => Became::Reused,
        }
    }

    fn submit(&mut self, kind: Kind, word: Option<u8>) {
        let picture = disc(24, 24, 3);
        let (query, image) = match kind {
            Kind::Quick => ("size=20", picture),
            Kind::Slow => ("method=mgpr&density=1", noise(1200)),
            Kind::Broken => ("size=20", picture[..picture.len() / 2].to_vec()),
        };
        let word_text = word.map(|word| format!("word-{word}"));
        let headers: Vec<_> =
            word_text.iter().map(|word| ("Idempotency-Key", word.as_str())).collect();
        let answer = self.server.submit(query, &headers, &image);
        let became = self.became(kind, word);
        let job = match became {
            Became::Reused => {
                answer.problem(422, "idempotency-key-reused");
                None
            }
            Became::Gone => {
                answer.problem(410, "gone");
                None
            }
            Became::New => {
                assert_eq!(answer.status, 202, "{}", answer.text());
                let path = answer.header("location").to_owned();
                assert!(self.jobs.iter().all(|job| job.path != path));
                let seen = Some(answer.json()["state"].as_str().unwrap().to_owned());
                self.jobs.push(Known { path, kind, word, seen, cancelled: false });
                Some(self.jobs.len() - 1)
            }
            Became::Same(job) => {
                assert_eq!(
                    (answer.status, answer.header("location")),
                    (202, self.jobs[job].path.as_str())
                );
                Some(job)
            }
        };
        self.submissions.push(job);
    }

    /// Looks at a job, whose state must be reachable from the one seen before.
    fn look(&mut self, job: usize) {
        let known = &mut self.jobs[job];
        let answer = self.server.get(&known.path);
        let Some(seen) = &known.seen else {
            answer.problem(404, "not-found");
            return;
        };
        assert_eq!(answer.status, 200, "{}", answer.text());
        let document = answer.json();
        let state = document["state"].as_str().unwrap().to_owned();
        assert!(rank(&state) >= rank(seen), "{seen} became {state}");
        assert!(!is_final(seen) || *seen == state, "{seen} became {state}");
        let allowed = match (known.kind, known.cancelled) {
            (_, false) if !is_final(&state) => true,
            (Kind::Quick, false) => state == "completed",
            (Kind::Broken, false) => state == "failed",
            (Kind::Slow, false) => false,
            (Kind::Quick, true) => state != "failed",
            (Kind::Broken, true) => state != "completed",
            (Kind::Slow, true) => ["running", "cancelled"].contains(&state.as_str()),
        };
        assert!(allowed, "{known:?} is {state}");
        assert_eq!(document["mesh"].is_null(), state != "completed");
        assert_eq!(document["error"].is_null(), state != "failed");
        known.seen = Some(state);
    }

    fn mesh(&mut self, job: usize) {
        let known = &self.jobs[job];
        let answer = self.server.get(&format!("{}/mesh", known.path));
        match known.seen.as_deref() {
            None => drop(answer.problem(404, "not-found")),
            Some("completed") => assert_eq!(answer.status, 200, "{}", answer.text()),
            Some("failed" | "cancelled") => drop(answer.problem(409, "job-without-mesh")),
            // It may have come to its end meanwhile.
            Some(_) => assert!([200, 409].contains(&answer.status), "{}", answer.text()),
        }
        self.look(job);
    }

    fn delete(&mut self, job: usize) {
        let known = &mut self.jobs[job];
        let answer: Answer = send(self.server.public, "DELETE", &known.path, &[], &[]);
        match known.seen.as_deref() {
            None => drop(answer.problem(404, "not-found")),
            Some(state) if is_final(state) => assert_eq!(answer.status, 204, "{}", answer.text()),
            Some(_) => assert!([202, 204].contains(&answer.status), "{}", answer.text()),
        }
        match answer.status {
            202 => known.cancelled = true,
            204 => known.seen = None,
            _ => {}
        }
        self.look(job);
    }

    /// The list has every job that is not deleted, newest first, and no other.
    fn list(&self) {
        let document = self.server.get("/v1/jobs?limit=100").json();
        let listed: Vec<&str> = document["jobs"]
            .as_array()
            .unwrap()
            .iter()
            .map(|job| job["links"]["self"].as_str().unwrap())
            .collect();
        let there = self.jobs.iter().filter(|job| job.seen.is_some());
        let expected: Vec<&str> = there.rev().map(|job| job.path.as_str()).collect();
        assert_eq!(listed, expected);
    }

    /// Cancels what is slow, and waits for the end of all else.
    fn settle(&mut self) {
        for job in 0..self.jobs.len() {
            let known = &self.jobs[job];
            let is_open = known.seen.as_deref().is_some_and(|state| !is_final(state));
            if known.kind == Kind::Slow && is_open && !known.cancelled {
                self.delete(job);
            }
        }
        for job in 0..self.jobs.len() {
            let path = self.jobs[job].path.clone();
            if self.jobs[job].seen.is_some() {
                self.server.wait_until("it has come to its end", || {
                    is_final(self.server.get(&path).json()["state"].as_str().unwrap())
                });
            }
            self.look(job);
        }
    }
}

impl StateMachineTest for Service {
    type SystemUnderTest = Self;
    type Reference = Calls;

    fn init_test(_: &Expected) -> Self {
        let server = Server::start(&["--workers", "1"]);
        Self { server, submissions: Vec::new(), jobs: Vec::new() }
    }

    fn apply(mut service: Self, _: &Expected, call: Call) -> Self {
        let jobs = service.submissions.clone();
        let known = |job: usize| jobs.get(job).copied().flatten();
        match call {
            Call::Submit { kind, word } => service.submit(kind, word),
            Call::Look { job } => known(job).into_iter().for_each(|job| service.look(job)),
            Call::Mesh { job } => known(job).into_iter().for_each(|job| service.mesh(job)),
            Call::Delete { job } => known(job).into_iter().for_each(|job| service.delete(job)),
            Call::List => service.list(),
            Call::Settle => service.settle(),
        }
        service
    }

    fn check_invariants(service: &Self, _: &Expected) {
        let running = service.server.metric("pixmesh_jobs_in_progress");
        assert!(running <= 1.0, "{running} at a time on one worker");
    }

    fn teardown(mut service: Self, _: Expected) {
        service.settle();
        service.list();
        service.server.wait_until_idle();
    }
}

/// How many sequences are tried: `PROPTEST_CASES` of them, or a few.
fn cases() -> ProptestConfig {
    let given = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok());
    ProptestConfig { cases: given.unwrap_or(12), max_shrink_iters: 40, ..ProptestConfig::default() }
}

prop_state_machine! {
    #![proptest_config(cases())]

    #[test]
    fn whatever_is_called_in_whatever_order_each_job_goes_from_state_to_state_as_promised(
        sequential 1..25 => Service
    );
}
