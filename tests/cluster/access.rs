//! Authentication and TLS between nodes and the database.

use crate::certificates::{Authority, Identity};
use crate::client::send;
use crate::cluster::Cluster;
use crate::node::{Node, program};
use crate::pictures::disc;
use crate::start::refused;
use pixmesh_test_support::postgres::{Pooler, PostgresServer, free_port};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A wrong setting must fail before the time that a node waits for a database that is starting.
const SOON: Duration = Duration::from_secs(10);
/// Every user may connect without TLS.
const TRUST: &str = "host all all 127.0.0.1/32 trust\n";

/// A database that a user in it must authenticate to, and a folder for blobs.
struct Database {
    server: PostgresServer,
    blobs: TempDir,
}

impl Database {
    /// Starts a server that presents a certificate for a host and authenticates clients by the lines of
    /// `pg_hba.conf` before `TRUST`.
    fn start(authority: &Authority, host: &str, rules: &str) -> Self {
        let identity = authority.identity(host);
        let read = |path: &str| std::fs::read_to_string(path).unwrap();
        let files = [
            ("server.crt", read(&identity.certificate)),
            ("server.key", read(&identity.key)),
            ("authority.crt", read(&authority.path())),
            ("pg_hba.conf", format!("{rules}{TRUST}")),
        ];
        let files = files.each_ref().map(|(name, text)| (*name, text.as_str()));
        let settings = ["ssl=on", "ssl_ca_file=authority.crt"];
        let server = PostgresServer::start_with(&settings, &files);
        server.run_sql("CREATE USER \"us er\" PASSWORD 'r:g@t/'");
        server.run_sql("CREATE USER node");
        server.run_sql("GRANT CREATE ON DATABASE postgres TO \"us er\", node");
        Self { server, blobs: TempDir::new().unwrap() }
    }

    /// The address for a user (and password) with parameters.
    fn url(&self, user: &str, parameters: &str) -> String {
        format!("postgres://{user}@127.0.0.1:{}/postgres{parameters}", self.server.port)
    }

