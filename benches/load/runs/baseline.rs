//! One client: what each size, method and density takes, beside the same work in this process.

use super::{Setting, processor_s};
use crate::driver::{request, together};
use crate::report::Result;
use crate::row;
use crate::server::Server;
use crate::work::{mesh_alone, picture_of};
use pixmesh_meshing::Method;
use std::time::Instant;

/// Sizes in megapixels, the largest that a scale measures beside each.
const SIZES: [(f64, f64); 5] = [(0.1, 0.0), (1.0, 0.0), (4.0, 0.02), (12.0, 0.2), (40.0, 0.5)];
const METHODS: [(&str, Method); 2] = [("med", Method::Med), ("mgprfs", Method::Mgprfs)];
/// Densities in percent, those that are left out at small scales last.
const DENSITIES: [f64; 3] = [2.0, 0.5, 10.0];
/// From this scale on all densities are measured.
const ALL_DENSITIES: f64 = 0.2;

pub(super) fn run(setting: &Setting) -> Result {
    let flags = ["--workers", "1", "--sync-deadline", "30m", "--memory-budget", "12GiB"];
    let server = Server::start(&flags);
    let mut rows = vec![row![
        "megapixels",
        "method",
        "density, %",
        "service, s",
        "kernels alone, s",
        "processor s per megapixel",
        "÷ alone",
    ]];
    let densities = if setting.scale < ALL_DENSITIES { &DENSITIES[..1] } else { &DENSITIES };
    for (megapixels, least_scale) in SIZES {
        if setting.scale < least_scale {
            continue;
        }
        let picture = picture_of(megapixels, 1);
        for (name, method) in METHODS {
            for &density in densities {
                let work = (name, method, density);
                rows.push(measured(&server, setting, &picture, megapixels, work));
            }
        }
    }
    Result {
        rows,
        notes: vec!["The median of some requests, one after another.".into()],
        ..Result::default()
    }
}

/// One row: the medians of some requests, and of the same work without the service.
fn measured(
    server: &Server,
    setting: &Setting,
    picture: &[u8],
    megapixels: f64,
    (name, method, density): (&str, Method, f64),
) -> Vec<String> {
    let count = setting.count((10.0 / megapixels) as usize, 1).min(20);
    let target = format!("/v1/meshes?method={name}&density={density}");
    let request = [request("solo", "POST", &target, picture)];
    let processor = processor_s(server);
    let service = median(count, || {
        let outcome = &together(server.public, &request)[0];
        assert_eq!(outcome.status(), 200, "{outcome:?}");
    });
    let used = (processor_s(server) - processor) / count as f64 / megapixels;
    let alone = median(count, || mesh_alone(picture, method, density));
    row![
        megapixels,
        name,
        density,
        format!("{service:.3}"),
        format!("{alone:.3}"),
        format!("{used:.3}"),
        format!("{:.3}", service / alone),
    ]
}

/// The median of the seconds that something takes.
fn median(count: usize, mut work: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..count)
        .map(|_| {
            let began = Instant::now();
            work();
            began.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[count / 2]
}
