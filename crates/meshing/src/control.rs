//! Progress and cancellation.
//!
//! The crate has no clock, no thread pool and no logger. The caller of a kernel passes a
//! [`Control`], which the kernel polls at intervals of some milliseconds.

use crate::named_values;
use std::num::NonZeroUsize;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread::Builder;
use std::time::Duration;
use thiserror::Error;

named_values! {
    /// The stages of a method, in the order in which they run.
    ///
    /// ```
    /// use pixmesh_meshing::Stage;
    /// assert!(Stage::Density < Stage::Triangulate);
    /// assert_eq!(Stage::Simplify.name(), "simplify");
    /// ```
    #[derive(PartialOrd, Ord)]
    "stage" Stage {
        /// The search for the smallest mesh of a quality, by meshes of several sizes.
        Search = "search",
        /// Significance of every lattice point, normalised to a density.
        Density = "density",
        /// Choice of the initial points by error diffusion.
        Diffuse = "diffuse",
        /// Choice of the initial points by greedy insertion.
        Insert = "insert",
        /// Preferred-directions Delaunay triangulation of the initial points.
        Triangulate = "triangulate",
        /// Greedy point removal.
        Simplify = "simplify",
        /// Refinement: vertices are moved, exchanged and fitted, edges are flipped.
        Refine = "refine",
        /// The squared error of the mesh, if removal does not yield it.
        Measure = "measure",
        /// The order of importance of the mesh's vertices.
        Order = "order",
        /// The picture rebuilt from the mesh.
        Rasterize = "rasterize",
        /// The checks of a mesh or a progression that a caller makes of its parts.
        Check = "check",
    }
}

/// The work was cancelled through its [`Control`].
///
/// ```
/// use pixmesh_meshing::{Cancelled, MeshingError};
/// assert_eq!(MeshingError::from(Cancelled).to_string(), "cancelled");
/// ```
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("cancelled")]
pub struct Cancelled;

/// Receives a kernel's progress, and may cancel its work.
///
/// ```
/// use pixmesh_meshing::{Cancelled, Control, Image, Method, Stage, Target, mesh_image};
/// use std::time::{Duration, Instant};
///
/// /// Cancels work that takes too long.
/// struct Deadline(Instant);
///
/// impl Control for Deadline {
///     fn poll(&self, _: Stage, _done: usize, _total: usize) -> Result<(), Cancelled> {
///         if Instant::now() < self.0 { Ok(()) } else { Err(Cancelled) }
///     }
/// }
///
/// let image = Image::from_top_down(32, 32, 8, vec![vec![7; 32 * 32]])?;
/// let parameters = Method::Mgprfs.parameters(Target::Percent(4.0));
/// assert!(mesh_image(&image, &parameters, &Deadline(Instant::now())).is_err());
/// let deadline = Deadline(Instant::now() + Duration::from_secs(60));
/// assert!(mesh_image(&image, &parameters, &deadline).is_ok());
/// # Ok::<(), pixmesh_meshing::ImageError>(())
/// ```
pub trait Control: Sync {
    /// Reports that `done` of `total` steps of `stage` are done. It is 0 once, when the stage begins, and
    /// the fraction of a stage never falls. Kernels call it often, so it should return at once.
    ///
    /// # Errors
    /// [`Cancelled`] stops the kernel, which returns that error to its caller.
    fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled>;

    /// Reports how much of all stages together is done, 0 to 1, by about how long each takes. It
    /// never falls.
    fn whole(&self, _fraction: f64) {}

    /// How many threads a kernel may use, the caller's among them. No result depends on it.
    fn threads(&self) -> NonZeroUsize {
        NonZeroUsize::MIN
    }
}

/// The lattice points that a kernel processes between two polls: at most some milliseconds.
pub(crate) const POINTS_PER_POLL: usize = 1 << 16;

/// The bytes of a vector that take milliseconds to free.
const LARGE_BYTES: usize = 1 << 25;
/// How long a waiting thread waits between two polls.
pub(crate) const PATIENCE: Duration = Duration::from_millis(5);

/// Collects items, with a poll for each [`POINTS_PER_POLL`] of them.
pub(crate) fn collect<T>(
    mut items: impl ExactSizeIterator<Item = T>,
    mut poll: impl FnMut() -> Result<(), Cancelled>,
) -> Result<Vec<T>, Cancelled> {
    let mut collected = Vec::with_capacity(items.len());
    while items.len() > 0 {
        poll()?;
        collected.extend(items.by_ref().take(POINTS_PER_POLL));
    }
    Ok(collected)
}

