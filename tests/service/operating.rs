//! What operators do: jobs of all owners, keys, backups.

use crate::client::{Answer, send};
use crate::keys::KeysFile;
use crate::pictures::disc;
use crate::server::{Folder, Server, program};
use std::sync::Arc;

/// A call on the listener for operations.
fn call(server: &Server, method: &str, target: &str, key: &str) -> Answer {
    let bearer = format!("Bearer {key}");
    let headers = [("Authorization", bearer.as_str())];
    send(server.operations, method, target, if key.is_empty() { &[] } else { &headers }, &[])
}

/// Runs `pixmesh jobs` with these arguments, and returns what it prints; an error begins with `error`.
fn jobs(server: &Server, key: &str, arguments: &[&str]) -> String {
    let address = server.operations.to_string();
    let mut command = program();
    command.args(["jobs", "--ops-listen", &address]).args(arguments);
    if !key.is_empty() {
        command.env("PIXMESH_KEY", key);
    }
    let output = command.output().unwrap();
    let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
    if output.status.success() { text } else { format!("error: {text}") }
}

/// A picture that is damaged behind its header: its job fails.
fn damaged() -> Vec<u8> {
    let mut image = disc(40, 40, 3);
    let length = image.len();
    image[length / 2..].fill(0xff);
    image
}

#[test]
fn operators_alone_see_the_jobs_of_all_owners() {
    let file = KeysFile::new("operators");
    let alice = file.issue("alice");
    let operator = file.issue_as("admin", &["--operator"]);
    let server = Server::start(&["--keys-file", file.path()]);
    let bearer = format!("Bearer {alice}");
    let submitted = server.submit("", &[("Authorization", &bearer)], &disc(30, 30, 1));
    let id = submitted.json()["id"].as_str().unwrap().to_owned();
    for target in ["/v1/jobs", "/v1/paused"] {
        call(&server, "GET", target, "").problem(401, "unauthorized");
        call(&server, "GET", target, &alice).problem(403, "operator-only");
    }
    call(&server, "POST", "/v1/jobs/delete?all=true", &alice).problem(403, "operator-only");
    let page =
        call(&server, "GET", "/v1/jobs?owner=alice&max_age=1h&min_size=10", &operator).json();
    assert_eq!((&page["jobs"][0]["id"], &page["jobs"][0]["owner"]), (&id.into(), &"alice".into()));
    assert_eq!(page["jobs"].as_array().unwrap().len(), 1);
    for empty in ["owner=bob", "min_age=1h", "min_size=1MiB", "problem=attempts-exhausted"] {
        let page = call(&server, "GET", &format!("/v1/jobs?{empty}"), &operator).json();
        assert_eq!(page["jobs"].as_array().map(Vec::len), Some(0), "{empty}: {page}");
    }
    for (query, status, slug) in [
        ("state=done", 422, "unknown-value"),
        ("problem=exhausted", 422, "unknown-value"),
        ("min_age=tomorrow", 400, "parameter-malformed"),
        ("id=1", 400, "parameter-malformed"),
        ("ownr=alice", 400, "unknown-parameter"),
    ] {
        call(&server, "GET", &format!("/v1/jobs?{query}"), &operator).problem(status, slug);
    }
    call(&server, "POST", "/v1/jobs/delete", &operator).problem(422, "unknown-value");
    call(&server, "POST", "/v1/jobs/burn?all=true", &operator).problem(404, "not-found");
    let own = send(server.public, "GET", "/v1/jobs", &[("Authorization", &bearer)], &[]);
    assert!(own.json()["jobs"][0].get("owner").is_none());
}

#[test]
fn a_page_of_another_origin_operates_nothing() {
    let server = Server::start(&[]);
    let foreign = [("Sec-Fetch-Site", "cross-site")];
    send(server.operations, "POST", "/v1/jobs/delete?all=true", &foreign, &[])
        .problem(403, "foreign-origin");
    assert_eq!(call(&server, "GET", "/v1/jobs", "").status, 200, "loopback without keys");
}

