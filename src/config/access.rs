//! Settings of who may use the service, and how much of it.

use super::ByteSize;
use crate::access::KeyRing;
use clap::Args;
use serde::Serialize;
use std::error::Error;
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;

/// Who may use the service, and how much of it.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct AccessSettings {
    /// File of keys; with it every request below /v1/ needs a key. It is read again when it changes.
    #[arg(long, env = "PIXMESH_KEYS_FILE")]
    pub keys_file: Option<PathBuf>,
    /// Most requests per minute of one key's name, unless the file gives another number.
    #[arg(long, env = "PIXMESH_KEY_REQUESTS_PER_MINUTE", default_value = "600")]
    pub key_requests_per_minute: NonZeroU32,
    /// Most tasks that run at the same time for one key's name, and most of its running jobs [default:
    /// all workers but one].
    #[arg(long, env = "PIXMESH_KEY_RUNNING", hide_env_values = true)]
    pub key_running: Option<NonZeroUsize>,
    /// Most queued requests of one key's name.
    #[arg(long, env = "PIXMESH_KEY_QUEUED", default_value = "32")]
    pub key_queued: NonZeroUsize,
    /// Most queued jobs of one key's name.
    #[arg(long, env = "PIXMESH_KEY_QUEUED_JOBS", default_value = "1000")]
    pub key_queued_jobs: NonZeroUsize,
    /// Most bytes of stored pictures and meshes of one key's name.
    #[arg(long, env = "PIXMESH_KEY_STORED_BYTES", default_value = "16GiB")]
    pub key_stored_bytes: ByteSize,
    /// Most open streams of job events of one key's name.
    #[arg(long, env = "PIXMESH_KEY_EVENT_STREAMS", default_value = "64")]
    pub key_event_streams: NonZeroUsize,
    /// Origins whose pages may call the service, such as `https://example.org`; none by default.
    #[arg(long = "cors-origin", env = "PIXMESH_CORS_ORIGIN", value_name = "ORIGIN", value_delimiter = ',', num_args = 1.., value_parser = origin)]
    #[serde(rename = "cors-origin")]
    pub cors_origins: Vec<String>,
    /// Host names that requests may be for, beside localhost [default: any with keys or
    /// --insecure-no-auth, otherwise none].
    #[arg(long = "allowed-host", env = "PIXMESH_ALLOWED_HOST", value_name = "HOST", value_delimiter = ',', num_args = 1.., value_parser = host)]
    #[serde(rename = "allowed-host")]
    pub allowed_hosts: Vec<String>,
}

/// Which origins and host names are accepted.
#[derive(Clone, Debug)]
pub struct Visitors {
    /// Origins whose pages may use the service.
    pub origins: Vec<String>,
    /// Names of this host beside those of loopback; `None` where any name will do.
    pub hosts: Option<Vec<String>>,
}

impl AccessSettings {
    /// Meshes made at the same time for one key's name: all workers but one, so that another name
    /// never waits for the end of what this one runs. One worker is everybody's.
    #[must_use]
    pub fn running(&self, workers: usize) -> usize {
        self.key_running.map_or_else(|| workers.saturating_sub(1), NonZeroUsize::get).max(1)
    }

    /// Reads the file of keys, where there is one.
    ///
    /// # Errors
    /// As [`KeyRing::of`].
    pub fn check(&self) -> Result<(), Box<dyn Error>> {
        KeyRing::of(self).map(|_| ())
    }
}

/// The name of a host, without a port.
fn host(text: &str) -> Result<String, String> {
    let allowed = |letter: u8| letter.is_ascii_alphanumeric() || b".-".contains(&letter);
    if !text.is_empty() && text.bytes().all(allowed) {
        return Ok(text.to_ascii_lowercase());
    }
    Err(format!("'{text}' is no host: write its name or IPv4 address, without scheme and port"))
}

/// An origin as browsers send it: scheme, host, and the port if it is not the scheme's own.
fn origin(text: &str) -> Result<String, String> {
    let host = ["http://", "https://"].iter().find_map(|scheme| text.strip_prefix(scheme));
    let is_host = |host: &str| {
        let allowed = |letter: u8| letter.is_ascii_lowercase() || letter.is_ascii_digit();
        !host.is_empty() && host.bytes().all(|letter| allowed(letter) || b".-:[]".contains(&letter))
    };
    match host {
        Some(host) if is_host(host) => Ok(text.to_owned()),
        _ => Err(format!(
            "'{text}' is no origin: write it as browsers do, https://example.org or \
             http://localhost:3000, in lower case and without a path"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_origin_is_written_as_browsers_send_it() {
        for text in ["https://example.org", "http://localhost:3000", "http://[::1]:8080"] {
            assert_eq!(origin(text).as_deref(), Ok(text));
        }
        for text in ["*", "null", "example.org", "https://example.org/", "https://Example.org"] {
            assert!(origin(text).is_err(), "{text}");
        }
    }
}
