//! Levels that tests of the service check already: these runs have them do it at length.

use super::Setting;
use crate::report::Result;
use std::process::Command;

/// Kills of the full run.
const KILLS: usize = 200;

/// L7: kills at random moments; no accepted job may be lost, doubled or changed.
pub(super) fn kills(setting: &Setting) -> Result {
    let kills = setting.count(KILLS, 5).to_string();
    let name = "no_accepted_job_is_lost_or_doubled_however_often_the_process_is_killed";
    test("S9", name, &[("PIXMESH_KILLS", &kills)])
}

/// L8: SIGTERM at saturation.
pub(super) fn terms(_: &Setting) -> Result {
    test("S10", "sigterm_at_saturation_breaks_nothing_that_was_accepted", &[])
}

/// Runs a test; a failure counts as one.
fn test(level: &str, name: &str, variables: &[(&str, &str)]) -> Result {
    let output = Command::new(env!("CARGO"))
        .args(["test", "--quiet", "--locked", "--package", "pixmesh", "--test", "service"])
        .args(["--", "--nocapture", name])
        .envs(variables.iter().copied())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let is_met = output.status.success() && said.contains("test result: ok. 1 passed");
    let mut notes = vec![format!("By the test `{name}` of `tests/service`, unoptimised.")];
    let is_figure = |line: &&str| !line.trim().is_empty() && !line.starts_with("running");
    let figures = said.lines().filter(is_figure).filter(|line| !line.contains("test result"));
    notes.extend(figures.map(|line| line.trim_matches('.').trim().to_owned()));
    if !is_met {
        eprintln!("{}", String::from_utf8_lossy(&output.stderr));
    }
    notes.retain(|note| !note.is_empty());
    let failures = if is_met { 0.0 } else { 1.0 };
    Result { figures: vec![(level.into(), failures)], notes, ..Result::default() }
}
