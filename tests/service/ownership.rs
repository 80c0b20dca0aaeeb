//! Whose jobs are whose, and how many one key's name may have.

use crate::client::{Answer, send};
use crate::in_process::Service;
use crate::keys::KeysFile;
use crate::pictures::{disc, noise};
use crate::server::{Client, Server};

/// Somebody with a key.
struct KeyHolder<'a> {
    server: &'a Client,
    bearer: String,
}

impl KeyHolder<'_> {
    fn send(&self, method: &str, target: &str, extra: &[(&str, &str)], body: &[u8]) -> Answer {
        let headers = [&[("Authorization", self.bearer.as_str())], extra].concat();
        send(self.server.public, method, target, &headers, body)
    }

    /// Submits a job and returns its path.
    fn job(&self, query: &str, image: &[u8]) -> String {
        let answer = self.send("POST", &format!("/v1/jobs?{query}"), &[], image);
        assert_eq!(answer.status, 202, "{}", answer.text());
        answer.header("location").to_owned()
    }

    fn state(&self, job: &str) -> String {
        self.send("GET", job, &[], &[]).json()["state"].as_str().unwrap_or_default().to_owned()
    }

    fn listed(&self) -> usize {
        self.send("GET", "/v1/jobs", &[], &[]).json()["jobs"].as_array().unwrap().len()
    }
}

fn client<'a>(server: &'a Client, file: &KeysFile, name: &str) -> KeyHolder<'a> {
    KeyHolder { server, bearer: format!("Bearer {}", file.issue(name)) }
}

#[test]
fn a_job_is_there_for_its_owner_alone() {
    let file = KeysFile::new("ownership");
    file.issue("anybody");
    let server = Service::start(&["--keys-file", file.path()]);
    let [mine, mine_too, theirs] =
        ["mine", "mine", "theirs"].map(|name| client(&server, &file, name));
    for client in [&mine, &mine_too, &theirs] {
        server.wait_until("the key is known", || {
            client.send("GET", "/v1/methods", &[], &[]).status == 200
        });
    }
    let image = disc(40, 30, 3);
    let job = mine.job("size=40", &image);
    server.wait_until("it is done", || mine.state(&job) == "completed");
    for (method, target) in [
        ("GET", job.clone()),
        ("GET", format!("{job}/mesh")),
        ("GET", format!("{job}/events")),
        ("DELETE", job.clone()),
    ] {
        let refused = theirs.send(method, &target, &[], &[]);
        assert_eq!(refused.status, 404, "{method} {target}: as if there were none");
    }
    assert_eq!((mine.listed(), mine_too.listed(), theirs.listed()), (1, 1, 0));
    assert_eq!(mine_too.send("GET", &format!("{job}/mesh"), &[], &[]).status, 200, "one name");
    let word = [("Idempotency-Key", "once")];
    let submit = |client: &KeyHolder<'_>| client.send("POST", "/v1/jobs?size=9", &word, &image);
    let [first, again, other] = [submit(&mine), submit(&mine_too), submit(&theirs)];
    assert_eq!(first.header("location"), again.header("location"));
    assert_ne!(first.header("location"), other.header("location"), "each has words of its own");
    assert_eq!(mine.send("DELETE", &job, &[], &[]).status, 204);
}

#[test]
fn jobs_of_a_key_keep_so_many_bytes_and_no_more() {
    let file = KeysFile::new("stored-bytes");
    file.issue("anybody");
    let picture = noise(900);
    let limit = picture.len() * 3 / 2;
    let server = Service::start(&[
        "--keys-file",
        file.path(),
        "--key-stored-bytes",
        &limit.to_string(),
        "--max-stored-bytes",
        &(limit * 3 / 2).to_string(),
    ]);
    let [greedy, modest] = ["greedy", "modest"].map(|name| client(&server, &file, name));
    for client in [&greedy, &modest] {
        server.wait_until("the key is known", || {
            client.send("GET", "/v1/methods", &[], &[]).status == 200
        });
    }
    let first = greedy.job("density=1&method=mgpr", &picture);
    let refused = greedy.send("POST", "/v1/jobs?size=9", &[], &noise(901));
    let problem = refused.problem(507, "storage-full");
    assert_eq!(problem["setting"], "--key-stored-bytes");
    assert_eq!(problem["limit"], limit);
    assert!(!refused.header("retry-after").is_empty());
    let refused = modest.send("POST", "/v1/jobs?size=9", &[], &noise(1050));
    assert_eq!(refused.problem(507, "storage-full")["setting"], "--max-stored-bytes");
    let small = modest.job("size=9", &disc(40, 30, 1));
    // A picture is kept until its job ends.
    assert_eq!(greedy.send("DELETE", &first, &[], &[]).status, 202);
    server.wait_until("there is room again", || {
        greedy.send("POST", "/v1/jobs?size=9", &[], &picture).status == 202
    });
    server.wait_until("it completes", || modest.state(&small) == "completed");
}

#[test]
fn a_key_has_so_many_jobs_waiting_and_running_and_no_more() {
    let file = KeysFile::new("job-caps");
    file.issue("anybody");
    let flags = ["--workers", "3", "--key-running", "1", "--key-queued-jobs", "2"];
    let server = Server::start(&[&flags[..], &["--keys-file", file.path()]].concat());
    let [greedy, modest] = ["greedy", "modest"].map(|name| client(&server, &file, name));
    for client in [&greedy, &modest] {
        server.wait_until("the key is known", || {
            client.send("GET", "/v1/methods", &[], &[]).status == 200
        });
    }
    let (slow, quick) = (noise(1500), disc(40, 30, 1));
    let running = greedy.job("density=2&method=mgprfs", &slow);
    server.wait_until("it runs", || greedy.state(&running) == "running");
    let waiting = [0; 2].map(|_| greedy.job("density=2&method=mgprfs", &slow));
    let refused = greedy.send("POST", "/v1/jobs?size=9", &[], &quick);
    let problem = refused.problem(429, "too-many-jobs");
    assert_eq!((&problem["limit"], &problem["setting"]), (&2.into(), &"--key-queued-jobs".into()));
    assert!(!refused.header("retry-after").is_empty());
    let other = modest.job("size=9", &quick);
    server.wait_until("another's job is done meanwhile", || modest.state(&other) == "completed");
    assert_eq!(waiting.each_ref().map(|job| greedy.state(job)), ["queued", "queued"]);
    for job in [&running, &waiting[0], &waiting[1]] {
        assert!([202, 204].contains(&greedy.send("DELETE", job, &[], &[]).status));
    }
    server.wait_until_idle();
}
