//! The connection to the broker, and what a failure of it means.

use super::answers::server_code;
use super::connection::connected;
use super::start::Start;
use crate::nats::settings::BrokerSettings;
use crate::queue::QueueError;
use async_nats::Client;
use async_nats::connection::State;
use async_nats::jetstream::ErrorCode;
use async_nats::jetstream::context::{AccountError, AccountErrorKind, Context};
use std::error::Error;

/// The oldest server that has what is needed: one that takes part in elections quickly and bounds
/// what is asked of it.
const OLDEST_SERVER: (i64, i64, i64) = (2, 11, 0);

/// A connection, which comes back by itself when it is lost.
#[derive(Clone, Debug)]
pub struct Broker {
    /// The connection.
    pub(super) client: Client,
    /// The same, for streams.
    pub(crate) context: Context,
    /// What the names of streams and subjects begin with.
    pub(super) prefix: String,
    /// Copies of each stream.
    pub(crate) replicas: usize,
}

impl Broker {
    /// Connects, and checks that the server can do what is asked of it.
    ///
    /// # Errors
    /// When none of the servers answers, refuses the credentials, is too old, or has no JetStream.
    pub async fn connect(settings: &BrokerSettings) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let client = connected(settings).await?;
        check_version(&client, settings)?;
        let context = async_nats::jetstream::new(client.clone());
        check_jetstream(&context, settings).await?;
        let is_cluster = client.server_info().cluster.is_some();
        let replicas = settings.replicas(is_cluster);
        Ok(Self { client, context, prefix: settings.queue_prefix.clone(), replicas })
    }

    /// The name of a stream, of which there is one of its kind under a prefix.
    pub(crate) fn stream_name(&self, kind: &str) -> String {
        format!("{}-{kind}", self.prefix)
    }

    /// Makes a stream or a bucket. A cluster that has just come up, or elects a leader, does not know
    /// all its servers yet: it is asked again for as long as a start may take.
    pub(crate) async fn made<T, E, F>(&self, make: impl Fn() -> F + Send + Sync) -> Result<T, E>
    where
        T: Send,
        E: Error + Send + 'static,
        F: Future<Output = Result<T, E>> + Send,
    {
        let is_cluster = self.client.server_info().cluster.is_some();
        let start = Start::begin();
        loop {
            let made = make().await;
            let is_forming = made.as_ref().err().is_some_and(|error| is_forming(error));
            if !(is_cluster && is_forming && start.goes_on().await) {
                return made;
            }
        }
    }

    /// Whether there is a connection now.
    pub(super) fn is_connected(&self) -> bool {
        self.client.connection_state() == State::Connected
    }
}

fn check_version(client: &Client, settings: &BrokerSettings) -> Result<(), String> {
    let (major, minor, patch) = OLDEST_SERVER;
    if client.is_server_compatible(major, minor, patch) {
        return Ok(());
    }
    let found = client.server_info().version;
    Err(format!(
        "--queue {settings}: the broker is nats-server {found}, and {major}.{minor} or newer is \
         needed"
    ))
}

/// Waits until JetStream answers, which it does not while a cluster elects its leader.
async fn check_jetstream(context: &Context, settings: &BrokerSettings) -> Result<(), String> {
    let start = Start::begin();
    loop {
        let Err(error) = context.query_account().await else { return Ok(()) };
        let is_off = is_off(&error);
        let is_cluster = context.client().server_info().cluster.is_some();
        if (is_off && !is_cluster) || !start.goes_on().await {
            let what = if is_off {
                "has no JetStream, where jobs are kept: start nats-server with -js and a store_dir, \
                 and allow it for the account"
            } else {
                "does not answer to JetStream: allow this node's user to publish to $JS.API.> and to \
                 subscribe to _INBOX.>"
            };
            let error = causes(&error);
            return Err(format!("--queue {settings}: the broker {what} ({error})"));
        }
    }
}

/// Whether the broker, or its account, has no JetStream.
fn is_off(error: &AccountError) -> bool {
    let codes = [ErrorCode::JETSTREAM_NOT_ENABLED, ErrorCode::JETSTREAM_NOT_ENABLED_FOR_ACCOUNT];
    error.kind() == AccountErrorKind::JetStreamUnavailable
        || server_code(error).is_some_and(|code| codes.contains(&code))
}

/// What a failure means for those who asked.
pub(crate) fn failure(what: &str, error: &(dyn Error + 'static)) -> QueueError {
    let text = format!("{what}: {}", causes(error));
    match server_code(error) {
        Some(_) if is_full(error) => QueueError::BrokerFull(text),
        Some(_) => QueueError::Broker(text),
        None => QueueError::Unreachable(text),
    }
}

/// Whether an error says that the broker takes no more.
pub(crate) fn is_full(error: &(dyn Error + 'static)) -> bool {
    matches!(
        server_code(error),
        Some(
            ErrorCode::INSUFFICIENT_RESOURCES
                | ErrorCode::STORAGE_RESOURCES_EXCEEDED
                | ErrorCode::ACCOUNT_RESOURCES_EXCEEDED
                | ErrorCode::STREAM_STORE_FAILED
        )
    )
}

/// Whether an error is one of a cluster that is not complete.
fn is_forming(error: &(dyn Error + 'static)) -> bool {
    matches!(
        server_code(error),
        Some(
            ErrorCode::CLUSTER_INCOMPLETE
                | ErrorCode::CLUSTER_NO_PEERS
                | ErrorCode::CLUSTER_NOT_ACTIVE
                | ErrorCode::CLUSTER_NOT_AVAILABLE
                | ErrorCode::INSUFFICIENT_RESOURCES
        )
    )
}

/// An error with all that caused it, each said once.
pub(super) fn causes(error: &(dyn Error + 'static)) -> String {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        next = cause.source();
        let cause = cause.to_string();
        if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}
