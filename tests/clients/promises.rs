//! Schemathesis makes thousands of requests of what the document promises, right and wrong ones, and
//! checks every answer against it.

use crate::server::Server;
use crate::tools::{checkout, require, text};
use std::path::Path;
use std::process::Command;

const PROGRAM: &str = "tests/clients/.venv/bin/schemathesis";
/// How long it may try new requests.
const SECONDS: &str = "20";

#[test]
fn the_service_does_what_its_document_says() {
    require(PROGRAM);
    let server = Server::start(&[]);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("schemathesis");
    std::fs::create_dir_all(&folder).unwrap();
    let output = Command::new(checkout(PROGRAM))
        .arg("--config-file")
        .arg(checkout("tests/clients/schemathesis.toml"))
        .args(["run", &format!("http://{}/openapi.json", server.public)])
        .args(["--max-time", SECONDS, "--workers", "2", "--seed", "1", "--no-color"])
        .arg("--continue-on-failure")
        .current_dir(folder)
        .output()
        .unwrap();
    let report = text(&output);
    assert!(output.status.success(), "{report}");
    let summary = report.lines().find(|line| line.contains(" generated, ")).unwrap_or_default();
    let count = summary.split_whitespace().next().and_then(|count| count.parse::<u32>().ok());
    assert!(count.is_some_and(|count| count > 500), "it tried hardly anything: {report}");
    println!("{}", summary.trim());
    server.wait_until_idle();
}
