//! 6.4: the wire, and forms.

use crate::client::{connect, exchange, field, form, send};
use crate::pictures::{disc, flat, noise};
use crate::server::Server;
use crate::table::{Expected, Request, Row, check, get, post};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::thread;
use std::time::{Duration, Instant};

/// Short limits, so that what is slow or long is so soon.
const FLAGS: [&str; 10] = [
    "--header-timeout",
    "700ms",
    "--body-timeout",
    "1s",
    "--max-body",
    "1MiB",
    "--max-connections",
    "200",
    "--workers",
    "1",
];
const MALFORMED: Expected = Expected::Refused(400, "multipart-malformed");
const HEAD: &str = "POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\n";
/// Work that takes seconds.
const SLOW: &str = "method=mgpr&density=1";

fn raw(bytes: impl Into<Vec<u8>>) -> Vec<Request> {
    vec![Request::Raw(bytes.into())]
}

/// A body of the same byte in chunks of 16 KiB, `count` of them, and no end.
fn chunked(count: usize) -> Vec<u8> {
    let mut bytes = format!("{HEAD}Transfer-Encoding: chunked\r\n\r\n").into_bytes();
    for _ in 0..count {
        bytes.extend_from_slice(b"4000\r\n");
        bytes.extend_from_slice(&[0; 0x4000]);
        bytes.extend_from_slice(b"\r\n");
    }
    bytes
}

/// Sends a piece again and again until the service closes or answers, and returns how it began.
fn trickle(server: &Server, head: &str, piece: &[u8], pause: Duration) -> (String, Duration) {
    let mut stream = connect(server.public);
    let began = Instant::now();
    stream.write_all(head.as_bytes()).unwrap();
    stream.set_read_timeout(Some(pause)).unwrap();
    let mut seen = Vec::new();
    let mut buffer = [0; 4096];
    while began.elapsed() < Duration::from_secs(15) {
        let _ = stream.write_all(piece);
        match stream.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => seen.extend_from_slice(&buffer[..count]),
            Err(error) if matches!(error.raw_os_error(), Some(11)) => {}
            Err(_) => break,
        }
    }
    (String::from_utf8_lossy(&seen).chars().take(12).collect(), began.elapsed())
}

