//! `pixmesh decode`: the process that decodes one picture and ends.
//!
//! `serve` and `worker` start it, nobody else: it is not in the program's help. It reads the file from
//! its standard input and writes its samples, or why there are none, to its standard output
//! ([`reply`]). It opens nothing, and keeps nothing of the environment. When whoever
//! started it is gone, it ends; signals that ask a group of processes to stop it leaves to that one,
//! which waits for the picture or kills it.

use super::reply;
use clap::Args;
use pixmesh_codec::{Alpha, DecodeOptions, Limits};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use std::error::Error;
use std::fs::File;
use std::io::{self, Read};
use std::os::fd::AsFd;
use std::thread;
use tokio::signal::unix::{SignalKind, signal};

/// How the picture is decoded.
#[derive(Args, Clone, Copy, Debug)]
pub struct DecodeSettings {
    /// Bytes of the file.
    #[arg(long)]
    bytes: usize,
    /// The most pixels.
    #[arg(long)]
    max_pixels: u64,
    /// The most columns, and the most rows.
    #[arg(long)]
    max_side: usize,
    /// A file that ends early is taken as far as it goes.
    #[arg(long)]
    lenient: bool,
}

impl DecodeSettings {
    /// Those of a file of so many bytes, as the program takes them.
    pub(super) fn arguments(options: &DecodeOptions, bytes: usize) -> Vec<String> {
        let DecodeOptions { limits, lenient, alpha: _ } = options;
        let mut arguments = vec![
            "decode".to_owned(),
            format!("--bytes={bytes}"),
            format!("--max-pixels={}", limits.max_pixels),
            format!("--max-side={}", limits.max_side),
        ];
        arguments.extend(lenient.then(|| "--lenient".to_owned()));
        arguments
    }

    fn options(self) -> DecodeOptions {
        let limits = Limits { max_pixels: self.max_pixels, max_side: self.max_side };
        // What becomes of alpha is decided where the picture is put together.
        DecodeOptions { limits, alpha: Alpha::Keep, lenient: self.lenient }
    }
}

/// Decodes the picture that comes in, and writes what came of it out.
///
/// # Errors
/// When the file does not come, or nobody takes the samples.
pub fn run(settings: DecodeSettings) -> Result<(), Box<dyn Error>> {
    be_first_to_go();
    leave_signals_to_others();
    end_with_reader();
    let mut file = vec![0; settings.bytes];
    io::stdin().read_exact(&mut file)?;
    let decoded = settings.options().decode_stored(&file);
    drop(file);
    // Not by lines, as standard output writes.
    let mut out = File::from(io::stdout().as_fd().try_clone_to_owned()?);
    Ok(reply::write(&decoded, &mut out)?)
}

/// Where memory runs out, this process goes and not the service.
fn be_first_to_go() {
    let _ = std::fs::write("/proc/self/oom_score_adj", "500");
}

/// Who stops a service by signals to all of its processes lets running work end all the same.
fn leave_signals_to_others() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build();
    if let Ok(runtime) = runtime {
        let _inside = runtime.enter();
        // Heard once, such a signal ends the process no more, whether or not anybody listens.
        for kind in [SignalKind::terminate(), SignalKind::interrupt(), SignalKind::hangup()] {
            let _ = signal(kind);
        }
    }
}

/// Ends this process as soon as nobody is left who could read its answer.
fn end_with_reader() {
    let wait = || {
        let out = io::stdout();
        loop {
            match poll(&mut [PollFd::new(&out, PollFlags::empty())], None) {
                Err(Errno::INTR | Errno::AGAIN) => {}
                // Nothing is waited for but that the other end is closed.
                _ => std::process::exit(1),
            }
        }
    };
    // Without it the process ends when it writes its answer.
    let _ = thread::Builder::new().name("reader".into()).spawn(wait);
}
