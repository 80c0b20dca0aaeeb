//! Who may use the service: keys, quotas, origins, and what browsers are told.

use crate::client::{Answer, connect, exchange, send};
use crate::in_process::Service;
use crate::keys::KeysFile;
use crate::pictures::{disc, noise};
use crate::server::{Client, Server, program};
use std::fs;
use std::io::{Read, Write};

fn methods(server: &Client, key: &str) -> Answer {
    let bearer = format!("Bearer {key}");
    send(server.public, "GET", "/v1/methods", &[("Authorization", &bearer)], &[])
}

#[test]
fn with_keys_everything_below_v1_needs_one() {
    let file = KeysFile::new("needed");
    let key = file.issue("studio");
    let server = Server::start(&["--keys-file", file.path()]);
    let image = disc(20, 20, 1);
    for target in ["/v1/meshes", "/v1/methods", "/v1/jobs/1", "/v1/nothing"] {
        for method in ["GET", "POST", "DELETE"] {
            let answer = send(server.public, method, target, &[], &image);
            answer.problem(401, "unauthorized");
            assert_eq!(answer.header("www-authenticate"), "Bearer realm=\"pixmesh\"");
        }
    }
    for target in ["/", "/openapi.json", "/problems/unauthorized"] {
        assert_eq!(server.get(target).status, 200, "{target}");
    }
    assert_eq!(server.operate("/metrics").status, 200);
    let bearer = format!("Bearer {key}");
    assert_eq!(server.mesh("", &[("Authorization", &bearer)], &image).status, 200);
    let last = if key.ends_with('0') { '1' } else { '0' };
    let wrong = format!("{}{last}", &key[..key.len() - 1]);
    for (sent, error) in [
        (format!("Bearer {wrong}"), "invalid_token"),
        ("Bearer ".into(), "invalid_request"),
        (format!("Bearer {}", "a".repeat(10_000)), "invalid_token"),
        (format!("Basic {key}"), "invalid_request"),
        (key.clone(), "invalid_request"),
        ("Bearer caf\u{e9}".into(), "invalid_request"),
    ] {
        let answer = send(server.public, "GET", "/v1/methods", &[("Authorization", &sent)], &[]);
        answer.problem(401, "unauthorized");
        assert!(answer.header("www-authenticate").contains(error), "{sent}");
    }
    let twice = [("Authorization", bearer.as_str()), ("Authorization", &bearer)];
    send(server.public, "GET", "/v1/methods", &twice, &[]).problem(401, "unauthorized");
    server.wait_until("the log names the holder", || server.log().contains("studio"));
    assert!(!server.log().contains(&key), "no log shows a key");
}

#[test]
fn keys_are_rotated_without_a_restart() {
    let file = KeysFile::new("rotated");
    let old = file.issue("studio");
    let server = Server::start(&["--keys-file", file.path()]);
    assert_eq!(methods(&server, &old).status, 200);
    let new = file.issue("studio");
    server.wait_until("both are good", || methods(&server, &new).status == 200);
    assert_eq!(methods(&server, &old).status, 200);
    file.edit(|text| text.lines().last().unwrap().to_owned());
    server.wait_until("the old one is not", || methods(&server, &old).status == 401);
    assert_eq!(methods(&server, &new).status, 200);
    file.edit(|text| format!("{text}\nno line of keys\n"));
    server.wait_until("the log says so", || server.log().contains("line 2"));
    assert_eq!(methods(&server, &new).status, 200, "what was in force stays");
    file.edit(|_| "# nobody\n".into());
    server.wait_until("the log says so", || server.log().contains("holds no key"));
    assert_eq!(methods(&server, &new).status, 200, "an empty file may be about to be written");
}

#[test]
fn a_file_of_keys_that_is_not_good_stops_the_start() {
    let file = KeysFile::new("refused");
    let refused = |reason: &str| {
        let arguments = ["serve", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0"];
        let output = program().args(arguments).args(["--keys-file", file.path()]).output().unwrap();
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains(reason), "{message}");
    };
    refused("cannot be read");
    fs::write(file.path(), "# none yet\n").unwrap();
    refused("pixmesh key new");
    fs::write(file.path(), "studio pixmesh_secret\n").unwrap();
    refused("line 1");
}

