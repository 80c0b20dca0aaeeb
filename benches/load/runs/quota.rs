//! A container with half a processor, and one with two.

use super::Setting;
use super::capacity::rate;
use super::overload::under_load;
use crate::group::{Group, Limits};
use crate::report::Result;
use crate::row;
use crate::statistics::percentile;
use crate::work::Work;

/// Seconds for each quota.
const PERIOD_S: f64 = 120.0;
const QUOTAS: [f64; 2] = [0.5, 2.0];
/// What is offered, in multiples of the capacity.
const LOAD: f64 = 5.0;

pub(super) fn run(setting: &Setting) -> Result {
    let work = Work::usual();
    let mut result = Result {
        rows: vec![row![
            "processors",
            "workers",
            "meshes per s",
            "health p99, ms",
            "health failed",
            "refusals p99, ms"
        ]],
        ..Result::default()
    };
    for processors in QUOTAS {
        let limits = Limits { processors: Some(processors), ..Limits::default() };
        let group = match Group::make("quota", limits) {
            Ok(group) => group,
            Err(why) => {
                result.notes.push(format!("Not run: no control group can be made: {why}."));
                return result;
            }
        };
        let server = group.start(&["--queue-seconds", "5"]);
        let workers = server.metric("pixmesh_workers");
        let period = setting.period(PERIOD_S);
        let capacity = rate(&server, &work, 2, period / 2).rate.max(0.2);
        let seen = under_load(&server, &work, LOAD * capacity, LOAD, period);
        result.rows.push(row![
            processors,
            workers,
            format!("{capacity:.2}"),
            format!("{:.1}", percentile(&seen.health_ms(), 0.99)),
            seen.health_failures(),
            format!("{:.1}", percentile(&seen.refusals_ms(), 0.99)),
        ]);
        drop(server);
    }
    result
}
