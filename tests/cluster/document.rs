//! The commands in the document on many machines.

use crate::emulator::{Protocol, StoreEmulator};
use crate::node::{Node, program};
use crate::pictures::disc;
use crate::tools::checkout;
use pixmesh_test_support::postgres::PostgresServer;
use std::fs;
use tempfile::TempDir;

/// A user needs its password.
const RULES: &str = "host jobs pixmesh 127.0.0.1/32 scram-sha-256\n";

#[test]
fn the_commands_of_the_document_start_nodes_that_complete_a_job() {
    let document = fs::read_to_string(checkout("docs/scaling.md")).unwrap();
    let block = document.split("```sh\n").nth(1).unwrap().split("```").next().unwrap();
    let [serve, work] = block.lines().collect::<Vec<_>>()[..] else { panic!("{block}") };
    let cluster = Documented::start();
    let node = cluster.run(serve);
    let _worker = cluster.run(work);
    let job = node.job("size=50", &disc(50, 50, 1));
    node.wait_for(&job, "completed");
}

/// The database and the store that the commands name, elsewhere, and a folder with the password.
struct Documented {
    database: PostgresServer,
    store: StoreEmulator,
    folder: TempDir,
}

impl Documented {
    fn start() -> Self {
        let trust = format!("{RULES}local all all trust\nhost all all 127.0.0.1/32 trust\n");
        let database = PostgresServer::start_with(&[], &[("pg_hba.conf", &trust)]);
        database.run_sql("ALTER USER pixmesh PASSWORD 'secret'");
        database.run_sql("CREATE DATABASE jobs");
        let folder = TempDir::new().unwrap();
        fs::write(folder.path().join("password"), "secret\n").unwrap();
        Self { database, store: StoreEmulator::start(Protocol::S3), folder }
    }

    /// Runs a command with the addresses of this machine.
    fn run(&self, command: &str) -> Node {
        let database = format!("127.0.0.1:{}", self.database.port);
        let command = command.replace("db:5432", &database);
        let command = command.replace("s3://BUCKET", self.store.bucket());
        let words: Vec<_> = command.split_whitespace().collect();
        let ["pixmesh", role, "--queue", queue, flags @ ..] = words.as_slice() else {
            panic!("{command}")
        };
        let mut program = self.store.at_port(program(), self.store.port);
        program.current_dir(self.folder.path());
        Node::start(program, role, queue, flags)
    }
}
