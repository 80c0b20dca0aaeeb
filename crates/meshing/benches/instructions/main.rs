//! Instruction counts of the stages beside those of a baseline: a part that takes 5 % more fails.
//!
//! `cargo bench -p pixmesh-meshing --bench instructions [-- --record]`
//!
//! Each part runs once on one thread under valgrind's callgrind, which counts its instructions
//! alone, to within a few, on a busy machine too. The baseline is `baseline.txt` beside this file;
//! `--record` rewrites it. With another architecture or other vectors than the baseline's nothing
//! can be compared: exit status 77 says so, and standard error why.

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a program that reports to a terminal"
)]

mod baseline;
mod callgrind;
mod part;
#[path = "../comparison/picture.rs"]
#[allow(dead_code, reason = "the parts mesh the picture in colour alone")]
mod picture;

use baseline::{Baseline, Comparison};
use callgrind::Counts;
use part::Part;
use std::error::Error;
use std::process::{Command, ExitCode};

type Fallible<T> = Result<T, Box<dyn Error>>;

/// The exit status that stands for a test that could not be made.
const NOTHING_COMPARED: u8 = 77;

fn main() -> ExitCode {
    // `cargo bench` adds a flag of its own.
    let arguments: Vec<String> =
        std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let outcome = match arguments[..] {
        [] => compare(),
        ["--record"] => record(),
        ["--part", name] => part::run(name),
        _ => Err("usage: cargo bench -p pixmesh-meshing --bench instructions [-- --record]".into()),
    };
    outcome.unwrap_or_else(|error| {
        eprintln!("error: {error}");
        ExitCode::FAILURE
    })
}

/// Counts all parts and compares them with the baseline's.
fn compare() -> Fallible<ExitCode> {
    if Command::new("valgrind").arg("--version").output().is_err() {
        return Err("valgrind, which counts the instructions, is missing: install valgrind".into());
    }
    let baseline = Baseline::read()?;
    let machine = callgrind::machine()?;
    if machine != baseline.machine {
        eprintln!(
            "NOTHING COMPARED: the baseline was recorded for {}, this is {machine} under valgrind.",
            baseline.machine
        );
        return Ok(ExitCode::from(NOTHING_COMPARED));
    }
    let mut has_failed = false;
    for part in Part::ALL {
        let counts = callgrind::count(part)?;
        let comparison = Comparison::new(part, &counts, &baseline)?;
        println!("{comparison}");
        has_failed |= comparison.has_failed();
    }
    if has_failed {
        let compiler = compiler()?;
        eprintln!("\nParts rose by more than {} %.", baseline::MOST_RISE_PERCENT);
        if compiler != baseline.compiler {
            eprintln!(
                "The compiler is another one, which may be why: {compiler}, the baseline's {}.",
                baseline.compiler
            );
        }
        eprintln!(
            "Where that is the price of something worth it, record a new baseline:\n    \
             cargo bench -p pixmesh-meshing --bench instructions -- --record"
        );
    }
    Ok(ExitCode::from(u8::from(has_failed)))
}

/// Counts all parts and writes the baseline.
fn record() -> Fallible<ExitCode> {
    let machine = callgrind::machine()?;
    let counts: Vec<(Part, Counts)> = Part::ALL
        .into_iter()
        .map(|part| Ok((part, callgrind::count(part)?)))
        .collect::<Fallible<_>>()?;
    Baseline::new(machine, compiler()?, counts).write()?;
    Ok(ExitCode::SUCCESS)
}

/// The version of the compiler of this directory.
fn compiler() -> Fallible<String> {
    let output = Command::new("rustc")
        .arg("--version")
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .map_err(|error| format!("rustc --version: {error}"))?;
    Ok(String::from_utf8(output.stdout)?.trim().to_owned())
}
