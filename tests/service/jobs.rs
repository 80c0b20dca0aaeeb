//! Jobs: submitted, looked at, cancelled, listed, and their meshes.

use crate::client::{Answer, assert_median_within, field, form, send};
use crate::in_process::Service;
use crate::pictures::{disc, noise};
use crate::server::{Client, Folder, Server};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use pixmesh_codec::Format;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// Work that takes seconds.
const SLOW: &str = "method=mgpr&density=1";
/// No job of anybody.
const UNKNOWN: &str = "/v1/jobs/01890000-0000-7000-8000-000000000000";

fn delete(server: &Client, job: &str) -> Answer {
    send(server.public, "DELETE", job, &[], &[])
}

fn get(server: &Client, target: &str, headers: &[(&str, &str)]) -> Answer {
    send(server.public, "GET", target, headers, &[])
}

#[test]
fn a_job_ends_with_the_same_mesh_as_a_request_in_every_format() {
    let server = Server::start(&[]);
    let image = disc(60, 50, 3);
    let job = server.job("size=100", &image);
    let document = server.wait_for(&job, "completed");
    assert_eq!(document["attempt"], 1);
    assert_eq!((&document["mesh"]["vertices"], &document["error"]), (&100.into(), &().into()));
    assert_eq!(document["parameters"]["size"], 100);
    assert_eq!(
        (&document["image"]["width"], &document["image"]["components"]),
        (&60.into(), &3.into())
    );
    assert!(document["timings_ms"]["simplify"].as_f64().unwrap() > 0.0, "{document}");
    for moment in ["created_at", "started_at", "finished_at", "expires_at"] {
        assert!(document[moment].as_str().unwrap().ends_with('Z'), "{document}");
    }
    let mesh = document["links"]["mesh"].as_str().unwrap();
    // Quantized-mesh is for elevation models alone: `terrain.rs`.
    for format in Format::NAMES.iter().filter(|name| **name != "terrain") {
        let direct = server.mesh(&format!("size=100&format={format}"), &[], &image);
        let stored = server.get(&format!("{mesh}?format={format}"));
        assert_eq!(stored.status, 200, "{}", stored.text());
        assert!(stored.body == direct.body, "{format}");
        for name in [
            "content-type",
            "content-disposition",
            "mesh-vertices",
            "mesh-faces",
            "mesh-psnr",
            "mesh-mse",
            "content-length",
        ] {
            assert_eq!(stored.header(name), direct.header(name), "{format}: {name}");
        }
        let head = head(&server, &format!("{mesh}?format={format}"));
        assert!(head.contains(&format!("content-length: {}\r\n", direct.body.len())), "{head}");
    }
    let direct = server.mesh("size=100", &[], &image);
    assert_eq!(server.get(mesh).header("etag"), direct.header("etag"));
    server.wait_until_idle();
}

#[test]
fn faces_of_a_flat_mesh_have_the_same_colors_in_every_answer() {
    let server = Server::start(&[]);
    let image = disc(60, 50, 3);
    let job = server.job("method=flat&size=60", &image);
    server.wait_for(&job, "completed");
    let of_request =
        |format: &str| server.mesh(&format!("method=flat&size=60&format={format}"), &[], &image);
    for format in Format::NAMES {
        let (direct, stored) =
            (of_request(format), server.get(&format!("{job}/mesh?format={format}")));
        if *format == "progression" {
            direct.problem(422, "format-not-possible");
            stored.problem(409, "job-without-order");
        } else if *format == "terrain" {
            direct.problem(422, "format-not-possible");
            stored.problem(422, "format-not-possible");
        } else {
            assert_eq!(stored.status, 200, "{format}: {}", stored.text());
            assert!(stored.body == direct.body, "{format}");
        }
    }
    let (model, picture) = (of_request("model"), of_request("png"));
    let rebuilt = send(server.public, "POST", "/v1/reconstructions", &[], &model.body);
    assert!(rebuilt.body == picture.body);
    let (label, pair) =
        form(&[(&field("image"), &image[..]), (&field("approximation"), &model.body[..])]);
    let headers = [("Content-Type", &*label)];
    let compared = send(server.public, "POST", "/v1/comparisons", &headers, &pair).json();
    let psnr_db: f64 = model.header("mesh-psnr").parse().unwrap();
    assert!((compared["psnr_db"].as_f64().unwrap() - psnr_db).abs() < 1e-9, "{compared}");
    server.wait_until_idle();
}

