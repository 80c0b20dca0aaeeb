//! Disks.

use super::{require_success, wait_long_for};
use crate::client::{Answer, send};
use crate::pictures::{disc, noise};
use crate::server::{Folder, Server, program};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Runs what is given in a file system of its own of so many KiB, mounted at the folder.
fn in_file_system(kib: usize, folder: &Folder) -> Command {
    std::fs::create_dir_all(folder.path()).unwrap();
    let mut command = Command::new("unshare");
    for (name, _) in std::env::vars_os() {
        if name.to_string_lossy().starts_with("PIXMESH_") {
            command.env_remove(name);
        }
    }
    let script =
        format!("mount -t tmpfs -o size={kib}k,mode=0777 tmpfs \"$FOLDER\" && exec \"$0\" \"$@\"");
    command.args(["--user", "--map-root-user", "--mount", "sh", "-c", &script]);
    command.env("FOLDER", folder.path());
    command
}

/// Fails a test where it may not have a file system of its own.
#[track_caller]
fn require_file_systems() {
    let why = "run this test as root, or where users may create user and mount namespaces";
    require_success(in_file_system(64, &Folder::new()).arg("true"), why);
}

/// A service on a file system of its own.
fn start_on(kib: usize, folder: &Arc<Folder>) -> Server {
    let mut command = in_file_system(kib, folder);
    command.arg(program().get_program());
    Server::start_as(command, &ON_FULL_DISKS, Arc::clone(folder))
}

/// The settings of a service that takes jobs in until the disk is full.
const ON_FULL_DISKS: [&str; 4] = ["--workers", "1", "--min-free-space", "1"];