fn of_lengths() -> Vec<Row> {
    vec![
        Row::steps(
            "T01",
            "Content-Length over the limit, with Expect: 100-continue",
            "413 `body-too-large` before any 100 Continue",
            |server| {
                let mut stream = connect(server.public);
                let head = format!("{HEAD}Content-Length: 1048577\r\nExpect: 100-continue\r\n\r\n");
                stream.write_all(head.as_bytes()).unwrap();
                let mut start = [0; 12];
                stream.read_exact(&mut start).unwrap();
                assert_eq!(&start, b"HTTP/1.1 413");
            },
        ),
        Row::new(
            "T02",
            "chunked body over the limit",
            Expected::Refused(413, "body-too-large"),
            || raw(chunked(100)),
        ),
        Row::new("T01b", "Content-Length of 2^64-1", Expected::Unparsed(431), || {
            raw(format!("{HEAD}Content-Length: 18446744073709551615\r\n\r\n"))
        }),
        Row::new(
            "T01c",
            "Content-Length of 2^64, of a hundred digits",
            Expected::Unparsed(400),
            || {
                ["18446744073709551616", &"9".repeat(100)]
                    .map(|length| {
                        let head = format!("{HEAD}Content-Length: {length}\r\n\r\n");
                        Request::Raw(head.into_bytes())
                    })
                    .into()
            },
        ),
        Row::new(
            "T02b",
            "announced body over the limit, sent in whole",
            Expected::Refused(413, "body-too-large"),
            || {
                raw([
                    format!("{HEAD}Content-Length: 10000000\r\n\r\n").into_bytes(),
                    vec![0; 10_000_000],
                ]
                .concat())
            },
        ),
        Row::steps("T03", "chunked body without an end", "413 `body-too-large`", |server| {
            let head = format!("{HEAD}Transfer-Encoding: chunked\r\n\r\n");
            let piece = [&b"10000\r\n"[..], &[0; 0x10000], b"\r\n"].concat();
            let (start, took) = trickle(server, &head, &piece, Duration::from_millis(5));
            assert_eq!(start, "HTTP/1.1 413");
            assert!(took < Duration::from_secs(14), "{took:?}");
        }),
        Row::steps(
            "T04",
            "header by single bytes",
            "the connection is closed after `--header-timeout`",
            |server| {
                let head = format!("{HEAD}X-Slow: ");
                let (start, took) = trickle(server, &head, b"a", Duration::from_millis(50));
                assert!(start.is_empty() || start == "HTTP/1.1 408", "{start}");
                assert!((500..14_000).contains(&took.as_millis()), "{took:?}");
            },
        ),
        Row::steps(
            "T05",
            "body by single bytes",
            "408 `request-timeout` after `--body-timeout`, and no worker is held",
            |server| {
                let head = format!("{HEAD}Content-Length: 100000\r\n\r\nP5");
                let (start, took) = trickle(server, &head, b"a", Duration::from_millis(50));
                assert_eq!(start, "HTTP/1.1 408");
                assert!((900..14_000).contains(&took.as_millis()), "{took:?}");
            },
        ),
        Row::steps(
            "T06",
            "clients that vanish: in their upload, in the answer, while they wait, while their work runs",
            "all they held is free again; work stops within 100 ms",
            vanish,
        ),
        Row::steps(
            "T16",
            "body that ends before its announced length",
            "400 `bad-request`, or the connection is closed",
            |server| {
                let mut stream = connect(server.public);
                stream
                    .write_all(format!("{HEAD}Content-Length: 1000\r\n\r\nP5").as_bytes())
                    .unwrap();
                stream.shutdown(std::net::Shutdown::Write).unwrap();
                let (mut rest, began) = (Vec::new(), Instant::now());
                let _ = stream.read_to_end(&mut rest);
                assert!(rest.is_empty() || rest.starts_with(b"HTTP/1.1 400"), "{}", rest.len());
                assert!(began.elapsed() < Duration::from_secs(20), "{:?}", began.elapsed());
            },
        ),
        Row::new(
            "T17",
            "chunk of a length that overflows, that is no number",
            Expected::Refused(400, "bad-request"),
            || {
                ["ffffffffffffffff1", "-1", "zz", "0x10"].map(|length| {
                Request::Raw(format!("{HEAD}Transfer-Encoding: chunked\r\n\r\n{length}\r\nabc\r\n0\r\n\r\n").into_bytes())
            }).into()
            },
        ),
    ]
}

/// Begins a request, and sends all of it.
fn begin(server: &Server, query: &str, image: &[u8]) -> TcpStream {
    let mut stream = connect(server.public);
    let length = image.len();
    let head = format!(
        "POST /v1/meshes?{query} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n\r\n"
    );
    stream.write_all(&[head.as_bytes(), image].concat()).unwrap();
    stream
}

fn vanish(server: &Server) {
    let slow = noise(700);
    let mut uploading = connect(server.public);
    uploading.write_all(format!("{HEAD}Content-Length: 500000\r\n\r\nP5").as_bytes()).unwrap();
    drop(uploading);
    let answering = begin(server, "method=med&size=4&format=pnm", &flat(500, 500));
    drop(answering);
    server.wait_until_idle();
    let running = begin(server, SLOW, &slow);
    server.wait_until("it runs", || server.metric("pixmesh_jobs_in_progress") == 1.0);
    let waiting = begin(server, SLOW, &slow);
    server.wait_until("it waits", || server.metric("pixmesh_queue_depth") == 1.0);
    drop(waiting);
    server.wait_until("it waits no more", || server.metric("pixmesh_queue_depth") == 0.0);
    let done = server.log().matches("meshed").count();
    drop(running);
    server.wait_until_idle();
    assert_eq!(server.log().matches("meshed").count(), done, "it was stopped and not done");
}

fn multipart(content_type: &str, body: impl Into<Vec<u8>>) -> Request {
    post("/v1/meshes", &[("Content-Type", content_type)], body.into())
}