/// Frees a vector with polls meanwhile, because a gigabyte takes 0.2 s: another thread gives large
/// ones back to the system while this one waits.
pub(crate) fn free<T>(values: Vec<T>, poller: &mut Poller<'_>) -> Result<(), Cancelled>
where
    T: Send + 'static,
{
    poller.poll()?;
    if size_of_val(&*values) < LARGE_BYTES {
        return Ok(());
    }
    let (freeing, freed) = channel::<()>();
    // If no thread starts, the closure is dropped here, and the values with it.
    _ = Builder::new().spawn(move || drop((values, freeing)));
    while freed.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
        poller.poll()?;
    }
    Ok(())
}

/// Sorts distinct elements in place, with a poll for at most [`POINTS_PER_POLL`] elements moved.
pub(crate) fn sort<T: Ord + Copy>(
    elements: &mut [T],
    poll: &dyn Fn() -> Result<(), Cancelled>,
) -> Result<(), Cancelled> {
    poll()?;
    if elements.len() <= POINTS_PER_POLL {
        elements.sort_unstable();
        return Ok(());
    }
    let below = split(elements, poll)?;
    let (lower, upper) = elements.split_at_mut(below);
    sort(lower, poll)?;
    sort(upper, poll)
}

/// Puts the elements of the lowest ranks, `rank` in number, before all others, with the same polls
/// as [`sort`]; returns the element of that rank.
pub(crate) fn select<T: Ord + Copy>(
    mut elements: &mut [T],
    mut rank: usize,
    poll: &dyn Fn() -> Result<(), Cancelled>,
) -> Result<T, Cancelled> {
    while elements.len() > POINTS_PER_POLL {
        let below = split(elements, poll)?;
        let (lower, upper) = elements.split_at_mut(below);
        (elements, rank) = if rank < below { (lower, rank) } else { (upper, rank - below) };
    }
    poll()?;
    Ok(*elements.select_nth_unstable(rank).1)
}

/// Puts the elements below a pivot before all others; returns how many these are.
fn split<T: Ord + Copy>(
    elements: &mut [T],
    poll: &dyn Fn() -> Result<(), Cancelled>,
) -> Result<usize, Cancelled> {
    // The median of the sample leaves a 128th of the elements or more at each side.
    let mut sample: Vec<T> = elements.iter().step_by(64).copied().collect();
    let middle = sample.len() / 2;
    let pivot = *sample.select_nth_unstable(middle).1;
    let mut below = 0;
    for i in 0..elements.len() {
        if i % POINTS_PER_POLL == 0 {
            poll()?;
        }
        let is_below = elements[i] < pivot;
        elements.swap(i, below);
        below += usize::from(is_below);
    }
    Ok(below)
}

/// Polls a control once in [`POINTS_PER_POLL`] steps.
pub(crate) struct Poller<'a> {
    control: &'a dyn Control,
    stage: Stage,
    /// How many of `total` are done.
    pub(crate) done: usize,
    total: usize,
    steps: usize,
}

impl<'a> Poller<'a> {
    /// A poller whose first [`step`](Self::step) polls.
    pub(crate) fn new(control: &'a dyn Control, stage: Stage, done: usize, total: usize) -> Self {
        Self { control, stage, done, total, steps: POINTS_PER_POLL }
    }

    /// Counts steps about to be made.
    #[inline]
    pub(crate) fn step(&mut self, count: usize) -> Result<(), Cancelled> {
        self.steps += count;
        if self.steps < POINTS_PER_POLL { Ok(()) } else { self.poll() }
    }

    pub(crate) fn poll(&mut self) -> Result<(), Cancelled> {
        self.steps = 0;
        self.control.poll(self.stage, self.done, self.total)
    }
}

/// A control that translates each report before it passes it on.
pub(crate) struct Translated<'a, F> {
    pub(crate) control: &'a dyn Control,
    /// The stage, the steps done and the steps in total, from those reported.
    pub(crate) translate: F,
}

impl<F: Fn(Stage, usize, usize) -> (Stage, usize, usize) + Sync> Control for Translated<'_, F> {
    fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
        let (stage, done, total) = (self.translate)(stage, done, total);
        self.control.poll(stage, done, total)
    }

    fn threads(&self) -> NonZeroUsize {
        self.control.threads()
    }
}

/// A control with this number of threads.
///
/// ```
/// use pixmesh_meshing::{Control, OnThreads};
/// let all = std::thread::available_parallelism()?;
/// assert_eq!(OnThreads((), all).threads(), all);
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct OnThreads<C>(pub C, pub NonZeroUsize);

