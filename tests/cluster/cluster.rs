//! A database server, a folder for blobs, and the nodes that share them.

use crate::node::{Node, program};
use pixmesh_test_support::postgres::{self, PostgresServer};
use tempfile::TempDir;

/// What nodes share.
pub(crate) struct Cluster {
    pub(crate) server: PostgresServer,
    pub(crate) blobs: TempDir,
}

impl Cluster {
    /// Starts a database server.
    pub(crate) fn start() -> Self {
        Self::start_with(&[])
    }

    /// Starts a database server with settings, each as `name=value`.
    pub(crate) fn start_with(settings: &[&str]) -> Self {
        Self { server: PostgresServer::start(settings), blobs: TempDir::new().unwrap() }
    }

    /// A node that takes requests and does no jobs.
    pub(crate) fn serve(&self, flags: &[&str]) -> Node {
        self.serve_at(self.server.port, flags)
    }

    /// The same with the database behind a port.
    pub(crate) fn serve_at(&self, port: u16, flags: &[&str]) -> Node {
        Node::serve(
            program(),
            &postgres::url(port),
            &[&["--blobs", &self.blob_address()], flags].concat(),
        )
    }

    /// A worker with one slot.
    pub(crate) fn work(&self, flags: &[&str]) -> Node {
        self.work_at(self.server.port, flags)
    }

    /// The same with the database behind a port.
    pub(crate) fn work_at(&self, port: u16, flags: &[&str]) -> Node {
        Node::work(
            program(),
            &postgres::url(port),
            &[&["--blobs", &self.blob_address()], flags].concat(),
        )
    }

    /// Where the blobs are.
    pub(crate) fn blob_address(&self) -> String {
        format!("file://{}", self.blobs.path().display())
    }
}