#[test]
fn with_keys_it_may_listen_anywhere() {
    let file = KeysFile::new("anywhere");
    file.issue("studio");
    let check = |flags: &[&str]| program().arg("config").args(flags).output().unwrap();
    assert!(!check(&["--listen", "0.0.0.0:0"]).status.success());
    assert!(check(&["--listen", "0.0.0.0:0", "--insecure-no-auth"]).status.success());
    let output = check(&["--listen", "0.0.0.0:0", "--keys-file", file.path()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_new_key_is_shown_once_and_only_its_digest_kept() {
    use std::os::unix::fs::PermissionsExt;
    let file = KeysFile::new("kept");
    let key = file.issue("studio");
    assert!(key.starts_with("pixmesh_") && key.len() == 8 + 64, "{key}");
    let text = fs::read_to_string(file.path()).unwrap();
    assert!(text.starts_with("studio ") && !text.contains(&key[8..]), "{text}");
    assert_eq!(fs::metadata(file.path()).unwrap().permissions().mode() & 0o777, 0o600);
    let printed = program().args(["key", "new", "studio"]).output().unwrap();
    let line = String::from_utf8(printed.stderr).unwrap();
    assert!(line.starts_with("line for --keys-file: studio "), "{line}");
    for name in ["", "a b", "caf\u{e9}", "../x"] {
        assert!(!program().args(["key", "new", name]).output().unwrap().status.success());
    }
}

#[test]
fn a_quota_is_told_and_kept_apart_by_name() {
    let file = KeysFile::new("quota");
    let [first, second, other] = ["studio", "studio", "batch"].map(|name| file.issue(name));
    file.edit(|text| text.trim_end().to_owned() + " requests-per-minute=30\n");
    let server = Server::start(&["--keys-file", file.path(), "--key-requests-per-minute", "3"]);
    let answers = [&first, &second, &first].map(|key| methods(&server, key));
    let left = answers.each_ref().map(|answer| answer.header("ratelimit"));
    assert_eq!(left, [2, 1, 0].map(|r| format!("\"requests\";r={r};t=20")));
    let refused = methods(&server, &second);
    let problem = refused.problem(429, "quota-exceeded");
    assert_eq!(problem["limit"], 3);
    assert_eq!(refused.header("ratelimit-policy"), "\"requests\";q=3;w=60");
    assert!((18..=20).contains(&refused.header("retry-after").parse::<u64>().unwrap()));
    let answer = methods(&server, &other);
    assert_eq!((answer.status, answer.header("ratelimit")), (200, "\"requests\";r=29;t=2"));
    assert_eq!(server.metric("pixmesh_requests_shed_total{reason=\"quota\"}"), 1.0);
    assert_eq!(server.get("/").status, 200, "what needs no key has no quota");
}

#[test]
fn pages_of_other_origins_are_let_in_by_name_only() {
    let origin = "https://example.org";
    let preflight = |server: &Client, origin: &str| {
        let headers = [
            ("Origin", origin),
            ("Access-Control-Request-Method", "POST"),
            ("Access-Control-Request-Headers", "authorization,content-type"),
        ];
        send(server.public, "OPTIONS", "/v1/meshes", &headers, &[])
    };
    let closed = Service::start(&[]);
    let answer = preflight(&closed, origin);
    answer.problem(403, "foreign-origin");
    assert_eq!(answer.header("access-control-allow-origin"), "");
    drop(closed);
    let file = KeysFile::new("origins");
    file.issue("studio");
    let flags = ["--cors-origin", origin, "http://localhost:3000", "--keys-file", file.path()];
    let server = Service::start(&flags);
    let answer = preflight(&server, origin);
    assert_eq!((answer.status, answer.header("access-control-allow-origin")), (200, origin));
    assert!(answer.header("access-control-allow-headers").contains("authorization"));
    assert!(answer.header("access-control-allow-methods").contains("POST"));
    assert_eq!(preflight(&server, "https://evil.org").header("access-control-allow-origin"), "");
    let refused = send(server.public, "GET", "/v1/methods", &[("Origin", origin)], &[]);
    refused.problem(401, "unauthorized");
    assert_eq!(refused.header("access-control-allow-origin"), origin, "it may read why");
    assert!(refused.header("access-control-expose-headers").contains("ratelimit"));
    for wrong in ["*", "example.org", "https://example.org/path"] {
        assert!(
            !program().args(["config", "--cors-origin", wrong]).output().unwrap().status.success()
        );
    }
}

#[test]
fn a_key_follows_so_many_jobs_at_a_time_and_takes_no_place_of_others() {
    let file = KeysFile::new("followers");
    let [alice, bob] = ["alice", "bob"].map(|name| format!("Bearer {}", file.issue(name)));
    let flags = ["--keys-file", file.path(), "--workers", "1"];
    let many = ["--key-requests-per-minute", "10000"];
    let server = Server::start(&[&flags[..], &many].concat());
    let submit = |key: &str| {
        let headers = [("Authorization", key)];
        // It runs, or waits behind the first one.
        let job = server.submit("method=mgpr&density=1", &headers, &noise(900));
        assert_eq!(job.status, 202, "{}", job.text());
        format!("{}/events", job.header("location"))
    };
    let (of_alice, of_bob) = (submit(&alice), submit(&bob));
    let follow = |key: &str, path: &str| {
        let mut stream = connect(server.public);
        let request =
            format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: {key}\r\n\r\n");
        stream.write_all(request.as_bytes()).unwrap();
        let mut start = [0; 12];
        stream.read_exact(&mut start).unwrap();
        (String::from_utf8_lossy(&start[9..]).into_owned(), stream)
    };
    let held: Vec<_> = (0..1024).map(|_| follow(&alice, &of_alice)).collect();
    let followed = held.iter().filter(|(status, _)| status == "200").count();
    assert_eq!(followed, 64);
    assert!(held.iter().all(|(status, _)| ["200", "429"].contains(&status.as_str())));
    for _ in 0..30 {
        assert_eq!(follow(&bob, &of_bob).0, "200");
    }
    assert!(server.metric("pixmesh_event_streams") >= 64.0);
    drop(held);
    server.wait_until("her places are free again", || follow(&alice, &of_alice).0 == "200");
}

#[test]
fn a_page_that_forges_requests_or_names_changes_and_reads_nothing() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    let forged = [("Origin", "https://evil.example"), ("Sec-Fetch-Site", "cross-site")];
    server.submit("size=20", &forged, &image).problem(403, "foreign-origin");
    let job = server.job("size=20", &image);
    server.wait_for(&job, "completed");
    for (method, target) in [("GET", "/v1/jobs"), ("GET", &job), ("DELETE", &job)] {
        let answer = send(server.public, method, target, &forged, &[]);
        assert_eq!(answer.problem(403, "foreign-origin")["setting"], "--cors-origin");
        // The page's name resolves to this machine.
        let rebound = format!("{method} {target} HTTP/1.1\r\nHost: evil.example:8080\r\n\r\n");
        let answer = exchange(server.public, rebound.as_bytes());
        assert_eq!(answer.problem(421, "unknown-host")["setting"], "--allowed-host");
    }
    let own = [("Origin", "http://localhost"), ("Sec-Fetch-Site", "same-origin")];
    assert_eq!(send(server.public, "GET", &job, &own, &[]).status, 200);
    drop(server);
    let server = Service::start(&["--allowed-host", "mesh.test"]);
    for (host, status) in [("mesh.test:80", 200), ("MESH.test", 200), ("other.test", 421)] {
        let request =
            format!("GET /v1/methods HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
        assert_eq!(exchange(server.public, request.as_bytes()).status, status, "{host}");
    }
    let wrong = ["config", "--allowed-host", "http://mesh.test"];
    assert!(!program().args(wrong).output().unwrap().status.success());
}

#[test]
fn browsers_are_told_to_run_nothing_and_frame_nothing() {
    let server = Service::start(&[]);
    let answers = [
        server.get("/v1/methods"),
        server.get("/nothing"),
        server.mesh("format=png", &[], &disc(20, 20, 1)),
        server.mesh("density=0", &[], &disc(20, 20, 1)),
    ];
    for answer in answers {
        assert_eq!(answer.header("x-content-type-options"), "nosniff");
        assert_eq!(answer.header("x-frame-options"), "DENY");
        assert_eq!(answer.header("cross-origin-opener-policy"), "same-origin");
        assert!(answer.header("permissions-policy").contains("camera=()"));
        assert_eq!(answer.header("referrer-policy"), "no-referrer");
        assert_eq!(answer.header("cross-origin-resource-policy"), "same-origin");
        assert!(answer.header("content-security-policy").contains("default-src 'none'"));
    }
}
