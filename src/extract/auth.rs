//! Authentication by `Authorization: Bearer`, and the quota of the key.
//!
//! Where there are keys, everything below `/v1/` needs one, whether or not there is anything at the
//! path, so that nobody without a key learns what exists. A handler finds the [`Owner`] among the
//! request's extensions.

use crate::access::{Holder, KeyRing, Standing};
use crate::problem::{Kind, Problem};
use axum::extract::{Request, State};
use axum::http::header::{AUTHORIZATION, WWW_AUTHENTICATE};
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use pixmesh_engine::Owner;
use pixmesh_engine::telemetry::{Shed, shed};
use std::sync::Arc;

/// The paths that need a key.
const GUARDED: &str = "/v1/";
/// The fields of RateLimit (draft-ietf-httpapi-ratelimit-headers).
static RATE_LIMIT: HeaderName = HeaderName::from_static("ratelimit");
static RATE_LIMIT_POLICY: HeaderName = HeaderName::from_static("ratelimit-policy");

/// The detail of a request without a key.
pub(crate) const KEY_NEEDED: &str = "a key is needed: send the header Authorization: Bearer KEY";

/// Whether the key of a request may operate the jobs of all owners.
#[derive(Clone, Copy, Debug)]
pub struct IsOperator(pub bool);

/// The layer that authenticates a request and counts it against the quota.
pub async fn authenticate(
    State(keys): State<Option<Arc<KeyRing>>>,
    mut request: Request,
    next: Next,
) -> Response {
    let keys = keys.filter(|_| request.uri().path().starts_with(GUARDED));
    let Some(keys) = keys else {
        request.extensions_mut().insert(Owner::Anonymous);
        return next.run(request).await;
    };
    let Holder { owner, is_operator, quota } = match holder(&keys, request.headers()) {
        Ok(found) => found,
        Err(refused) => return refused.into_response(),
    };
    tracing::Span::current().record("key", owner.as_str());
    let standing = quota.take();
    let mut response = match standing {
        Ok(_) => {
            request.extensions_mut().insert(owner);
            request.extensions_mut().insert(IsOperator(is_operator));
            next.run(request).await
        }
        Err(standing) => {
            shed(Shed::Quota);
            exhausted(standing).into_response()
        }
    };
    let (Ok(standing) | Err(standing)) = standing;
    tell(standing, response.headers_mut());
    response
}

/// The holder of the one key that a request presents.
fn holder(keys: &KeyRing, headers: &HeaderMap) -> Result<Holder, Unauthorized> {
    let mut given = headers.get_all(AUTHORIZATION).iter();
    let (Some(only), None) = (given.next(), given.next()) else {
        return Err(match headers.contains_key(AUTHORIZATION) {
            false => Unauthorized::Missing,
            true => Unauthorized::Unreadable,
        });
    };
    let key = bearer(only).ok_or(Unauthorized::Unreadable)?;
    keys.find(key).ok_or(Unauthorized::Unknown)
}

/// What follows the word `Bearer`, which may be written in any case.
fn bearer(value: &HeaderValue) -> Option<&str> {
    let (scheme, key) = value.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| key.trim_matches(' '))
}

/// Why authentication fails (RFC 6750, section 3.1).
#[derive(Clone, Copy, Debug)]
enum Unauthorized {
    Missing,
    Unreadable,
    Unknown,
}

impl IntoResponse for Unauthorized {
    fn into_response(self) -> Response {
        let (detail, challenge) = match self {
            Self::Missing => (KEY_NEEDED, "Bearer realm=\"pixmesh\""),
            Self::Unreadable => (
                "the header Authorization must be there once, as Bearer KEY",
                "Bearer realm=\"pixmesh\", error=\"invalid_request\"",
            ),
            Self::Unknown => (
                "there is no such key, or no longer",
                "Bearer realm=\"pixmesh\", error=\"invalid_token\"",
            ),
        };
        let mut response = Problem::new(Kind::Unauthorized, detail).into_response();
        response.headers_mut().insert(WWW_AUTHENTICATE, HeaderValue::from_static(challenge));
        response
    }
}

/// The refusal of a request over the quota.
pub(crate) fn exhausted(standing: Standing) -> Problem {
    let limit = standing.per_minute;
    let detail = format!(
        "the key has used up its {limit} requests per minute: wait for the seconds in Retry-After"
    );
    Problem::new(Kind::QuotaExceeded, detail)
        .setting("--key-requests-per-minute")
        .member("limit", limit)
        .retry_after_s(standing.reset_s)
}

/// Adds the headers RateLimit and RateLimit-Policy.
fn tell(standing: Standing, headers: &mut HeaderMap) {
    let Standing { per_minute, remaining, reset_s } = standing;
    let fields = [
        (&RATE_LIMIT_POLICY, format!("\"requests\";q={per_minute};w=60")),
        (&RATE_LIMIT, format!("\"requests\";r={remaining};t={reset_s}")),
    ];
    for (name, text) in fields {
        if let Ok(value) = HeaderValue::try_from(text) {
            headers.insert(name, value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scheme_may_be_written_in_any_case_and_nothing_else_is_one() {
        let key = |text: &str| bearer(&HeaderValue::try_from(text).unwrap()).map(str::to_owned);
        assert_eq!(key("Bearer abc"), Some("abc".into()));
        assert_eq!(key("bEARER  abc "), Some("abc".into()));
        for text in ["", "abc", "Basic abc", "Bearerabc"] {
            assert_eq!(key(text), None, "{text}");
        }
    }
}
