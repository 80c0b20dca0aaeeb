//! What a control is told of a run.

// A panic tells a test that something is wrong, in its own functions too.
#![allow(clippy::unwrap_used)]

use pixmesh_meshing::{
    Cancelled, Control, Image, Method, Parameters, Progression, Stage, Target, mesh_image,
};
use std::sync::{Mutex, PoisonError};

/// Notes every report.
#[derive(Default)]
struct Recorder {
    reports: Mutex<Vec<(Stage, usize, usize)>>,
    whole: Mutex<Vec<f64>>,
}

impl Control for Recorder {
    fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
        self.reports.lock().unwrap_or_else(PoisonError::into_inner).push((stage, done, total));
        Ok(())
    }

    fn whole(&self, fraction: f64) {
        self.whole.lock().unwrap_or_else(PoisonError::into_inner).push(fraction);
    }
}

/// A picture of discs on a slope.
fn image(width: usize, height: usize) -> Image {
    let sample = |i: usize| {
        let (x, y) = (i % width, i / width);
        let disc = x.abs_diff(40).pow(2) + y.abs_diff(30).pow(2) < 300;
        (if disc { 200 } else { (x + y) % 160 } + (x * 7 + y * 13) % 5) as u16
    };
    let plane: Vec<u16> = (0..width * height).map(sample).collect();
    Image::from_top_down(width, height, 8, vec![plane]).unwrap()
}

fn check(name: &str, recorder: Recorder) {
    let whole = recorder.whole.into_inner().unwrap();
    assert!(whole.is_sorted(), "{name}: {whole:?}");
    assert!(whole.iter().all(|fraction| (0.0..=1.0).contains(fraction)), "{name}: {whole:?}");
    assert_eq!(whole.last(), Some(&1.0), "{name}");
    let reports = recorder.reports.into_inner().unwrap();
    let mut begun = Vec::new();
    let mut last = None;
    for (stage, done, total) in reports {
        if done == 0 {
            assert!(!begun.contains(&stage), "{name}: {stage} begins twice");
            begun.push(stage);
        }
        assert_eq!(begun.last(), Some(&stage), "{name}: {stage} is reported before it begins");
        let fraction = if total == 0 { 0.0 } else { done as f64 / total as f64 };
        assert!(fraction <= 1.0, "{name}: {done} of {total} of {stage}");
        if let Some((before, least)) = last {
            assert!(before != stage || fraction >= least, "{name}: {stage} falls to {fraction}");
        }
        last = Some((stage, fraction));
    }
}

fn run(name: &str, image: &Image, parameters: &Parameters) {
    let recorder = Recorder::default();
    let made = mesh_image(image, parameters, &recorder).unwrap();
    check(name, recorder);
    if parameters.is_of_points_alone() {
        let recorder = Recorder::default();
        Progression::new(image, &made.mesh, parameters, &recorder).unwrap();
        check(&format!("{name}, its progression"), recorder);
    }
}

#[test]
fn every_stage_begins_once_and_its_fraction_never_falls() {
    let image = &image(96, 64);
    for method in Method::NAMES {
        let method: Method = method.parse().unwrap();
        if method.check_component_count(1).is_err() {
            continue;
        }
        for target in
            [Target::Size(200), Target::Psnr(30.0), Target::MeanError(5.0), Target::MaxError(30)]
        {
            run(&format!("{method}, {target:?}"), image, &method.parameters(target));
        }
    }
    for effort in [3, 9] {
        let parameters = Method::Mgprfs.parameters(Target::Size(300)).effort(effort);
        run(&format!("effort {effort}"), image, &parameters);
    }
}

#[test]
fn stages_of_large_preview_begin_once() {
    let parameters = Method::Preview.parameters(Target::Percent(0.1));
    run("preview of a large picture", &image(1100, 1000), &parameters);
}
