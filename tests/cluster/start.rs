//! What stops a start, and what it says.

use crate::nats_server::{NatsServer, free_port, program};
use crate::node;
use std::process::Output;

fn start(flags: &[&str]) -> Output {
    node::program().args(flags).output().unwrap()
}

#[track_caller]
fn refused(flags: &[&str], needles: &[&str]) {
    let output = start(flags);
    assert!(!output.status.success());
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    for needle in needles {
        assert!(text.contains(needle), "{needle} in {text}");
    }
}

#[test]
fn settings_that_cannot_be_together_are_refused_with_what_would_do() {
    refused(&["worker"], &["--queue nats://"]);
    refused(&["serve", "--no-worker"], &["--no-worker", "--queue nats://"]);
    refused(&["serve", "--blobs", "nats"], &["--blobs nats", "--queue nats://"]);
    refused(
        &["serve", "--queue", "nats://a", "--blobs", "file"],
        &["file:///FOLDER", "s3://BUCKET"],
    );
    refused(&["serve", "--queue", "redis://a"], &["nats://HOST:PORT"]);
    refused(&["serve", "--queue-prefix", "a.b"], &["--queue-prefix"]);
}

#[test]
fn a_broker_without_streams_is_refused_with_how_to_start_one() {
    let Some(program) = program() else { return };
    let broker = NatsServer::start_with(&program, "");
    let queue = broker.address();
    refused(&["worker", "--ops-listen", "127.0.0.1:0", "--queue", &queue], &["JetStream", "-js"]);
}

#[test]
fn a_broker_that_wants_a_password_refuses_without_showing_one() {
    let Some(program) = program() else { return };
    let broker = NatsServer::start_with(
        &program,
        "jetstream { store_dir: \"STORE\" }\nauthorization { user: u, password: right }",
    );
    let address = |password: &str| format!("nats://u:{password}@127.0.0.1:{}", broker.port);
    let flags = |queue: &str| {
        ["doctor", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0", "--queue", queue]
            .map(str::to_owned)
    };
    let run = |queue: &str| {
        let flags = flags(queue);
        let output = start(&flags.each_ref().map(String::as_str));
        String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned()
    };
    let refused = run(&address("wrong-one"));
    assert!(refused.contains("BAD   queue") && !refused.contains("wrong-one"), "{refused}");
    let accepted = run(&address("right"));
    assert!(accepted.contains("ok    queue") && !accepted.contains("right@"), "{accepted}");
}

#[test]
fn a_broker_that_is_not_there_is_named() {
    let queue = format!("nats://127.0.0.1:{}", free_port());
    refused(&["worker", "--ops-listen", "127.0.0.1:0", "--queue", &queue], &[&queue, "reached"]);
}