/// The answer to HEAD, which has no body.
fn head(server: &Client, target: &str) -> String {
    use std::io::{Read, Write};
    let mut stream = crate::client::connect(server.public);
    let request = format!("HEAD {target} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).unwrap();
    let mut head = String::new();
    stream.read_to_string(&mut head).unwrap();
    assert!(head.starts_with("HTTP/1.1 200") && head.ends_with("\r\n\r\n"), "{head}");
    head
}

#[test]
fn a_mesh_is_sent_in_part_or_not_at_all_where_the_client_says_so() {
    let server = Server::start(&[]);
    let job = server.job("size=100&format=glb", &disc(60, 50, 3));
    server.wait_for(&job, "completed");
    let mesh = format!("{job}/mesh");
    assert_eq!(server.get(&mesh).header("content-type"), "model/gltf-binary", "as submitted");
    let accept = [("Accept", "image/png")];
    assert_eq!(get(&server, &mesh, &accept).header("content-type"), "image/png");
    get(&server, &mesh, &[("Accept", "text/html")]).problem(406, "not-acceptable");
    server.get(&format!("{mesh}?format=gif")).problem(422, "unknown-value");
    server.get(&format!("{mesh}?fromat=glb")).problem(400, "unknown-parameter");
    for format in ["model", "png"] {
        let target = format!("{mesh}?format={format}");
        let whole = server.get(&target);
        let tag = whole.header("etag").to_owned();
        assert_eq!(get(&server, &target, &[("If-Match", &tag)]).status, 200);
        let other = get(&server, &target, &[("If-Match", "\"other\"")]);
        other.problem(412, "precondition-failed");
        let known = get(&server, &target, &[("If-None-Match", &tag)]);
        assert_eq!((known.status, known.body.len()), (304, 0));
        assert_eq!(known.header("etag"), tag);
        let part = get(&server, &target, &[("Range", "bytes=10-19")]);
        assert_eq!((part.status, &part.body[..]), (206, &whole.body[10..20]));
        let length = whole.body.len();
        assert_eq!(part.header("content-range"), format!("bytes 10-19/{length}"));
        let end = get(&server, &target, &[("Range", "bytes=-5"), ("If-Range", &tag)]);
        assert_eq!((end.status, &end.body[..]), (206, &whole.body[length - 5..]));
        let changed = get(&server, &target, &[("Range", "bytes=-5"), ("If-Range", "\"old\"")]);
        assert_eq!((changed.status, changed.body.len()), (200, length));
        let beyond = get(&server, &target, &[("Range", &format!("bytes={length}-"))]);
        let problem = beyond.problem(416, "range-not-satisfiable");
        assert_eq!(problem["limit"], length);
        assert_eq!(beyond.header("content-range"), format!("bytes */{length}"));
    }
    server.wait_until_idle();
}

#[test]
fn parameters_of_a_job_are_refused_like_those_of_a_request() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    for (query, status, slug) in [
        ("density=0", 422, "parameter-out-of-range"),
        ("density=NaN", 422, "not-finite"),
        ("density=", 400, "parameter-malformed"),
        ("desnity=5", 400, "unknown-parameter"),
        ("density=5&density=5", 400, "duplicate-parameter"),
        ("density=5&size=50", 422, "conflicting-parameters"),
        ("method=ced", 422, "component-count"),
        ("size=401", 422, "parameter-out-of-range"),
        ("density=%zz", 400, "query-malformed"),
    ] {
        server.submit(query, &[], &image).problem(status, slug);
    }
    server.submit("", &[], b"").problem(400, "empty-file");
    server.submit("", &[], b"no picture").problem(415, "unsupported-image");
    let label = [("Content-Type", "text/html")];
    server.submit("", &label, &image).problem(415, "unsupported-media-type");
    assert_eq!(server.get("/v1/jobs").json()["jobs"].as_array().unwrap().len(), 0);
}

