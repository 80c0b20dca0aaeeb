//! Whom a broker lets in, and which broker a node trusts.

use crate::certificates::Authority;
use crate::nats_server::{NatsServer, free_port, program};
use crate::node::{self, Node};
use crate::operator::{Operator, strange_credentials};
use crate::pictures::disc;
use crate::start::refused;
use std::path::Path;
use std::time::{Duration, Instant};

/// How soon it must be known that something is refused: not after all the time that a broker has
/// to come up.
const SOON: Duration = Duration::from_secs(10);
const STREAMS: &str = "jetstream { sync_interval: always, store_dir: \"STORE\" }\n";

/// The flags of a worker that is to be refused.
fn worker<'a>(queue: &'a str, flags: &[&'a str]) -> Vec<&'a str> {
    [&["worker", "--ops-listen", "127.0.0.1:0", "--queue", queue], flags].concat()
}

/// Refused for a reason, and soon.
#[track_caller]
fn turned_away(queue: &str, flags: &[&str], needles: &[&str]) {
    let began = Instant::now();
    refused(&worker(queue, flags), needles);
    assert!(began.elapsed() < SOON, "{:?}", began.elapsed());
}

/// A node that takes requests and one that works do a job together.
#[track_caller]
fn let_in(queue: &str, flags: &[&str]) {
    let (node, _worker) = (Node::serve(queue, flags), Node::work(queue, flags));
    let job = node.job("size=50", &disc(50, 50, 1));
    node.wait_for(&job, "completed");
}

/// What doctor says of a queue.
fn examined(queue: &str, flags: &[&str]) -> String {
    let mut command = node::program();
    command.args(["doctor", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0"]);
    let output = command.args(["--queue", queue]).args(flags).output().unwrap();
    String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned()
}

/// A server that shows a certificate; with `verify` it asks for one, too.
fn secured(program: &Path, authority: &Authority, host: &str, verify: bool) -> NatsServer {
    let server = authority.identity(host);
    let configuration = format!(
        "{STREAMS}tls {{ cert_file: \"{}\", key_file: \"{}\", ca_file: \"{}\", verify: {verify} }}",
        server.certificate,
        server.key,
        authority.path()
    );
    NatsServer::start_with(program, &configuration)
}

#[test]
fn a_broker_s_certificate_is_checked_by_the_authority_that_is_named() {
    let Some(program) = program() else { return };
    let (authority, stranger) = (Authority::new(), Authority::new());
    let broker = secured(&program, &authority, "127.0.0.1", false);
    let queue = format!("tls://127.0.0.1:{}", broker.port);
    let_in(&queue, &["--queue-ca", &authority.path()]);
    // A server that wants TLS gets it, whatever the address says.
    let plain = examined(&broker.address(), &["--queue-ca", &authority.path()]);
    assert!(plain.contains("ok    queue"), "{plain}");
    let wrong = stranger.path();
    turned_away(&queue, &["--queue-ca", &wrong], &["authority", "--queue-ca", &wrong]);
    turned_away(&queue, &[], &["certificate", "name its file with --queue-ca"]);
}

#[test]
fn a_machine_whose_authorities_cannot_be_read_is_told_at_once() {
    let Some(program) = program() else { return };
    let authority = Authority::new();
    let broker = secured(&program, &authority, "127.0.0.1", false);
    let missing = authority.folder().join("missing").display().to_string();
    let queue = format!("tls://127.0.0.1:{}", broker.port);
    let began = Instant::now();
    let mut command = node::program();
    command.env("SSL_CERT_FILE", &missing).args(worker(&queue, &[]));
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("TLS cannot be set up"), "{said}");
    assert!(said.contains(&missing), "{said}");
    assert!(began.elapsed() < SOON, "{:?}", began.elapsed());
}

#[test]
fn a_certificate_for_another_host_is_refused() {
    let Some(program) = program() else { return };
    let authority = Authority::new();
    let broker = secured(&program, &authority, "broker.example", false);
    let queue = format!("tls://127.0.0.1:{}", broker.port);
    let flags = ["--queue-ca", &authority.path()];
    turned_away(&queue, &flags, &["not for the host in --queue", "127.0.0.1"]);
}

#[test]
fn a_broker_without_tls_is_not_spoken_to_where_tls_is_asked_for() {
    let Some(program) = program() else { return };
    let (authority, broker) = (Authority::new(), NatsServer::start(&program));
    let queue = format!("tls://127.0.0.1:{}", broker.port);
    turned_away(&queue, &["--queue-ca", &authority.path()], &["does not speak TLS"]);
    let flags = ["--queue-ca", &authority.path()];
    turned_away(&broker.address(), &flags, &["does not speak TLS", "--queue-ca"]);
}

#[test]
fn a_broker_that_wants_certificates_lets_in_those_who_have_one() {
    let Some(program) = program() else { return };
    let (authority, stranger) = (Authority::new(), Authority::new());
    let broker = secured(&program, &authority, "127.0.0.1", true);
    let queue = format!("tls://127.0.0.1:{}", broker.port);
    let (ours, theirs) = (authority.identity("node"), stranger.identity("node"));
    let ca = authority.path();
    let flags = |identity: &'_ crate::certificates::Identity| {
        ["--queue-ca", &ca, "--queue-cert", &identity.certificate, "--queue-key", &identity.key]
            .map(str::to_owned)
    };
    let_in(&queue, &flags(&ours).each_ref().map(String::as_str));
    turned_away(&queue, &["--queue-ca", &ca], &["wants a certificate", "--queue-cert"]);
    let theirs = flags(&theirs);
    turned_away(&queue, &theirs.each_ref().map(String::as_str), &["refuses", "--queue-cert"]);
}

#[test]
fn a_file_that_is_of_no_use_is_named_with_its_setting() {
    let authority = Authority::new();
    let (node, other) = (authority.identity("node"), authority.identity("other"));
    let (ca, empty) = (authority.path(), authority.write("empty.pem", ""));
    let missing = authority.folder().join("missing").display().to_string();
    // Nobody need listen there: files are read first.
    let queue = format!("tls://127.0.0.1:{}", free_port());
    let (begin, end) = ("-----BEGIN CERTIFICATE-----", "-----END CERTIFICATE-----");
    let nonsense = authority.write("nonsense.pem", &format!("{begin}\nAAAA\n{end}\n"));
    for ca in [&missing, &empty, &node.key, &nonsense] {
        turned_away(&queue, &["--queue-ca", ca], &["--queue-ca", ca]);
    }
    for (certificate, key, flag, named) in [
        (&missing, &node.key, "--queue-cert", &missing),
        (&empty, &node.key, "--queue-cert", &empty),
        (&nonsense, &node.key, "--queue-cert", &nonsense),
        (&node.certificate, &missing, "--queue-key", &missing),
        (&node.certificate, &ca, "--queue-key", &ca),
        (&node.certificate, &other.key, "--queue-key", &other.key),
    ] {
        let flags = ["--queue-ca", &ca, "--queue-cert", certificate, "--queue-key", key];
        turned_away(&queue, &flags, &[flag, named]);
    }
    for credentials in [&missing, &empty, &ca] {
        let flags = ["--queue-credentials", credentials];
        turned_away(&queue, &flags, &["--queue-credentials", credentials]);
    }
    let alone = ["--queue-cert", &node.certificate];
    turned_away(&queue, &alone, &["--queue-key"]);
}

#[test]
fn a_name_with_its_password_is_let_in_and_no_other() {
    let Some(program) = program() else { return };
    let users = format!("{STREAMS}authorization {{ user: us er, password: \"r:g@t/\" }}");
    let users = users.replace("us er", "\"us er\"");
    let broker = NatsServer::start_with(&program, &users);
    let address = |user: &str| format!("nats://{user}127.0.0.1:{}", broker.port);
    let right = address("us%20er:r%3Ag%40t%2F@");
    let_in(&right, &[]);
    let said = examined(&right, &[]);
    assert!(said.contains("ok    queue") && !said.contains("us%20er"), "{said}");
    let wrong = address("us%20er:wrong-one@");
    turned_away(&wrong, &[], &["refuses the name and password in --queue"]);
    assert!(!examined(&wrong, &[]).contains("wrong-one"));
    turned_away(&address(""), &[], &["wants credentials", "--queue-credentials"]);
}

#[test]
fn a_token_is_let_in_and_no_other() {
    let Some(program) = program() else { return };
    let token = format!("{STREAMS}authorization {{ token: \"secret-token\" }}");
    let broker = NatsServer::start_with(&program, &token);
    let address = |token: &str| format!("nats://{token}@127.0.0.1:{}", broker.port);
    let_in(&address("secret-token"), &[]);
    turned_away(&address("wrong-token"), &[], &["refuses the token in --queue"]);
    let said = examined(&address("wrong-token"), &[]);
    assert!(said.contains("BAD   queue") && !said.contains("wrong-token"), "{said}");
}

#[test]
fn a_user_that_an_operator_s_account_has_signed_is_let_in_by_a_file_of_credentials() {
    let Some(program) = program() else { return };
    let (operator, files) = (Operator::new(), Authority::new());
    let configuration = format!("{STREAMS}{}", operator.configuration());
    let broker = NatsServer::start_with(&program, &configuration);
    let queue = broker.address();
    let good = files.write("good.creds", &operator.credentials());
    let_in(&queue, &["--queue-credentials", &good]);
    for (name, text) in [
        ("strange.creds", strange_credentials()),
        ("expired.creds", operator.expired_credentials()),
    ] {
        let path = files.write(name, &text);
        turned_away(&queue, &["--queue-credentials", &path], &["refuses", name]);
    }
    turned_away(&queue, &[], &["wants credentials"]);
}

#[test]
fn a_user_needs_the_permissions_that_are_documented_and_is_told_when_they_are_missing() {
    let Some(program) = program() else { return };
    let users = "authorization { users: [
        { user: u, password: p, permissions: { publish: \"pixmesh.>\" } }
        { user: all, password: p, permissions: {
            publish: [\"$JS.API.>\", \"$JS.ACK.>\", \"$O.>\", \"pixmesh.>\"]
            subscribe: [\"_INBOX.>\", \"pixmesh.>\"]
        } }
    ] }";
    let broker = NatsServer::start_with(&program, &format!("{STREAMS}{users}"));
    let queue = |user: &str| format!("nats://{user}:p@127.0.0.1:{}", broker.port);
    refused(&worker(&queue("u"), &[]), &["$JS.API.>", "_INBOX.>"]);
    let_in(&queue("all"), &[]);
    assert!(!broker.log().contains("Violation - User \"all\""), "{}", broker.log());
}

#[test]
fn one_server_of_several_is_enough_to_start_with() {
    let Some(program) = program() else { return };
    let broker = NatsServer::start(&program);
    let queue = format!("nats://127.0.0.1:{},{}", free_port(), broker.address());
    let_in(&queue, &[]);
}

#[test]
fn two_deployments_share_a_broker_and_see_nothing_of_each_other() {
    let Some(program) = program() else { return };
    let broker = NatsServer::start(&program);
    let (queue, image) = (broker.address(), disc(50, 50, 1));
    let blue = Node::serve(&queue, &["--queue-prefix", "blue"]);
    let green = Node::serve(&queue, &["--queue-prefix", "green"]);
    let word = [("Idempotency-Key", "word")];
    let waiting = blue.submit("size=50", &word, &image);
    assert_eq!(waiting.status, 202, "{}", waiting.text());
    let waiting = waiting.header("location").to_owned();
    let worker = Node::work(&queue, &["--queue-prefix", "green"]);
    let other = green.submit("size=51", &word, &image);
    assert_eq!(other.status, 202, "the same word in another deployment: {}", other.text());
    let other = other.header("location").to_owned();
    green.wait_for(&other, "completed");
    worker.wait_until("it has said so", || worker.completions() == 1);
    assert_eq!(blue.get(&waiting).json()["state"], "queued");
    assert_eq!((green.get(&waiting).status, blue.get(&other).status), (404, 404));
    for (node, count) in [(&blue, 1), (&green, 1)] {
        assert_eq!(node.get("/v1/jobs").json()["jobs"].as_array().unwrap().len(), count);
    }
    let _worker = Node::work(&queue, &["--queue-prefix", "blue"]);
    blue.wait_for(&waiting, "completed");
}