fn form_of(parts: &[(&str, &[u8])]) -> Request {
    let (content_type, body) = form(parts);
    multipart(&content_type, body)
}

fn of_forms() -> Vec<Row> {
    vec![
        Row::new(
            "T07",
            "form of 1000 parts, of 100000 tiny ones",
            Expected::OneOf(&[
                (400, "too-many-parts"),
                (400, "duplicate-parameter"),
                (413, "body-too-large"),
            ]),
            || {
                let many = |count: usize| {
                    let names: Vec<String> = (0..count).map(|_| field("density")).collect();
                    form_of(
                        &names.iter().map(|name| (name.as_str(), &b"5"[..])).collect::<Vec<_>>(),
                    )
                };
                vec![many(1000), many(10_000), many(100_000)]
            },
        ),
        Row::new(
            "T07b",
            "form with 10000 headers in a part, a boundary of 64 kB, none, a wrong one, none at the end",
            MALFORMED,
            || {
                let many = format!("{}{}", "X: y\r\n".repeat(10_000), field("image"));
                let long = "b".repeat(65_536);
                vec![
                    form_of(&[(&many, b"abc")]),
                    multipart("multipart/form-data", "--limit\r\n"),
                    multipart("multipart/form-data; boundary=", "--limit\r\n"),
                    multipart(
                        "multipart/form-data; boundary=other",
                        "--limit\r\n\r\nabc\r\n--limit--\r\n",
                    ),
                    multipart(
                        "multipart/form-data; boundary=limit",
                        format!("--limit\r\n{}\r\n\r\nabc", field("image")),
                    ),
                    multipart(
                        "multipart/form-data; boundary=x",
                        format!("--{long}\r\n\r\nabc\r\n--{long}--\r\n"),
                    ),
                ]
            },
        ),
        Row::new(
            "T07c",
            "boundary of 64 kB in the header",
            Expected::Refused(431, "headers-too-large"),
            || {
                vec![multipart(
                    &format!("multipart/form-data; boundary={}", "b".repeat(65_536)),
                    "",
                )]
            },
        ),
        Row::new(
            "T07d",
            "part without a name, with a name that is not UTF-8, lines without CR",
            MALFORMED,
            || {
                let lone = format!("--limit\n{}\n\nabc\n--limit--\n", field("image"));
                vec![
                    form_of(&[("Content-Disposition: form-data", b"5")]),
                    form_of(&[("X: y", b"5")]),
                    multipart("multipart/form-data; boundary=limit", lone),
                ]
            },
        ),
        Row::new(
            "T07e",
            "nested multipart/mixed",
            Expected::Refused(415, "unsupported-media-type"),
            || {
                let headers =
                    format!("{}\r\nContent-Type: multipart/mixed; boundary=inner", field("image"));
                vec![form_of(&[(&headers, b"--inner--")])]
            },
        ),
        Row::new(
            "T07f",
            "picture that holds almost the boundary, again and again",
            Expected::Served,
            || {
                let mut picture = b"P5\n40 40\n255\n".to_vec();
                picture.extend(b"\r\n--limi".iter().cycle().take(1600));
                vec![form_of(&[(&field("image"), &picture)])]
            },
        ),
        Row::new("T08", "two parts 'image'", Expected::Refused(400, "duplicate-part"), || {
            let picture = disc(20, 20, 1);
            vec![form_of(&[(&field("image"), &picture), (&field("image"), &picture)])]
        }),
        Row::new("T09", "form without a picture", Expected::Refused(400, "image-missing"), || {
            vec![form_of(&[(&field("density"), b"5")]), form_of(&[])]
        }),
        Row::new(
            "T09b",
            "JSON in place of a picture",
            Expected::Refused(415, "unsupported-media-type"),
            || vec![post("/v1/meshes", &[("Content-Type", "application/json")], b"{}".to_vec())],
        ),
    ]
}

