//! The client address of a request: the peer of its connection, and what a trusted proxy forwards.

use axum::extract::Request;
use axum::http::HeaderMap;
use ipnet::IpNet;
use std::net::IpAddr;

/// What proxies add, the nearest one last.
const FORWARDED_FOR: &str = "x-forwarded-for";

/// The other end of a connection, among a request's extensions.
#[derive(Clone, Copy, Debug)]
pub struct Peer(pub IpAddr);

/// The addresses of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClientAddress {
    /// The other end of the connection.
    pub peer: Option<IpAddr>,
    /// The client that a trusted proxy names.
    pub forwarded: Option<IpAddr>,
}

impl ClientAddress {
    /// Those of a request. Of the addresses that trusted proxies forward it is the last that is no
    /// trusted proxy itself: what stands before it anyone may have written.
    #[must_use]
    pub fn of(request: &Request, trusted: &[IpNet]) -> Self {
        let peer = request.extensions().get::<Peer>().map(|peer| peer.0.to_canonical());
        let is_trusted = |address: &IpAddr| trusted.iter().any(|network| network.contains(address));
        let forwarded = peer
            .filter(is_trusted)
            .and_then(|_| named(request.headers()).find(|address| !is_trusted(address)));
        Self { peer, forwarded }
    }
}

/// The addresses that proxies name, the last one first.
fn named(headers: &HeaderMap) -> impl Iterator<Item = IpAddr> {
    let lines = headers.get_all(FORWARDED_FOR).iter().rev();
    let texts = lines.filter_map(|line| line.to_str().ok()).flat_map(|line| line.rsplit(','));
    texts.map_while(|text| text.trim().parse::<IpAddr>().ok())
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;

    fn forwarded(peer: &str, lines: &[&str]) -> Option<String> {
        let mut request = Request::builder().extension(Peer(peer.parse().unwrap()));
        for line in lines {
            request = request.header(FORWARDED_FOR, *line);
        }
        let trusted = ["10.0.0.0/8", "127.0.0.1/32"].map(|network| network.parse().unwrap());
        let request = request.body(Body::empty()).unwrap();
        ClientAddress::of(&request, &trusted).forwarded.map(|address| address.to_string())
    }

    #[test]
    fn only_trusted_proxies_are_believed() {
        assert_eq!(forwarded("10.1.1.1", &["1.2.3.4"]).as_deref(), Some("1.2.3.4"));
        assert_eq!(forwarded("::ffff:10.1.1.1", &["1.2.3.4"]).as_deref(), Some("1.2.3.4"));
        assert_eq!(forwarded("9.9.9.9", &["1.2.3.4"]), None);
        let forged = ["6.6.6.6", "1.2.3.4, 10.2.2.2"];
        assert_eq!(forwarded("127.0.0.1", &forged).as_deref(), Some("1.2.3.4"));
        assert_eq!(forwarded("10.1.1.1", &["1.2.3.4, nonsense"]), None);
        assert_eq!(forwarded("10.1.1.1", &[]), None);
    }
}
