//! A system that gives the process no more threads.

use crate::pictures::disc;
use crate::server::{Folder, Server, program};
use serde_json::json;
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// A user that nothing else runs as: the system counts the threads of each user.
const USER: &str = "--reuid=54321 --regid=54321 --clear-groups";

/// Runs what is given as that user, without the settings of this environment.
fn as_user() -> Command {
    let mut command = Command::new("setpriv");
    for (name, _) in std::env::vars_os() {
        if name.to_string_lossy().starts_with("PIXMESH_") {
            command.env_remove(name);
        }
    }
    command.args(USER.split(' ')).arg(program().get_program());
    command
}

/// Lets a process start no thread where its user has so many.
fn allow_threads(process: u32, count: usize) {
    // As the user itself: this takes no privilege over others.
    let mut command = Command::new("setpriv");
    command.args(USER.split(' ')).args(["prlimit", "--pid", &process.to_string()]);
    command.arg(format!("--nproc={count}:"));
    assert!(command.status().unwrap().success());
}

/// A service that runs as that user, or `None` where only an administrator could start it.
fn server_of_user() -> Option<Server> {
    let tried = as_user().arg("--version").output();
    if !tried.is_ok_and(|output| output.status.success()) {
        println!("skipped: only an administrator can run the service as another user");
        return None;
    }
    let folder: Arc<Folder> = Arc::default();
    std::fs::create_dir_all(folder.path()).unwrap();
    std::os::unix::fs::chown(folder.path(), Some(54321), Some(54321)).unwrap();
    Some(Server::start_as(as_user(), &["--workers", "2"], folder))
}

/// One service at a time: the system counts the threads of both together.
static ALONE: Mutex<()> = Mutex::new(());

#[test]
fn a_job_without_a_thread_waits_for_one_and_loses_no_attempt() {
    let _alone = ALONE.lock();
    let Some(server) = server_of_user() else { return };
    // What reads and writes jobs has its threads; what makes meshes has none yet.
    assert_eq!(server.get("/v1/jobs").status, 200);
    allow_threads(server.process_id(), 1);
    let job = server.job("", &disc(40, 40, 1));
    server.wait_for(&job, "running");
    for _ in 0..8 {
        thread::sleep(Duration::from_millis(500));
        let document = server.get(&job).json();
        assert_eq!((&document["state"], &document["attempt"]), (&json!("running"), &json!(1)));
        assert_eq!(server.operate("/livez").status, 200);
    }
    allow_threads(server.process_id(), 500);
    let document = server.wait_for(&job, "completed");
    assert_eq!(document["attempt"], 1);
    assert!(server.log().contains("no thread could be started"));
}

#[test]
fn work_without_a_thread_is_refused_and_takes_no_worker_with_it() {
    let _alone = ALONE.lock();
    let Some(server) = server_of_user() else { return };
    let image = disc(40, 40, 1);
    allow_threads(server.process_id(), 1);
    for _ in 0..5 {
        let answer = server.mesh("", &[], &image);
        answer.problem(503, "overloaded");
        assert!(!answer.header("retry-after").is_empty());
        assert_eq!(server.operate("/livez").status, 200);
    }
    server.wait_until_idle();
    allow_threads(server.process_id(), 500);
    for _ in 0..5 {
        assert_eq!(server.mesh("", &[], &image).status, 200);
    }
}