fn of_heads() -> Vec<Row> {
    vec![
        Row::steps(
            "T10",
            "Content-Length and Transfer-Encoding at once, in any order and case",
            "the body is read by Transfer-Encoding, and the connection closes after one response",
            both_lengths,
        ),
        Row::new("T10c", "lines that end in LF alone", Expected::Served, || {
            raw("GET /v1/methods HTTP/1.1\nHost: localhost\nConnection: close\n\n")
        }),
        Row::new(
            "T10b",
            "Transfer-Encoding that is obfuscated, unknown or twice; two Content-Lengths that differ",
            Expected::Unparsed(400),
            || {
                [
                    "Transfer-Encoding : chunked\r\n",
                    "Transfer-Encoding: xchunked\r\n",
                    "Transfer-Encoding: chunked, identity\r\n",
                    " Transfer-Encoding: chunked\r\n",
                    "Content-Length: 5\r\nContent-Length: 6\r\n",
                    "Content-Length: 1, 2\r\n",
                    "Content-Length: +5\r\n",
                    "Content-Length: -1\r\n",
                ]
                .map(|lengths| Request::Raw(format!("{HEAD}{lengths}\r\nabcde").into_bytes()))
                .into()
            },
        )
        .and(|answer| assert_eq!(answer.header("connection"), "close")),
        Row::new(
            "T10d",
            "a transfer coding before chunked",
            Expected::Refused(400, "bad-request"),
            || {
                let body = "5\r\nabcde\r\n0\r\n\r\n";
                raw(format!("{HEAD}Transfer-Encoding: gzip, chunked\r\n\r\n{body}"))
            },
        )
        .and(|answer| assert_eq!(answer.header("connection"), "close")),
        Row::new(
            "T10e",
            "two equal Content-Lengths, which RFC 9110, 8.6, lets a server take for one",
            Expected::Served,
            || {
                let image = disc(20, 20, 1);
                let length = format!("Content-Length: {}\r\n", image.len());
                let head = format!("{HEAD}Connection: close\r\n{length}{length}\r\n");
                vec![Request::Raw([head.as_bytes(), &image].concat())]
            },
        ),
        Row::steps(
            "T11",
            "HTTP/2: its preface alone and byte by byte, rapid resets, a flood of CONTINUATION",
            "the connection is closed within `--header-timeout`; other clients are served",
            http2,
        ),
        Row::steps(
            "T12",
            "1500 idle connections where 200 may be",
            "those over the number get 503 `overloaded` or are closed; health answers at once",
            idle_connections,
        ),
        Row::new(
            "T13",
            "target of 16 kB, of 60 kB",
            Expected::Refused(414, "uri-too-long"),
            || [16_000, 60_000].map(|length| get(&format!("/{}", "a".repeat(length)), &[])).into(),
        ),
        Row::new("T13d", "target of 70 kB", Expected::Unparsed(414), || {
            raw(format!("GET /{} HTTP/1.1\r\nHost: localhost\r\n\r\n", "a".repeat(70_000)))
        }),
        Row::new(
            "T13b",
            "header of 100 kB, of 1000 lines",
            Expected::Refused(431, "headers-too-large"),
            || {
                let names: Vec<String> = (0..1000).map(|i| format!("X-{i}")).collect();
                let lines: Vec<_> = names.iter().map(|name| (name.as_str(), "y")).collect();
                let long = "a".repeat(100_000);
                vec![get("/", &[("X-Long", &long)]), get("/", &lines)]
            },
        ),
        Row::new(
            "T13c",
            "what is no HTTP: TLS, SSH, SMTP, a version of the future, controls in the header",
            Expected::Unparsed(400),
            || {
                [
                    "\u{16}\u{3}\u{1} a TLS greeting \r\n\r\n",
                    "SSH-2.0-OpenSSH_9.7\r\n\r\n",
                    "EHLO mail.example.org\r\n\r\n",
                    "GET / HTTP/9.9\r\nHost: localhost\r\n\r\n",
                    "GET / HTTP/1.1\r\nHost: localhost\r\nX: a\0b\r\n\r\n",
                    "GET / HTTP/1.1\r\nHost: localhost\r\nX\u{7}: b\r\n\r\n",
                    "GET  / HTTP/1.1\r\nHost: localhost\r\n\r\n",
                    "GET /\r\n\r\n",
                ]
                .map(|bytes| Request::Raw(bytes.as_bytes().to_vec()))
                .into()
            },
        ),
        Row::steps(
            "T14",
            "every method, known or not, on every route",
            "405 with `Allow` where the method is not served; never 5xx",
            every_method,
        ),
        Row::steps(
            "T15",
            "HEAD on every GET",
            "the same status and headers, and no body",
            head_for_get,
        ),
        Row::steps(
            "T18",
            "500 requests down one connection before any answer is read",
            "all are answered in turn",
            |server| {
                let mut stream = connect(server.public);
                let one = b"GET /v1/methods HTTP/1.1\r\nHost: localhost\r\n\r\n";
                let head = b"GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
                let writing = stream.try_clone().unwrap();
                let sender = thread::spawn(move || {
                    let mut writing = writing;
                    let _ = writing.write_all(&one.repeat(500));
                    let _ = writing.write_all(head);
                });
                let mut all = Vec::new();
                stream.read_to_end(&mut all).unwrap();
                sender.join().unwrap();
                let count = all.windows(15).filter(|seen| seen == b"HTTP/1.1 200 OK").count();
                assert_eq!(count, 501);
            },
        ),
        Row::new(
            "T19",
            "a request that asks to upgrade to WebSocket or HTTP/2",
            Expected::Served,
            || {
                vec![
                    get(
                        "/v1/methods",
                        &[("Upgrade", "websocket"), ("Sec-WebSocket-Version", "13")],
                    ),
                    get(
                        "/v1/methods",
                        &[("Upgrade", "h2c"), ("HTTP2-Settings", "AAMAAABkAARAAAAAAAIAAAAA")],
                    ),
                ]
            },
        ),
    ]
}

