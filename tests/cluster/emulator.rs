//! Emulators of stores on the network: moto for S3, the same behind a changed signature for Google
//! Cloud Storage, and Azurite for Azure. They keep objects in memory. They show that requests are
//! well formed, and nothing of how a real store behaves.

use crate::client::send;
use crate::tools::{checkout, require};
use pixmesh_test_support::postgres::free_port;
use std::net::{SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Where `./test` installs them.
const MOTO: &str = "tests/cluster/.venv/bin/moto_server";
const PYTHON: &str = "tests/cluster/.venv/bin/python";
const AZURITE: &str = "tests/cluster/azurite/node_modules/.bin/azurite-blob";

/// The protocol of a store.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Protocol {
    S3,
    Google,
    Azure,
}

/// A running emulator with one bucket, `pixmesh`.
pub(crate) struct StoreEmulator {
    protocol: Protocol,
    child: Child,
    pub(crate) port: u16,
}

impl StoreEmulator {
    pub(crate) fn start(protocol: Protocol) -> Self {
        let port = free_port();
        let number = port.to_string();
        let (program, arguments) = match protocol {
            Protocol::S3 => (MOTO, vec!["-H", "127.0.0.1", "-p", &number]),
            Protocol::Google => (PYTHON, vec!["tests/cluster/gcs_server.py", &number]),
            Protocol::Azure => (
                AZURITE,
                vec!["--inMemoryPersistence", "--disableTelemetry", "--blobPort", &number],
            ),
        };
        require(program);
        let child = Command::new(checkout(program))
            .args(arguments)
            .current_dir(checkout("."))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let emulator = Self { protocol, child, port };
        let began = Instant::now();
        while TcpStream::connect(emulator.listens_at()).is_err() {
            assert!(began.elapsed() < Duration::from_secs(60), "{program} does not listen");
            thread::sleep(Duration::from_millis(50));
        }
        emulator.create_bucket();
        emulator
    }

    fn create_bucket(&self) {
        if let Protocol::Azure = self.protocol {
            let script = checkout("tests/cluster/azurite/create_container.mjs");
            let status = Command::new("node").arg(script).arg(self.port.to_string()).status();
            assert!(status.unwrap().success());
            return;
        }
        let made = send(self.listens_at(), "PUT", "/pixmesh", &[], b"");
        assert_eq!(made.status, 200, "{}", made.text());
    }

    fn listens_at(&self) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], self.port))
    }

    /// The address of the bucket.
    pub(crate) fn bucket(&self) -> &'static str {
        match self.protocol {
            Protocol::S3 => "s3://pixmesh",
            Protocol::Google => "gs://pixmesh",
            Protocol::Azure => "az://pixmesh",
        }
    }

    /// A command that finds the store at a port: its own, or that of a proxy.
    pub(crate) fn at_port(&self, mut command: Command, port: u16) -> Command {
        let endpoint = format!("http://127.0.0.1:{port}");
        match self.protocol {
            Protocol::S3 => command
                .env("AWS_ENDPOINT_URL", endpoint)
                .env("AWS_ACCESS_KEY_ID", "emulated")
                .env("AWS_SECRET_ACCESS_KEY", "emulated")
                .env("AWS_REGION", "us-east-1"),
            Protocol::Google => command.env("GOOGLE_BASE_URL", endpoint).env(
                "GOOGLE_SERVICE_ACCOUNT_KEY",
                r#"{"disable_oauth":true,"client_email":"","private_key":"","private_key_id":""}"#,
            ),
            Protocol::Azure => command
                .env("AZURE_STORAGE_USE_EMULATOR", "true")
                .env("AZURITE_BLOB_STORAGE_URL", endpoint),
        };
        command
    }

    pub(crate) fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for StoreEmulator {
    fn drop(&mut self) {
        self.kill();
    }
}
