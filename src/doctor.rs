//! `pixmesh doctor`: checks whether the service works on this machine with these settings.
//!
//! It meshes a picture made in code, and has the mesh checked by another library's triangulation
//! ([`delaunay`]); and it looks at the machine: folder, memory, processors, addresses ([`machine`]).
//! Every finding is printed; a bad one makes the exit status 1.

mod delaunay;
mod machine;
mod meshing;

use crate::config::Settings;
use pixmesh_jobs::blobs::{BlobEngine, Blobs};
use pixmesh_jobs::postgres::Postgres;
use pixmesh_jobs::settings::QueueEngine;
use std::error::Error;
use std::io::{self, Write};

/// What one check found: what is so, or what is wrong.
type Finding = Result<String, String>;
/// One check of the settings or of what they count on.
type Check = fn(&Settings) -> Finding;

/// Checks everything, and prints what it finds.
///
/// # Errors
/// When a finding is bad.
pub fn examine(settings: &Settings) -> Result<(), Box<dyn Error>> {
    let checks: [(&str, Check); 11] = [
        ("settings", |settings| {
            let checked = settings.clone().checked().map_err(|error| error.to_string())?;
            Ok(format!("{} workers", checked.worker_count()))
        }),
        ("meshing", |_| meshing::check()),
        ("codec", |_| meshing::check_codec()),
        ("data folder", machine::check_data_folder),
        ("free space", machine::check_free_space),
        ("queue", check_queue),
        ("blobs", check_blobs),
        ("memory", machine::check_memory),
        ("processors", machine::check_processors),
        ("public address", |settings| machine::check_address(settings.listen)),
        ("operations address", |settings| machine::check_address(settings.ops_listen)),
    ];
    let mut bad = 0;
    for (name, check) in checks {
        match check(settings) {
            Ok(fact) => writeln!(io::stdout(), "ok    {name}: {fact}")?,
            Err(defect) => {
                bad += 1;
                writeln!(io::stdout(), "BAD   {name}: {defect}")?;
            }
        }
    }
    if bad > 0 {
        return Err(format!("{bad} of {} checks failed", checks.len()).into());
    }
    Ok(())
}

/// Opens the shared database, where the settings name one.
fn check_queue(settings: &Settings) -> Finding {
    let queue = &settings.jobs.queue;
    let QueueEngine::Postgres(url) = &queue.queue else { return Ok("embedded".into()) };
    let opened = wait_for(Postgres::open(url, &queue.postgres, settings.of_jobs().terms))?;
    opened
        .map(|_| format!("{} answers, and its tables can be used", queue.queue))
        .map_err(|error| format!("--queue {}: {error}", queue.queue))
}

/// Writes, reads and deletes an object in the shared store, where the settings name one.
fn check_blobs(settings: &Settings) -> Finding {
    let engine = &settings.jobs.blobs;
    if *engine == BlobEngine::File {
        return Ok("in the data folder".into());
    }
    let opened = wait_for(Blobs::shared(engine))?;
    opened
        .map(|_| format!("--blobs {engine} can be written to and read"))
        .map_err(|error| error.to_string())
}

fn wait_for<T>(future: impl Future<Output = T>) -> Result<T, String> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    Ok(runtime.map_err(|error| error.to_string())?.block_on(future))
}
