//! Which pages a browser may send requests from: the service's own, and those of the origins that
//! the settings name.
//!
//! Browsers send forms of any page to any address, this service's too, and a page whose name
//! resolves to this address (DNS rebinding) could even read the answers. So requests that a browser
//! says come from another origin are refused below `/v1/`, and a service that anyone on this
//! machine may use answers to this machine's names alone. Programs send neither header and are not
//! affected.
//!
//! Literature: W3C, "Fetch Metadata Request Headers", 2024; RFC 6454 (Origin).

use crate::config::Visitors;
use crate::problem::{Kind, Problem};
use axum::extract::{Request, State};
use axum::http::HeaderMap;
use axum::http::header::{HOST, ORIGIN};
use axum::http::uri::Authority;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::IpAddr;
use std::sync::Arc;

/// What pages of other origins may not ask for.
const GUARDED: &str = "/v1/";
/// Says where a request comes from, as browsers see it.
const SITE: &str = "sec-fetch-site";

/// The layer that refuses requests for other hosts and of foreign pages.
pub(super) async fn admit(
    State(visitors): State<Arc<Visitors>>,
    request: Request,
    next: Next,
) -> Response {
    match visitors.refusal(&request) {
        Some(problem) => problem.into_response(),
        None => next.run(request).await,
    }
}

impl Visitors {
    fn refusal(&self, request: &Request) -> Option<Problem> {
        let host = host_of(request);
        // HTTP/1.0 names no host, and no browser speaks it.
        let names_host = host.is_some() || request.headers().contains_key(HOST);
        let is_own = host.as_ref().is_some_and(|host| self.is_own(host.host()));
        if self.hosts.is_some() && names_host && !is_own {
            let detail =
                "the service only accepts requests for localhost and the hosts of --allowed-host";
            return Some(Problem::new(Kind::UnknownHost, detail).setting("--allowed-host"));
        }
        let is_guarded = request.uri().path().starts_with(GUARDED);
        (is_guarded && self.is_foreign(request.headers(), host.as_ref())).then(|| {
            let detail = "a browser sent this request for a page of another origin";
            Problem::new(Kind::ForeignOrigin, detail).setting("--cors-origin")
        })
    }

    /// Whether a host's name is one of loopback or one that the settings name.
    fn is_own(&self, name: &str) -> bool {
        let name = name.trim_start_matches('[').trim_end_matches([']', '.']).to_ascii_lowercase();
        let is_loopback = match name.parse::<IpAddr>() {
            Ok(address) => address.is_loopback(),
            Err(_) => name == "localhost" || name.ends_with(".localhost"),
        };
        is_loopback || self.hosts.iter().flatten().any(|allowed| *allowed == name)
    }

    /// Whether a browser sent a request for a page of another origin that is not let in.
    fn is_foreign(&self, headers: &HeaderMap, host: Option<&Authority>) -> bool {
        let text = |name: &str| headers.get(name).and_then(|value| value.to_str().ok());
        let origin = headers.get(ORIGIN).map(|origin| origin.to_str().unwrap_or_default());
        if origin.is_some_and(|origin| self.origins.iter().any(|known| known == origin)) {
            return false;
        }
        match (text(SITE), origin) {
            (Some("same-origin" | "none"), _) | (None, None) => false,
            (Some(_), _) => true,
            // Browsers of before 2023 say no more than the origin.
            (None, Some(origin)) => {
                let own = origin.split_once("://").map(|(_, host)| host);
                own.is_none() || own != host.map(Authority::as_str)
            }
        }
    }
}

/// The host and port that a request is for.
fn host_of(request: &Request) -> Option<Authority> {
    let header = || request.headers().get(HOST)?.to_str().ok()?.parse().ok();
    request.uri().authority().cloned().or_else(header)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;

    fn slug(visitors: &Visitors, headers: &[(&str, &str)]) -> Option<&'static str> {
        let mut request = Request::builder().uri("/v1/jobs");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let request = request.body(Body::empty()).unwrap();
        visitors.refusal(&request).map(|problem| problem.kind().slug())
    }

    #[test]
    fn only_names_of_this_machine_are_answered_to() {
        let own = Visitors { origins: vec![], hosts: Some(vec!["mesh.test".into()]) };
        for host in [
            "localhost",
            "LOCALHOST.:8080",
            "a.localhost",
            "127.0.0.9:1",
            "[::1]:8080",
            "mesh.test",
        ] {
            assert_eq!(slug(&own, &[("host", host)]), None, "{host}");
        }
        for host in
            ["evil.example", "127.0.0.1.evil.example", "localhost.evil", "10.0.0.1", "@", ""]
        {
            assert_eq!(slug(&own, &[("host", host)]), Some("unknown-host"), "{host}");
        }
        let any = Visitors { hosts: None, ..own };
        assert_eq!(slug(&any, &[("host", "evil.example")]), None);
    }

    #[test]
    fn pages_of_other_origins_are_refused_unless_named() {
        let visitors = Visitors { origins: vec!["https://a.test".into()], hosts: None };
        let from = |more: &[(&str, &str)]| {
            slug(&visitors, &[&[("host", "mesh.test:8080")], more].concat())
        };
        for allowed in [
            &[][..],
            &[("origin", "https://a.test"), ("sec-fetch-site", "cross-site")],
            &[("origin", "http://mesh.test:8080")],
            // A proxy may have another name than the service.
            &[("origin", "https://proxy.test"), ("sec-fetch-site", "same-origin")],
            &[("sec-fetch-site", "none")],
        ] {
            assert_eq!(from(allowed), None, "{allowed:?}");
        }
        for refused in [
            &[("sec-fetch-site", "cross-site")][..],
            &[("sec-fetch-site", "same-site"), ("origin", "http://b.mesh.test")],
            &[("origin", "https://evil.example")],
            &[("origin", "null")],
            &[("origin", "http://mesh.test")],
        ] {
            assert_eq!(from(refused), Some("foreign-origin"), "{refused:?}");
        }
    }
}
