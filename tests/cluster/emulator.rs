//! An emulator of the S3 protocol: the server of the Python package moto, which keeps objects in
//! memory. It shows that requests are well formed, and nothing of how a real store behaves.

use crate::client::send;
use crate::tools::{checkout, require};
use pixmesh_test_support::postgres::free_port;
use std::net::{SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Where `./test` installs it.
const INSTALLED: &str = "tests/cluster/.venv/bin/moto_server";

/// A running emulator with one bucket, `pixmesh`.
pub(crate) struct S3Emulator {
    child: Child,
    pub(crate) port: u16,
}

impl S3Emulator {
    pub(crate) fn start() -> Self {
        require(INSTALLED);
        let port = free_port();
        let child = Command::new(checkout(INSTALLED))
            .args(["-H", "127.0.0.1", "-p", &port.to_string()])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let address = SocketAddr::from(([127, 0, 0, 1], port));
        let began = Instant::now();
        while TcpStream::connect(address).is_err() {
            assert!(began.elapsed() < Duration::from_secs(60), "moto_server does not listen");
            thread::sleep(Duration::from_millis(50));
        }
        let made = send(address, "PUT", "/pixmesh", &[], b"");
        assert_eq!(made.status, 200, "{}", made.text());
        Self { child, port }
    }

    pub(crate) fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for S3Emulator {
    fn drop(&mut self) {
        self.kill();
    }
}

/// A command that finds the store at a port.
pub(crate) fn with_store_at(mut command: Command, port: u16) -> Command {
    command
        .env("AWS_ENDPOINT_URL", format!("http://127.0.0.1:{port}"))
        .env("AWS_ACCESS_KEY_ID", "emulated")
        .env("AWS_SECRET_ACCESS_KEY", "emulated")
        .env("AWS_REGION", "us-east-1");
    command
}
