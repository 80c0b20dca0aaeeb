//! A stream that keeps the newest value under each name.
//!
//! Reads go to the stream's leader, so that a value is seen by every node as soon as it was
//! acknowledged to one. A write names the version that it changes, and is refused where somebody was
//! quicker.

use super::answers::server_code;
use super::broker::{Broker, failure};
use crate::queue::QueueError;
use async_nats::jetstream::Context;
use async_nats::jetstream::ErrorCode;
use async_nats::jetstream::message::{PublishMessage, StreamMessage};
use async_nats::jetstream::stream::{LastRawMessageErrorKind, Stream};
use futures_util::TryStreamExt;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::error::Error;

/// What a write must find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Expected {
    /// Whatever there is.
    Anything,
    /// Nothing under this name.
    Nothing,
    /// This version.
    Version(u64),
}

/// What became of a write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Put {
    /// It is on stable storage, as this version.
    Stored(u64),
    /// Something else was there.
    Conflict,
}

/// A value, and the version by which it can be changed.
#[derive(Clone, Debug)]
pub(super) struct Versioned<T> {
    pub(super) value: T,
    pub(super) version: u64,
}

/// The way to a stream.
#[derive(Clone, Debug)]
pub(super) struct Table {
    context: Context,
    stream: Stream<()>,
    /// What all subjects of the broker's user begin with.
    prefix: String,
}

impl Table {
    /// The table in a stream that is there.
    pub(super) async fn of(broker: &Broker, stream: &str) -> Result<Self, QueueError> {
        let name = broker.stream_name(stream);
        let stream = broker.context.get_stream_no_info(name).await;
        let stream = stream.map_err(|error| failure("a stream cannot be used", &error))?;
        Ok(Self { context: broker.context.clone(), stream, prefix: broker.prefix.clone() })
    }

    /// The stream.
    pub(super) fn stream(&self) -> &Stream<()> {
        &self.stream
    }

    /// The subject of a name.
    pub(super) fn subject(&self, name: &str) -> String {
        format!("{}.{name}", self.prefix)
    }

