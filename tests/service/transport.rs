//! The wire: limits, timeouts, methods, and requests that mean two things.

use crate::client::{assert_median_within, connect, connect_from, exchange, receive, send};
use crate::in_process::Service;
use crate::pictures::disc;
use crate::server::Server;
use rustix::process::{Resource, getrlimit, setrlimit};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

#[test]
fn a_body_over_the_limit_is_refused_announced_or_not() {
    let server = Server::start(&["--max-body", "64KiB"]);
    let head = "POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\n";
    let announced = format!("{head}Content-Length: 65537\r\nExpect: 100-continue\r\n\r\n");
    let mut stream = connect(server.public);
    stream.write_all(announced.as_bytes()).unwrap();
    let mut first_line = [0; 12];
    stream.read_exact(&mut first_line).unwrap();
    assert_eq!(&first_line, b"HTTP/1.1 413", "without 100 Continue before it");

    let whole = format!("{head}Content-Length: 10000000\r\n\r\n").into_bytes();
    let answer = exchange(server.public, &[whole, vec![0; 10_000_000]].concat());
    let problem = answer.problem(413, "body-too-large");
    assert_eq!((&problem["limit"], &problem["actual"]), (&65536.into(), &10_000_000.into()));
    assert_eq!(problem["setting"], "--max-body");

    let mut chunked = format!("{head}Transfer-Encoding: chunked\r\n\r\n").into_bytes();
    for _ in 0..200 {
        chunked.extend_from_slice(b"4000\r\n");
        chunked.extend_from_slice(&[0; 0x4000]);
        chunked.extend_from_slice(b"\r\n");
    }
    exchange(server.public, &chunked).problem(413, "body-too-large");
    server.wait_until_idle();
}

#[test]
fn a_chunked_body_is_received_and_ends_its_connection() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    let mut request =
        b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n"
            .to_vec();
    for piece in image.chunks(100) {
        request.extend_from_slice(format!("{:x}\r\n", piece.len()).as_bytes());
        request.extend_from_slice(piece);
        request.extend_from_slice(b"\r\n");
    }
    request.extend_from_slice(b"0\r\n\r\n");
    let answer = exchange(server.public, &request);
    assert_eq!((answer.status, answer.header("connection")), (200, "close"), "{}", answer.text());
}

#[test]
fn one_connection_serves_many_requests() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    let mut stream = connect(server.public);
    for _ in 0..5 {
        let head = format!(
            "POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: {}\r\n\r\n",
            image.len()
        );
        stream.write_all(&[head.as_bytes(), &image].concat()).unwrap();
        assert_eq!(receive(&mut stream, Instant::now()).status, 200);
    }
}

#[test]
fn paths_methods_and_targets_that_do_not_exist_are_problems_too() {
    let server = Service::start(&[]);
    for target in
        ["/nothing", "/v1", "/v1/meshes/", "/v1/meshes/..%2f..%2fetc", "/%00", "/v1/jobs/1"]
    {
        server.get(target).problem(404, "not-found");
    }
    for method in ["GET", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "BREW"] {
        let answer = send(server.public, method, "/v1/meshes", &[], &[]);
        assert_eq!((answer.status, answer.header("allow")), (405, "POST"), "{method}");
        let problem = answer.problem(405, "method-not-allowed");
        let detail = format!("the method {method} is not for this path: send POST");
        assert_eq!((&problem["detail"], &problem["allowed"][0]), (&detail.into(), &"POST".into()));
    }
    let answer = send(server.public, "POST", "/v1/methods", &[], &[]);
    let problem = answer.problem(405, "method-not-allowed");
    assert_eq!(problem["allowed"], serde_json::json!(["GET", "HEAD"]));
    assert_eq!(answer.header("allow"), "GET,HEAD");
    server.get(&format!("/{}", "a".repeat(16_000))).problem(414, "uri-too-long");
    for length in [20_000, 100_000] {
        let long = "a".repeat(length);
        let answer = send(server.public, "GET", "/", &[("X-Long", &long)], &[]);
        let problem = answer.problem(431, "headers-too-large");
        assert_eq!(problem["limit"], 16 * 1024);
    }
    let huge = "a".repeat(400_000);
    let answer = send(server.public, "GET", "/", &[("X-Long", &huge)], &[]);
    assert_eq!((answer.status, answer.text().as_str()), (431, ""));
    let headers: Vec<_> = (0..1000).map(|i| (format!("X-{i}"), "y")).collect();
    let headers: Vec<_> = headers.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    send(server.public, "GET", "/", &headers, &[]).problem(431, "headers-too-large");
    for request in [
        "nonsense\r\n\r\n",
        "GET / HTTP/1.1\r\nA b: c\r\n\r\n",
        "GET / HTTP/9.9\r\nHost: localhost\r\n\r\n",
        "GET http://[ HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1, 2\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: x\r\n\r\n",
        "\u{16}\u{3}\u{1} a TLS greeting \r\n\r\n",
    ] {
        let answer = exchange(server.public, request.as_bytes());
        assert_eq!((answer.status, answer.text().as_str()), (400, ""), "{request}");
    }
    let target = format!("GET /{} HTTP/1.1\r\nHost: localhost\r\n\r\n", "a".repeat(70_000));
    assert_eq!(exchange(server.public, target.as_bytes()).status, 414);
    for target in ["CONNECT test:80", "OPTIONS *", "GET *"] {
        let request = format!("{target} HTTP/1.1\r\nHost: localhost\r\n\r\n");
        let answer = exchange(server.public, request.as_bytes());
        assert!((400..500).contains(&answer.status), "{target}: {}", answer.status);
    }
    for (host, status) in [("localhost", 200), ("elsewhere", 421)] {
        let absolute = format!("GET http://{host}/v1/methods HTTP/1.0\r\n\r\n");
        assert_eq!(exchange(server.public, absolute.as_bytes()).status, status);
    }
}

