//! Runs parts under callgrind and reads what it counted.

use crate::Fallible;
use crate::part::Part;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// The function, in this program, that is counted with all that it calls.
const COUNTED: &str = "*part_that_is_counted*";

/// The functions that all loops over vectors are inlined into: named with who calls them.
const VECTORISED: &str = "*::vectorize::*";

/// How many instructions a part took.
pub(crate) struct Counts {
    pub(crate) total: u64,
    /// Of each function, those that are its own.
    pub(crate) of_functions: BTreeMap<String, u64>,
}

/// The architecture, and the vectors that the kernels choose under valgrind.
pub(crate) fn machine() -> Fallible<String> {
    let output = run(&["--tool=none"], "none")?;
    Ok(output.trim().to_owned())
}

/// Counts the instructions of a part.
pub(crate) fn count(part: Part) -> Fallible<Counts> {
    let name =
        format!("instructions-{}-{}.out", std::process::id(), part.to_string().replace('/', "-"));
    let file = std::env::temp_dir().join(name);
    let options = [
        "--tool=callgrind",
        &format!("--toggle-collect={COUNTED}"),
        &format!("--separate-callers1={VECTORISED}"),
        &format!("--callgrind-out-file={}", file.display()),
        "--compress-strings=no",
        "--compress-pos=no",
    ];
    let counts = run(&options, &part.to_string()).and_then(|_| read(&file));
    // Already gone when valgrind failed.
    let _ = std::fs::remove_file(&file);
    let counts = counts?;
    if counts.total == 0 {
        return Err(format!("callgrind has not met {COUNTED} in {part}").into());
    }
    Ok(counts)
}

/// Runs a part of this program under valgrind, and returns what it prints.
fn run(options: &[&str], part: &str) -> Fallible<String> {
    let output = Command::new("valgrind")
        .args(options)
        .arg(std::env::current_exe()?)
        .args(["--part", part])
        .output()
        .map_err(|error| format!("valgrind: {error}"))?;
    if !output.status.success() {
        let told = String::from_utf8_lossy(&output.stderr);
        return Err(format!("{part} under valgrind: {}\n{told}", output.status).into());
    }
    Ok(String::from_utf8(output.stdout)?)
}

/// Reads a file of callgrind, whose format its manual defines: after a line `fn=NAME`, lines
/// `POSITION COUNT` are costs of this function; one after a line `calls=` is what a call cost.
fn read(file: &Path) -> Fallible<Counts> {
    let text = std::fs::read_to_string(file).map_err(|e| format!("{}: {e}", file.display()))?;
    let mut counts = Counts { total: 0, of_functions: BTreeMap::new() };
    let (mut function, mut is_call) = (String::new(), false);
    for line in text.lines() {
        if let Some(name) = line.strip_prefix("fn=") {
            function = readable(name);
        } else if line.starts_with("calls=") {
            is_call = true;
        } else if line.starts_with(|first: char| first.is_ascii_digit()) {
            let cost = line.split(' ').nth(1).map_or(Ok(0), str::parse::<u64>)?;
            if !std::mem::take(&mut is_call) {
                counts.total += cost;
                *counts.of_functions.entry(function.clone()).or_default() += cost;
            }
        }
    }
    Ok(counts)
}

/// A function's name, or that of the caller that it is named with.
fn readable(name: &str) -> String {
    match name.split_once('\'') {
        Some((_, caller)) => format!("{}, its vectors", without_hash(caller)),
        None => without_hash(name).to_owned(),
    }
}

/// A function's name without the hash that changes with every version.
fn without_hash(name: &str) -> &str {
    match name.rsplit_once("::h") {
        Some((name, hash)) if hash.len() == 16 => name,
        _ => name,
    }
}
