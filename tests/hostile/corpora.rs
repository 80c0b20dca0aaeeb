//! What fuzzing has found or begun with, once more; and where the seeds come from: the table.
//!
//! `PIXMESH_WRITE_SEEDS=1` writes the seeds anew.

use crate::containers::one_of_each;
use crate::samples::bombs::{contradictions, huge_headers};
use crate::samples::{lattice, scattered};
use crate::targets::TARGETS;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The longest file of a corpus.
const LONGEST: usize = 8 * 1024;
/// The longest time that a target may take for one of them.
const IN_TIME: Duration = Duration::from_secs(5);

fn folder(target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target)
}

/// Some meshes in both formats.
fn meshes() -> [Vec<Vec<u8>>; 2] {
    let meshes = [lattice(2, 2, 1, 1), lattice(4, 3, 3, 8), lattice(5, 5, 2, 16)];
    let models = meshes.iter().map(|mesh| {
        let mut bytes = Vec::new();
        pixmesh_codec::write_model(mesh, &mut bytes).unwrap();
        bytes
    });
    let pmeshes = meshes.iter().filter_map(|mesh| {
        let mut bytes = Vec::new();
        pixmesh_codec::write_pmesh(mesh, &mut bytes).is_ok().then_some(bytes)
    });
    [models.collect(), pmeshes.collect()]
}

/// The seeds of every target.
fn seeds() -> HashMap<&'static str, Vec<Vec<u8>>> {
    let texts = |texts: &[&str]| texts.iter().map(|text| text.as_bytes().to_vec()).collect();
    let pictures = one_of_each().into_iter().map(|(_, bytes, _)| bytes);
    let bombs = huge_headers().into_iter().chain(contradictions()).map(|(_, bytes)| bytes);
    let mut tiny = Vec::new();
    pixmesh_codec::write_png(&scattered(3, 3, 4, 16), &mut tiny).unwrap();
    let [models, pmeshes] = meshes();
    let form = |cut: char, body: &str| format!("{cut}{body}").into_bytes();
    let image =
        "Content-Disposition: form-data; name=\"image\"; filename=\"x\"\r\n\r\nP2 2 2 1 0 1 1 0";
    let size = "Content-Disposition: form-data; name=\"size\"\r\n\r\n5";
    let params = "Content-Disposition: form-data; name=\"params\"\r\n\r\n{\"seed\": 3}";
    HashMap::from([
        (
            "decode_image",
            pictures.chain(bombs).chain([tiny]).filter(|seed| seed.len() <= LONGEST).collect(),
        ),
        (
            "parse_params",
            texts(&[
                "density=2.5&method=med&leaky=true&seed=7\0{\"size\": 40, \"policy\": \"psd_max_d\"}",
                "target_psnr=30&gamma=4&initial=random&format=glb&height=3&unit=mm",
                "alpha=over:%23ff8000&smoothing_order=5&boundary=zero",
                "density=NaN&size=18446744073709551616",
            ]),
        ),
        (
            "multipart",
            vec![
                form('a', &format!("--limit\r\n{image}\r\n--limit\r\n{size}\r\n--limit--\r\n")),
                form('c', &format!("--limit\r\n{params}\r\n--limit\r\n{image}\r\n--limit--\r\n")),
                form('\0', "--limit\r\n\r\n\r\n--limit--"),
            ],
        ),
        (
            "headers",
            texts(&[
                "text/plain;q=0.2, model/*;q=0.9\nkey-1\nrespond-async, wait=5",
                "*/*;q=0\n\nwait=\"1",
            ]),
        ),
        ("read_model", models),
        ("read_pmesh", pmeshes),
        ("roundtrip_mesh", vec![vec![9, 9, 2, 7, 1, 3, 4, 5, 5, 1, 8, 2, 2], vec![0; 40]]),
        (
            "triangulate",
            vec![
                (0..60_u32).map(|i| (i * 37 % 251) as u8).collect(),
                vec![10, 10, 5, 5],
                vec![3; 30],
            ],
        ),
        (
            "simplify",
            vec![(0..40_u32).map(|i| (i * 29 % 241) as u8).collect(), vec![4, 4, 1, 9, 1, 0, 1, 1]],
        ),
        (
            "job_record",
            texts(&[
                "method=med&size=20\n{\"width\":2,\"height\":2,\"components\":1,\"precision\":8}\n{\"digest\":\"a\",\"bytes\":1,\"vertices\":4,\"faces\":2,\"mse\":0.5,\"psnr_db\":null,\"timings_ms\":[[\"decode\",1.5]]}\n{\"type\":\"/problems/internal\",\"detail\":\"x\"}\n01890000-0000-7000-8000-000000000000\nba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
            ]),
        ),
    ])
}

#[test]
fn every_target_has_its_seeds() {
    let seeds = seeds();
    for (target, _) in TARGETS {
        for (n, seed) in seeds[target].iter().enumerate() {
            let path = folder(target).join(format!("seed-{n:02}"));
            if std::env::var_os("PIXMESH_WRITE_SEEDS").is_some() {
                std::fs::create_dir_all(folder(target)).unwrap();
                std::fs::write(&path, seed).unwrap();
            }
            assert!(std::fs::read(&path).is_ok_and(|stored| stored == *seed), "{}", path.display());
        }
    }
}

#[test]
fn every_corpus_passes_once_more() {
    for (name, run) in TARGETS {
        let mut count = 0;
        for file in std::fs::read_dir(folder(name)).unwrap() {
            let path = file.unwrap().path();
            let bytes = std::fs::read(&path).unwrap();
            let began = Instant::now();
            run(&bytes);
            let took = began.elapsed();
            assert!(took < IN_TIME, "{}: {took:?}", path.display());
            count += 1;
        }
        println!("{name}: {count} inputs");
        assert!(count > 0, "{name} has no corpus");
    }
}
