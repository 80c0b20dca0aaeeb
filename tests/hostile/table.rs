//! A row of the table, and what holds for every row: an answer within its time, little memory, no
//! panic, nothing left behind, and the next client served.

use crate::client::{Answer, exchange, send};
use crate::pictures::disc;
use crate::server::{Folder, Server};
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The longest time to an answer, unless a row says otherwise.
const IN_TIME: Duration = Duration::from_secs(1);
/// By how much a row may make the process grow at its peak, unless it says otherwise.
const MOST_MIB: u64 = 64;
/// What is sent.
pub(crate) enum Request {
    /// A request as clients write them.
    Whole { method: &'static str, target: String, headers: Vec<(String, String)>, body: Vec<u8> },
    /// Bytes as they are.
    Raw(Vec<u8>),
}

/// What comes back.
#[derive(Clone, Copy)]
pub(crate) enum Expected {
    /// 200 and what was asked for.
    Served,
    /// A status with the slug of its problem.
    Refused(u16, &'static str),
    /// A status without a body: the request cannot be parsed as HTTP.
    Unparsed(u16),
    /// One of several refusals.
    OneOf(&'static [(u16, &'static str)]),
    /// 200, or one of several refusals.
    ServedOr(&'static [(u16, &'static str)]),
    /// What the steps of the row check, in words.
    Told(&'static str),
}

/// How the row is tried.
enum Trial {
    Requests(Box<dyn Fn() -> Vec<Request>>),
    Steps(fn(&Server)),
}

/// A row of the table.
pub(crate) struct Row {
    pub(crate) id: &'static str,
    pub(crate) what: &'static str,
    pub(crate) expected: Expected,
    trial: Trial,
    check: fn(&Answer),
    in_time: Duration,
    most_mib: u64,
}

impl Row {
    /// A row of requests that all get the same answer.
    pub(crate) fn new(
        id: &'static str,
        what: &'static str,
        expected: Expected,
        requests: impl Fn() -> Vec<Request> + 'static,
    ) -> Self {
        let trial = Trial::Requests(Box::new(requests));
        let (in_time, most_mib) = (IN_TIME, MOST_MIB);
        Self { id, what, expected, trial, check: |_| {}, in_time, most_mib }
    }

    /// A row of one picture that is to be meshed.
    pub(crate) fn picture(
        id: &'static str,
        what: &'static str,
        expected: Expected,
        picture: impl Fn() -> Vec<u8> + 'static,
    ) -> Self {
        Self::new(id, what, expected, move || vec![mesh("", picture())])
    }

    /// A row that checks its answers itself.
    pub(crate) fn steps(
        id: &'static str,
        what: &'static str,
        told: &'static str,
        steps: fn(&Server),
    ) -> Self {
        let row = Self::new(id, what, Expected::Told(told), Vec::new);
        Self { trial: Trial::Steps(steps), in_time: Duration::from_secs(30), ..row }
    }

    /// What the answer must be like beside its status.
    pub(crate) fn and(self, check: fn(&Answer)) -> Self {
        Self { check, ..self }
    }

    /// A longer time, for what is legitimate work or a long upload.
    pub(crate) fn within(self, in_time: Duration) -> Self {
        Self { in_time, ..self }
    }

    /// More memory, for what is legitimate work or a long upload.
    pub(crate) fn taking(self, most_mib: u64) -> Self {
        Self { most_mib, ..self }
    }
}

/// Asks for the mesh of a picture.
pub(crate) fn mesh(query: &str, picture: Vec<u8>) -> Request {
    post(&format!("/v1/meshes?{query}"), &[], picture)
}

/// Asks for the picture of a MODEL.
pub(crate) fn rebuild(model: impl Into<Vec<u8>>) -> Request {
    post("/v1/reconstructions", &[], model.into())
}

pub(crate) fn post(target: &str, headers: &[(&str, &str)], body: Vec<u8>) -> Request {
    whole("POST", target, headers, body)
}

pub(crate) fn get(target: &str, headers: &[(&str, &str)]) -> Request {
    whole("GET", target, headers, Vec::new())
}

pub(crate) fn whole(
    method: &'static str,
    target: &str,
    headers: &[(&str, &str)],
    body: Vec<u8>,
) -> Request {
    let owned = |&(name, value): &(&str, &str)| (name.to_owned(), value.to_owned());
    let headers = headers.iter().map(owned).collect();
    Request::Whole { method, target: target.to_owned(), headers, body }
}

/// Sends every row to a service, which must be as good as new after each. What takes much memory by
/// right goes to a service of its own: the system does not get all of it back at once.
pub(crate) fn check(flags: &[&str], rows: &[Row]) {
    let (large, small): (Vec<&Row>, Vec<&Row>) =
        rows.iter().partition(|row| row.most_mib > MOST_MIB);
    let fallen: Vec<_> = [fallen(flags, &small), fallen(flags, &large)].concat();
    assert!(fallen.is_empty(), "{fallen:?}");
}

