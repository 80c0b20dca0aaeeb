//! 6.5: names and headers.

use crate::client::{field, form, send};
use crate::keys::KeysFile;
use crate::pictures::disc;
use crate::server::Server;
use crate::table::{Expected, Request, Row, check, get, post};
use std::path::Path;

fn named(disposition: &str) -> Request {
    let (content_type, body) = form(&[(disposition, &disc(20, 20, 1))]);
    post("/v1/meshes", &[("Content-Type", &content_type)], body)
}

fn with_file_name(name: &str) -> Request {
    named(&format!("{}; filename=\"{name}\"", field("image")))
}

fn of_files() -> Vec<Row> {
    vec![
        Row::new("H01", "file names that climb, are absolute, reserved, empty, dots or 10 kB: names are never looked at", Expected::Served, || {
            let long = "n".repeat(10_000);
            [
                "../../etc/passwd", "..\\\\..\\\\x", "/abs/name", "C:\\\\x", "NUL", "COM1.png", &long,
                "", ".", "..", "x...", "x ", "~/.ssh/id", "$(id)", "`id`", "%2e%2e%2f",
            ]
            .map(with_file_name)
            .into()
        })
        .and(|answer| assert_eq!(answer.header("content-disposition"), "inline; filename=\"mesh.model\"")),
        Row::new("H02", "file names with quotes, semicolons, RTL overrides, emoji, bad UTF-8 or percents: none comes back", Expected::Served, || {
            let mut requests: Vec<_> = ["a\\\"b", "a;b", "\u{202E}gnp.x", "\u{1F600}"].map(with_file_name).into();
            let image = field("image");
            requests.push(named(&format!("{image}; filename*=UTF-8''a%zz%0d%0aX-Evil%3a1")));
            requests.push(named(&format!("{image}; filename=\"a\tb\"")));
            requests
        })
        .and(|answer| {
            assert_eq!(answer.header("content-disposition"), "inline; filename=\"mesh.model\"");
            assert_eq!(answer.header("x-evil"), "");
        }),
    ]
}

fn of_headers() -> Vec<Row> {
    vec![
        Row::steps(
            "H03",
            "X-Request-ID that is long, not ASCII, markup, twice",
            "replaced by one of the service's own",
            |server| {
                let id = |headers: &[(&str, &str)]| {
                    send(server.public, "GET", "/", headers, &[]).header("x-request-id").to_owned()
                };
                assert_eq!(id(&[("X-Request-ID", "abc-DEF_123")]), "abc-DEF_123");
                for harmful in
                    ["", "a b", "<script>", "a\"b", &"a".repeat(10_000), "caf\u{e9}", "${jndi:x}"]
                {
                    assert_eq!(id(&[("X-Request-ID", harmful)]).len(), 36, "{harmful}");
                }
                assert_eq!(id(&[("X-Request-ID", "a"), ("X-Request-ID", "b")]).len(), 36);
            },
        ),
        Row::new(
            "H04",
            "Accept that allows nothing offered",
            Expected::Refused(406, "not-acceptable"),
            || {
                let accepting =
                    |accept: &str| post("/v1/meshes", &[("Accept", accept)], disc(20, 20, 1));
                let many = vec!["a/b;q=0.1"; 900].join(",");
                ["text/html", "*/*;q=0", "nonsense", "", ";;;,,,", &many].map(accepting).into()
            },
        ),
        Row::new(
            "H04b",
            "the parameter format beside such an Accept: the parameter wins",
            Expected::Served,
            || vec![post("/v1/meshes?format=png", &[("Accept", "text/html")], disc(20, 20, 1))],
        )
        .and(|answer| assert_eq!(answer.header("content-type"), "image/png")),
        Row::steps(
            "H05",
            "forged Host and X-Forwarded headers",
            "links stay relative, whatever is claimed",
            |server| {
                let headers = [
                    ("X-Forwarded-Host", "evil.example"),
                    ("X-Forwarded-Proto", "https"),
                    ("X-Forwarded-Prefix", "/evil"),
                    ("Forwarded", "host=evil.example"),
                    ("X-Original-URL", "/metrics"),
                ];
                let answer = server.submit("size=20", &headers, &disc(20, 20, 1));
                assert_eq!(answer.status, 202, "{}", answer.text());
                assert!(answer.header("location").starts_with("/v1/jobs/"));
                assert!(!answer.text().contains("evil"), "{}", answer.text());
                server.wait_for(answer.header("location"), "completed");
                send(server.public, "DELETE", answer.header("location"), &[], &[]);
            },
        ),
        Row::steps(
            "H06",
            "a wrong key, none, two, one for another's job",
            "401 `unauthorized` with `WWW-Authenticate`; another's job is 404 `not-found`",
            |_| keys(),
        ),
        Row::new(
            "H07",
            "job names with dots, slashes, NUL, wrong case, no UUID",
            Expected::Refused(404, "not-found"),
            || {
                [
                    "..%2f..%2fetc%2fpasswd",
                    "%2e%2e/%2e%2e",
                    "%00",
                    "foo%00bar",
                    "1",
                    "-1",
                    "%ff",
                    "01890000-0000-7000-8000-00000000000G",
                    "01890000000070008000000000000000",
                    "01890000-0000-7000-8000-00000000000A",
                    "{01890000-0000-7000-8000-000000000000}",
                    "urn:uuid:01890000-0000-7000-8000-000000000000",
                    "01890000-0000-7000-8000-000000000000",
                ]
                .map(|name| get(&format!("/v1/jobs/{name}"), &[]))
                .into()
            },
        )
        .and(|answer| assert!(!answer.text().contains("passwd"))),
        Row::new(
            "H07c",
            "the page's assets by names that climb",
            Expected::Refused(404, "not-found"),
            || {
                ["..%2fCargo.toml", "%2e%2e%2f%2e%2e%2fetc%2fpasswd", "nothing.js", "%00", "a%5cb"]
                    .map(|name| get(&format!("/studio/{name}"), &[]))
                    .into()
            },
        ),
        Row::new(
            "H07b",
            "the documents' assets by names that climb",
            Expected::Refused(404, "not-found"),
            || {
                ["..%2fCargo.toml", "%2e%2e%2f%2e%2e%2fetc%2fpasswd", "nothing.js", "%00", "."]
                    .map(|name| get(&format!("/docs/{name}"), &[]))
                    .into()
            },
        ),
        Row::steps(
            "H08",
            "a page of another origin asks what it may do",
            "no `Access-Control-Allow-Origin`, unless `--cors-origin` names it",
            |server| {
                let headers = [
                    ("Origin", "https://evil.example"),
                    ("Access-Control-Request-Method", "POST"),
                    ("Access-Control-Request-Headers", "authorization"),
                ];
                for method in ["OPTIONS", "GET", "POST"] {
                    let answer = send(server.public, method, "/v1/meshes", &headers, &[]);
                    assert_eq!(answer.header("access-control-allow-origin"), "", "{method}");
                }
            },
        ),
        Row::new(
            "H09",
            "Range and If-None-Match of nonsense, of 10000 ranges",
            Expected::Served,
            || {
                let many = format!("bytes={}", vec!["0-0"; 2000].join(","));
                [
                    "bytes=",
                    "bytes=-",
                    "bytes=9-1",
                    "lines=1-2",
                    "bytes=99999999999999999999-",
                    &many,
                ]
                .map(|range| get("/v1/methods", &[("Range", range), ("If-None-Match", "\"\"\"")]))
                .into()
            },
        ),
        Row::new(
            "H10",
            "a Prefer header and a traceparent that are nonsense",
            Expected::Served,
            || {
                ["wait=", "wait=-1", "wait=1e9x", "respond-sometimes", ",,,", "wait=\"5"]
                    .map(|prefer| {
                        let headers = [("Prefer", prefer), ("traceparent", "00-zz-zz-zz")];
                        post("/v1/meshes", &headers, disc(20, 20, 1))
                    })
                    .into()
            },
        ),
    ]
}

