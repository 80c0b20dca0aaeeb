//! What people do with the page, done by a browser: each test is a scenario of `browse.mjs`.

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

/// Runs a scenario, and shows what it measured.
#[track_caller]
fn browse(scenario: &str, server: &Server, more: &[&str]) {
    let _one = BROWSER.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let output = browser(scenario, server.public, more).wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    let failed = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{scenario}: {said}\n{failed}");
    println!("{said}");
}

/// A scenario with a service of its own.
#[track_caller]
fn browse_afresh(scenario: &str) {
    browse(scenario, &Server::start(&[]), &[]);
}

#[test]
fn a_picture_that_is_chosen_dropped_or_pasted_is_seen_as_a_preview_and_then_as_its_mesh() {
    browse_afresh("upload");
}

#[test]
fn what_is_drawn_equals_the_picture_of_the_service_within_one_level() {
    browse_afresh("pixels");
}

#[test]
fn every_layer_shows_what_it_says() {
    browse_afresh("layers");
}

#[test]
fn a_long_job_tells_its_progress_and_can_be_cancelled() {
    browse_afresh("cancel");
}

#[test]
fn the_slider_shows_any_size_at_once_with_the_figures_of_the_service() {
    browse_afresh("slider");
}

#[test]
fn every_format_can_be_downloaded_at_the_size_that_is_seen() {
    browse_afresh("downloads");
}

#[test]
fn two_methods_stand_side_by_side_and_their_figures_can_be_copied() {
    browse_afresh("compare");
}

#[test]
fn the_address_and_the_command_make_the_same_again() {
    browse_afresh("again");
}

#[test]
fn jobs_of_before_are_listed_and_opened() {
    browse_afresh("history");
}

#[test]
fn the_relief_turns_in_three_dimensions() {
    browse_afresh("relief");
}

#[test]
fn everything_works_by_keyboard() {
    browse_afresh("keyboard");
}

#[test]
fn axe_finds_nothing_serious_in_any_colours_or_direction() {
    browse_afresh("axe");
}

#[test]
fn a_narrow_screen_shows_everything_without_scrolling_sideways() {
    browse_afresh("narrow");
}

#[test]
fn the_page_is_light_keeps_its_policy_and_does_not_jump() {
    browse_afresh("weight");
}

#[test]
fn two_hundred_thousand_triangles_cost_little_of_a_frame() {
    browse_afresh("frames");
}

#[test]
fn what_goes_wrong_is_said_in_a_sentence_with_what_to_do() {
    browse_afresh("errors");
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
    assert!(page.body.starts_with(&[0x1f, 0x8b]));
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
    for module in ["app.js", "worker.js", "theme.css", "icon.svg"] {
        assert_eq!(get(&format!("/studio/{module}"), &[]).status, 200, "{module}");
    }
}