/// The rows that do not stand.
fn fallen(flags: &[&str], rows: &[&Row]) -> Vec<&'static str> {
    let folder: Arc<Folder> = Arc::default();
    let server = Server::start_in(&folder, flags);
    let good = disc(64, 64, 3);
    // The first requests of a process take memory that all others use again.
    for _ in 0..4 {
        assert_eq!(server.mesh("", &[], &good).status, 200);
    }
    let stands = |row: &Row| {
        let tried = || row.stand(&server, folder.path(), &good);
        // Each row is tried, whatever became of those before it.
        catch_unwind(AssertUnwindSafe(tried)).is_ok()
    };
    rows.iter().filter(|row| !stands(row)).map(|row| row.id).collect()
}

impl Row {
    /// Tries the row, and checks what holds for every one.
    fn stand(&self, server: &Server, folder: &Path, good: &[u8]) {
        let began = Instant::now();
        let idle_kib = server.memory_kib("VmRSS");
        server.forget_peak();
        self.try_on(server);
        let rise_mib = server.memory_kib("VmHWM").saturating_sub(idle_kib) >> 10;
        println!("{}: {:?}, {rise_mib} MiB", self.id, began.elapsed());
        assert!(rise_mib <= self.most_mib, "{}: {rise_mib} MiB more", self.id);
        let next = server.mesh("", &[], good);
        assert_eq!(next.status, 200, "{}: the next client got {}", self.id, next.text());
        server.wait_until_idle();
        assert_eq!(staged_files(folder), 0, "{} left files behind", self.id);
        assert!(!server.log().contains("panicked"), "{}: {}", self.id, server.log());
    }

    fn try_on(&self, server: &Server) {
        match &self.trial {
            Trial::Steps(steps) => steps(server),
            Trial::Requests(requests) => {
                for (n, request) in requests().iter().enumerate() {
                    let answer = self.in_time(server, request);
                    self.compare(n, &answer);
                    (self.check)(&answer);
                }
            }
        }
    }

    /// The answer to a request, which comes in time. One that does not may have been held up by another
    /// program: the median of three counts.
    fn in_time(&self, server: &Server, request: &Request) -> Answer {
        let answer = request.send(server);
        if answer.took > self.in_time {
            let mut times = [answer.took, request.send(server).took, request.send(server).took];
            times.sort_unstable();
            assert!(times[1] <= self.in_time, "{}, {}: answers took {times:?}", self.id, self.what);
        }
        answer
    }

    fn compare(&self, n: usize, answer: &Answer) {
        let refusal = |allowed: &[(u16, &str)]| {
            let slug = answer.json()["type"].as_str().unwrap_or_default().replace("/problems/", "");
            let found = allowed
                .iter()
                .any(|(status, known)| (*status, *known) == (answer.status, slug.as_str()));
            assert!(found, "{}, {}, request {n}: {}", self.id, self.what, answer.text());
            answer.problem(answer.status, &slug);
        };
        match self.expected {
            Expected::Refused(status, slug) => refusal(&[(status, slug)]),
            Expected::Unparsed(status) => {
                assert_eq!((answer.status, answer.text().as_str()), (status, ""), "{}", self.id);
            }
            Expected::OneOf(allowed) => refusal(allowed),
            Expected::ServedOr(allowed) if answer.status != 200 => refusal(allowed),
            Expected::Served | Expected::ServedOr(_) => {
                let (id, text) = (self.id, answer.text());
                assert_eq!(answer.status, 200, "{id}, {}, request {n}: {text}", self.what);
            }
            Expected::Told(_) => {}
        }
    }
}

impl Request {
    fn send(&self, server: &Server) -> Answer {
        match self {
            Self::Raw(bytes) => exchange(server.public, bytes),
            Self::Whole { method, target, headers, body } => {
                let headers: Vec<_> =
                    headers.iter().map(|(name, value)| (name.as_str(), value.as_str())).collect();
                send(server.public, method, target, &headers, body)
            }
        }
    }
}

impl fmt::Display for Expected {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let refusals = |allowed: &[(u16, &str)]| {
            let each = allowed.iter().map(|(status, slug)| format!("{status} `{slug}`"));
            each.collect::<Vec<_>>().join(", or ")
        };
        match self {
            Self::Served => formatter.write_str("200"),
            Self::Refused(status, slug) => write!(formatter, "{status} `{slug}`"),
            Self::Unparsed(status) => write!(formatter, "{status} without a body"),
            Self::OneOf(allowed) => formatter.write_str(&refusals(allowed)),
            Self::ServedOr(allowed) => write!(formatter, "200, or {}", refusals(allowed)),
            Self::Told(told) => formatter.write_str(told),
        }
    }
}

/// Files that were begun and never became a blob.
fn staged_files(folder: &Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder.join("blobs")) else { return 0 };
    let shelves = entries.filter_map(|shelf| std::fs::read_dir(shelf.ok()?.path()).ok());
    let is_blob = |name: &str| name.len() == 64 && name.bytes().all(|b| b.is_ascii_hexdigit());
    let names = shelves.flatten().map(|file| file.unwrap().file_name());
    names.filter(|name| !is_blob(&name.to_string_lossy())).count()
}
