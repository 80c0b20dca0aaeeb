//! The times of all contestants over all rounds, and their ratios to the yardsticks.

use pixmesh_meshing::{Cancelled, Control, Stage};
use std::collections::BTreeMap;
use std::error::Error;
use std::fmt;
use std::hint::black_box;
use std::sync::Mutex;
use std::time::{Duration, Instant};

type Fallible<T> = Result<T, Box<dyn Error>>;

/// What others do in the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Yardstick {
    /// The image crate decodes the picture.
    Decode,
    /// spade bulk loads the points of MED.
    OneShotPoints,
    /// spade bulk loads the initial points of MGPRFS.
    InitialPoints,
    /// spade bulk loads all lattice points.
    FullGrid,
}

impl Yardstick {
    fn name(self) -> &'static str {
        match self {
            Self::Decode => "R_d, image decodes the picture",
            Self::OneShotPoints => "R_s, spade bulk loads the points of MED",
            Self::InitialPoints => "R_s, spade bulk loads the points of MGPRFS",
            Self::FullGrid => "R_g, spade bulk loads the full grid",
        }
    }
}

/// All times of one contestant.
#[derive(Default)]
struct Times {
    yardstick: Option<Yardstick>,
    goal: Option<f64>,
    all: Vec<Duration>,
    /// Of each stage, where it has any.
    stages: BTreeMap<Stage, Vec<Duration>>,
}

/// Everything measured.
#[derive(Default)]
pub(crate) struct Contest {
    yardsticks: BTreeMap<Yardstick, Vec<Duration>>,
    /// In the order of their first run.
    contestants: Vec<(String, Times)>,
}

impl Contest {
    /// Times what the others are compared with.
    pub(crate) fn time_yardstick<T>(
        &mut self,
        yardstick: Yardstick,
        run: impl FnOnce() -> Fallible<T>,
    ) -> Fallible<()> {
        let begun = Instant::now();
        black_box(run()?);
        self.yardsticks.entry(yardstick).or_default().push(begun.elapsed());
        Ok(())
    }

    /// Times a contestant whose ratio to a yardstick should be `goal` at most.
    pub(crate) fn time<T>(
        &mut self,
        title: &str,
        yardstick: Yardstick,
        goal: Option<f64>,
        run: impl FnOnce() -> Fallible<T>,
    ) -> Fallible<T> {
        let begun = Instant::now();
        let result = black_box(run()?);
        let times = self.times(title);
        (times.yardstick, times.goal) = (Some(yardstick), goal);
        times.all.push(begun.elapsed());
        Ok(result)
    }

    /// The same for one that tells a clock of its stages.
    pub(crate) fn time_stages<T>(
        &mut self,
        title: &str,
        yardstick: Yardstick,
        goal: Option<f64>,
        run: impl FnOnce(&StageClock) -> Fallible<T>,
    ) -> Fallible<T> {
        let clock = StageClock::default();
        let result = self.time(title, yardstick, goal, || run(&clock))?;
        let times = self.times(title);
        for (stage, took) in clock.finish() {
            times.stages.entry(stage).or_default().push(took);
        }
        Ok(result)
    }

    fn times(&mut self, title: &str) -> &mut Times {
        let at = self.contestants.iter().position(|(known, _)| known == title);
        let at = at.unwrap_or_else(|| {
            self.contestants.push((title.to_owned(), Times::default()));
            self.contestants.len() - 1
        });
        &mut self.contestants[at].1
    }
}

impl fmt::Display for Contest {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (yardstick, times) in &self.yardsticks {
            writeln!(formatter, "{:<48} {:>9.2} ms", yardstick.name(), least_ms(times))?;
        }
        for (title, times) in &self.contestants {
            let took = least_ms(&times.all);
            write!(formatter, "{title:<48} {took:>9.2} ms")?;
            if let Some(unit) = times.yardstick.and_then(|y| self.yardsticks.get(&y)) {
                write!(formatter, "  {:>6.2} of its yardstick", took / least_ms(unit))?;
            }
            if let Some(goal) = times.goal {
                write!(formatter, ", goal {goal}")?;
            }
            writeln!(formatter)?;
            for (stage, times) in &times.stages {
                writeln!(formatter, "    {:<44} {:>9.2} ms", stage.name(), least_ms(times))?;
            }
        }
        Ok(())
    }
}

/// The least of all times: whatever else the machine does only adds to them.
fn least_ms(times: &[Duration]) -> f64 {
    times.iter().min().map_or(f64::NAN, |least| least.as_secs_f64() * 1e3)
}

/// A control that notes when each stage begins.
#[derive(Default)]
pub(crate) struct StageClock {
    begun: Mutex<Vec<(Stage, Instant)>>,
}

impl StageClock {
    fn finish(self) -> Vec<(Stage, Duration)> {
        let begun = self.begun.into_inner().unwrap_or_default();
        let ends = begun.iter().skip(1).map(|&(_, end)| end).chain([Instant::now()]);
        begun.iter().zip(ends).map(|(&(stage, start), end)| (stage, end - start)).collect()
    }
}

impl Control for StageClock {
    fn poll(&self, stage: Stage, done: usize, _: usize) -> Result<(), Cancelled> {
        if done == 0
            && let Ok(mut begun) = self.begun.lock()
            && begun.last().is_none_or(|&(last, _)| last != stage)
        {
            begun.push((stage, Instant::now()));
        }
        Ok(())
    }
}
