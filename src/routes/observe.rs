//! One span, one log line and two metrics for each request.
//!
//! `tower_http::trace` logs in callbacks that do not see the matched route, the client address and the
//! problem together, so this is a layer of our own.

use crate::extract::client_address::ClientAddress;
use crate::extract::request_id::RequestId;
use crate::problem::Problem;
use crate::telemetry;
use axum::extract::{MatchedPath, Request, State};
use axum::http::Method;
use axum::middleware::Next;
use axum::response::Response;
use http_body::Body;
use ipnet::IpNet;
use std::sync::Arc;
use std::time::Instant;
use tracing::field::Empty;
use tracing::{Instrument, error, info, info_span};

/// The layer that logs and counts.
pub(super) async fn observe(
    State(trusted): State<Arc<[IpNet]>>,
    request: Request,
    next: Next,
) -> Response {
    let id = request.extensions().get::<RequestId>();
    let span = info_span!("request", id = id.map_or("", RequestId::as_str), key = Empty);
    let matched = request.extensions().get::<MatchedPath>().cloned();
    let route = matched.as_ref().map_or(telemetry::UNKNOWN_ROUTE, MatchedPath::as_str);
    let progress = Progress::begin(span.clone());
    let method = label(request.method());
    let ClientAddress { peer, forwarded } = ClientAddress::of(&request, &trusted);
    let received = request.body().size_hint().exact();
    telemetry::adopt(&span, method, route, request.headers());
    let response = next.run(request).instrument(span.clone()).await;
    let took = progress.end();
    let code = response.status().as_u16();
    telemetry::answered(route, method, code, took);
    let _in_span = span.enter();
    let refusal = response.extensions().get::<Problem>();
    let problem = refusal.map(|problem| problem.kind().slug());
    if let Some(cause) = refusal.and_then(Problem::cause) {
        error!(cause, problem, "request failed");
    }
    info!(
        method,
        route,
        code,
        problem,
        param = refusal.and_then(Problem::named_param),
        seconds = took.as_secs_f64(),
        received,
        sent = response.body().size_hint().exact().filter(|_| refusal.is_none()),
        peer = peer.map(display),
        forwarded = forwarded.map(display),
        "answered"
    );
    response
}

/// A request in progress; dropped before its end when the client goes away.
struct Progress {
    began: Instant,
    span: tracing::Span,
    ended: bool,
}

impl Progress {
    fn begin(span: tracing::Span) -> Self {
        telemetry::requests_in_progress(1.0);
        Self { began: Instant::now(), span, ended: false }
    }

    fn end(mut self) -> std::time::Duration {
        self.ended = true;
        self.began.elapsed()
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        telemetry::requests_in_progress(-1.0);
        if !self.ended {
            self.span.in_scope(|| info!("client disconnected before the response"));
        }
    }
}

/// The method as a label: one of HTTP's, never a client's own word.
fn label(method: &Method) -> &'static str {
    match *method {
        Method::GET => "GET",
        Method::HEAD => "HEAD",
        Method::POST => "POST",
        Method::PUT => "PUT",
        Method::DELETE => "DELETE",
        Method::PATCH => "PATCH",
        Method::OPTIONS => "OPTIONS",
        _ => "OTHER",
    }
}
