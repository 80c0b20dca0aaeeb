//! Pictures from their files, for as long as somebody wants them.
//!
//! Decoders that read piece by piece are stopped where they read. Three of others' decoders do not
//! read while they do the most of their work: those of progressive JPEG and of WebP, lossy or not. What
//! they would go on with for a tenth of a second or longer is decoded by a process of its own
//! ([`apart`]), which is killed as soon as nobody wants the picture any more: this same program as
//! `pixmesh decode` ([`process`]), with the same code, so that the samples are the same. Where the
//! system does not start it, this process decodes the picture itself, and the log and a metric say so.

mod apart;
pub mod process;
mod reply;

use crate::pool::Watch;
use crate::problem::Problem;
use crate::telemetry::{self, DecodeProcess};
use apart::Decoder;
use pixmesh_codec::{DecodeError, DecodeOptions};
use pixmesh_meshing::{Cancelled, Image};
use std::path::PathBuf;
use std::sync::OnceLock;

/// This program, where it may be started once more.
static PROGRAM: OnceLock<PathBuf> = OnceLock::new();

/// Why there is no picture.
#[derive(Clone, Debug, PartialEq)]
pub enum Failure {
    /// Its file is not one, or it is no longer wanted.
    Picture(DecodeError),
    /// The process that decoded it ended before it was done.
    Process(Problem),
}

/// From now on this process starts its own program for what decoders could not be stopped in.
///
/// Only the program itself calls this: tests and benchmarks, which are other programs, decode everything
/// in their own process.
pub fn allow_processes() {
    // The link leads to the program that runs, also where its file was replaced by a newer version.
    let own = if cfg!(target_os = "linux") {
        Some(PathBuf::from("/proc/self/exe"))
    } else {
        std::env::current_exe().ok()
    };
    if let Some(own) = own {
        PROGRAM.get_or_init(|| own);
    }
}

/// Decodes a picture, and stops within some milliseconds of when the watch says so.
///
/// # Errors
/// When the file is broken, the watch stops the work, or the process for it was ended by others.
pub fn decode(options: &DecodeOptions, file: &[u8], watch: &Watch) -> Result<Image, Failure> {
    watch.check()?;
    if let Some(program) = program_for(options, file) {
        match Decoder::start(program, options, file.len()) {
            Ok(decoder) => return decoder.decode(options, file, watch),
            Err(error) => {
                telemetry::decode_process(DecodeProcess::NotStarted);
                tracing::warn!(
                    %error,
                    "no process could be started for a picture: it is decoded here, and may go on for \
                     some time when its client leaves"
                );
            }
        }
    }
    Ok(options.decode_while(file, &|| watch.check())?)
}

/// Bytes that [`decode`] takes beyond what the header says: of the copy that a process gets.
#[must_use]
pub fn copied_bytes(options: &DecodeOptions, file: &[u8]) -> u64 {
    if program_for(options, file).is_some() { file.len() as u64 } else { 0 }
}

/// What is to decode a file, if not this process.
fn program_for(options: &DecodeOptions, file: &[u8]) -> Option<&'static PathBuf> {
    PROGRAM.get().filter(|_| options.may_stop_late(file))
}

impl From<DecodeError> for Failure {
    fn from(error: DecodeError) -> Self {
        Self::Picture(error)
    }
}

impl From<Cancelled> for Failure {
    fn from(cancelled: Cancelled) -> Self {
        Self::Picture(cancelled.into())
    }
}

impl From<Failure> for Problem {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Picture(error) => error.into(),
            Failure::Process(problem) => problem,
        }
    }
}
