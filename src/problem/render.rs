//! Writes problems out: the outermost layer, which knows the request's id.

use super::{Kind, Problem};
use crate::extract::request_id::RequestId;
use axum::body::Body;
use axum::extract::Request;
use axum::http::header::{
    ACCEPT_ENCODING, ALLOW, CONNECTION, CONTENT_LENGTH, CONTENT_RANGE, CONTENT_TYPE, RETRY_AFTER,
};
use axum::http::{HeaderValue, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value};

/// The media type of every refusal.
const MEDIA_TYPE: &str = "application/problem+json";

/// Seconds after which a client may try again what the service cannot do now: databases that nodes
/// share have elected a new leader by then.
const RETRY_AFTER_S: u64 = 5;
/// Seconds after which a client may try again when the storage is full: jobs may have expired.
const ROOM_AFTER_S: u64 = 30;

/// The members that a kept problem may have beside its kind's and its detail.
const KEPT_MEMBERS: [&str; 9] =
    ["param", "limit", "actual", "minimum", "maximum", "allowed", "nearest", "setting", "attempts"];

impl IntoResponse for Problem {
    /// A response with the problem beside it, which [`render`] writes into the body.
    fn into_response(self) -> Response {
        let mut response = self.kind.status().into_response();
        response.extensions_mut().insert(self);
        response
    }
}

/// The layer that gives every refusal its document, also those that the framework makes.
pub async fn render(request: Request, next: Next) -> Response {
    let id = request.extensions().get::<RequestId>().cloned();
    let method = request.method().clone();
    let mut response = next.run(request).await;
    if !is_refusal(response.status()) {
        return response;
    }
    let problem = response
        .extensions_mut()
        .remove::<Problem>()
        .unwrap_or_else(|| Problem::of_response(&response, &method));
    problem.write_into(response, id.as_ref())
}

fn is_refusal(status: StatusCode) -> bool {
    status.is_client_error() || status.is_server_error()
}

impl Problem {
    /// The problem of a response that says no more than its status, and which methods it allows.
    fn of_response(response: &Response, method: &Method) -> Self {
        let kind = Kind::of_status(response.status());
        let allowed = response.headers().get(ALLOW).and_then(|allowed| allowed.to_str().ok());
        let Some(allowed) = allowed else { return Self::new(kind, kind.title()) };
        let methods: Vec<&str> = allowed.split(',').map(str::trim).collect();
        let method: String = method.as_str().chars().take(64).collect();
        let wanted = methods.join(" or ");
        Self::new(kind, format!("the method {method} is not for this path: send {wanted}"))
            .allowed(&methods)
            .member("actual", method)
    }

    /// Replaces the body of `response`, and keeps headers such as `Allow`.
    fn write_into(&self, mut response: Response, id: Option<&RequestId>) -> Response {
        let headers = response.headers_mut();
        headers.remove(CONTENT_LENGTH);
        headers.insert(CONTENT_TYPE, HeaderValue::from_static(MEDIA_TYPE));
        if let Some(seconds) = self.seconds_to_retry() {
            headers.insert(RETRY_AFTER, seconds.into());
        }
        if let Some(length) = self.length_of_representation() {
            headers.insert(CONTENT_RANGE, length);
        }
        if self.kind == Kind::UnsupportedEncoding {
            headers.insert(ACCEPT_ENCODING, HeaderValue::from_static("identity"));
        }
        if self.ends_connection() {
            headers.insert(CONNECTION, HeaderValue::from_static("close"));
        }
        *response.status_mut() = self.kind.status();
        *response.body_mut() = Body::from(self.document(id));
        response
    }

    /// The JSON text of the problem.
    #[must_use]
    pub fn document(&self, id: Option<&RequestId>) -> String {
        let mut document = self.members_of_document();
        if let Some(seconds) = self.seconds_to_retry() {
            document.insert("retry_after_s".into(), seconds.into());
        }
        if let Some(id) = id {
            document.insert("request_id".into(), id.as_str().into());
        }
        Value::Object(document).to_string()
    }

    /// The problem as it is kept of a job that failed: without the id of any request.
    #[must_use]
    pub fn value(&self) -> Value {
        Value::Object(self.members_of_document())
    }

    /// The problem that was kept so; `None` when it cannot be read.
    #[must_use]
    pub fn of_value(value: &Value) -> Option<Self> {
        let reference = value.get("type")?.as_str()?;
        let kind = Kind::ALL.iter().find(|kind| kind.reference() == reference)?;
        let problem = Self::new(*kind, value.get("detail")?.as_str()?);
        let known = KEPT_MEMBERS.iter().filter_map(|name| Some((*name, value.get(*name)?)));
        Some(known.fold(problem, |problem, (name, value)| problem.member(name, value.clone())))
    }

    fn members_of_document(&self) -> Map<String, Value> {
        let mut document = self.kind.document();
        document.insert("detail".into(), self.detail.as_str().into());
        for (name, value) in &self.members {
            document.insert((*name).into(), value.clone());
        }
        document
    }

    /// When to try again: every refusal for a state of the service says so.
    fn seconds_to_retry(&self) -> Option<u64> {
        let member = self.members.iter().find(|(name, _)| *name == "retry_after_s");
        let usual = match self.kind.status() {
            StatusCode::SERVICE_UNAVAILABLE => Some(RETRY_AFTER_S),
            StatusCode::INSUFFICIENT_STORAGE => Some(ROOM_AFTER_S),
            _ => None,
        };
        member.and_then(|(_, seconds)| seconds.as_u64()).or(usual)
    }

    /// Where a range was asked for that is not there: how long all of it is.
    fn length_of_representation(&self) -> Option<HeaderValue> {
        let (_, length) = self.members.iter().find(|(name, _)| *name == "limit")?;
        let range = format!("bytes */{}", length.as_u64()?);
        HeaderValue::try_from(range).ok().filter(|_| self.kind == Kind::RangeNotSatisfiable)
    }

    /// Whether what is left of the request cannot or shall not be read.
    fn ends_connection(&self) -> bool {
        matches!(self.kind, Kind::RequestTimeout | Kind::BodyTooLarge | Kind::ShuttingDown)
    }
}

impl Kind {
    /// The members that every problem of this kind shares: type, title and status.
    #[must_use]
    pub fn document(self) -> Map<String, Value> {
        let mut document = Map::new();
        document.insert("type".into(), self.reference().into());
        document.insert("title".into(), self.title().into());
        document.insert("status".into(), self.status().as_u16().into());
        document
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_503_and_507_says_when_to_try_again() {
        for kind in Kind::ALL {
            let is_passing = matches!(kind.status().as_u16(), 503 | 507);
            let problem = Problem::new(*kind, "detail");
            assert_eq!(problem.seconds_to_retry().is_some(), is_passing, "{}", kind.slug());
        }
    }
}
