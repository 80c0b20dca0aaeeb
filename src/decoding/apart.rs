//! A process that decodes one picture, as seen by the thread that waits for it.
//!
//! One thread sends the file, receives the samples, and looks at the watch: it waits for the pipes for
//! some milliseconds at a time. However it leaves this, the process is killed and waited for, so that
//! none is left behind and the memory of its ticket is free again.

use super::Failure;
use super::process::DecodeSettings;
use super::reply::{Broken, Reply};
use crate::pool::Watch;
use crate::problem::{Kind, Problem};
use crate::telemetry::{self, DecodeProcess};
use pixmesh_codec::{Assembly, DecodeError, DecodeOptions, PictureFormat};
use pixmesh_meshing::Image;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::{Errno, ioctl_fionbio};
use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, ChildStderr, ChildStdin, ChildStdout, Command, Stdio};

/// How long the pipes are waited for before the watch is looked at again.
const LOOK_AGAIN: Timespec = Timespec { tv_sec: 0, tv_nsec: 10_000_000 };
/// Bytes that are read at a time: what pipes hold by default.
const PIECE_BYTES: usize = 1 << 16;
/// The most that is read of what the process says when it fails.
const MAX_WORDS_BYTES: u64 = 4096;
/// When a client should try again whose picture's process was ended by others, in seconds.
const RETRY_AFTER_S: u64 = 5;

/// The process.
pub(super) struct Decoder {
    child: Child,
    /// Closed when the whole file is sent.
    input: Option<ChildStdin>,
    output: ChildStdout,
    words: ChildStderr,
}

impl Decoder {
    /// Starts the program for a file of so many bytes.
    ///
    /// # Errors
    /// When the system does not start it.
    pub(super) fn start(program: &Path, options: &DecodeOptions, bytes: usize) -> io::Result<Self> {
        let mut command = Command::new(program);
        command.arg0("pixmesh").args(DecodeSettings::arguments(options, bytes)).env_clear();
        // In a group of its own, so that a terminal's Ctrl-C does not end it before its time.
        command.process_group(0);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn()?;
        let pipes = (child.stdin.take(), child.stdout.take(), child.stderr.take());
        let (Some(input), Some(output), Some(words)) = pipes else {
            end(&mut child);
            return Err(io::Error::from(ErrorKind::BrokenPipe));
        };
        let decoder = Self { child, input: Some(input), output, words };
        decoder.set_nonblocking()?;
        Ok(decoder)
    }

    fn set_nonblocking(&self) -> io::Result<()> {
        if let Some(input) = &self.input {
            ioctl_fionbio(input, true)?;
        }
        ioctl_fionbio(&self.output, true)?;
        Ok(ioctl_fionbio(&self.words, true)?)
    }

    /// Has the file decoded, for as long as the watch lets it.
    pub(super) fn decode(
        mut self,
        options: &DecodeOptions,
        file: &[u8],
        watch: &Watch,
    ) -> Result<Image, Failure> {
        let assemble = || options.assemble(file, &|| watch.check());
        let mut reply = Reply::new(PictureFormat::sniff(file)?, assemble);
        let received = self.exchange(file, &mut reply, watch);
        self.log_words();
        telemetry::decode_process(match &received {
            Ok(()) => DecodeProcess::Done,
            Err(Failure::Picture(DecodeError::Cancelled(_))) => DecodeProcess::Stopped,
            Err(_) => DecodeProcess::Failed,
        });
        // The process and its memory are gone before the image is finished.
        drop(self);
        received?;
        Ok(reply.into_image(&|| watch.check())?)
    }

    /// Sends the file and receives the reply, each as far as the other side goes.
    fn exchange(
        &mut self,
        file: &[u8],
        reply: &mut Reply<impl Fn() -> Result<Assembly, DecodeError>>,
        watch: &Watch,
    ) -> Result<(), Failure> {
        let (mut unsent, mut piece) = (file, vec![0; PIECE_BYTES]);
        loop {
            watch.check()?;
            self.wait_for_pipes().map_err(|error| failed(&error))?;
            unsent = self.send(unsent).map_err(|error| failed(&error))?;
            match self.output.read(&mut piece) {
                Ok(0) => return Err(self.ended_early()),
                Ok(count) => {
                    let come = piece.get(..count).unwrap_or_default();
                    reply.take(come).map_err(|broken| match broken {
                        Broken::Garbled => failed(&ErrorKind::InvalidData.into()),
                        Broken::Picture(error) => error.into(),
                    })?;
                    if reply.is_whole() {
                        return Ok(());
                    }
                }
                Err(error) if is_for_now(&error) => {}
                Err(error) => return Err(failed(&error)),
            }
        }
    }

    /// Waits until there is something to read or room to write, or for as long as the watch may be left
    /// alone.
    fn wait_for_pipes(&self) -> io::Result<()> {
        let mut pipes = vec![PollFd::from_borrowed_fd(self.output.as_fd(), PollFlags::IN)];
        if let Some(input) = &self.input {
            pipes.push(PollFd::from_borrowed_fd(input.as_fd(), PollFlags::OUT));
        }
        match poll(&mut pipes, Some(&LOOK_AGAIN)) {
            Ok(_) | Err(Errno::INTR | Errno::AGAIN) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    /// Sends what the pipe takes, closes it behind the end, and returns what is left.
    fn send<'a>(&mut self, unsent: &'a [u8]) -> io::Result<&'a [u8]> {
        let Some(input) = &mut self.input else { return Ok(unsent) };
        let sent = match input.write(unsent) {
            Ok(sent) => sent,
            Err(error) if is_for_now(&error) => 0,
            // What it says meanwhile, or its end, tells why.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => unsent.len(),
            Err(error) => return Err(error),
        };
        let rest = unsent.get(sent..).unwrap_or_default();
        if rest.is_empty() {
            self.input = None;
        }
        Ok(rest)
    }

    /// The process has closed its end and not said all.
    fn ended_early(&mut self) -> Failure {
        // It has nothing more to do: the wait is short, or it is killed.
        let status = self.child.wait();
        let signal = status.as_ref().ok().and_then(ExitStatusExt::signal);
        tracing::error!(?status, "the process that decodes a picture ended before it was done");
        Failure::Process(match signal {
            Some(signal) => Problem::new(
                Kind::Overloaded,
                format!(
                    "the process that decoded the image was ended from outside (signal {signal})"
                ),
            )
            .retry_after_s(RETRY_AFTER_S),
            None => Problem::new(Kind::Internal, IN_LOG),
        })
    }

    /// What the process said is in the log, as a panic of this process would be.
    fn log_words(&mut self) {
        let mut words = Vec::new();
        let _ = (&mut self.words).take(MAX_WORDS_BYTES).read_to_end(&mut words);
        if !words.is_empty() {
            telemetry::panicked_apart(&String::from_utf8_lossy(&words));
        }
    }
}

impl Drop for Decoder {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}

/// Kills a process that has not ended yet, and waits until it and its memory are gone.
fn end(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}

const IN_LOG: &str = "the log has the reason under this request's id";

fn failed(error: &io::Error) -> Failure {
    tracing::error!(%error, "the process that decodes a picture cannot be spoken to");
    Failure::Process(Problem::new(Kind::Internal, IN_LOG))
}

/// Whether a pipe has nothing to read or no room only now.
fn is_for_now(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}