#[test]
fn failed_jobs_are_found_retried_and_deleted_on_the_command_line() {
    let server = Server::start(&[]);
    let job = server.job("", &damaged());
    let whole = server.job("", &disc(30, 30, 1));
    server.wait_for(&job, "failed");
    server.wait_for(&whole, "completed");
    let id = job.rsplit('/').next().unwrap();
    let found = jobs(&server, "", &["list", "--problem", "image-decode-failed"]);
    assert!(found.starts_with(&format!("{id}  failed  -  ")), "{found}");
    assert_eq!(found.lines().count(), 1, "{found}");
    let lines = jobs(&server, "", &["list", "--json"]);
    assert_eq!(lines.lines().filter(|line| line.starts_with("{\"owner\":\"\",")).count(), 2);
    assert_eq!(jobs(&server, "", &["pause", "work"]), "intake: running\nwork: paused\n");
    assert_eq!(jobs(&server, "", &["retry", "--state", "failed"]), "retry: 1 jobs\n");
    let document = server.get(&job).json();
    assert_eq!((&document["state"], &document["attempt"]), (&"queued".into(), &0.into()));
    assert_eq!(jobs(&server, "", &["resume", "work"]), "intake: running\nwork: running\n");
    server.wait_until("it fails again, by its picture", || {
        let document = server.get(&job).json();
        document["state"] == "failed"
            && document["attempt"] == 1
            && document["error"]["type"] == "/problems/image-decode-failed"
    });
    let refused = jobs(&server, "", &["delete"]);
    assert!(refused.starts_with("error: ") && refused.contains("all=true"), "{refused}");
    assert_eq!(jobs(&server, "", &["delete", id]), "delete: 1 jobs\n");
    server.get(&job).problem(410, "gone");
    assert_eq!(server.get(&whole).status, 200);
    assert_eq!(jobs(&server, "", &["delete", "--all"]), "delete: 1 jobs\n");
    server.get(&whole).problem(410, "gone");
    server.wait_until("the log says who did what", || server.log().contains("an operator changed"));
}

#[test]
fn paused_intake_and_work_outlive_a_kill() {
    let folder: Arc<Folder> = Arc::default();
    let mut server = Server::start_in(&folder, &[]);
    assert_eq!(jobs(&server, "", &["pause", "work"]), "intake: running\nwork: paused\n");
    let job = server.job("", &disc(30, 30, 1));
    assert_eq!(jobs(&server, "", &["pause", "intake"]), "intake: paused\nwork: paused\n");
    server.kill();
    let server = Server::start_in(&folder, &[]);
    let refused = server.submit("", &[], &disc(30, 30, 2));
    refused.problem(503, "jobs-paused");
    assert!(!refused.header("retry-after").is_empty());
    let ready = server.operate("/readyz");
    assert!(ready.status == 200 && ready.text().contains("paused"), "{}", ready.text());
    assert_eq!(server.metric("pixmesh_jobs_paused{what=\"work\"}"), 1.0);
    assert_eq!(server.mesh("", &[], &disc(30, 30, 2)).status, 200, "requests are answered");
    assert_eq!(server.get(&job).json()["state"], "queued");
    jobs(&server, "", &["resume", "work"]);
    server.wait_for(&job, "completed");
    assert_eq!(jobs(&server, "", &["resume", "intake"]), "intake: running\nwork: running\n");
    server.job("", &disc(30, 30, 2));
}

