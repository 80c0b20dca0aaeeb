//! What the queue in a database promises like all engines, directly and through a pooler, and some
//! promises of its own. All tests share a real server, and each has a schema of its own.

use super::*;
use crate::conformance::{Engine, conforms};
use crate::fairness::Caps;
use crate::record::Picture;
use pixmesh_test_support::postgres::{self as servers, Pooler, PostgresServer};
use std::num::NonZeroU32;
use std::sync::Weak;

mod nodes;

mod restarts;
mod versions;

/// A queue in a schema of a server.
struct InSchema {
    server: Arc<(PostgresServer, Pooler)>,
    schema: String,
    is_pooled: bool,
}

#[async_trait]
impl Engine for InSchema {
    /// The server is asked over a connection, and other tests use the same processor.
    const SHORT: Duration = Duration::from_millis(500);
    /// Longer than a busy machine holds anything up.
    const LEASE: Duration = Duration::from_secs(3);

    async fn open(&self, terms: Terms) -> Arc<dyn Queue> {
        Arc::new(self.opened(terms).await)
    }

    /// That a process has ended shows when its leases end.
    async fn open_after_kill(&self, terms: Terms) -> Arc<dyn Queue> {
        let queue = self.open(terms).await;
        sleep(terms.lease + Self::SHORT).await;
        queue.sweep().await.unwrap();
        queue
    }
}

impl InSchema {
    async fn opened(&self, terms: Terms) -> Postgres {
        Postgres::open(&self.settings(), terms).await.unwrap()
    }

    fn settings(&self) -> PostgresSettings {
        let url = if self.is_pooled { self.server.1.url() } else { self.server.0.url() };
        settings(url, &self.schema)
    }
}

fn settings(url: String, schema: &str) -> PostgresSettings {
    PostgresSettings {
        url,
        direct_url: None,
        ca: None,
        certificate: None,
        key: None,
        password_file: None,
        max_connections: NonZeroU32::new(8).unwrap(),
        schema: schema.into(),
    }
}

/// One in a schema of its own on a server that all tests share while there are any; `None` where there is
/// no server to be had.
fn engine(promise: &str, is_pooled: bool) -> Option<InSchema> {
    static SERVER: Mutex<Weak<(PostgresServer, Pooler)>> = Mutex::new(Weak::new());
    let (programs, pooler) = (servers::programs()?, servers::pooler()?);
    let mut shared = SERVER.lock().unwrap();
    let server = shared.upgrade().unwrap_or_else(|| {
        let server = PostgresServer::start(&programs, &["fsync=off", "max_connections=300"]);
        let pooler = Pooler::start(&pooler, &server);
        let started = Arc::new((server, pooler));
        *shared = Arc::downgrade(&started);
        started
    });
    // A schema has 32 letters at the most, and these are no two promises' beginning.
    let kind = if is_pooled { "p_" } else { "d_" };
    let schema = kind.chars().chain(promise.chars()).take(32).collect();
    Some(InSchema { server, schema, is_pooled })
}

mod direct {
    use super::*;
    fn engine(promise: &str) -> Option<InSchema> {
        super::engine(promise, false)
    }
    conforms! { engine, InSchema }
}

mod through_a_pooler {
    use super::*;
    fn engine(promise: &str) -> Option<InSchema> {
        super::engine(promise, true)
    }
    conforms! { engine, InSchema }
}

fn terms() -> Terms {
    let caps = Caps { queued: 10_000, queued_per_owner: 10_000, running_per_owner: 10_000 };
    let hour = Duration::from_hours(1);
    Terms {
        caps,
        lease: hour,
        result_ttl: hour,
        idempotency_ttl: hour,
        gone_ttl: hour,
        look_again: Duration::from_secs(1),
    }
}

fn job(owner: &Owner, image: &str) -> NewJob {
    NewJob {
        id: JobId::new(),
        owner: owner.clone(),
        order: "density=2".into(),
        picture: Picture::of_bytes(image.as_bytes()),
        idempotency_key: None,
    }
}

async fn submit(queue: &dyn Queue, owner: &Owner, image: &str) -> JobId {
    let submitted = queue.submit(job(owner, image)).await.unwrap();
    let Submitted::Created(record) = submitted else { panic!("{submitted:?}") };
    record.id
}
