//! Images that jobs keep, from which further meshes are made.

use crate::client::{field, form, send};
use crate::keys::KeysFile;
use crate::pictures::noise;
use crate::server::Server;

const SIDE: usize = 40;

#[test]
fn a_kept_image_makes_the_meshes_that_a_sent_one_makes() {
    let server = Server::start(&[]);
    let image = noise(SIDE);
    let job = server.job("size=90&keep_image=true", &image);
    server.wait_for(&job, "completed");
    let id = job.rsplit('/').next().unwrap();
    let kept = server.get(&format!("{job}/image"));
    assert_eq!((kept.status, &kept.body), (200, &image));
    assert_eq!(kept.header("content-type"), "image/x-portable-anymap");
    assert_eq!(server.get(&format!("{job}/mesh")).body, server.mesh("size=90", &[], &image).body);

    let sent = server.mesh("size=70&method=med", &[], &image);
    let named = server.mesh(&format!("size=70&method=med&image_of={id}"), &[], &[]);
    assert_eq!((named.status, &named.body), (200, &sent.body), "{}", named.text());
    // A job made of it, with weights, keeps it in its turn.
    let (content_type, body) = form(&[(&field("weights"), &image)]);
    let path = format!("/v1/jobs?size=50&keep_image=true&image_of={id}");
    let headers = [("Content-Type", content_type.as_str())];
    let next = send(server.public, "POST", &path, &headers, &body);
    assert_eq!(next.status, 202, "{}", next.text());
    let next = next.header("location").to_owned();
    let document = server.wait_for(&next, "completed");
    assert_eq!(document["image"]["weights"]["bytes"], image.len());
    assert_eq!(server.get(&format!("{next}/image")).body, image);
}

#[test]
fn the_image_of_a_job_that_runs_can_be_taken() {
    let server = Server::start(&[]);
    let image = noise(400);
    let job = server.job("density=30&method=mgpr&effort=9", &image);
    assert_eq!(server.get(&format!("{job}/image")).body, image);
    let id = job.rsplit('/').next().unwrap();
    let other = server.submit(&format!("size=40&image_of={id}"), &[], &[]);
    assert_eq!(other.status, 202, "{}", other.text());
    send(server.public, "DELETE", &job, &[], &[]);
    server.wait_for(other.header("location"), "completed");
}

#[test]
fn an_image_that_is_not_kept_or_is_another_keys_is_refused() {
    let server = Server::start(&[]);
    let image = noise(SIDE);
    let job = server.job("size=50", &image);
    server.wait_for(&job, "completed");
    let id = job.rsplit('/').next().unwrap();
    server.get(&format!("{job}/image")).problem(409, "job-without-image");
    let refused = |query: &str, body: &[u8]| server.submit(query, &[], body);
    let of = format!("image_of={id}");
    let problem = refused(&of, &[]).problem(409, "job-without-image");
    assert_eq!(problem["param"], "image_of");
    refused(&of, &image).problem(422, "conflicting-parameters");
    refused("image_of=nothing", &[]).problem(404, "not-found");
    refused(&format!("{of}&{of}"), &[]).problem(400, "duplicate-parameter");

    let file = KeysFile::new("kept");
    let keys = [file.issue("one"), file.issue("other")];
    let server = Server::start(&["--keys-file", file.path()]);
    let headers = keys.each_ref().map(|key| format!("Bearer {key}"));
    let with = |header: &str, query: &str, body: &[u8]| {
        server.submit(query, &[("Authorization", header)], body)
    };
    let own = with(&headers[0], "size=50&keep_image=true", &image);
    let id = own.header("location").rsplit('/').next().unwrap().to_owned();
    with(&headers[1], &format!("image_of={id}"), &[]).problem(404, "not-found");
    assert_eq!(with(&headers[0], &format!("image_of={id}"), &[]).status, 202);
}