const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";

/// Sends both lengths with a second request behind the body: only the first gets a response.
fn both_lengths(server: &Server) {
    for lengths in [
        "Content-Length: 5\r\nTransfer-Encoding: chunked\r\n",
        "Transfer-Encoding: chunked\r\nContent-Length: 5\r\n",
        "transfer-encoding: CHUNKED\r\ncontent-length: 0\r\n",
    ] {
        let request = format!(
            "{HEAD}{lengths}\r\n0\r\n\r\nGET /v1/methods HTTP/1.1\r\nHost: localhost\r\n\r\n"
        );
        let mut stream = connect(server.public);
        stream.write_all(request.as_bytes()).unwrap();
        let mut all = String::new();
        stream.read_to_string(&mut all).unwrap();
        assert!(all.starts_with("HTTP/1.1 400 ") && all.contains("/problems/empty-file"), "{all}");
        assert!(all.to_lowercase().contains("\r\nconnection: close\r\n"), "{all}");
        assert_eq!(all.matches("HTTP/1.1 ").count(), 1, "{all}");
    }
}

fn http2(server: &Server) {
    let settings = [0, 0, 0, 4, 0, 0, 0, 0, 0];
    let mut resets = [PREFACE, &settings].concat();
    for stream in 0..10_000_u32 {
        let id = (2 * stream + 1).to_be_bytes();
        resets.extend([&[0, 0, 1, 1, 4][..], &id, &[0x82]].concat());
        resets.extend([&[0, 0, 4, 3, 0][..], &id, &[0, 0, 0, 8]].concat());
    }
    let continuation = [&[0, 0x40, 0, 9, 0, 0, 0, 0, 1][..], &[b'x'; 0x4000]].concat().repeat(200);
    let flood = [PREFACE, &settings, &[0, 0, 1, 1, 0, 0, 0, 0, 1, 0x82], &continuation].concat();
    for bytes in [PREFACE[..10].to_vec(), PREFACE.to_vec(), resets, flood] {
        let mut stream = connect(server.public);
        let began = Instant::now();
        bytes.chunks(bytes.len().div_ceil(24)).for_each(|piece| drop(stream.write_all(piece)));
        let _ = stream.read_to_end(&mut Vec::new());
        assert!(began.elapsed() < Duration::from_secs(10), "{:?}", began.elapsed());
    }
}

