//! Sees what of a request's head is ambiguous, before the HTTP library decides it.
//!
//! A request with both `Content-Length` and `Transfer-Encoding` ends at different places for
//! different readers, and so does one whose lines end in LF alone; behind a proxy, what one of them
//! takes for a body the other takes for a request ("request smuggling"; RFC 9112, sections 2.2 and
//! 6.1). The library resolves both silently, so the bytes are looked at on their way in: heads are
//! read, bodies of a known length skipped. After a request with `Transfer-Encoding` nothing needs
//! looking at, because the service answers no other on that connection.
//!
//! A request of HTTP/1.1 with no or more than one `Host` is for different hosts to different
//! readers (RFC 9112, section 3.2), and the library does not mind it either.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The longest head that is looked at; the library refuses longer ones itself.
const MAX_HEAD: usize = 128 * 1024;

/// The longest body that the library can count; the next two numbers mean other things to it.
const MAX_LENGTH: u64 = u64::MAX - 2;

/// What was seen of the requests on one connection.
#[derive(Clone, Debug)]
pub struct Framing(Arc<Mutex<State>>);

#[derive(Debug)]
enum State {
    /// Bytes of a head that has not ended yet.
    Head(Vec<u8>),
    /// So many bytes of a body are to come.
    Body(u64),
    /// A body is to come that is longer than the library can count.
    Countless,
    /// Nothing more will be looked at.
    Done,
    /// A request had this defect.
    Defective(HeadDefect),
}

/// What makes a request's head ambiguous.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeadDefect {
    /// Where the body ends.
    Length,
    /// Which host is meant.
    Host,
}

impl Default for Framing {
    fn default() -> Self {
        Self(Arc::new(Mutex::new(State::Head(Vec::new()))))
    }
}

impl Framing {
    /// What was wrong with a request on this connection.
    #[must_use]
    pub fn defect(&self) -> Option<HeadDefect> {
        match *self.state() {
            State::Defective(defect) => Some(defect),
            _ => None,
        }
    }

    /// Whether a request announced a body of more bytes than the library can count.
    pub(super) fn is_countless(&self) -> bool {
        matches!(*self.state(), State::Countless)
    }