#[test]
fn keys_are_listed_expire_and_are_revoked() {
    let file = KeysFile::new("revoked");
    let [alice, bob] = ["alice", "bob"].map(|name| file.issue(name));
    let late = file.issue_as("late", &["--expires", "2020-01-01T00:00:00Z"]);
    let soon = file.issue_as("soon", &["--operator", "--expires", "2999-01-01T00:00:00Z"]);
    let run = |arguments: &[&str]| {
        let output =
            program().arg("key").args(arguments).args(["--keys-file", file.path()]).output();
        let output = output.unwrap();
        let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
        (output.status.success(), text)
    };
    let (_, listed) = run(&["list"]);
    let lines: Vec<&str> = listed.lines().collect();
    assert!(lines[0].starts_with("alice ") && lines[0].len() == "alice ".len() + 8, "{listed}");
    assert!(lines[2].ends_with(" expired=2020-01-01T00:00:00.000Z"), "{listed}");
    assert!(lines[3].ends_with(" operator expires=2999-01-01T00:00:00.000Z"), "{listed}");
    let server = Server::start(&["--keys-file", file.path()]);
    let status = |key: &str| {
        let bearer = format!("Bearer {key}");
        send(server.public, "GET", "/v1/methods", &[("Authorization", &bearer)], &[]).status
    };
    assert_eq!([&alice, &bob, &late, &soon].map(|key| status(key)), [200, 200, 401, 200]);
    let digits = lines[1].split(' ').nth(1).unwrap();
    assert_eq!(run(&["revoke", digits]), (true, "keys revoked: 1\n".into()));
    assert_eq!(run(&["revoke", "alice"]), (true, "keys revoked: 1\n".into()));
    server.wait_until("both are refused", || status(&alice) == 401 && status(&bob) == 401);
    assert_eq!(status(&soon), 200);
    assert!(run(&["revoke", "nobody"]).1.contains("no such key"));
    run(&["revoke", "late"]);
    assert!(run(&["revoke", "soon"]).1.contains("no key would be left"));
    assert!(
        !program()
            .args(["key", "new", "x", "--expires", "soon"])
            .output()
            .unwrap()
            .status
            .success()
    );
}

#[test]
fn backup_of_a_running_service_is_restored_with_all_it_had() {
    let (folder, backup): (Arc<Folder>, Arc<Folder>) = (Arc::default(), Arc::default());
    let server = Server::start_in(&folder, &[]);
    let image = disc(30, 30, 1);
    let done = server.job("", &image);
    server.wait_for(&done, "completed");
    jobs(&server, "", &["pause", "work"]);
    let waiting = server.job("", &disc(30, 30, 2));
    let run = |command: &str, arguments: &[&str], data: &Folder| {
        let mut program = program();
        program.arg(command).args(arguments).arg("--data-dir").arg(data.path());
        let output = program.output().unwrap();
        let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
        (output.status.success(), text)
    };
    let to = backup.path().to_str().unwrap();
    for _ in 0..2 {
        let (is_done, text) = run("backup", &[to], &folder);
        assert!(is_done && text.starts_with("2 jobs, 2 pictures and meshes, "), "{text}");
    }
    for data in [&folder, &backup] {
        let (is_done, text) = run("check", &[], data);
        assert!(is_done && text.starts_with("2 jobs, 2 pictures and meshes, "), "{text}");
    }
    let mesh = server.get(&format!("{done}/mesh")).body;
    drop(server);
    let restored = Server::start_in(&backup, &[]);
    assert_eq!(restored.get(&format!("{done}/mesh")).body, mesh);
    jobs(&restored, "", &["resume", "work"]);
    restored.wait_for(&waiting, "completed");
    drop(restored);
    let blob = first_file(&backup.path().join("blobs"));
    std::fs::write(blob, "other bytes").unwrap();
    let (is_done, text) = run("check", &[], &backup);
    assert!(!is_done && text.contains("damaged: job "), "{text}");
}

/// The first blob of a store.
fn first_file(blobs: &std::path::Path) -> std::path::PathBuf {
    let folders = std::fs::read_dir(blobs).unwrap().map(|entry| entry.unwrap().path());
    let mut files = folders
        .filter(|path| path.is_dir())
        .flat_map(|path| std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()));
    files.next().unwrap()
}
