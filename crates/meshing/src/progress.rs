//! The reports of a whole run: each stage begins once, its fraction never falls, and all stages
//! together have one fraction.

use crate::control::{Cancelled, Control, Stage};
use crate::image::Shape;
use crate::parameters::{Generator, Parameters, Plan};
use std::num::NonZeroUsize;
use std::sync::{Mutex, PoisonError};

/// The total of a report that only repeats that a stage has begun.
const MANY_STEPS: usize = 1 << 20;

/// About how long the steps of a stage take, in units of ten nanoseconds.
const DENSITY_PER_SAMPLE: f64 = 0.6;
const DIFFUSION_PER_PIXEL: f64 = 0.4;
const INSERTION_PER_POINT: f64 = 2000.0;
const TRIANGULATION_PER_POINT: f64 = 60.0;
const REMOVAL_PER_POINT: f64 = 900.0;
const REFINEMENT_PER_POINT: f64 = 6000.0;
const MEASURE_PER_SAMPLE: f64 = 0.3;

/// The control of a whole run, which passes orderly reports on.
pub(crate) struct Run<'a> {
    control: &'a dyn Control,
    /// About how long each stage takes, in the order of the stages.
    durations: Vec<(Stage, f64)>,
    /// The last report that was passed on.
    last: Mutex<Option<(Stage, usize, usize)>>,
}

impl<'a> Run<'a> {
    /// The run that makes a mesh by a plan.
    pub(crate) fn of_mesh(
        control: &'a dyn Control,
        shape: Shape,
        parameters: &Parameters,
        plan: &Plan,
    ) -> Self {
        let pixels = (shape.width * shape.height) as f64;
        let samples = pixels * shape.component_count as f64;
        let [initial, size] = [plan.initial_size, plan.size].map(|count| count as f64);
        let refined = if parameters.refines() { size } else { 0.0 };
        let durations = vec![
            (Stage::Density, DENSITY_PER_SAMPLE * samples),
            (Stage::Diffuse, DIFFUSION_PER_PIXEL * pixels),
            (Stage::Insert, INSERTION_PER_POINT * initial),
            (Stage::Triangulate, TRIANGULATION_PER_POINT * initial),
            (Stage::Simplify, REMOVAL_PER_POINT * (initial - size).max(0.0)),
            (Stage::Refine, REFINEMENT_PER_POINT * f64::from(parameters.effort) * refined),
            (Stage::Measure, MEASURE_PER_SAMPLE * samples),
        ];
        let (inserts, generator) = (parameters.inserts(shape), parameters.generator);
        let runs = |stage| match stage {
            Stage::Insert => inserts,
            Stage::Density | Stage::Diffuse => {
                !inserts && matches!(generator, Generator::ErrorDiffusion | Generator::Insertion)
            }
            _ => true,
        };
        let durations = durations.into_iter().filter(|(stage, _)| runs(*stage)).collect();
        Self { control, durations, last: Mutex::default() }
    }

    /// A run of one stage.
    pub(crate) fn of(control: &'a dyn Control, stage: Stage) -> Self {
        Self { control, durations: vec![(stage, 1.0)], last: Mutex::default() }
    }

    /// How much of the run is done when `fraction` of a stage is.
    fn whole_at(&self, stage: Stage, fraction: f64) -> f64 {
        let all: f64 = self.durations.iter().map(|(_, duration)| duration).sum();
        let before = self.durations.iter().filter(|(other, _)| *other < stage);
        let present = self.durations.iter().filter(|(other, _)| *other == stage);
        let done: f64 = before.map(|(_, duration)| duration).sum::<f64>()
            + present.map(|(_, duration)| fraction * duration).sum::<f64>();
        (done / all).min(1.0)
    }
}

impl Control for Run<'_> {
    fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let report = match *last {
            Some((before, behind, of)) if stage <= before => {
                if stage == before && fraction(done, total) > fraction(behind, of) {
                    (stage, done.min(total), total)
                } else if behind == 0 {
                    (before, 1, of.max(MANY_STEPS))
                } else {
                    (before, behind, of)
                }
            }
            _ => {
                if done > 0 {
                    self.control.poll(stage, 0, total)?;
                }
                (stage, done.min(total), total)
            }
        };
        *last = Some(report);
        let (stage, done, total) = report;
        self.control.whole(self.whole_at(stage, fraction(done, total)));
        self.control.poll(stage, done, total)
    }

    fn whole(&self, fraction: f64) {
        self.control.whole(fraction);
    }

    fn threads(&self) -> NonZeroUsize {
        self.control.threads()
    }
}

fn fraction(done: usize, total: usize) -> f64 {
    if total == 0 { 0.0 } else { (done as f64 / total as f64).min(1.0) }
}
