//! What stops a start, and what it says.

use crate::nats_server::{NatsServer, free_port, program};
use crate::node;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::process::Output;
use std::thread;

fn start(flags: &[&str]) -> Output {
    node::program().args(flags).output().unwrap()
}

/// Is refused at its start, and says certain words.
#[track_caller]
pub(crate) fn refused(flags: &[&str], needles: &[&str]) {
    let output = start(flags);
    assert!(!output.status.success());
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    for needle in needles {
        assert!(text.contains(needle), "{needle} in {text}");
    }
}

#[test]
fn settings_that_cannot_be_together_are_refused_with_what_would_do() {
    refused(&["worker"], &["--queue postgres://"]);
    refused(&["serve", "--no-worker"], &["--no-worker", "--queue postgres://"]);
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
fn an_account_without_streams_is_refused_the_same_way() {
    let Some(program) = program() else { return };
    let broker = NatsServer::start_with(
        &program,
        "jetstream { store_dir: \"STORE\" }\naccounts { plain { users: [{ user: u, password: p }] } }",
    );
    let queue = format!("nats://u:p@127.0.0.1:{}", broker.port);
    let needles = ["JetStream", "-js", "account"];
    refused(&["worker", "--ops-listen", "127.0.0.1:0", "--queue", &queue], &needles);
}

#[test]
fn more_copies_than_there_are_servers_are_refused_with_the_setting() {
    let Some(program) = program() else { return };
    let broker = NatsServer::start(&program);
    let queue = broker.address();
    let folder = format!("file://{}", std::env::temp_dir().display());
    for blobs in ["nats", &folder] {
        let flags = ["--queue", &queue, "--queue-replicas", "3", "--blobs", blobs];
        let flags = [&["worker", "--ops-listen", "127.0.0.1:0"], &flags[..]].concat();
        refused(&flags, &["--queue-replicas 3", "non-clustered"]);
    }
}

/// What says it is an old server is none: as much of one as a node asks before it knows.
#[test]
fn a_broker_that_is_too_old_is_refused_with_both_versions() {
    let queue = format!("nats://127.0.0.1:{}", claim_to_be("2.9.10"));
    refused(
        &["worker", "--ops-listen", "127.0.0.1:0", "--queue", &queue],
        &["--queue", "nats-server 2.9.10", "2.11 or newer"],
    );
}

/// Greets like a server of a version, and answers nothing but pings; returns its port.
fn claim_to_be(version: &str) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let greeting = format!(
        "INFO {{\"server_id\":\"old\",\"server_name\":\"old\",\"version\":\"{version}\",\
         \"host\":\"127.0.0.1\",\"port\":{port},\"max_payload\":1048576,\"proto\":1,\
         \"headers\":true,\"jetstream\":true}}\r\n"
    );
    thread::spawn(move || {
        for mut connection in listener.incoming().map_while(Result::ok) {
            connection.write_all(greeting.as_bytes()).unwrap();
            let lines = BufReader::new(connection.try_clone().unwrap()).lines();
            for line in lines.map_while(Result::ok) {
                if line == "PING" && connection.write_all(b"PONG\r\n").is_err() {
                    break;
                }
            }
        }
    });
    port
}

#[test]
fn a_broker_that_is_not_there_is_named() {
    let queue = format!("nats://127.0.0.1:{}", free_port());
    refused(&["worker", "--ops-listen", "127.0.0.1:0", "--queue", &queue], &[&queue, "reached"]);
}
