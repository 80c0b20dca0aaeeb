//! One client: what each size, method and density takes, beside the same work in this process on one
//! thread, and where it may use the cores of the other workers.

use super::{Setting, processor_s};
use crate::driver::{request, together};
use crate::report::Result;
use crate::row;
use crate::server::Server;
use crate::work::{mesh_alone, picture_of};
use pixmesh_meshing::{Method, Parameters, Target};
use std::time::Instant;

/// Sizes in megapixels, the largest that a scale measures beside each.
const SIZES: [(f64, f64); 5] = [(0.1, 0.0), (1.0, 0.0), (4.0, 0.02), (12.0, 0.2), (40.0, 0.5)];
/// Methods and efforts.
const METHODS: [(&str, Method, u8); 3] =
    [("med", Method::Med, 0), ("mgprfs", Method::Mgprfs, 0), ("mgprfs", Method::Mgprfs, 1)];
/// Densities in percent, those that are left out at small scales last.
const DENSITIES: [f64; 3] = [2.0, 0.5, 10.0];
/// From this scale on all densities are measured.
const ALL_DENSITIES: f64 = 0.2;

pub(super) fn run(setting: &Setting) -> Result {
    let flags = ["--sync-deadline", "30m", "--memory-budget", "12GiB"];
    let servers =
        [Server::start(&[&flags[..], &["--workers", "1"]].concat()), Server::start(&flags)];
    let mut rows = vec![row![
        "megapixels",
        "method",
        "effort",
        "density, %",
        "one worker, s",
        "all workers, s",
        "kernels alone, s",
        "processor s per megapixel",
        "one worker ÷ alone",
        "all ÷ one",
    ]];
    let densities = if setting.scale < ALL_DENSITIES { &DENSITIES[..1] } else { &DENSITIES };
    for (megapixels, least_scale) in SIZES {
        if setting.scale < least_scale {
            continue;
        }
        let picture = picture_of(megapixels, 1);
        for (name, method, effort) in METHODS {
            for &density in densities {
                let query = format!("method={name}&effort={effort}&density={density}");
                let parameters = method.parameters(Target::Percent(density)).effort(effort);
                let work = (query.as_str(), &parameters);
                let figures = measured(&servers, setting, (&picture, megapixels), work);
                rows.push([row![megapixels, name, effort, density], figures].concat());
            }
        }
    }
    Result {
        rows,
        notes: vec![
            "The median of some requests, one after another. One that is alone uses the cores of all workers.".into(),
        ],
        ..Result::default()
    }
}

/// The medians of some requests to a service with one worker and to one with all, in turns, and of the
/// same work without a service.
fn measured(
    servers: &[Server; 2],
    setting: &Setting,
    (picture, megapixels): (&[u8], f64),
    (query, parameters): (&str, &Parameters),
) -> Vec<String> {
    // A new process touches much memory for the first time, which takes long on some machines.
    let count = if setting.is_short { 1 } else { ((12.0 / megapixels) as usize).clamp(1, 20) };
    let request = [request("solo", "POST", &format!("/v1/meshes?{query}"), picture)];
    let answer = |server: &Server| {
        let outcome = &together(server.public, &request)[0];
        assert_eq!(outcome.status(), 200, "{outcome:?}");
    };
    let mut times = [const { Vec::new() }; 3];
    let processor = processor_s(&servers[0]);
    for _ in 0..count {
        times[0].push(seconds(|| answer(&servers[0])));
        times[1].push(seconds(|| answer(&servers[1])));
        times[2].push(seconds(|| mesh_alone(picture, parameters)));
    }
    let used = (processor_s(&servers[0]) - processor) / count as f64 / megapixels;
    let [one, all, alone] = times.map(median);
    row![
        format!("{one:.3}"),
        format!("{all:.3}"),
        format!("{alone:.3}"),
        format!("{used:.3}"),
        format!("{:.3}", one / alone),
        format!("{:.3}", all / one),
    ]
}

/// The seconds that something takes.
fn seconds(work: impl FnOnce()) -> f64 {
    let began = Instant::now();
    work();
    began.elapsed().as_secs_f64()
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