fn keys() {
    let file = KeysFile::new("hostile");
    let (mine, theirs) = (file.issue("mine"), file.issue("theirs"));
    let server = Server::start(&["--keys-file", file.path()]);
    let bearer = |key: &str| format!("Bearer {key}");
    let image = disc(20, 20, 1);
    let ask = |sent: &[&str], target: &str| {
        let headers: Vec<_> = sent.iter().map(|value| ("Authorization", *value)).collect();
        send(server.public, "GET", target, &headers, &[])
    };
    let (good, wrong) = (bearer(&mine), bearer(&format!("{}x", &mine[..mine.len() - 1])));
    let long = bearer(&"a".repeat(12_000));
    for sent in [
        &[][..],
        &[wrong.as_str()],
        &[&good, &good],
        &["Basic abc"],
        &[&mine],
        &[&long],
        &["Bearer"],
    ] {
        for target in ["/v1/methods", "/v1/jobs/1", "/v1/nothing", "/v1/jobs/..%2f.."] {
            let answer = ask(sent, target);
            answer.problem(401, "unauthorized");
            assert!(answer.header("www-authenticate").starts_with("Bearer"), "{sent:?}");
        }
    }
    let job = server.submit("size=20", &[("Authorization", &good)], &image);
    let location = job.header("location");
    for target in [location.to_owned(), format!("{location}/mesh"), format!("{location}/events")] {
        ask(&[&bearer(&theirs)], &target).problem(404, "not-found");
    }
    send(server.public, "DELETE", location, &[("Authorization", &bearer(&theirs))], &[])
        .problem(404, "not-found");
    assert_eq!(ask(&[&good], location).status, 200);
    assert!(!server.log().contains(&mine) && !server.log().contains(&wrong));
}

/// The rows of this chapter.
pub(crate) fn rows() -> Vec<Row> {
    [of_files(), of_headers()].into_iter().flatten().collect()
}

#[test]
fn no_name_and_no_header_reaches_further_than_it_may() {
    let before = entries();
    check(&[], &rows());
    assert_eq!(entries(), before, "no file was made by a name");
}

/// What lies where the service was started.
fn entries() -> Vec<String> {
    let folder = std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR"))).unwrap();
    let mut names: Vec<_> =
        folder.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}
