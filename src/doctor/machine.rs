//! Checks disk, memory, processors and addresses against the settings.

use super::Finding;
use crate::config::{BESIDE_BUDGET, ByteSize, Settings, machine_memory, memory_limit};
use pixmesh_jobs::folder::Space;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::thread::available_parallelism;

/// Writes and syncs a file where jobs are to be kept.
pub(super) fn check_data_folder(settings: &Settings) -> Finding {
    let folder = &settings.jobs.data_dir;
    let path = folder.join(format!("doctor-{}", std::process::id()));
    let was_there = folder.exists();
    let write = || {
        fs::create_dir_all(folder)?;
        let mut file = File::create(&path)?;
        file.write_all(b"well\n")?;
        file.sync_all()?;
        fs::remove_file(&path)?;
        if was_there { Ok(()) } else { fs::remove_dir(folder) }
    };
    write()
        .map(|()| format!("{} can be written to", folder.display()))
        .map_err(|error| format!("--data-dir {}: {error}", folder.display()))
}

/// Compares the free space of that folder's disk with what new jobs leave free.
pub(super) fn check_free_space(settings: &Settings) -> Finding {
    let folder = &settings.jobs.data_dir;
    // It is made at the first start.
    let place = folder.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("."));
    let space =
        Space::of(place).map_err(|error| format!("--data-dir {}: {error}", folder.display()))?;
    let (free, least) = (space.free, space.least_free(settings.jobs.min_free_space.0));
    let numbers = format!("{} MiB are free, and {} MiB stay free", free >> 20, least >> 20);
    if free < least {
        return Err(format!(
            "{numbers}: no jobs are accepted; give the disk of --data-dir more room"
        ));
    }
    Ok(numbers)
}

/// Compares the budget with what the container and the machine have.
pub(super) fn check_memory(settings: &Settings) -> Finding {
    let budget = settings.memory_budget();
    let needed = ByteSize(budget.0.saturating_add(BESIDE_BUDGET.0));
    let available = [memory_limit(), machine_memory()].into_iter().flatten().min();
    match available {
        Some(available) if available < needed => Err(format!(
            "--memory-budget {budget} needs {needed} with what the process takes besides, but \
             there are {} MiB",
            available.0 >> 20
        )),
        Some(available) => Ok(format!("{budget} of {} MiB", available.0 >> 20)),
        None => Ok(format!("{budget}; the limit of the machine is unknown")),
    }
}

/// Compares the workers with the processors.
pub(super) fn check_processors(settings: &Settings) -> Finding {
    let workers = settings.worker_count();
    match available_parallelism() {
        Ok(cores) if workers > cores.get() => {
            Err(format!("--workers {workers}, but there are {cores} processors"))
        }
        Ok(cores) => Ok(format!("{workers} of {cores}")),
        Err(error) => Ok(format!("{workers}; the number of processors is unknown: {error}")),
    }
}

/// Tries whether an address can be listened on.
pub(super) fn check_address(address: SocketAddr) -> Finding {
    match TcpListener::bind(address) {
        Ok(_) => Ok(format!("{address} is free")),
        Err(error) if error.kind() == ErrorKind::AddrInUse => {
            Err(format!("{address} is in use: does the service run already?"))
        }
        Err(error) => Err(format!("{address} cannot be listened on: {error}")),
    }
}
