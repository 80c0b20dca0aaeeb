//! Makes every mesh that the tables need, each once.
//!
//! Picture by picture, so that one is in memory at a time. The meshes of a picture are made in
//! parallel, from a queue that begins with those that take longest; those whose seconds a table
//! shows are made after the others, one at a time, so that nothing else of this program runs
//! beside them.

use crate::cases::Case;
use crate::journal::{Journal, Key, Outcome};
use crate::pictures::{self, Picture};
use crate::progress::Progress;
use pixmesh_cli::CliError;
use pixmesh_meshing::{Image, mesh_image};
use std::cmp::Reverse;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::{self, Builder};
use std::time::Instant;

/// A case that some table needs.
#[derive(Clone, Debug)]
pub struct Job {
    /// The mesh to make.
    pub case: Case,
    /// Whether a table shows how long that takes.
    pub timed: bool,
}

/// What came of cases, by components and code.
type Outcomes = HashMap<(usize, String), Outcome>;

/// What came of every case of every picture.
#[derive(Default)]
pub struct Results {
    pictures: Vec<PictureResults>,
}

/// What came of a picture.
pub struct PictureResults {
    /// What the tables call it.
    pub name: String,
    /// What the published figures call it.
    pub stem: String,
    /// Whether it has three components.
    colour: bool,
    outcomes: Outcomes,
}

impl Results {
    /// The pictures that have an image of 1 or 3 components, in order.
    pub fn pictures(&self, components: usize) -> impl Iterator<Item = &PictureResults> {
        self.pictures.iter().filter(move |picture| components == 1 || picture.colour)
    }
}

impl PictureResults {
    /// What came of a case, if it was made.
    #[must_use]
    pub fn outcome(&self, case: &Case) -> Option<Outcome> {
        self.outcomes.get(&(case.components, case.code.clone())).copied()
    }
}

/// What all pictures have in common.
pub struct Survey<'a> {
    /// The cases of every picture, no two of them the same.
    pub jobs: &'a [Job],
    /// Meshes to make at the same time.
    pub threads: usize,
    /// Where finished cases are found and noted.
    pub journal: &'a Journal,
}

/// A mesh to make now.
struct Task<'a> {
    image: &'a Image,
    case: &'a Case,
    key: Key,
}

impl Survey<'_> {
    /// Makes the meshes of all pictures; a file that is none is skipped, and named on standard
    /// error.
    ///
    /// # Errors
    /// When the journal cannot be written.
    pub fn run(&self, paths: &[PathBuf]) -> Result<Results, CliError> {
        let progress = Progress::new(paths.len());
        let mut results = Results::default();
        for (path, name) in paths.iter().zip(pictures::names(paths)) {
            progress.begin_picture(&name);
            match Picture::read(path) {
                Ok(picture) => {
                    let outcomes = self.measure(&name, &picture, &progress)?;
                    let (stem, colour) = (pictures::stem_of(path), picture.image(3).is_some());
                    results.pictures.push(PictureResults { name, stem, colour, outcomes });
                }
                Err(reason) => {
                    progress.say(&format!("{} skipped: {reason}", pictures::file_name(path)));
                }
            }
        }
        Ok(results)
    }

    /// Makes the meshes of a picture that the journal does not have.
    fn measure(
        &self,
        name: &str,
        picture: &Picture,
        progress: &Progress,
    ) -> Result<Outcomes, CliError> {
        let Plan { found, together, alone } = self.plan(name, picture);
        progress.expect(found.len(), together.len() + alone.len());
        let outcomes = Mutex::new(found);
        for (tasks, threads, timed) in [(together, self.threads, false), (alone, 1, true)] {
            for_each(&tasks, threads, |task| -> Result<(), CliError> {
                let outcome = make(task, timed)?;
                self.journal.add(&task.key, outcome)?;
                let mut outcomes = outcomes.lock().unwrap_or_else(PoisonError::into_inner);
                outcomes.insert((task.key.components, task.key.code.clone()), outcome);
                progress.advance();
                Ok(())
            })?;
        }
        Ok(outcomes.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Looks up every mesh of a picture in the journal.
    fn plan<'b>(&'b self, name: &str, picture: &'b Picture) -> Plan<'b> {
        let mut plan = Plan::default();
        let digest = picture.digest();
        for Job { case, timed } in self.jobs {
            let Some(image) = picture.image(case.components) else { continue };
            let (components, code) = (case.components, case.code.clone());
            let key = Key { image: name.to_owned(), digest, components, code };
            match self.journal.find(&key) {
                Some(outcome) if outcome.seconds.is_some() || !timed => {
                    plan.found.insert((components, key.code), outcome);
                }
                _ if *timed => plan.alone.push(Task { image, case, key }),
                _ => plan.together.push(Task { image, case, key }),
            }
        }
        plan.together.sort_by_key(|task| Reverse(task.case.initial_size(task.image.shape())));
        plan
    }
}

/// The meshes of a picture.
#[derive(Default)]
struct Plan<'a> {
    /// Those that the journal has.
    found: Outcomes,
    /// Those to make in parallel.
    together: Vec<Task<'a>>,
    /// Those to make one at a time, for their seconds.
    alone: Vec<Task<'a>>,
}

/// Makes a mesh, and takes the time if it is made alone.
fn make(task: &Task<'_>, alone: bool) -> Result<Outcome, CliError> {
    let start = Instant::now();
    let model = mesh_image(task.image, &task.case.parameters, &())?;
    let seconds = alone.then(|| start.elapsed().as_secs_f64());
    Ok(Outcome { psnr_db: model.fidelity.psnr_db(), seconds })
}

/// Does the work for every task, some at the same time, in order of their beginning; after an
/// error none begins any more.
fn for_each<T: Sync, E: Send>(
    tasks: &[T],
    threads: usize,
    work: impl Fn(&T) -> Result<(), E> + Sync,
) -> Result<(), E> {
    let next = AtomicUsize::new(0);
    let failure = Mutex::new(Ok(()));
    let worker = || {
        while let Some(task) = tasks.get(next.fetch_add(1, Ordering::Relaxed)) {
            if let Err(error) = work(task) {
                next.store(tasks.len(), Ordering::Relaxed);
                *failure.lock().unwrap_or_else(PoisonError::into_inner) = Err(error);
            }
        }
    };
    thread::scope(|scope| {
        // Where no more threads start, those that did do it all.
        (1..threads.min(tasks.len())).all(|_| Builder::new().spawn_scoped(scope, worker).is_ok());
        worker();
    });
    failure.into_inner().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_is_done_once_with_any_number_of_threads() {
        let tasks: Vec<usize> = (0..100).collect();
        for threads in [1, 3, 200] {
            let done = Mutex::new(Vec::new());
            let work = |&task: &usize| -> Result<(), ()> {
                done.lock().unwrap().push(task);
                Ok(())
            };
            for_each(&tasks, threads, work).unwrap();
            let mut done = done.into_inner().unwrap();
            done.sort_unstable();
            assert_eq!(done, tasks);
        }
    }

    #[test]
    fn after_an_error_no_task_begins() {
        let begun = AtomicUsize::new(0);
        let work = |&task: &usize| {
            begun.fetch_add(1, Ordering::Relaxed);
            if task == 3 { Err("three") } else { Ok(()) }
        };
        assert_eq!(for_each(&(0..100).collect::<Vec<_>>(), 1, work), Err("three"));
        assert_eq!(begun.into_inner(), 4);
    }
}