fn idle_connections(server: &Server) {
    // Fewer where this process may not open so many.
    let idle: Vec<TcpStream> =
        (0..1500).map_while(|_| TcpStream::connect(server.public).ok()).collect();
    assert!(idle.len() > 400, "only {} connections could be opened", idle.len());
    for target in ["/livez", "/readyz", "/metrics"] {
        let answer = server.operate(target);
        assert_eq!(answer.status, 200);
        assert!(answer.took < Duration::from_secs(1), "{:?}", answer.took);
    }
    drop(idle);
    server.wait_until("there is a place again", || {
        let mut stream = connect(server.public);
        let sent =
            stream.write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        sent.is_ok() && answer.starts_with("HTTP/1.1 200")
    });
}

/// The paths of the API's document, their parameters filled in, with the methods that they have.
fn routes(server: &Server) -> Vec<(String, Vec<String>)> {
    let document = server.get("/openapi.json").json();
    let paths = document["paths"].as_object().unwrap().iter();
    let of = |(path, methods): (&String, &serde_json::Value)| {
        let path = path
            .replace("{id}", "01890000-0000-7000-8000-000000000000")
            .replace("{slug}", "overloaded");
        let methods = methods.as_object().unwrap().keys().map(|name| name.to_uppercase());
        (path, methods.filter(|name| name.len() < 8).collect())
    };
    let routes: Vec<_> = paths.map(of).collect();
    assert!(routes.len() >= 8, "{routes:?}");
    routes
}

fn every_method(server: &Server) {
    const METHODS: [&str; 14] = [
        "GET", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "CONNECT", "PROPFIND", "BREW",
        "get", "G", "DEBUG", "SOURCE",
    ];
    for (path, served) in routes(server) {
        for method in METHODS {
            let answer = send(server.public, method, &path, &[], &[]);
            assert!(answer.status < 500, "{method} {path}: {}", answer.text());
            if !served.iter().any(|known| known == method) {
                assert!(
                    [400, 404, 405].contains(&answer.status),
                    "{method} {path}: {}",
                    answer.status
                );
                assert!(
                    answer.status != 405 || !answer.header("allow").is_empty(),
                    "{method} {path}"
                );
                assert_ne!(answer.header("content-type"), "", "{method} {path}");
            }
        }
        let garbage = format!("{} {path} HTTP/1.1\r\nHost: localhost\r\n\r\n", "M".repeat(5000));
        let answer = exchange(server.public, garbage.as_bytes());
        assert!((400..500).contains(&answer.status), "{}", answer.status);
    }
    let answer = send(server.public, "TRACE", "/v1/meshes", &[("X-Secret", "do-not-echo")], &[]);
    assert!(!answer.text().contains("do-not-echo"));
    let metrics = server.operate("/metrics").text();
    assert!(!metrics.contains("BREW") && !metrics.contains("MMMM"), "clients add no series");
}

/// The status line and header of an answer to a request without a body, and all that follows.
fn head_and_rest(server: &Server, method: &str, path: &str) -> (Vec<String>, Vec<u8>) {
    let mut stream = connect(server.public);
    let request =
        format!("{method} {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).unwrap();
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    let end = bytes.windows(4).position(|window| window == b"\r\n\r\n").unwrap();
    let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
    // What differs from one answer to the next.
    let changes = |line: &&str| {
        !["date:", "x-request-id:"].iter().any(|name| line.to_lowercase().starts_with(name))
    };
    (head.split("\r\n").filter(changes).map(str::to_owned).collect(), bytes[end + 4..].to_vec())
}

fn head_for_get(server: &Server) {
    for (path, methods) in routes(server) {
        if methods.iter().any(|method| method == "GET") {
            let (of_get, _) = head_and_rest(server, "GET", &path);
            let (of_head, body) = head_and_rest(server, "HEAD", &path);
            assert_eq!(of_head, of_get, "{path}");
            assert!(body.is_empty(), "{path}");
        }
    }
}

/// The rows of this chapter.
pub(crate) fn rows() -> Vec<Row> {
    [of_lengths(), of_forms(), of_heads()].into_iter().flatten().collect()
}

#[test]
fn no_bytes_on_the_wire_do_harm() {
    check(&FLAGS, &rows());
}