    /// Sees the next bytes of the connection.
    pub(super) fn see(&self, mut bytes: &[u8]) {
        let mut state = self.state();
        while !bytes.is_empty() {
            bytes = state.see(bytes);
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// Sees some of the bytes and returns the rest.
    fn see<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        match self {
            Self::Countless | Self::Done | Self::Defective(_) => &[],
            Self::Body(left) => {
                let skipped = usize::try_from(*left).unwrap_or(usize::MAX).min(bytes.len());
                *left -= skipped as u64;
                if *left == 0 {
                    *self = Self::Head(Vec::new());
                }
                &bytes[skipped..]
            }
            Self::Head(head) => {
                let line =
                    bytes.iter().position(|&byte| byte == b'\n').map_or(bytes.len(), |n| n + 1);
                let (line, rest) = bytes.split_at(line);
                head.extend_from_slice(line);
                if is_blank(head) {
                    head.clear();
                } else if ends_head(head) {
                    *self = after(head);
                } else if head.len() > MAX_HEAD {
                    *self = Self::Done;
                }
                rest
            }
        }
    }
}

/// Empty lines before a request are skipped.
fn is_blank(head: &[u8]) -> bool {
    head == b"\r\n" || head == b"\n"
}

fn ends_head(head: &[u8]) -> bool {
    head.ends_with(b"\n\r\n") || head.ends_with(b"\n\n")
}

/// What comes after a head.
fn after(head: &[u8]) -> State {
    let mut lines = head.split_inclusive(|&byte| byte == b'\n');
    if lines.clone().any(|line| !line.ends_with(b"\r\n")) {
        return State::Defective(HeadDefect::Length);
    }
    let needs_host = lines.next().is_some_and(|line| line.ends_with(b" HTTP/1.1\r\n"));
    let length = lines.clone().find_map(|line| value_of(line, b"content-length"));
    let hosts = lines.clone().filter(|line| value_of(line, b"host").is_some()).count();
    let is_encoded = lines.any(|line| value_of(line, b"transfer-encoding").is_some());
    match length {
        Some(_) if is_encoded => State::Defective(HeadDefect::Length),
        _ if needs_host && hosts != 1 => State::Defective(HeadDefect::Host),
        _ if is_encoded => State::Done,
        None => State::Head(Vec::new()),
        Some("") => State::Done,
        Some(text) => match text.parse() {
            Ok(0) => State::Head(Vec::new()),
            Ok(length) if length <= MAX_LENGTH => State::Body(length),
            Ok(_) => State::Countless,
            Err(_) if text.bytes().all(|byte| byte.is_ascii_digit()) => State::Countless,
            Err(_) => State::Done,
        },
    }
}

/// The value of a header line, when it is the header of this name.
fn value_of<'a>(line: &'a [u8], name: &[u8]) -> Option<&'a str> {
    let (start, value) = line.split_at_checked(name.len())?;
    let value = value.strip_prefix(b":")?;
    start.eq_ignore_ascii_case(name).then(|| str::from_utf8(value).unwrap_or_default().trim())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is wrong with the bytes, however they are cut into pieces.
    fn defect(bytes: &str) -> Option<HeadDefect> {
        let of_pieces = |length: usize| {
            let framing = Framing::default();
            bytes.as_bytes().chunks(length).for_each(|piece| framing.see(piece));
            framing.defect()
        };
        let answers = [1, 2, 3, 7, bytes.len()].map(of_pieces);
        assert!(answers.iter().all(|answer| *answer == answers[0]), "{bytes:?}");
        answers[0]
    }

    #[test]
    fn both_lengths_are_ambiguous_in_any_order() {
        let both = "Host: a\r\nContent-Length: 5\r\ntransfer-encoding: chunked\r\n";
        let swapped = "Transfer-Encoding: chunked\r\nCONTENT-LENGTH: 5\r\n";
        for headers in [both, swapped] {
            let first = format!("POST / HTTP/1.1\r\n{headers}\r\n0\r\n\r\n");
            assert_eq!(defect(&first), Some(HeadDefect::Length));
            let second = format!(
                "POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 3\r\n\r\nabc\
                 POST / HTTP/1.1\r\n{headers}\r\n"
            );
            assert_eq!(defect(&second), Some(HeadDefect::Length), "also as the second request");
        }
    }

    #[test]
    fn lines_that_end_in_a_bare_line_feed_are_ambiguous() {
        assert_eq!(defect("GET / HTTP/1.1\nHost: a\n\n"), Some(HeadDefect::Length));
        let mixed = "GET / HTTP/1.1\r\nHost: a\nX: b\r\n\r\n";
        assert_eq!(defect(mixed), Some(HeadDefect::Length));
    }

    #[test]
    fn since_http_1_1_a_request_names_one_host() {
        assert_eq!(defect("GET / HTTP/1.1\r\nX: Host: a\r\n\r\n"), Some(HeadDefect::Host));
        let twice = "GET / HTTP/1.1\r\nHost: a\r\nhost: a\r\n\r\n";
        assert_eq!(defect(twice), Some(HeadDefect::Host));
        assert_eq!(defect("GET / HTTP/1.1\r\nhost:\r\n\r\n"), None, "it may be empty");
        assert_eq!(defect("GET / HTTP/1.0\r\n\r\n"), None);
    }

    #[test]
    fn a_body_too_long_to_count_is_told_from_a_length_that_is_no_number() {
        let is_countless = |length: &str| {
            let framing = Framing::default();
            let head = format!("POST / HTTP/1.1\r\nHost: a\r\nContent-Length: {length}\r\n\r\n");
            framing.see(head.as_bytes());
            framing.is_countless()
        };
        for length in ["18446744073709551614", "18446744073709551616", &"9".repeat(100)] {
            assert!(is_countless(length), "{length}");
        }
        for length in ["18446744073709551613", "0", "", "-1", "9x", "1844674407370955161x"] {
            assert!(!is_countless(length), "{length}");
        }
    }

    #[test]
    fn what_a_body_holds_is_not_looked_at() {
        let head = "POST / HTTP/1.1\r\nHost: a\r\n";
        let body = "GET / HTTP/1.1\nContent-Length: 1\nTransfer-Encoding: chunked\n\n";
        let length = body.len();
        assert_eq!(defect(&format!("{head}Content-Length: {length}\r\n\r\n{body}")), None);
        assert_eq!(defect(&format!("{head}Transfer-Encoding: chunked\r\n\r\n{body}")), None);
        assert_eq!(defect("\r\n\r\nGET / HTTP/1.1\r\nHost: a\r\n\r\n"), None);
    }
}
