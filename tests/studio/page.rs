//! What people do with the page, done by a browser: the scenarios of `browse.mjs`.

use crate::client::send;
use crate::keys::KeysFile;
use crate::relay::Relay;
use crate::server::{Folder, Server};
use crate::tools::{checkout, require};
use std::io::{BufRead, BufReader, Write};
use std::net::SocketAddr;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};

/// Software that draws takes both cores: one browser at a time.
static BROWSER: Mutex<()> = Mutex::new(());

fn browser(scenario: &str, service: SocketAddr, more: &[&str]) -> Child {
    for tool in ["chromium", "node", "tests/studio/node_modules/playwright-core"] {
        require(tool);
    }
    Command::new("node")
        .arg(checkout("tests/studio/browse.mjs"))
        .args([scenario, &format!("http://{service}")])
        .args(more)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Runs scenarios, and shows what they measured.
#[track_caller]
fn browse(scenarios: &str, server: &Server, more: &[&str]) {
    let _one = BROWSER.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let output = browser(scenarios, server.public, more).wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    let failed = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{scenarios}: {said}\n{failed}");
    println!("{said}");
}

/// Scenarios one after another in one browser, with one service.
#[track_caller]
fn browse_afresh(scenarios: &[&str]) {
    browse(&scenarios.join(","), &Server::start(&[]), &[]);
}

#[test]
fn pictures_become_meshes_that_are_seen_in_every_size() {
    // The visit comes first: it asks whether the service has any job.
    browse_afresh(&[
        "visit", "upload", "cancel", "slider", "once", "races", "camera", "large", "drawing",
    ]);
}

#[test]
fn what_is_drawn_is_what_the_service_makes() {
    browse_afresh(&["pixels", "layers", "relief", "frames"]);
}

#[test]
fn outcomes_looks_and_weights_are_seen_and_taken_away() {
    browse_afresh(&["outcomes", "solids", "looks", "brush", "downloads"]);
}

#[test]
fn meshes_are_compared_shared_and_found_again() {
    browse_afresh(&["compare", "again", "history", "pressed", "elsewhere"]);
}

#[test]
fn everyone_can_use_it_and_refusals_say_what_to_do() {
    browse_afresh(&["keyboard", "axe", "narrow", "weight", "errors"]);
}

#[test]
fn a_service_with_keys_is_used_with_one() {
    let file = KeysFile::new("studio");
    let key = file.issue("someone");
    browse("keys", &Server::start(&["--keys-file", file.path()]), &[&key]);
}

#[test]
fn a_job_goes_on_when_the_service_goes_away_and_comes_back() {
    let _one = BROWSER.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let folder = Arc::new(Folder::new());
    let mut server = Server::start_in(&folder, &[]);
    let relay = Relay::to(server.public);
    let mut browser = browser("away", relay.address, &[]);
    let mut lines = BufReader::new(browser.stdout.take().unwrap()).lines();
    let mut input = browser.stdin.take().unwrap();
    let mut said = String::new();
    for line in lines.by_ref() {
        let line = line.unwrap();
        said += &line;
        if line == "take it away" {
            server.kill();
            writeln!(input, "gone").unwrap();
        } else if line == "bring it back" {
            server = Server::start_in(&folder, &[]);
            relay.set(server.public);
            writeln!(input, "back").unwrap();
        }
    }
    let output = browser.wait_with_output().unwrap();
    assert!(output.status.success(), "{said}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("bring it back"), "{said}");
}

#[test]
fn programs_get_links_and_browsers_the_page_compressed_and_once() {
    let server = Server::start(&[]);
    let get =
        |target: &str, headers: &[(&str, &str)]| send(server.public, "GET", target, headers, &[]);
    let page = get("/", &[("Accept", "text/html,*/*;q=0.8"), ("Accept-Encoding", "gzip, br")]);
    assert_eq!((page.status, page.header("content-encoding")), (200, "gzip"));
    let again = get("/", &[("If-None-Match", page.header("etag")), ("Accept-Encoding", "gzip")]);
    assert_eq!((again.status, again.body.len()), (304, 0));
    let plain = get("/", &[]);
    assert!(plain.text().starts_with("<!doctype html>"));
    let policy = plain.header("content-security-policy");
    assert!(policy.contains("script-src 'self'") && !policy.contains("unsafe"), "{policy}");
    assert_eq!(
        page.header("etag"),
        format!("W/{}", plain.header("etag")),
        "other bytes, a weak tag"
    );
    assert!(get("/", &[("Accept", "application/json")]).json()["links"]["jobs"].is_string());
    for unknown in ["none.js", "index", "..%2fCargo.toml", "%2e%2e%2ftsconfig.json"] {
        get(&format!("/studio/{unknown}"), &[]).problem(404, "not-found");
    }
    for module in ["app.js", "worker.js", "theme.css", "icon.svg", "lake.pmesh"] {
        assert_eq!(get(&format!("/studio/{module}"), &[]).status, 200, "{module}");
    }
}
