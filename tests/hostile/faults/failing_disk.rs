//! A disk that turns read-only while the service runs, as Linux makes one of a disk that fails.

use super::{SLOW, require_success, wait_long_for};
use crate::pictures::{disc, noise};
use crate::server::{Folder, Server, program};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A disk in a file, with a file system of its own.
struct Disk {
    image: PathBuf,
    _folder: Folder,
}

impl Disk {
    /// A disk of 32 MiB.
    fn new() -> Self {
        let folder = Folder::new();
        std::fs::create_dir_all(folder.path()).unwrap();
        let image = folder.path().join("disk");
        std::fs::File::create(&image).unwrap().set_len(32 << 20).unwrap();
        require_success(Command::new("mkfs.ext4").arg("-q").arg(&image), "install e2fsprogs");
        let disk = Self { image, _folder: folder };
        let place = Folder::new();
        let why = "run this test as root, with loop devices";
        require_success(disk.mounted_at(place.path()).arg("true"), why);
        disk
    }

    /// Runs what is given where the disk is mounted at a path, for it alone.
    fn mounted_at(&self, path: &Path) -> Command {
        std::fs::create_dir_all(path).unwrap();
        let mut command = Command::new("unshare");
        let mount = "mount -o loop,errors=remount-ro \"$DISK\" \"$PLACE\" && exec \"$0\" \"$@\"";
        command.args(["--mount", "sh", "-c", mount]);
        command.env("DISK", &self.image).env("PLACE", path);
        command
    }

    /// A service whose data are on the disk.
    fn start(&self, folder: &Arc<Folder>) -> Server {
        let mut command = self.mounted_at(folder.path());
        for (name, _) in std::env::vars_os() {
            if name.to_string_lossy().starts_with("PIXMESH_") {
                command.env_remove(name);
            }
        }
        command.arg(program().get_program());
        Server::start_as(command, &["--workers", "1"], Arc::clone(folder))
    }

    /// Repairs the file system, as is done when a machine starts.
    fn repair(&self) {
        let status = Command::new("e2fsck").args(["-f", "-y"]).arg(&self.image).output();
        // 1 means that there was something to repair.
        assert!(status.unwrap().status.code().is_some_and(|code| code <= 1));
    }
}

/// Lets the disk of a running service fail: from now on nothing is written to it.
fn fail(server: &Server, folder: &Folder) {
    let mut command = Command::new("nsenter");
    command.args(["--target", &server.process_id().to_string(), "--mount"]);
    command.args(["mount", "-o", "remount,abort"]).arg(folder.path());
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_disk_that_turns_read_only_is_told_and_no_accepted_job_is_lost() {
    let disk = Disk::new();
    let folder = Arc::default();
    let mut server = disk.start(&folder);
    let small = disc(30, 30, 1);
    let done = server.job("size=20", &small);
    server.wait_for(&done, "completed");
    let mesh = server.get(&format!("{done}/mesh")).body;
    let running = server.job(SLOW, &noise(700));
    server.wait_for(&running, "running");
    let waiting = server.job("size=30", &small);

    fail(&server, &folder);
    server.wait_until("it is not ready", || server.operate("/readyz").status == 503);
    server.operate("/readyz").problem(503, "storage-unavailable");
    assert_eq!(server.operate("/livez").status, 200);
    server.submit("size=40", &[], &small).problem(503, "storage-unavailable");
    server.submit("size=40", &[], &noise(40)).problem(503, "storage-unavailable");
    assert_eq!(server.mesh("", &[], &small).status, 200, "requests need no storage");
    for path in [&done, &format!("{done}/mesh"), "/v1/jobs"] {
        assert_eq!(server.get(path).status, 200, "{path} can still be read");
    }
    assert!(server.get(&format!("{done}/mesh")).body == mesh);
    // Neither is said to be done, or to have failed, which nothing could remember.
    for job in [&running, &waiting] {
        let state = server.get(job).json()["state"].clone();
        assert!(state == "queued" || state == "running", "{state}");
    }
    server.signal("TERM");
    let began = Instant::now();
    server.wait();
    assert!(began.elapsed() < Duration::from_secs(30), "{:?}", began.elapsed());
    drop(server);

    disk.repair();
    let server = disk.start(&folder);
    for job in [&running, &waiting] {
        wait_long_for(&server, job, "completed");
        assert_eq!(server.get(&format!("{job}/mesh")).status, 200);
    }
    assert!(server.get(&format!("{done}/mesh")).body == mesh);
    let next = server.job("size=40", &small);
    wait_long_for(&server, &next, "completed");
}