#[test]
fn a_request_id_that_could_do_harm_is_replaced() {
    let server = Service::start(&[]);
    let id = |given: &str| {
        let answer = send(server.public, "GET", "/", &[("X-Request-ID", given)], &[]);
        answer.header("x-request-id").to_owned()
    };
    assert_eq!(id("abc-DEF_123"), "abc-DEF_123");
    for harmful in ["", "a b", "<script>", "a\"b", &"a".repeat(65), "caf\u{e9}"] {
        let replaced = id(harmful);
        assert!(replaced != harmful && replaced.len() == 36, "{harmful}: {replaced}");
    }
}

#[test]
fn a_header_that_does_not_arrive_closes_the_connection() {
    // So long that no busy machine takes it between a connection and its first bytes.
    let server = Service::start(&["--header-timeout", "3s"]);
    let mut kept = connect(server.public);
    let request = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n";
    kept.write_all(request).unwrap();
    let parts =
        ["", "POST /v1/meshes HTT", "POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nX-Slow: "];
    let streams = parts.map(|sent| {
        let mut stream = connect(server.public);
        stream.write_all(sent.as_bytes()).unwrap();
        stream
    });
    assert_eq!(receive(&mut kept, Instant::now()).status, 200);
    for mut stream in streams {
        assert_closed_within(&mut stream, CLOSED_WITHIN);
    }
    // A connection stays open between requests, and the next header must arrive as soon as the first.
    kept.write_all(request).unwrap();
    assert_eq!(receive(&mut kept, Instant::now()).status, 200);
    kept.write_all(b"GET / HTTP/1.1\r\nHost: ").unwrap();
    assert_closed_within(&mut kept, CLOSED_WITHIN);
}

#[test]
fn a_body_may_arrive_for_longer_than_a_header_on_a_kept_connection() {
    let server = Service::start(&["--header-timeout", "1s"]);
    let mut stream = connect(server.public);
    let image = disc(20, 20, 1);
    for _ in 0..2 {
        let head = format!(
            "POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: {}\r\n\r\n",
            image.len()
        );
        stream.write_all(&[head.as_bytes(), &image[..30]].concat()).unwrap();
        std::thread::sleep(Duration::from_millis(1500));
        stream.write_all(&image[30..]).unwrap();
        assert_eq!(receive(&mut stream, Instant::now()).status, 200);
    }
}

#[test]
fn a_connection_without_requests_is_closed() {
    let server = Service::start(&["--keep-alive-timeout", "1s"]);
    let mut idle = connect(server.public);
    idle.write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    assert_eq!(receive(&mut idle, Instant::now()).status, 200);
    assert_closed_within(&mut idle, CLOSED_WITHIN);
}

