//! The conformance tests, directly and through a pooler, and tests of several nodes, restarts and
//! versions. All tests share a real server, and each has a schema of its own.

use super::*;
use crate::conformance::{Engine, conforms};
use crate::queue::Caps;
use crate::testing::{job, submit, terms};
use pixmesh_test_support::postgres::{Pooler, PostgresServer};
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
    /// Other tests use the same processors.
    const SHORT: Duration = Duration::from_millis(500);
    /// Longer than a busy machine delays anything.
    const LEASE: Duration = Duration::from_secs(3);

    async fn open(&self, terms: Terms) -> Arc<dyn Queue> {
        Arc::new(self.opened(terms).await)
    }

    /// The engine learns of the death of a node when its leases expire.
    async fn open_after_kill(&self, terms: Terms) -> Arc<dyn Queue> {
        let queue = self.open(terms).await;
        sleep(terms.lease + Self::SHORT).await;
        queue.sweep().await.unwrap();
        queue
    }
}

impl InSchema {
    async fn opened(&self, terms: Terms) -> Postgres {
        self.try_open(terms).await.unwrap()
    }

    async fn try_open(&self, terms: Terms) -> Result<Postgres, Box<dyn Error + Send + Sync>> {
        let url = if self.is_pooled { self.server.1.url() } else { self.server.0.url() };
        open(&url, &self.schema, terms).await
    }
}

async fn open(
    url: &str,
    schema: &str,
    terms: Terms,
) -> Result<Postgres, Box<dyn Error + Send + Sync>> {
    let settings = PostgresSettings {
        queue_direct: None,
        queue_connections: NonZeroU32::new(8).unwrap(),
        queue_schema: schema.into(),
        queue_password_file: None,
        queue_ca: None,
        queue_cert: None,
        queue_key: None,
    };
    Postgres::open(&url.parse().unwrap(), &settings, terms).await
}

/// A queue in a new schema of the shared server.
fn engine(case: &str, is_pooled: bool) -> InSchema {
    static SERVER: Mutex<Weak<(PostgresServer, Pooler)>> = Mutex::new(Weak::new());
    let mut shared = SERVER.lock().unwrap();
    let server = shared.upgrade().unwrap_or_else(|| {
        let server = PostgresServer::start(&["fsync=off", "max_connections=300"]);
        let pooler = Pooler::start(&server);
        let started = Arc::new((server, pooler));
        *shared = Arc::downgrade(&started);
        started
    });
    // The name of a schema has at most 32 letters. No two cases start with the same 30.
    let kind = if is_pooled { "p_" } else { "d_" };
    let schema = kind.chars().chain(case.chars()).take(32).collect();
    InSchema { server, schema, is_pooled }
}

mod direct {
    use super::*;
    fn engine(case: &str) -> InSchema {
        super::engine(case, false)
    }
    conforms! { engine, InSchema }
}

mod through_a_pooler {
    use super::*;
    fn engine(case: &str) -> InSchema {
        super::engine(case, true)
    }
    conforms! { engine, InSchema }
}