    /// The name of a subject.
    pub(super) fn name_of<'a>(&self, subject: &'a str) -> &'a str {
        subject.strip_prefix(self.prefix.as_str()).map_or(subject, |rest| &rest[1..])
    }

    /// The value under a name; [`QueueError::Damaged`] for one that cannot be read.
    pub(super) async fn get<T: DeserializeOwned>(
        &self,
        name: &str,
    ) -> Result<Option<Versioned<T>>, QueueError> {
        self.newest(name).await?.map(|message| read(&message)).transpose()
    }

    /// What is under a name, with `None` for a value that cannot be read.
    pub(super) async fn get_readable<T: DeserializeOwned>(
        &self,
        name: &str,
    ) -> Result<Option<Versioned<Option<T>>>, QueueError> {
        let Some(message) = self.newest(name).await? else { return Ok(None) };
        let value = read(&message);
        if let Err(error) = &value {
            tracing::error!(%error);
        }
        let value = value.ok().map(|read| read.value);
        Ok(Some(Versioned { value, version: message.sequence }))
    }

    /// The message under a name.
    async fn newest(&self, name: &str) -> Result<Option<StreamMessage>, QueueError> {
        match self.stream.get_last_raw_message_by_subject(&self.subject(name)).await {
            Ok(message) => Ok(Some(message)),
            Err(error) if matches!(error.kind(), LastRawMessageErrorKind::NoMessageFound) => {
                Ok(None)
            }
            Err(error) => Err(failure("a value cannot be read", &error)),
        }
    }

    /// The first message from a version on whose name fits a filter, and its name.
    pub(super) async fn next(
        &self,
        filter: &str,
        version: u64,
    ) -> Result<Option<(String, StreamMessage)>, QueueError> {
        let next = self.stream.raw_message_builder().sequence(version.max(1));
        match next.next_by_subject(self.subject(filter)).send().await {
            Ok(message) => Ok(Some((self.name_of(&message.subject).to_owned(), message))),
            Err(error) if matches!(error.kind(), LastRawMessageErrorKind::NoMessageFound) => {
                Ok(None)
            }
            Err(error) => Err(failure("the next value cannot be read", &error)),
        }
    }

    /// Puts a value under a name.
    pub(super) async fn put<T: Serialize>(
        &self,
        name: &str,
        value: &T,
        expected: Expected,
    ) -> Result<Put, QueueError> {
        let payload = serde_json::to_vec(value)
            .map_err(|error| QueueError::Storage(format!("a value cannot be written: {error}")))?;
        let message = PublishMessage::build().payload(payload.into());
        self.publish(name, with_expectation(message, expected)).await
    }

    /// Publishes a message under a name.
    pub(super) async fn publish(
        &self,
        name: &str,
        message: PublishMessage,
    ) -> Result<Put, QueueError> {
        let message = message.outbound_message(self.subject(name));
        let headers = message.headers.unwrap_or_default();
        let sent =
            self.context.publish_with_headers(message.subject, headers, message.payload).await;
        let acknowledged = match sent {
            Ok(acknowledgement) => acknowledgement.await,
            Err(error) => Err(error),
        };
        match acknowledged {
            Ok(acknowledgement) => Ok(Put::Stored(acknowledgement.sequence)),
            Err(error) if is_conflict(&error) => Ok(Put::Conflict),
            Err(error) => Err(failure("a value cannot be stored", &error)),
        }
    }

    /// Leaves nothing under the names that fit a filter.
    pub(super) async fn remove(&self, filter: &str) -> Result<(), QueueError> {
        let removed = self.stream.purge().filter(self.subject(filter)).await;
        removed.map(|_| ()).map_err(|error| failure("a value cannot be removed", &error))
    }

    /// Takes the message under a name away. Unlike [`Self::remove`] this leaves consumers alone,
    /// which upon a purge forget for a while what they were to give out again.
    pub(super) async fn take_away(&self, name: &str) -> Result<(), QueueError> {
        match self.newest(name).await? {
            Some(message) => self.delete(name, message.sequence).await,
            None => Ok(()),
        }
    }

    /// Deletes the message of a version under a name, of which only the newest is kept.
    pub(super) async fn delete(&self, name: &str, version: u64) -> Result<(), QueueError> {
        let Err(error) = self.stream.delete_message(version).await else { return Ok(()) };
        // Somebody may have been quicker, as whoever answers it is; the server's error does not tell.
        match self.newest(name).await? {
            Some(message) if message.sequence == version => {
                Err(failure("a message cannot be taken away", &error))
            }
            _ => Ok(()),
        }
    }

    /// The names that fit a filter, in no order.
    pub(super) async fn names(&self, filter: &str) -> Result<Vec<String>, QueueError> {
        let info = self.stream.info_with_subjects(self.subject(filter)).await;
        let info = info.map_err(|error| failure("names cannot be read", &error))?;
        info.map_ok(|(subject, _)| self.name_of(&subject).to_owned())
            .try_collect()
            .await
            .map_err(|error| failure("names cannot be read", &error))
    }

    /// Whether there is something under a name that fits a filter.
    pub(super) async fn has(&self, filter: &str) -> Result<bool, QueueError> {
        Ok(self.next(filter, 1).await?.is_some())
    }
}

/// The value of a message.
pub(super) fn read<T: DeserializeOwned>(
    message: &StreamMessage,
) -> Result<Versioned<T>, QueueError> {
    let value = serde_json::from_slice(&message.payload).map_err(|error| {
        QueueError::Damaged(format!("the value under {}: {error}", message.subject))
    })?;
    Ok(Versioned { value, version: message.sequence })
}

fn with_expectation(message: PublishMessage, expected: Expected) -> PublishMessage {
    match expected {
        Expected::Anything => message,
        Expected::Nothing => message.expected_last_subject_sequence(0),
        Expected::Version(version) => message.expected_last_subject_sequence(version),
    }
}

/// Whether a write found something else than it expected.
fn is_conflict(error: &(dyn Error + 'static)) -> bool {
    matches!(
        server_code(error),
        Some(
            ErrorCode::STREAM_WRONG_LAST_SEQUENCE | ErrorCode::STREAM_WRONG_LAST_SEQUENCE_CONSTANT
        )
    )
}
