//! A disk that is full, and one that cannot be written to: jobs are refused, requests served.

use super::Setting;
use crate::client::send;
use crate::pictures::{disc, noise};
use crate::report::Result;
use crate::row;
use crate::server::{Folder, Server, program};
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A file system of its own for a folder; gone when dropped.
struct Mounted<'a>(&'a Folder);

impl Drop for Mounted<'_> {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("--lazy").arg(self.0.path()).status();
    }
}

pub(super) fn run(_: &Setting) -> Result {
    let folder = Arc::<Folder>::default();
    std::fs::create_dir_all(folder.path()).unwrap();
    let mount = |options: &str| {
        let output = Command::new("mount")
            .args(["-t", "tmpfs", "-o", options, "pixmesh-load"])
            .arg(folder.path())
            .output()
            .unwrap();
        output.status.success()
    };
    if !mount("size=8m") {
        let notes = vec!["Not run: only an administrator can mount a small disk.".into()];
        return Result { notes, ..Result::default() };
    }
    let mounted = Mounted(&folder);
    let server = Server::start_as(program(), &[], Arc::clone(&folder));
    let mut rows = vec![row!["disk", "job", "/readyz", "/livez", "mesh"]];
    let full = refused_by(&server);
    rows.push(states("full", &server, full));
    drop(server);
    assert!(mount("remount,ro"));
    let start = program()
        .args(["serve", "--listen", "127.0.0.1:0", "--data-dir"])
        .arg(folder.path())
        .output()
        .unwrap();
    drop(mounted);
    // The report is read elsewhere: where the folder was says nothing there.
    let path = folder.path().display().to_string();
    let said = String::from_utf8_lossy(&start.stderr).replace('|', "/");
    let said = said.trim().replace(path.as_str(), "FOLDER");
    let notes = vec![format!("On a disk that cannot be written to it does not start: `{said}`.")];
    Result { rows, notes, ..Result::default() }
}

/// Submits until there is no room left, and returns the status that says so.
fn refused_by(server: &Server) -> u16 {
    let mut image = noise(1000);
    let began = Instant::now();
    for number in 0_u8..=255 {
        let last = image.len() - 1;
        image[last] = number;
        let status = server.submit("method=med", &[], &image).status;
        if status != 202 {
            return status;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "the disk never fills up");
    }
    0
}

fn states(disk: &str, server: &Server, job: u16) -> Vec<String> {
    let mesh = send(server.public, "POST", "/v1/meshes?method=med", &[], &disc(200, 200, 3)).status;
    row![disk, job, server.operate("/readyz").status, server.operate("/livez").status, mesh]
}
