//! Whether the machine gives what the settings count on.

use super::Finding;
use crate::config::{BESIDE_BUDGET, ByteSize, Settings, memory_limit};
use pixmesh_jobs::folder::Space;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::net::{SocketAddr, TcpListener};
use std::thread::available_parallelism;

/// Writes and syncs a file where jobs are to be kept.
pub(super) fn check_data_folder(settings: &Settings) -> Finding {
    let folder = &settings.jobs.data_dir;
    let path = folder.join(format!("doctor-{}", std::process::id()));
    let write = || {
        fs::create_dir_all(folder)?;
        let mut file = File::create(&path)?;
        file.write_all(b"well\n")?;
        file.sync_all()?;
        fs::remove_file(&path)
    };
    write()
        .map(|()| format!("{} can be written to", folder.display()))
        .map_err(|error| format!("--data-dir {}: {error}", folder.display()))
}

/// Compares the free space of that folder's disk with what new jobs leave free.
pub(super) fn check_free_space(settings: &Settings) -> Finding {
    let folder = &settings.jobs.data_dir;
    let space =
        Space::of(folder).map_err(|error| format!("--data-dir {}: {error}", folder.display()))?;
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
    let limit = memory_limit().map(|limit| limit.0);
    let available = [limit, machine_memory()].into_iter().flatten().min();
    match available.map(ByteSize) {
        Some(available) if available < needed => Err(format!(
            "--memory-budget {budget} needs {needed} with what the process takes besides, but \
             there are {} MiB",
            available.0 >> 20
        )),
        Some(available) => Ok(format!("{budget} of {} MiB", available.0 >> 20)),
        None => Ok(format!("{budget}; how much there is, is not known")),
    }
}

fn machine_memory() -> Option<u64> {
    let text = fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

/// Compares the workers with the processors.
pub(super) fn check_processors(settings: &Settings) -> Finding {
    let workers = settings.worker_count();
    match available_parallelism() {
        Ok(cores) if workers > cores.get() => {
            Err(format!("--workers {workers}, but there are {cores} processors"))
        }
        Ok(cores) => Ok(format!("{workers} of {cores}")),
        Err(error) => Ok(format!("{workers}; how many there are, is not known: {error}")),
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
