//! `pixmesh backup` and `pixmesh check`: copy and check the data folder of the embedded queue.

use clap::Args;
use pixmesh_jobs::embedded::{self, Findings};
use std::error::Error;
use std::io::{self, Write};
use std::path::PathBuf;

/// A data folder.
#[derive(Args, Clone, Debug)]
pub struct DataFolder {
    /// Folder of the jobs, or of a backup. Nodes that share a queue back up their database and store of
    /// blobs with the tools of these.
    #[arg(long, env = "PIXMESH_DATA_DIR", default_value = "./pixmesh-data")]
    pub data_dir: PathBuf,
}

/// The settings of `pixmesh backup`.
#[derive(Args, Clone, Debug)]
pub struct Backup {
    /// Folder of the copy; what an earlier one has is not copied again.
    pub to: PathBuf,
    /// The folder to copy.
    #[command(flatten)]
    pub from: DataFolder,
}

/// Copies the data folder.
///
/// # Errors
/// When it cannot be copied, or a part of it is damaged.
pub fn back_up(order: &Backup) -> Result<(), Box<dyn Error>> {
    tell("copied", wait_for(embedded::back_up(&order.from.data_dir, &order.to))??)
}

/// Checks the data folder.
///
/// # Errors
/// When it cannot be read, or a part of it is damaged.
pub fn check(folder: &DataFolder) -> Result<(), Box<dyn Error>> {
    tell("read", wait_for(embedded::check(&folder.data_dir))??)
}

/// Prints what was found; damage is an error.
fn tell(done: &str, findings: Findings) -> Result<(), Box<dyn Error>> {
    let Findings { jobs, blobs, bytes, damage } = findings;
    writeln!(io::stdout(), "{jobs} jobs, {blobs} pictures and meshes, {bytes} bytes {done}")?;
    for what in &damage {
        writeln!(io::stdout(), "damaged: {what}")?;
    }
    if damage.is_empty() {
        Ok(())
    } else {
        Err(format!("{} parts are damaged", damage.len()).into())
    }
}

fn wait_for<T>(future: impl Future<Output = T>) -> io::Result<T> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    Ok(runtime.block_on(future))
}