/// Mounts the file system of a running service anew with other options.
fn remount(server: &Server, folder: &Folder, options: &str) {
    let target = server.process_id().to_string();
    let mut command = Command::new("nsenter");
    command.args(["--target", &target, "--user", "--mount", "--preserve-credentials"]);
    command.args(["mount", "-o", &format!("remount,{options}")]).arg(folder.path());
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Submits until the storage takes no more, and returns the jobs that it took.
fn fill(server: &Server, image: &[u8]) -> (Vec<String>, Answer) {
    let (mut image, mut accepted) = (image.to_vec(), Vec::new());
    loop {
        // Each is another picture, so that each is written.
        let last = image.len() - 1;
        image[last] = image[last].wrapping_add(1);
        let answer = server.submit("method=med&size=20", &[], &image);
        if answer.status != 202 {
            return (accepted, answer);
        }
        accepted.push(answer.header("location").to_owned());
        assert!(accepted.len() < 500, "it never fills up");
    }
}

#[test]
fn a_disk_that_fills_up_is_told_and_used_again_when_there_is_room() {
    require_file_systems();
    let folder = Arc::default();
    let server = start_on(3000, &folder);
    let (large, small) = (noise(400), disc(30, 30, 1));
    let (mut accepted, refused) = fill(&server, &large);
    assert!([503, 507].contains(&refused.status), "{}", refused.text());
    let unready = server.operate("/readyz");
    unready.problem(503, "storage-unavailable");
    let (more, refused) = fill(&server, &noise(40));
    assert!([503, 507].contains(&refused.status), "{}", refused.text());
    accepted.extend(more);
    assert_eq!(server.operate("/livez").status, 200);
    assert_eq!(server.mesh("", &[], &small).status, 200, "requests need no storage");
    let listed = server.get("/v1/jobs?limit=100");
    assert!([200, 503].contains(&listed.status), "{}", listed.text());
    remount(&server, &folder, "size=60m");
    server.wait_until("it is ready again", || server.operate("/readyz").status == 200);
    for job in &accepted {
        wait_long_for(&server, job, "completed");
        assert_eq!(server.get(&format!("{job}/mesh")).status, 200);
    }
    let next = server.job("size=20", &small);
    wait_long_for(&server, &next, "completed");
}

#[test]
fn a_full_disk_has_room_again_by_itself_once_jobs_expire() {
    require_file_systems();
    let folder: Arc<Folder> = Arc::default();
    let mut command = in_file_system(64 << 10, &folder);
    command.arg(program().get_program());
    let flags = [&ON_FULL_DISKS[..], &["--result-ttl", "5s"]].concat();
    let server = Server::start_as(command, &flags, Arc::clone(&folder));
    let (accepted, refused) = fill(&server, &noise(700));
    assert_eq!(refused.problem(507, "storage-full")["setting"], "--data-dir");
    assert!(!refused.header("retry-after").is_empty());
    assert_eq!(server.mesh("", &[], &disc(30, 30, 1)).status, 200, "requests need no storage");
    let deleted = send(server.public, "DELETE", accepted.last().unwrap(), &[], &[]);
    assert!([202, 204].contains(&deleted.status), "{}", deleted.text());
    // Nothing that was accepted is lost: each job completes, and expires.
    for job in &accepted[..accepted.len() - 1] {
        let ended = || matches!(state(&server, job).as_str(), "completed" | "expired");
        server.wait_until("it completes", ended);
    }
    server.wait_until("there is room again", || server.operate("/readyz").status == 200);
    let next = server.job("size=20", &noise(700));
    wait_long_for(&server, &next, "completed");
}

#[test]
fn jobs_are_refused_before_the_disk_is_full_and_taken_again_soon_after_some_expire() {
    require_file_systems();
    let folder: Arc<Folder> = Arc::default();
    let mut command = in_file_system(64 << 10, &folder);
    command.arg(program().get_program());
    let flags = ["--workers", "1", "--result-ttl", "5s"];
    let server = Server::start_as(command, &flags, Arc::clone(&folder));
    let (accepted, refused) = fill(&server, &noise(700));
    let problem = refused.problem(507, "storage-full");
    assert_eq!(problem["setting"], "--min-free-space");
    // An eighth of the file system stays free.
    assert_eq!(problem["limit"], 8 << 20);
    assert!(!refused.header("retry-after").is_empty());
    let ready = server.operate("/readyz");
    assert!(
        ready.status == 200 && ready.text().contains("no jobs are accepted"),
        "{}",
        ready.text()
    );
    let metrics = server.operate("/metrics").text();
    for metric in
        ["pixmesh_disk_free_bytes{state=\"free\"}", "pixmesh_stored_bytes{state=\"used\"}"]
    {
        assert!(metrics.contains(metric), "{metric}");
    }
    assert_eq!(server.mesh("", &[], &disc(30, 30, 1)).status, 200, "requests need no storage");
    // The first jobs expire while the last ones run.
    server.wait_until("the first job expires", || state(&server, &accepted[0]) == "expired");
    let expired = Instant::now();
    server.wait_until("jobs are accepted", || {
        server.submit("method=med&size=20", &[], &noise(700)).status == 202
    });
    let waited = expired.elapsed();
    assert!(waited < Duration::from_secs(10), "{waited:?}");
    for job in &accepted {
        let ended = || matches!(state(&server, job).as_str(), "completed" | "expired");
        server.wait_until("it completes", ended);
    }
}

#[test]
fn doctor_tells_how_much_space_is_free() {
    require_file_systems();
    let folder = Folder::new();
    let mut command = in_file_system(8 << 10, &folder);
    let fill = "head -c 7500000 /dev/zero > \"$FOLDER/other\" && exec \"$0\" \"$@\"";
    command.args(["sh", "-c", fill]).arg(program().get_program());
    let output = command.arg("doctor").arg("--data-dir").arg(folder.path()).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        !output.status.success() && text.contains("BAD   free space: 0 MiB are free"),
        "{text}"
    );
}

