//! `pixmesh health`: asks a running service whether it takes requests.

use crate::config::HealthSettings;
use std::error::Error;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// Longest time to connect, to send, and to wait for the answer, each.
const TIMEOUT: Duration = Duration::from_secs(3);

/// Asks `/readyz`.
///
/// # Errors
/// When nothing answers, or the answer is not 200.
pub fn ask(settings: &HealthSettings) -> Result<(), Box<dyn Error>> {
    let address = settings.ops_listen;
    let mut stream = TcpStream::connect_timeout(&address, TIMEOUT)
        .map_err(|error| format!("nothing answers at {address}: {error}"))?;
    stream.set_read_timeout(Some(TIMEOUT))?;
    stream.set_write_timeout(Some(TIMEOUT))?;
    write!(stream, "GET /readyz HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n")?;
    let mut status_line = [0; 12];
    stream.read_exact(&mut status_line)?;
    match &status_line {
        b"HTTP/1.1 200" => Ok(()),
        _ => Err(format!("not ready: {}", String::from_utf8_lossy(&status_line)).into()),
    }
}