impl<C: Control> Control for OnThreads<C> {
    fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
        self.0.poll(stage, done, total)
    }

    fn whole(&self, fraction: f64) {
        self.0.whole(fraction);
    }

    fn threads(&self) -> NonZeroUsize {
        self.1
    }
}

impl<C: Control + ?Sized> Control for &C {
    fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
        (**self).poll(stage, done, total)
    }

    fn whole(&self, fraction: f64) {
        (**self).whole(fraction);
    }

    fn threads(&self) -> NonZeroUsize {
        (**self).threads()
    }
}

/// Ignores every report, never cancels, and allows one thread.
impl Control for () {
    fn poll(&self, _: Stage, _: usize, _: usize) -> Result<(), Cancelled> {
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::sync::Mutex;

    /// A poller that never cancels.
    pub(crate) fn poller() -> Poller<'static> {
        Poller::new(&(), Stage::Check, 0, 0)
    }

    /// What a kernel reported: the stage, the steps done and the steps in total.
    pub(crate) type Report = (Stage, usize, usize);

    /// Records every report, and cancels from a chosen poll on.
    pub(crate) struct Recorder {
        reports: Mutex<Vec<Report>>,
        first_cancelled: usize,
    }

    impl Default for Recorder {
        /// Never cancels.
        fn default() -> Self {
            Self::cancelling_at(usize::MAX)
        }
    }

    impl Control for Recorder {
        fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
            let mut reports = self.reports.lock().unwrap();
            reports.push((stage, done, total));
            if reports.len() > self.first_cancelled { Err(Cancelled) } else { Ok(()) }
        }
    }

    impl Recorder {
        /// Cancels at poll number `first_cancelled`, counted from 0, and at all later ones.
        pub(crate) fn cancelling_at(first_cancelled: usize) -> Self {
            Self { reports: Mutex::default(), first_cancelled }
        }

        /// All reports, in order.
        pub(crate) fn reports(self) -> Vec<Report> {
            self.reports.into_inner().unwrap()
        }

        /// The steps done in all reports, which must be of this stage and this total.
        pub(crate) fn done(self, stage: Stage, total: usize) -> Vec<usize> {
            let reports = self.reports();
            assert!(
                reports.iter().all(|report| (report.0, report.2) == (stage, total)),
                "{reports:?}"
            );
            reports.into_iter().map(|(_, done, _)| done).collect()
        }
    }

    #[test]
    fn selects_in_parts() {
        let count = 1 << 18;
        for rank in [0, 1, 70_000, count - 1] {
            let mut numbers: Vec<u32> =
                (0..count).map(|i: u32| i.wrapping_mul(0x9E37_79B1)).collect();
            let recorder = Recorder::default();
            let poll = || recorder.poll(Stage::Check, 0, 1);
            let found = select(&mut numbers, rank as usize, &poll).unwrap();
            assert!(numbers[..rank as usize].iter().all(|&below| below < found), "{rank}");
            assert!(numbers[rank as usize..].iter().all(|&above| above >= found), "{rank}");
            assert!(recorder.reports().len() > 4);
        }
    }

    #[test]
    fn sorts_in_parts() {
        for count in [1, 1 << 16, (1 << 16) + 1, 1 << 18] {
            let sort = |recorder: &Recorder| {
                let mut numbers: Vec<u32> =
                    (0..count).map(|i: u32| i.wrapping_mul(0x9E37_79B1)).collect();
                sort(&mut numbers, &|| recorder.poll(Stage::Check, 0, 1)).map(|()| numbers)
            };
            let recorder = Recorder::default();
            assert!(sort(&recorder).unwrap().is_sorted(), "{count}");
            let polls = recorder.reports().len();
            assert!(polls >= (count as usize).div_ceil(POINTS_PER_POLL), "{count}");
            assert!((0..polls).all(|poll| sort(&Recorder::cancelling_at(poll)).is_err()));
        }
    }

    const THREE: NonZeroUsize = NonZeroUsize::new(3).unwrap();

    #[test]
    fn wrapped_controls_poll_the_inner_one() {
        fn answers(control: &impl Control) -> (Result<(), Cancelled>, usize) {
            (control.poll(Stage::Density, 0, 1), control.threads().get())
        }
        let cancelling = || OnThreads(Recorder::cancelling_at(0), THREE);
        assert_eq!(answers(&cancelling()), (Err(Cancelled), 3));
        assert_eq!(answers(&&cancelling()), (Err(Cancelled), 3));
        assert_eq!(answers(&OnThreads(cancelling(), NonZeroUsize::MIN)), (Err(Cancelled), 1));
        assert_eq!(answers(&OnThreads((), THREE)), (Ok(()), 3));
        assert_eq!(answers(&()), (Ok(()), 1));
    }
}