#[test]
fn a_service_starts_on_a_full_disk_and_loses_nothing() {
    require_file_systems();
    let folder: Arc<Folder> = Arc::default();
    let mut command = in_file_system(32 << 10, &folder);
    command.arg(program().get_program());
    let mut server = Server::start_as(command, &ON_FULL_DISKS, Arc::clone(&folder));
    let holding = server.job(super::SLOW, &noise(900));
    server.wait_for(&holding, "running");
    let (accepted, _) = fill(&server, &noise(500));
    // A process that keeps the file system while there is no service.
    let inside = |server: u32| {
        let mut command = Command::new("nsenter");
        command.args(["--target", &server.to_string()]);
        command.args(["--user", "--mount", "--preserve-credentials"]);
        command
    };
    let mut keeper = inside(server.process_id()).args(["sleep", "600"]).spawn().unwrap();
    let name = format!("/proc/{}/comm", keeper.id());
    server.wait_until("it is inside", || {
        std::fs::read_to_string(&name).is_ok_and(|name| name.trim() == "sleep")
    });
    server.kill();
    let mut command = inside(keeper.id());
    command.arg(program().get_program());
    let server = Server::start_as(command, &ON_FULL_DISKS, Arc::clone(&folder));
    assert_eq!(server.mesh("", &[], &disc(30, 30, 1)).status, 200);
    for job in accepted.iter().chain([&holding]) {
        wait_long_for(&server, job, "completed");
    }
    keeper.kill().unwrap();
    keeper.wait().unwrap();
}

/// The state of a job, or `expired`.
fn state(server: &Server, job: &str) -> String {
    let answer = server.get(job);
    match answer.status {
        200 => answer.json()["state"].as_str().unwrap().to_owned(),
        410 => "expired".into(),
        _ => answer.text(),
    }
}

#[test]
fn a_folder_that_cannot_be_written_to_stops_the_start_with_a_reason() {
    require_file_systems();
    let folder = Folder::new();
    let mut command = in_file_system(4000, &folder);
    let read_only = "mount -o remount,ro \"$FOLDER\" && exec \"$0\" \"$@\"";
    command.args(["sh", "-c", read_only]).arg(program().get_program());
    command.args(["serve", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0"]);
    let output = command.arg("--data-dir").arg(folder.path()).output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && message.contains("--data-dir"), "{message}");
    assert!(message.contains("ead-only") && !message.contains("panicked"), "{message}");
}

/// The file of each blob in a folder.
fn blobs(folder: &Folder) -> Vec<PathBuf> {
    let read = |path: &Path| std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path());
    read(&folder.path().join("blobs")).flat_map(|shelf| read(&shelf).collect::<Vec<_>>()).collect()
}

/// Flips a bit in the middle of each of the files.
fn damage(files: &[PathBuf]) {
    for file in files {
        let mut bytes = std::fs::read(file).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(file, bytes).unwrap();
    }
}

#[test]
fn a_mesh_that_the_disk_has_changed_is_never_sent() {
    let folder: Arc<Folder> = Arc::default();
    let server = Server::start_in(&folder, &["--workers", "1"]);
    let image = disc(60, 50, 3);
    let job = server.job("size=100", &image);
    server.wait_for(&job, "completed");
    let whole = server.get(&format!("{job}/mesh"));
    assert_eq!(whole.status, 200);
    server.wait_until("only the mesh is left", || {
        blobs(&folder).len() == 1 || blobs(&folder).len() == 2
    });
    damage(&blobs(&folder));
    for format in ["model", "glb", "png"] {
        server.get(&format!("{job}/mesh?format={format}")).problem(500, "storage-damaged");
    }
    assert_eq!(server.get(&job).status, 200, "the rest of the job is there");
    // Made once more, it is stored once more.
    let again = server.job("size=100", &image);
    server.wait_for(&again, "completed");
    for path in [&again, &job] {
        assert!(server.get(&format!("{path}/mesh")).body == whole.body);
    }
}

