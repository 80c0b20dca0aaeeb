//! `GET /v1/jobs/{id}/events`: what happens to a job, as it happens (server-sent events).
//!
//! Each event has the job's revision as its id. A client that comes back with `Last-Event-ID` hears
//! what it missed; one without hears what is known from the beginning. The stream ends with the
//! event of a final state, and when the service stops.

use super::document::JobEvent;
use super::found;
use crate::access::Share;
use crate::extract::fields::Few;
use crate::problem::{Kind, Problem};
use crate::routes::openapi::answers::{Problems, ProblemsOf};
use crate::routes::openapi::bodies::Text;
use crate::routes::openapi::parameters::{JobPath, LastEventId};
use crate::service::Service;
use crate::telemetry::Open;
use axum::Extension;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, Request, State};
use axum::http::HeaderMap;
use axum::response::sse::{Event, KeepAlive};
use axum::response::{IntoResponse, Response, Sse};
use futures_util::stream::{self, Stream};
use pixmesh_engine::Owner;
use pixmesh_jobs::queue::Queue;
use pixmesh_jobs::record::{Event as Change, JobId};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// The header by which a client says what it heard last.
const LAST_EVENT_ID: &str = "last-event-id";
/// How often something is sent, so that nobody on the way takes the connection for dead.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// How long a client shall wait before it comes back.
const COME_BACK: Duration = Duration::from_secs(1);

/// Answers with the stream.
///
/// # Errors
/// `not-found`, or `gone` when the job is no longer kept.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/events", operation_id = "followJob",
    summary = "The events of a job, as they happen",
    description = "Server-sent events named state and progress, the data of each a JobEvent, until \
                   the job ends. A client that reconnects with Last-Event-ID receives what it missed.",
    params(JobPath, LastEventId),
    responses(
        (
            status = 200, description = "The events", body = inline(Text),
            content_type = "text/event-stream",
        ),
        Problems, ProblemsOf::<404>, ProblemsOf::<410>,
    ),
    security((), ("key" = [])),
)]
pub async fn follow(
    State(service): State<Arc<Service>>,
    Extension(owner): Extension<Owner>,
    path: Result<Path<String>, PathRejection>,
    request: Request,
) -> Result<Response, Problem> {
    Few::of_query(&[], request.uri().query())?;
    let id = found::find(&service, &owner, path).await?.id;
    let most = service.followers_of_each;
    let place = service.followers.take(&owner, most).ok_or_else(|| too_many(most))?;
    let follower = Follower {
        _place: (place, Open::event_stream()),
        queue: Arc::clone(&service.jobs.queue),
        owner,
        stop: service.shutdown.stop.clone(),
        id,
        last: last_event(request.headers()),
        changes: VecDeque::new(),
        has_ended: false,
    };
    let keep_alive = KeepAlive::new().interval(KEEP_ALIVE);
    let events = Sse::new(follower.events()).keep_alive(keep_alive);
    // Proxies that collect answers must not collect this one.
    Ok(([("x-accel-buffering", "no")], events).into_response())
}

/// The revision that a client heard of last; 0 for one that says nothing of use.
fn last_event(headers: &HeaderMap) -> u64 {
    let text = headers.get(LAST_EVENT_ID).and_then(|value| value.to_str().ok());
    text.and_then(|text| text.trim().parse().ok()).unwrap_or(0)
}

fn too_many(most: usize) -> Problem {
    let detail =
        format!("{most} event streams are open already, which is the limit: close one first");
    Problem::new(Kind::QuotaExceeded, detail)
        .setting("--key-event-streams")
        .member("limit", most)
        .retry_after_s(COME_BACK.as_secs())
}

/// One who follows a job.
struct Follower {
    /// Counts it until it ends.
    _place: (Share<Owner>, Open),
    queue: Arc<dyn Queue>,
    owner: Owner,
    stop: CancellationToken,
    id: JobId,
    /// The revision sent last.
    last: u64,
    /// What is still to be sent.
    changes: VecDeque<Change>,
    has_ended: bool,
}

impl Follower {
    fn events(self) -> impl Stream<Item = Result<Event, axum::Error>> {
        stream::unfold(self, |mut follower| async {
            let change = follower.next().await?;
            Some((written(follower.id, &change), follower))
        })
    }

    /// The next change; `None` after the last one.
    async fn next(&mut self) -> Option<Change> {
        if self.changes.is_empty() && !self.has_ended {
            let changes = tokio::select! {
                changes = self.queue.events(&self.owner, self.id, self.last) => changes,
                () = self.stop.cancelled() => return None,
            };
            let changes = changes.inspect_err(|error| {
                tracing::error!(%error, "job events not read");
            });
            self.changes = changes.ok()?.into();
        }
        let change = self.changes.pop_front()?;
        self.last = change.revision;
        self.has_ended = change.state.is_final();
        Some(change)
    }
}

fn written(id: JobId, change: &Change) -> Result<Event, axum::Error> {
    let kind = if change.progress.is_some() { "progress" } else { "state" };
    Event::default()
        .id(change.revision.to_string())
        .event(kind)
        .retry(COME_BACK)
        .json_data(JobEvent::new(id, change))
}
