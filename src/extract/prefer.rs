//! `Prefer` (RFC 7240): `respond-async` and `wait`, which make a request a job.

use axum::http::HeaderMap;
use std::time::Duration;

/// What a client prefers; what cannot be read is no preference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Preference {
    /// `respond-async`.
    pub respond_async: bool,
    /// `wait`.
    pub wait: Option<Duration>,
}

impl Preference {
    /// The preferences of a request; the first of each name counts.
    #[must_use]
    pub fn of(headers: &HeaderMap) -> Self {
        let values = headers.get_all("prefer").iter().filter_map(|value| value.to_str().ok());
        let mut preference = Self::default();
        for item in values.flat_map(|value| value.split(',')) {
            let item = item.split(';').next().unwrap_or_default();
            let (name, value) = item.split_once('=').unwrap_or((item, ""));
            let value = value.trim().trim_matches('"');
            match name.trim().to_ascii_lowercase().as_str() {
                "respond-async" => preference.respond_async = true,
                "wait"
                    if preference.wait.is_none() && value.bytes().all(|b| b.is_ascii_digit()) =>
                {
                    preference.wait = value.parse().ok().map(Duration::from_secs);
                }
                _ => {}
            }
        }
        preference
    }

    /// Whether the request becomes a job.
    #[must_use]
    pub fn is_for_job(self) -> bool {
        self.respond_async || self.wait.is_some()
    }

    /// The value of `Preference-Applied`.
    #[must_use]
    pub fn applied(self) -> String {
        let wait = self.wait.map(|wait| format!("wait={}", wait.as_secs()));
        let respond_async = self.respond_async.then(|| "respond-async".to_owned());
        respond_async.into_iter().chain(wait).collect::<Vec<_>>().join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn preference(values: &[&'static str]) -> Preference {
        let mut headers = HeaderMap::new();
        for value in values {
            headers.append("prefer", value.parse().unwrap());
        }
        Preference::of(&headers)
    }

    #[test]
    fn preferences_are_found_among_others_and_in_any_case() {
        let both = preference(&["return=minimal, Respond-Async;x=y", "WAIT = \"10\", wait=3"]);
        assert_eq!(both.wait, Some(Duration::from_secs(10)));
        assert!(both.respond_async && both.is_for_job());
        assert_eq!(both.applied(), "respond-async, wait=10");
    }

    #[test]
    fn what_cannot_be_read_is_no_preference() {
        for value in ["", "wait", "wait=-1", "wait=x", "wait=1.5", "respond-asynchronously"] {
            assert_eq!(preference(&[value]), Preference::default(), "{value}");
        }
        assert_eq!(preference(&["wait=99999999999999999999999"]), Preference::default());
    }
}