#[test]
fn an_image_that_the_disk_has_changed_is_never_meshed() {
    let folder: Arc<Folder> = Arc::default();
    let mut server = Server::start_in(&folder, &["--workers", "1"]);
    let holding = server.job(super::SLOW, &noise(900));
    server.wait_for(&holding, "running");
    let waiting = server.job("size=20", &noise(50));
    server.kill();
    damage(&blobs(&folder));
    let server = Server::start_in(&folder, &["--workers", "1"]);
    for job in [&holding, &waiting] {
        let document = server.wait_for(job, "failed");
        assert_eq!(document["error"]["type"], "/problems/storage-damaged", "{document}");
    }
    let again = server.job("size=20", &noise(50));
    server.wait_for(&again, "completed");
}

#[test]
fn jobs_of_a_damaged_log_are_told_and_their_pictures_set_aside() {
    let folder: Arc<Folder> = Arc::default();
    let mut server = Server::start_in(&folder, &["--workers", "1"]);
    let holding = server.job(super::SLOW, &noise(900));
    server.wait_for(&holding, "running");
    let log = folder.path().join("jobs.sqlite3-wal");
    let length = std::fs::metadata(&log).unwrap().len();
    let jobs: Vec<String> = (1..=5).map(|n| server.job("size=20", &disc(30, 30 + n, 1))).collect();
    server.kill();
    let mut bytes = std::fs::read(&log).unwrap();
    // In a page that is written after the first job.
    bytes[length as usize + 500] ^= 8;
    std::fs::write(&log, &bytes).unwrap();
    let server = Server::start_in(&folder, &["--workers", "1"]);
    server.wait_until("it is told", || server.log().contains("log of the jobs is damaged"));
    let lost = jobs.iter().filter(|job| server.get(job).status == 404).count();
    assert!(lost > 0 && server.metric("pixmesh_transactions_lost") >= lost as f64, "{lost}");
    let aside = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap());
    let aside = aside.map(|entry| entry.path());
    let aside: Vec<_> =
        aside.filter(|path| path.to_string_lossy().contains("set-aside-")).collect();
    let set_aside = || std::fs::read_dir(&aside[0]).unwrap().count();
    server.wait_until("their pictures and the log are there", || set_aside() == lost + 1);
    // Those before are kept, and a start without damage says nothing.
    let path = folder.path().join("jobs.sqlite3");
    assert!(path.exists() && server.get(&holding).status == 200);
    drop(server);
    let server = Server::start_in(&folder, &["--workers", "1"]);
    assert!(!server.log().contains("is damaged") && set_aside() == lost + 1, "{}", server.log());
}

#[test]
fn a_data_folder_that_is_removed_is_noticed() {
    let folder: Arc<Folder> = Arc::default();
    let server = Server::start_in(&folder, &[]);
    let image = disc(30, 30, 1);
    let away = folder.path().with_extension("away");
    std::fs::rename(folder.path(), &away).unwrap();
    server.operate("/readyz").problem(503, "storage-unavailable");
    server.submit("size=20", &[], &image).problem(503, "storage-unavailable");
    assert_eq!(server.mesh("", &[], &image).status, 200, "requests need no storage");
    server.wait_until("it is told", || server.log().contains("was removed or replaced"));
    std::fs::rename(&away, folder.path()).unwrap();
    assert_eq!(server.operate("/readyz").status, 200);
    let job = server.job("size=20", &image);
    server.wait_for(&job, "completed");
}

#[test]
fn a_database_that_is_none_stops_the_start_with_a_reason() {
    let folder: Arc<Folder> = Arc::default();
    let mut server = Server::start_in(&folder, &[]);
    let job = server.job("size=20", &disc(30, 30, 1));
    server.wait_for(&job, "completed");
    server.kill();
    for name in ["jobs.sqlite3", "jobs.sqlite3-wal"] {
        let _ = std::fs::write(folder.path().join(name), vec![0xA5; 8192]);
    }
    let mut command = program();
    command.args(["serve", "--listen", "127.0.0.1:0", "--ops-listen", "127.0.0.1:0"]);
    let output = command.arg("--data-dir").arg(folder.path()).output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && message.contains("jobs.sqlite3"), "{message}");
    assert!(!message.contains("panicked"), "{message}");
}