#[test]
fn a_body_that_does_not_arrive_is_answered_408() {
    let server = Server::start(&["--body-timeout", "300ms"]);
    let mut stream = connect(server.public);
    let began = Instant::now();
    stream
        .write_all(b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000\r\n\r\nP5")
        .unwrap();
    let answer = receive(&mut stream, began);
    answer.problem(408, "request-timeout");
    assert!((300..15_000).contains(&answer.took.as_millis()), "{:?}", answer.took);
    assert_closed_within(&mut stream, CLOSED_WITHIN);
    server.wait_until_idle();
}

#[test]
fn connections_over_the_number_are_told_so() {
    let server = Service::start(&["--max-connections", "3"]);
    let held: Vec<_> = (0..3).map(|_| connect(server.public)).collect();
    let mut over = connect(server.public);
    let answer = receive(&mut over, Instant::now());
    assert_eq!((answer.status, answer.header("retry-after")), (503, "1"));
    assert_eq!(answer.json()["type"], "/problems/overloaded");
    assert_eq!(server.operate("/livez").status, 200);
    drop(held);
    server.wait_until("there is a place again", || {
        let mut stream = connect(server.public);
        stream.write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        receive(&mut stream, Instant::now()).status == 200
    });
}

#[test]
fn one_address_leaves_connections_to_others() {
    // By default, 2048 connections at this budget, and three quarters of them for one address.
    allow_descriptors(4096);
    let server = Server::start(&["--memory-budget", "1GiB"]);
    let slow: Vec<_> = (0..1536).map(|_| connect(server.public)).collect();
    server.wait_until("its part is taken", || server.metric("pixmesh_open_connections") >= 1536.0);
    for _ in 0..50 {
        // Its own address has no more.
        let answer = receive(&mut connect(server.public), Instant::now());
        assert_eq!(answer.status, 503);
        assert_eq!(answer.json()["setting"], "--connections-per-address");
        // Another has the rest.
        let mut stream = connect_from("127.0.0.2", server.public);
        stream
            .write_all(b"GET /v1/methods HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
            .unwrap();
        assert_eq!(receive(&mut stream, Instant::now()).status, 200);
    }
    assert_eq!(server.metric("pixmesh_open_connections"), 1536.0);
    let refused = "pixmesh_connections_refused_total{reason=\"address\"}";
    assert_eq!(server.metric(refused), 50.0);
    drop(slow);
}

/// Lets this process have so many files and connections open.
fn allow_descriptors(count: u64) {
    let mut limit = getrlimit(Resource::Nofile);
    limit.current = limit.current.map(|current| current.max(count));
    let raised = setrlimit(Resource::Nofile, limit);
    assert!(raised.is_ok(), "run this test with `ulimit -Hn` of {count} or more");
}

#[test]
fn bodies_share_a_memory_of_their_own() {
    let server = Service::start(&["--memory-budget", "4MiB"]);
    let mut slow = connect(server.public);
    let head = b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000\r\n\r\n";
    slow.write_all(&[head.as_slice(), &[0; 900_000]].concat()).unwrap();
    std::thread::sleep(Duration::from_millis(300));
    server.wait_until("bodies take their memory", || {
        let answer = server.mesh("", &[], &[0; 500_000]);
        if answer.status == 503 {
            assert_eq!(answer.problem(503, "overloaded")["setting"], "--memory-budget");
            assert!(!answer.header("retry-after").is_empty());
        }
        answer.status == 503
    });
    assert_eq!(server.mesh("", &[], &disc(20, 20, 1)).status, 200, "there is room for small ones");
    drop(slow);
    server.wait_until("it is freed", || server.mesh("", &[], &[0; 500_000]).status == 415);
}

#[test]
fn a_body_that_the_memory_for_bodies_could_never_hold_is_too_large() {
    let server = Server::start(&["--memory-budget", "4MiB"]);
    let over = vec![0; (1 << 20) + 1];
    let problem = server.mesh("", &[], &over).problem(413, "body-too-large");
    assert_eq!(
        (&problem["limit"], &problem["setting"]),
        (&(1 << 20).into(), &"--memory-budget".into())
    );
    server.mesh("", &[], &over[1..]).problem(415, "unsupported-image");
    server.wait_until("the log says so", || server.log().contains("longest=\"1MiB\""));
}

#[test]
fn few_descriptors_leave_the_listener_for_operations_its_own() {
    let server = Server::start_with_descriptors(128, &[]);
    let idle: Vec<_> = (0..200).map(|_| connect(server.public)).collect();
    for target in ["/livez", "/readyz", "/metrics"] {
        assert_median_within(Duration::from_secs(1), || {
            let answer = server.operate(target);
            assert_eq!(answer.status, 200);
            answer.took
        });
    }
    assert!(server.metric("process_open_fds") < 128.0);
    assert!(!server.log().contains("could not be accepted"), "{}", server.log());
    let warned = "fewer connections than --max-connections";
    server.wait_until("the log says so", || server.log().contains(warned));
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

#[test]
fn a_request_names_one_host() {
    let server = Service::start(&[]);
    for headers in ["", "Host: localhost\r\nHost: b\r\n", "Host: localhost\r\nHost: localhost\r\n"]
    {
        let request = format!("GET / HTTP/1.1\r\n{headers}\r\n");
        let answer = exchange(server.public, request.as_bytes());
        answer.problem(400, "bad-request");
        assert_eq!(answer.header("connection"), "close");
    }
    assert_eq!(exchange(server.public, b"GET / HTTP/1.0\r\n\r\n").status, 200);
}

#[test]
fn http2_with_prior_knowledge_serves_every_route() {
    let server = Server::start(&[]);
    let image = disc(40, 30, 3);
    let over_http1 = server.mesh("density=5", &[], &image).body;
    let address = server.public;
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let _ = rustls::crypto::ring::default_provider().install_default();
    runtime.block_on(async {
        let client = reqwest::Client::builder().http2_prior_knowledge().build().unwrap();
        let mesh = || {
            let target = format!("http://{address}/v1/meshes?density=5");
            client.post(target).body(image.clone()).send()
        };
        let (first, second, missing) =
            tokio::join!(mesh(), mesh(), client.get(format!("http://{address}/nothing")).send());
        for response in [first.unwrap(), second.unwrap()] {
            assert_eq!(response.version(), reqwest::Version::HTTP_2);
            assert_eq!(response.status(), 200);
            assert_eq!(response.bytes().await.unwrap(), over_http1);
        }
        let missing = missing.unwrap();
        assert_eq!(missing.headers()["content-type"], "application/problem+json");
    });
    server.wait_until_idle();
}

#[test]
fn text_is_compressed_for_clients_that_accept_it() {
    let server = Service::start(&[]);
    let (image, address) = (disc(60, 60, 1), server.public);
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let _ = rustls::crypto::ring::default_provider().install_default();
    let answer = |query: &str, accepted: &'static str| {
        let target = format!("http://{address}/v1/meshes?density=20&{query}");
        let request = reqwest::Client::new().post(target).header("accept-encoding", accepted);
        runtime.block_on(async {
            let response = request.body(image.clone()).send().await.unwrap();
            (response.headers().clone(), response.bytes().await.unwrap())
        })
    };
    let (plain, text) = answer("", "identity");
    let (headers, compressed) = answer("", "br, gzip");
    assert_eq!(
        (&headers["content-encoding"], plain.get("content-encoding")),
        (&"gzip".parse().unwrap(), None)
    );
    assert!(compressed.len() * 2 < text.len(), "{} of {}", compressed.len(), text.len());
    let mut unpacked = Vec::new();
    flate2::read::GzDecoder::new(&compressed[..]).read_to_end(&mut unpacked).unwrap();
    assert_eq!(unpacked, text);
    // The bytes are others, so the tag is a weak one.
    assert_eq!(headers["etag"], format!("W/{}", plain["etag"].to_str().unwrap()));
    assert_eq!(headers["mesh-vertices"], plain["mesh-vertices"]);
    for (query, accepted) in
        [("", "gzip;q=0"), ("", "br"), ("format=glb", "gzip"), ("format=png", "gzip")]
    {
        let (headers, body) = answer(query, accepted);
        assert_eq!(headers.get("content-encoding"), None, "{query} {accepted}");
        assert_eq!(headers["content-length"], body.len().to_string(), "{query} {accepted}");
    }
}

/// The least that the service waits where nothing else is set is twice as long.
const CLOSED_WITHIN: Duration = Duration::from_secs(15);

fn assert_closed_within(stream: &mut TcpStream, limit: Duration) {
    let began = Instant::now();
    let mut rest = Vec::new();
    let _ = stream.read_to_end(&mut rest);
    assert!(began.elapsed() < limit, "open after {:?}", began.elapsed());
}