#[test]
fn a_job_can_be_a_form_or_json() {
    let server = Service::start(&[]);
    let image = disc(30, 30, 1);
    let json = |body: &str| {
        send(
            server.public,
            "POST",
            "/v1/jobs",
            &[("Content-Type", "application/json")],
            body.as_bytes(),
        )
    };
    let encoded = STANDARD.encode(&image);
    let answer = json(&format!(
        "{{\"image\": \"{encoded}\", \"params\": {{\"size\": 50, \"method\": \"med\"}}}}"
    ));
    assert_eq!(answer.status, 202, "{}", answer.text());
    let by_json = server.wait_for(answer.header("location"), "completed");
    let (label, body) =
        form(&[(&field("image"), &image), (&field("params"), br#"{"size": 50, "method": "med"}"#)]);
    let answer = send(server.public, "POST", "/v1/jobs", &[("Content-Type", &label)], &body);
    let by_form = server.wait_for(answer.header("location"), "completed");
    assert_eq!(by_json["parameters"], by_form["parameters"]);
    assert_eq!(by_json["mesh"], by_form["mesh"]);
    assert_eq!(by_json["image"], by_form["image"]);
    for (body, status, slug) in [
        ("{}".to_owned(), 400, "image-missing"),
        ("{".to_owned(), 400, "json-malformed"),
        ("{\"image\": 5}".to_owned(), 400, "parameter-malformed"),
        (format!("{{\"image\": \"{encoded}\", \"parms\": {{}}}}"), 400, "unknown-parameter"),
        (
            format!("{{\"image\": \"{encoded}\", \"params\": {{\"size\": 3}}}}"),
            422,
            "parameter-out-of-range",
        ),
        (format!("{{\"image\": \"{encoded}\", \"image\": \"\"}}"), 400, "duplicate-parameter"),
    ] {
        json(&body).problem(status, slug);
    }
    let direct = [("Content-Type", "application/json")];
    server.mesh("", &direct, b"{}").problem(415, "unsupported-media-type");
}

#[test]
fn the_same_idempotency_key_is_the_same_job_for_the_same_content_alone() {
    let server = Service::start(&[]);
    let image = disc(30, 30, 1);
    let key = [("Idempotency-Key", "3fa1-word")];
    let first = server.submit("size=50&method=med", &key, &image);
    assert_eq!((first.status, first.header("idempotency-replayed")), (202, ""));
    let location = first.header("location");
    // The order of the parameters is no content.
    let again = server.submit("method=med&size=50", &key, &image);
    assert_eq!((again.status, again.header("location")), (202, location));
    assert_eq!(again.header("idempotency-replayed"), "true");
    server.submit("size=51&method=med", &key, &image).problem(422, "idempotency-key-reused");
    server
        .submit("size=50&method=med", &key, &disc(31, 30, 1))
        .problem(422, "idempotency-key-reused");
    let preferring = [key[0], ("Prefer", "respond-async")];
    let by_mesh = server.mesh("method=med&size=50", &preferring, &image);
    assert_eq!((by_mesh.status, by_mesh.header("location")), (202, location));
    assert_eq!(server.get("/v1/jobs").json()["jobs"].as_array().unwrap().len(), 1);
    server.wait_for(location, "completed");
    let after = server.submit("size=50&method=med", &key, &image);
    assert_eq!(
        (after.json()["state"].as_str(), after.header("location")),
        (Some("completed"), location)
    );
    assert_eq!(delete(&server, location).status, 204);
    server.submit("size=50&method=med", &key, &image).problem(410, "gone");
    for wrong in ["", "two words", &"x".repeat(256)] {
        server
            .submit("", &[("Idempotency-Key", wrong)], &image)
            .problem(400, "parameter-malformed");
    }
}

#[test]
fn clients_that_repeat_a_submission_at_once_make_one_job() {
    let server = Service::start(&[]);
    let image = disc(40, 40, 1);
    let mut locations: Vec<String> = thread::scope(|scope| {
        let submit = || {
            let answer = server.submit("size=50", &[("Idempotency-Key", "once")], &image);
            assert_eq!(answer.status, 202, "{}", answer.text());
            answer.header("location").to_owned()
        };
        let clients: Vec<_> = (0..12).map(|_| scope.spawn(submit)).collect();
        clients.into_iter().map(|client| client.join().unwrap()).collect()
    });
    locations.dedup();
    assert_eq!(locations.len(), 1, "{locations:?}");
}

#[test]
fn who_prefers_a_job_gets_one_when_the_time_is_over() {
    let server = Server::start(&["--workers", "1"]);
    let image = disc(40, 40, 3);
    let plain = server.mesh("size=50", &[], &image);
    let waited = server.mesh("size=50", &[("Prefer", "wait=20")], &image);
    assert_eq!((waited.status, waited.header("preference-applied")), (200, "wait=20"));
    assert!(waited.body == plain.body);
    assert_eq!(waited.header("etag"), plain.header("etag"));
    let mesh = waited.header("content-location");
    assert!(mesh.ends_with("/mesh") && server.get(mesh).body == plain.body);
    let png = server.mesh("size=50&format=png", &[("Prefer", "wait=20")], &image);
    assert_eq!(png.header("content-type"), "image/png");

    let asynchronous = server.mesh(SLOW, &[("Prefer", "respond-async")], &noise(1024));
    assert_eq!(asynchronous.status, 202, "{}", asynchronous.text());
    assert_eq!(asynchronous.header("preference-applied"), "respond-async");
    let slow = server.mesh(SLOW, &[("Prefer", "respond-async, wait=1")], &noise(1024));
    assert_eq!((slow.status, slow.header("preference-applied")), (202, "respond-async, wait=1"));
    assert!(slow.took >= Duration::from_millis(900), "{:?}", slow.took);
    assert!(["queued", "running"].contains(&slow.json()["state"].as_str().unwrap()));
    for answer in [slow, asynchronous] {
        assert_eq!(delete(&server, answer.header("location")).status, 202);
    }
    // A picture that breaks after its header: the job fails, and so does the request that waits.
    let broken = server.mesh("", &[("Prefer", "wait=20")], &image[..image.len() / 2]);
    broken.problem(422, "image-decode-failed");
    server.wait_until_idle();
}

#[test]
fn a_job_that_fails_says_why_and_has_no_mesh() {
    let server = Server::start(&["--job-deadline", "300ms"]);
    let image = disc(40, 40, 3);
    let job = server.job("", &image[..image.len() / 2]);
    let document = server.wait_for(&job, "failed");
    assert_eq!(document["error"]["type"], "/problems/image-decode-failed");
    assert!(document["mesh"].is_null() && document["links"]["mesh"].is_null());
    server.get(&format!("{job}/mesh")).problem(409, "job-without-mesh");
    let slow = server.job(SLOW, &noise(1024));
    let document = server.wait_for(&slow, "failed");
    assert_eq!(document["error"]["type"], "/problems/deadline-exceeded");
    assert_eq!(document["error"]["setting"], "--job-deadline");
    server.wait_until_idle();
}

#[test]
fn a_job_that_can_never_fit_is_refused_when_it_is_submitted() {
    let server = Service::start(&["--memory-budget", "64MiB"]);
    let problem = server.submit("method=mgpr", &[], &noise(2000)).problem(422, "work-too-large");
    assert_eq!(problem["setting"], "--memory-budget");
    assert!(problem["actual"].as_u64() > problem["limit"].as_u64(), "{problem}");
}

#[test]
fn cancelling_stops_running_work_at_once_and_frees_its_worker() {
    let server = Server::start(&["--workers", "1"]);
    let running = server.job(SLOW, &noise(1024));
    server.wait_for(&running, "running");
    let waiting = server.job("size=50", &disc(30, 30, 1));
    let waiting_too = server.job("size=50", &disc(31, 30, 1));
    server.get(&format!("{waiting}/mesh")).problem(409, "job-unfinished");
    let answer = delete(&server, &waiting_too);
    assert_eq!((answer.status, answer.json()["state"].as_str()), (202, Some("cancelled")));
    assert_eq!(delete(&server, &running).status, 202);
    server.wait_for(&running, "cancelled");
    server.wait_for(&waiting, "completed");
    assert_median_within(Duration::from_secs(1), || {
        let running = server.job(SLOW, &noise(1024));
        server.wait_for(&running, "running");
        let waiting = server.job("size=50", &disc(30, 30, 1));
        let began = std::time::Instant::now();
        assert_eq!(delete(&server, &running).status, 202);
        server.wait_for(&waiting, "completed");
        let took = began.elapsed();
        assert_eq!(server.wait_for(&running, "cancelled")["mesh"], serde_json::Value::Null);
        took
    });
    server.get(&format!("{running}/mesh")).problem(409, "job-without-mesh");
    for job in [&running, &waiting, &waiting_too] {
        assert_eq!(delete(&server, job).status, 204);
        server.get(job).problem(404, "not-found");
        delete(&server, job).problem(404, "not-found");
    }
    server.wait_until_idle();
}

#[test]
fn jobs_are_listed_newest_first_and_page_by_page() {
    let server = Service::start(&[]);
    let jobs: Vec<String> =
        (0..5).map(|i| server.job("method=med&size=20", &disc(20 + i, 20, 1))).collect();
    for job in &jobs {
        server.wait_for(job, "completed");
    }
    let (mut listed, mut next) = (Vec::new(), "/v1/jobs?limit=2&state=completed".to_owned());
    loop {
        let page = server.get(&next).json();
        let documents = page["jobs"].as_array().unwrap();
        listed
            .extend(documents.iter().map(|job| job["links"]["self"].as_str().unwrap().to_owned()));
        match page["links"]["next"].as_str() {
            Some(target) => next = target.to_owned(),
            None => break,
        }
    }
    assert!(listed.iter().rev().eq(&jobs), "{listed:?}");
    assert!(server.get("/v1/jobs?state=queued").json()["jobs"].as_array().unwrap().is_empty());
    for (query, status, slug) in [
        ("limit=0", 422, "parameter-out-of-range"),
        ("limit=101", 422, "parameter-out-of-range"),
        ("limit=x", 400, "parameter-malformed"),
        ("limit=1&limit=1", 400, "duplicate-parameter"),
        ("state=done", 422, "unknown-value"),
        ("cursor=x", 400, "parameter-malformed"),
        ("crusor=x", 400, "unknown-parameter"),
    ] {
        server.get(&format!("/v1/jobs?{query}")).problem(status, slug);
    }
}

#[test]
fn what_is_no_name_of_a_job_is_not_found() {
    let server = Service::start(&[]);
    for name in [
        "..%2f..%2fetc%2fpasswd",
        "%00",
        "%ff",
        "x",
        "018900000000700080000000000000000",
        "01890000-0000-7000-8000-00000000000A",
        "{01890000-0000-7000-8000-000000000000}",
    ] {
        for path in ["", "/mesh", "/events"] {
            server.get(&format!("/v1/jobs/{name}{path}")).problem(404, "not-found");
        }
        delete(&server, &format!("/v1/jobs/{name}")).problem(404, "not-found");
    }
    server.get(UNKNOWN).problem(404, "not-found");
    send(server.public, "PUT", UNKNOWN, &[], &[]).problem(405, "method-not-allowed");
}

#[test]
fn results_are_gone_after_their_time_and_their_files_with_them() {
    let folder: Arc<Folder> = Arc::default();
    let server = Server::start_in(&folder, &["--result-ttl", "1s"]);
    let job = server.job("method=med&size=20", &disc(20, 20, 1));
    server.wait_for(&job, "completed");
    server.wait_until("it is gone", || server.get(&job).status == 410);
    server.get(&job).problem(410, "gone");
    server.get(&format!("{job}/mesh")).problem(410, "gone");
    server.get(&format!("{job}/events")).problem(410, "gone");
    delete(&server, &job).problem(410, "gone");
    server.wait_until("its files are deleted", || blobs(&folder) == 0);
}

/// How many blobs there are in a folder of jobs.
fn blobs(folder: &Folder) -> usize {
    let shelves = std::fs::read_dir(folder.path().join("blobs")).unwrap();
    shelves.map(|shelf| std::fs::read_dir(shelf.unwrap().path()).unwrap().count()).sum()
}

#[test]
fn more_jobs_than_may_wait_are_turned_away_at_once() {
    let server = Service::start(&["--workers", "1", "--max-queued-jobs", "3"]);
    let running = server.job(SLOW, &noise(1024));
    server.wait_for(&running, "running");
    let waiting: Vec<String> = (0..3).map(|i| server.job("", &disc(20 + i, 20, 1))).collect();
    assert_median_within(Duration::from_millis(500), || {
        let refused = server.submit("", &[], &disc(40, 40, 1));
        let problem = refused.problem(503, "overloaded");
        let told = (&problem["setting"], &problem["limit"]);
        assert_eq!(told, (&"--max-queued-jobs".into(), &3.into()));
        assert!(refused.header("retry-after").parse::<u64>().unwrap() >= 1);
        refused.took
    });
    delete(&server, &running);
    for job in waiting {
        server.wait_for(&job, "completed");
    }
}

#[test]
fn jobs_and_requests_together_keep_to_the_workers_and_the_memory() {
    let server = Server::start(&["--workers", "2"]);
    let image = noise(400);
    let jobs: Vec<String> = (0..6).map(|_| server.job(SLOW, &image)).collect();
    thread::scope(|scope| {
        let send = || assert_eq!(server.mesh(SLOW, &[], &image).status, 200);
        let clients: Vec<_> = (0..4).map(|_| scope.spawn(send)).collect();
        while clients.iter().any(|client| !client.is_finished()) {
            assert!(server.metric("pixmesh_jobs_in_progress") <= 2.0);
            thread::sleep(Duration::from_millis(5));
        }
    });
    for job in &jobs {
        server.wait_for(job, "completed");
    }
    server.wait_until_idle();
    assert_eq!(server.metric("pixmesh_job_attempts_total"), 6.0);
    assert_eq!(server.metric("pixmesh_jobs_total{state=\"completed\"}"), 6.0);
}