    fn flags<'a>(&self, flags: &[&'a str], blobs: &'a str) -> Vec<&'a str> {
        [&["--blobs", blobs], flags].concat()
    }

    fn blob_address(&self) -> String {
        format!("file://{}", self.blobs.path().display())
    }

    /// Checks that a node and a worker complete a job.
    #[track_caller]
    fn accepts(&self, queue: &str, flags: &[&str]) {
        let blobs = self.blob_address();
        let flags = self.flags(flags, &blobs);
        let node = Node::serve(program(), queue, &flags);
        let _worker = Node::work(program(), queue, &flags);
        let job = node.job("size=50", &disc(50, 50, 1));
        node.wait_for(&job, "completed");
    }

    /// Checks that a worker ends soon with an error that contains texts.
    #[track_caller]
    fn refuses(&self, queue: &str, flags: &[&str], texts: &[&str]) {
        refuses(queue, &self.flags(flags, &self.blob_address()), texts);
    }

    /// What `pixmesh doctor` prints.
    fn doctor(&self, queue: &str, flags: &[&str]) -> String {
        let mut command = program();
        command.args(["doctor", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0"]);
        command.args(["--queue", queue]).args(self.flags(flags, &self.blob_address()));
        let output = command.output().unwrap();
        String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned()
    }
}

#[track_caller]
fn refuses(queue: &str, flags: &[&str], texts: &[&str]) {
    let began = Instant::now();
    let worker = ["worker", "--ops-listen", "127.0.0.1:0", "--queue", queue];
    refused(&[&worker, flags].concat(), texts);
    assert!(began.elapsed() < SOON, "{:?}", began.elapsed());
}

#[test]
fn the_certificate_of_the_database_is_checked_by_the_named_authority() {
    let (authority, stranger) = (Authority::new(), Authority::new());
    let database = Database::start(&authority, "127.0.0.1", "");
    let queue = database.url("pixmesh", "");
    let (ours, theirs) = (authority.path(), stranger.path());
    database.accepts(&queue, &["--queue-ca", &ours]);
    assert!(database.doctor(&queue, &["--queue-ca", &ours]).contains("ok    queue"));
    database.refuses(&queue, &["--queue-ca", &theirs], &["authority", "--queue-ca", &theirs]);
    let verified = database.url("pixmesh", "?sslmode=verify-full");
    database.refuses(&verified, &[], &["no known authority", "--queue-ca"]);
}

#[test]
fn a_certificate_for_another_host_is_refused() {
    let authority = Authority::new();
    let database = Database::start(&authority, "db.example", "");
    let ca = authority.path();
    let queue = database.url("pixmesh", "");
    database.refuses(&queue, &["--queue-ca", &ca], &["not for the host in --queue"]);
    let without_host = database.url("pixmesh", "?sslmode=verify-ca");
    database.accepts(&without_host, &["--queue-ca", &ca]);
}

#[test]
fn a_database_without_tls_is_refused_where_tls_is_required() {
    let authority = Authority::new();
    let cluster = Cluster::start();
    let (queue, ca, blobs) = (cluster.server.url(), authority.path(), cluster.blob_address());
    let texts = ["does not offer TLS", "--queue-ca"];
    refuses(&queue, &["--queue-ca", &ca, "--blobs", &blobs], &texts);
    refuses(&format!("{queue}?sslmode=require"), &["--blobs", &blobs], &texts);
}

#[test]
fn a_database_that_requires_certificates_accepts_nodes_that_have_one() {
    let (authority, stranger) = (Authority::new(), Authority::new());
    let rules = "hostssl all node all cert\n";
    let database = Database::start(&authority, "127.0.0.1", rules);
    let queue = database.url("node", "");
    let (ours, theirs, ca) =
        (authority.identity("node"), stranger.identity("node"), authority.path());
    let flags = |identity: &Identity| {
        let Identity { certificate, key } = identity;
        ["--queue-ca", &ca, "--queue-cert", certificate, "--queue-key", key].map(str::to_owned)
    };
    database.accepts(&queue, &flags(&ours).each_ref().map(String::as_str));
    database.refuses(&queue, &["--queue-ca", &ca], &["--queue-cert"]);
    let theirs = flags(&theirs);
    database.refuses(&queue, &theirs.each_ref().map(String::as_str), &["refuses", "--queue-cert"]);
}

#[test]
fn a_pooler_and_a_direct_connection_are_used_with_tls() {
    let (authority, stranger) = (Authority::new(), Authority::new());
    let database = Database::start(&authority, "127.0.0.1", "");
    let Identity { certificate, key } = authority.identity("127.0.0.1");
    let [certificate, key] = [certificate, key].map(|path| std::fs::read_to_string(path).unwrap());
    let pooler = Pooler::start_with_tls(&database.server, &certificate, &key);
    let (ca, direct, blobs) =
        (authority.path(), database.url("pixmesh", ""), database.blob_address());
    let flags = ["--queue-ca", &ca, "--queue-direct", &direct, "--blobs", &blobs];
    let node = Node::serve(program(), &pooler.url(), &flags);
    let _worker = Node::work(program(), &pooler.url(), &flags);
    let listeners = "SELECT count(*) FROM pg_stat_activity JOIN pg_stat_ssl USING (pid)
                     WHERE query LIKE 'LISTEN%' AND ssl AND client_addr IS NOT NULL";
    assert_eq!(database.server.run_sql(listeners), "2");
    let job = node.job("size=50", &disc(50, 50, 1));
    node.wait_for(&job, "completed");
    assert!(!node.log().contains("no notifications"), "{}", node.log());
    let other = Database::start(&stranger, "127.0.0.1", "");
    let elsewhere = other.url("pixmesh", "");
    let flags = ["--queue-ca", &ca, "--queue-direct", &elsewhere];
    database.refuses(&pooler.url(), &flags, &["--queue-direct: no known authority", "--queue-ca"]);
}

#[test]
fn a_file_without_the_expected_content_is_named_with_its_setting() {
    let authority = Authority::new();
    let (node, other) = (authority.identity("node"), authority.identity("other"));
    let (ca, empty) = (authority.path(), authority.write("empty.pem", ""));
    let missing = authority.folder().join("missing").display().to_string();
    // No server is needed: the program reads the files first.
    let queue = format!("postgres://pixmesh@127.0.0.1:{}/jobs", free_port());
    let (begin, end) = ("-----BEGIN CERTIFICATE-----", "-----END CERTIFICATE-----");
    let invalid = authority.write("invalid.pem", &format!("{begin}\nAAAA\n{end}\n"));
    let refuses = |flags: &[&str], texts: &[&str]| {
        refuses(&queue, &[&["--blobs", "file:///tmp"], flags].concat(), texts);
    };
    for ca in [&missing, &empty, &node.key, &invalid] {
        refuses(&["--queue-ca", ca], &["--queue-ca", ca]);
    }
    for (certificate, key, flag, named) in [
        (&missing, &node.key, "--queue-cert", &missing),
        (&empty, &node.key, "--queue-cert", &empty),
        (&node.certificate, &missing, "--queue-key", &missing),
        (&node.certificate, &ca, "--queue-key", &ca),
    ] {
        let flags = ["--queue-ca", &ca, "--queue-cert", certificate, "--queue-key", key];
        refuses(&flags, &[flag, named]);
    }
    for password in [&missing, &empty] {
        let flags = ["--queue-password-file", password];
        refuses(&flags, &["--queue-password-file", password]);
    }
    refuses(&["--queue-cert", &node.certificate], &["--queue-key"]);
    let database = Database::start(&authority, "127.0.0.1", "");
    let flags = ["--queue-ca", &ca, "--queue-cert", &node.certificate, "--queue-key", &other.key];
    database.refuses(&database.url("node", ""), &flags, &["--queue-key", &other.key]);
}

#[test]
fn a_password_is_read_from_the_address_or_a_file_and_never_printed() {
    let authority = Authority::new();
    let rules = "host all \"us er\" all scram-sha-256\n";
    let database = Database::start(&authority, "127.0.0.1", rules);
    database.accepts(&database.url("us%20er:r%3Ag%40t%2F", ""), &[]);
    let file = authority.write("password", "r:g@t/\n");
    let queue = database.url("us%20er", "");
    database.accepts(&queue, &["--queue-password-file", &file]);
    let printed = database.doctor(&queue, &["--queue-password-file", &file]);
    assert!(printed.contains("ok    queue") && !printed.contains("us%20er"), "{printed}");
    let wrong = database.url("us%20er:wrong-one", "");
    database.refuses(&wrong, &[], &["refuses", "--queue-password-file"]);
    assert!(!database.doctor(&wrong, &[]).contains("wrong-one"));
}

#[test]
fn a_user_that_may_not_create_the_schema_is_told_which_privilege_is_missing() {
    let authority = Authority::new();
    let database = Database::start(&authority, "127.0.0.1", "");
    database.server.run_sql("REVOKE CREATE ON DATABASE postgres FROM node");
    database.refuses(&database.url("node", ""), &[], &["grant CREATE", "--queue"]);
    let other = format!("postgres://node@127.0.0.1:{}/other", database.server.port);
    database.refuses(&other, &[], &["create the database", "--queue"]);
}

#[test]
fn two_deployments_share_a_database_by_different_schemas() {
    let cluster = Cluster::start();
    let image = disc(50, 50, 1);
    let [blue, green] = ["blue", "green"].map(|name| cluster.serve(&["--queue-schema", name]));
    let key = [("Idempotency-Key", "key")];
    let location = |node: &Node, query: &str| {
        let answer = node.submit(query, &key, &image);
        assert_eq!(answer.status, 202, "{}", answer.text());
        answer.header("location").to_owned()
    };
    let queued = location(&blue, "size=50");
    let worker = cluster.work(&["--queue-schema", "green"]);
    let done = location(&green, "size=51");
    green.wait_for(&done, "completed");
    assert_eq!(worker.completions(), 1);
    assert_eq!(blue.get(&queued).json()["state"], "queued");
    assert_eq!((green.get(&queued).status, blue.get(&done).status), (404, 404));
    for node in [&blue, &green] {
        assert_eq!(node.get("/v1/jobs").json()["jobs"].as_array().unwrap().len(), 1);
    }
    assert_eq!(send(blue.public, "DELETE", &done, &[], &[]).status, 404);
}
