//! What is no value of a parameter is refused by make_model too, with a message that names it.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::io::Write;
use std::process::{Command, Output, Stdio};

/// Flags with wrong values, and what the message must name.
const REFUSALS: [(&[&str], &str); 31] = [
    (&["--density=0"], "density"),
    (&["--density=-0.0"], "density"),
    (&["--density=-1"], "density"),
    (&["--density=101"], "density"),
    (&["--density=100.0000001"], "density"),
    (&["--density=1e308"], "density"),
    (&["--density=1e-320"], "density"),
    (&["--density=NaN"], "density"),
    (&["--density=inf"], "density"),
    (&["--density=+Infinity"], "density"),
    (&["--density=1e309"], "density"),
    (&["--density="], "density"),
    (&["--density= 5 "], "density"),
    (&["--density=5%"], "density"),
    (&["--density=5,0"], "density"),
    (&["--density=0x10"], "density"),
    (&["--density=\u{665}"], "density"),
    (&["--density=1_000"], "density"),
    (&["--size=3"], "size"),
    (&["--size=0"], "size"),
    (&["--size=-1"], "size"),
    (&["--size=4294967296"], "size"),
    (&["--size=1e2"], "size"),
    (&["--size=3.5"], "size"),
    (&["--size=401"], "size"),
    (&["--density=5", "--size=50"], "cannot be used with"),
    (&["--density=1", "--density=99"], "multiple times"),
    (&["--desnity=5"], "--density"),
    (&["--method=MED", "--density=1"], "method"),
    (&["--method=", "--density=1"], "method"),
    (&["--seed=18446744073709551616", "--density=1"], "seed"),
];

#[test]
fn every_wrong_value_is_refused_by_name() {
    for (flags, named) in REFUSALS {
        let output = make_model(flags);
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && output.stdout.is_empty(), "{flags:?}");
        assert!(message.contains(named) && !message.contains("panicked"), "{flags:?}: {message}");
    }
    assert!(make_model(&["--density=100"]).status.success());
}

/// Runs the program on a picture of 20 by 20 pixels.
fn make_model(flags: &[&str]) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_make_model"))
        .args(flags)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut picture = b"P5\n20 20\n255\n".to_vec();
    picture.extend((0..400).map(|i| (i * 7 % 256) as u8));
    // It may have refused its flags before it reads anything.
    let _ = child.stdin.take().unwrap().write_all(&picture);
    child.wait_with_output().unwrap()
}
