//! The memory model of admission, against what the process really takes.

use crate::pictures::{flat, noise};
use crate::server::Server;
use crate::slow_decoders::KINDS;
use pixmesh_codec::Format;
use pixmesh_engine::params::ParameterSet;
use pixmesh_engine::task::Cost;

/// A query, the format it asks for, and the picture.
type Work = (&'static str, Format, Vec<u8>);

/// What the allocator and the runtime take besides, in MiB, whatever the work: 20 to 30 were measured
/// for work that needs next to none.
const APART_MIB: u64 = 32;

#[test]
fn no_work_takes_more_memory_than_it_was_admitted_for() {
    let works: [Work; 23] = [
        ("method=med&density=2&format=model", Format::Model, noise(1500)),
        ("method=med&density=1&format=png", Format::Png, flat(2500, 2500)),
        ("method=mgprfs&density=1&format=model", Format::Model, noise(1200)),
        ("method=mgpr&density=1&format=model", Format::Model, noise(700)),
        ("method=mgpr&density=1&parallel=tiles&format=model", Format::Model, noise(700)),
        ("method=med&density=1&policy=pse_d&format=pnm", Format::Pnm, flat(2000, 2000)),
        ("method=med&density=15&format=glb", Format::Glb, noise(1000)),
        ("method=med&density=15&format=glb&compression=meshopt", Format::Glb, noise(1000)),
        ("method=med&density=15&format=gltf", Format::Gltf, noise(1000)),
        ("method=med&density=15&format=svg", Format::Svg, noise(1000)),
        ("method=med&density=15&format=ply", Format::Ply, noise(1000)),
        ("method=med&density=15&format=obj", Format::Obj, noise(1000)),
        ("method=med&density=15&format=stl", Format::Stl, noise(1000)),
        ("method=med&density=15&format=json", Format::Json, noise(1000)),
        ("method=med&density=15&format=pmesh", Format::Pmesh, noise(1000)),
        ("method=med&density=15&format=progression", Format::Progression, noise(1000)),
        (
            "method=med&density=10&error_metric=mean_comp_ae&format=progression",
            Format::Progression,
            noise(700),
        ),
        ("method=preview&density=8&format=model", Format::Model, noise(800)),
        ("method=preview&density=2&format=model", Format::Model, noise(1500)),
        ("method=optimal&effort=1&density=4&format=model", Format::Model, noise(600)),
        ("connectivity=free&values=fitted&density=4&format=model", Format::Model, noise(700)),
        ("method=flat&density=1&format=png", Format::Png, noise(600)),
        ("error_metric=ssim&density=1&format=model", Format::Model, noise(1200)),
    ];
    for (query, format, picture) in works {
        let (admitted_mib, taken_mib) =
            (admitted_mib(query, format, &picture), taken_mib(query, &picture));
        println!("{query}: {taken_mib} MiB of {admitted_mib} MiB");
        assert!(taken_mib <= admitted_mib + APART_MIB, "{query}: {taken_mib} > {admitted_mib} MiB");
        assert!(
            admitted_mib <= 4 * taken_mib + APART_MIB,
            "{query}: {taken_mib} << {admitted_mib} MiB"
        );
    }
}

#[test]
fn decoders_of_webp_and_progressive_jpeg_take_what_was_admitted() {
    let query = "method=med&size=100&initial=uniform&format=model";
    for (kind, make) in KINDS {
        let picture = make(5000, 4000);
        let admitted_mib = admitted_mib(query, Format::Model, &picture);
        let taken_mib = taken_mib(query, &picture);
        println!("{kind}: {taken_mib} MiB of {admitted_mib} MiB");
        assert!(taken_mib <= admitted_mib + APART_MIB, "{kind}: {taken_mib} > {admitted_mib} MiB");
    }
}

/// What the model says, with the body beside it.
fn admitted_mib(query: &str, format: Format, picture: &[u8]) -> u64 {
    let order = ParameterSet::of_query(Some(query)).unwrap().finish().unwrap();
    let header = pixmesh_codec::probe(picture, &pixmesh_codec::Limits::default()).unwrap();
    let plan = order.plan(&header).unwrap();
    let cost = Cost::of_mesh(&header, &plan, &order.parameters, format);
    u64::from(cost.mib()) + (picture.len() as u64 >> 20)
}

/// By how much the resident memory of a new process rises at most while it does the work.
fn taken_mib(query: &str, picture: &[u8]) -> u64 {
    // Two, so that the work may take both cores.
    let server = Server::start(&["--workers", "2", "--sync-deadline", "120s"]);
    let before = server.memory_kib("VmRSS");
    let answer = server.mesh(query, &[], picture);
    assert_eq!(answer.status, 200, "{}", answer.text());
    (server.memory_kib("VmHWM") - before) >> 10
}
