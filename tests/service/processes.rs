//! The processes that decode what cannot be stopped otherwise: ended with their client, their service,
//! or from outside, and never left behind.

use crate::client::{assert_once_within, connect};
use crate::late::{KINDS, children};
use crate::pictures::disc;
use crate::server::{Server, program};
use pixmesh_codec::{DecodeOptions, write_model};
use pixmesh_meshing::parameters::Generator;
use pixmesh_meshing::{Method, Target, mesh_image};
use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// The largest size that is accepted where nothing else is set.
const LARGE: (u16, u16) = (8000, 5000);
/// Such pictures take much memory and time, beside whatever else the machine does.
const FLAGS: [&str; 10] = [
    "--workers",
    "1",
    "--max-body",
    "100MiB",
    "--memory-budget",
    "6GiB",
    "--body-timeout",
    "5m",
    "--sync-deadline",
    "5m",
];
/// Quick to mesh whatever the size.
const QUERY: &str = "method=med&size=100&initial=uniform";
const PATIENCE: Duration = Duration::from_secs(60);

/// Waits for the process that decodes a picture for this service.
#[track_caller]
fn decoder_of(server: &Server) -> u32 {
    let began = Instant::now();
    loop {
        if let Some(&id) = children(server.process_id()).first() {
            return id;
        }
        assert!(began.elapsed() < PATIENCE, "no process is started: {}", server.log());
    }
}

fn is_there(process: u32) -> bool {
    fs::exists(format!("/proc/{process}")).unwrap()
}

fn send_signal(name: &str, process: u32) {
    let sent = Command::new("sh").args(["-c", &format!("kill -{name} {process}")]).status();
    assert!(sent.unwrap().success());
}

/// Sends a picture, and does not wait for its mesh.
fn begin(server: &Server, image: &[u8]) -> TcpStream {
    let mut stream = connect(server.public);
    let length = image.len();
    let head =
        format!("POST /v1/meshes?{QUERY} HTTP/1.1\r\nHost: a\r\nContent-Length: {length}\r\n\r\n");
    stream.write_all(head.as_bytes()).unwrap();
    stream.write_all(image).unwrap();
    stream
}

/// How often a process was started and came to such an end.
fn outcome(server: &Server, outcome: &str) -> f64 {
    server.metric(&format!("pixmesh_decode_processes_total{{outcome=\"{outcome}\"}}"))
}

/// The processor time that a process has used, in hundredths of a second; `None` when it has ended.
fn processor_time(process: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let mut fields = stat.rsplit(')').next()?.split_whitespace();
    if fields.next() == Some("Z") {
        return None;
    }
    let [user, system] = [fields.nth(10)?, fields.next()?].map(|ticks| ticks.parse::<u64>());
    Some(user.unwrap() + system.unwrap())
}

/// The processor time that the program itself takes to decode a file.
fn decoding_time(image: &[u8]) -> u64 {
    let mut child = program()
        .args(["decode", "--max-pixels=40000000", "--max-side=16384"])
        .arg(format!("--bytes={}", image.len()))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(image).unwrap();
    let mut output = vec![0; 9 + 3 * usize::from(LARGE.0) * usize::from(LARGE.1)];
    child.stdout.as_mut().unwrap().read_exact(&mut output[..1]).unwrap();
    // It writes what it has decoded.
    let took = processor_time(child.id()).unwrap();
    child.stdout.as_mut().unwrap().read_exact(&mut output[1..]).unwrap();
    assert!(child.wait().unwrap().success() && output[0] == b'S');
    took
}

#[test]
fn a_client_that_leaves_ends_the_process_within_a_tenth_of_a_second_at_any_moment() {
    let server = Server::start(&FLAGS);
    for (kind, make) in KINDS {
        let image = make(LARGE.0, LARGE.1);
        let decoding = decoding_time(&image);
        println!("{kind}: {} bytes, {decoding} hundredths of a second", image.len());
        // Far longer than it may go on.
        assert!(decoding > 20, "{kind}: {decoding}");
        for eighths in [0, 2, 4, 5, 6, 7] {
            assert_once_within(Duration::from_millis(100), || {
                let client = begin(&server, &image);
                let decoder = decoder_of(&server);
                while processor_time(decoder).is_some_and(|used| used < eighths * decoding / 8) {
                    thread::sleep(Duration::from_millis(2));
                }
                drop(client);
                let left = Instant::now();
                while is_there(decoder) || server.metric("pixmesh_jobs_in_progress") > 0.0 {
                    assert!(left.elapsed() < PATIENCE, "{kind}: {eighths}");
                }
                println!("{kind}, left at {eighths}/8: {:?}", left.elapsed());
                left.elapsed()
            });
        }
    }
    assert_eq!(outcome(&server, "not_started") + outcome(&server, "failed"), 0.0);
    assert!(outcome(&server, "stopped") >= 3.0);
    server.wait_until_idle();
    assert_eq!(server.mesh("", &[], &disc(30, 30, 1)).status, 200);
}

#[test]
fn a_picture_from_a_process_is_the_one_that_the_library_decodes_and_so_are_refusals() {
    let server = Server::start(&FLAGS);
    let options = DecodeOptions::default();
    let parameters = Method::Med.parameters(Target::Size(100)).generator(Generator::Uniform);
    // Hardly larger than what is decoded in the service.
    let sizes = [(3600, 2300), (3200, 2000), (2000, 1600)];
    for (n, ((kind, make), (width, height))) in KINDS.into_iter().zip(sizes).enumerate() {
        let image = make(width, height);
        assert!(options.may_stop_late(&image), "{kind}");
        assert!(!options.may_stop_late(&make(width, height - 200)), "{kind}");
        let decoded = options.decode(&image).unwrap();
        let made = mesh_image(&decoded, &parameters, &()).unwrap();
        let mut model = Vec::new();
        write_model(&made.mesh, &mut model).unwrap();
        let answer = server.mesh(QUERY, &[], &image);
        assert_eq!(answer.status, 200, "{kind}: {}", answer.text());
        assert!(answer.body == model, "{kind}");
        // The error is that of all samples.
        assert_eq!(answer.header("mesh-mse"), made.fidelity.mse().to_string(), "{kind}");
        assert!(answer.header("server-timing").contains("decode;dur="));
        let broken = &image[..image.len() - 200_000 / (n + 1)];
        let problem = match options.decode(broken) {
            // What a decoder does not miss has no bytes less.
            Ok(_) => continue,
            Err(error) => error.to_string(),
        };
        let refused = server.mesh(QUERY, &[], broken);
        assert_eq!(refused.problem(422, "image-decode-failed")["detail"], problem, "{kind}");
    }
    assert!(outcome(&server, "done") >= 4.0);
    assert_eq!(outcome(&server, "not_started") + outcome(&server, "failed"), 0.0);
    let small = KINDS[0].1(640, 480);
    let before = outcome(&server, "done");
    assert_eq!(server.mesh(QUERY, &[], &small).status, 200);
    assert_eq!(outcome(&server, "done"), before, "what stops soon is decoded here");
}

#[test]
fn a_process_that_is_ended_from_outside_is_told_and_the_next_request_is_served() {
    let server = Server::start(&FLAGS);
    let image = KINDS[0].1(LARGE.0, LARGE.1);
    let answer = thread::scope(|scope| {
        let asked = scope.spawn(|| server.mesh(QUERY, &[], &image));
        send_signal("KILL", decoder_of(&server));
        asked.join().unwrap()
    });
    let problem = answer.problem(503, "overloaded");
    assert!(problem["detail"].as_str().unwrap().contains("signal 9"), "{problem}");
    assert!(!answer.header("retry-after").is_empty());
    assert_eq!(outcome(&server, "failed"), 1.0);
    server.wait_until_idle();
    assert_eq!(server.mesh(QUERY, &[], &KINDS[0].1(3600, 2500)).status, 200);
    assert_eq!(outcome(&server, "done"), 1.0);
}

#[test]
fn a_signal_to_all_processes_lets_the_picture_be_finished() {
    let mut server = Server::start(&FLAGS);
    let image = KINDS[1].1(LARGE.0, LARGE.1);
    let public = server.public;
    let (decoder, answer) = thread::scope(|scope| {
        let asked = scope.spawn(|| {
            crate::client::try_send(public, "POST", &format!("/v1/meshes?{QUERY}"), &[], &image)
        });
        let decoder = decoder_of(&server);
        // It has had time to say that it leaves signals to others.
        server.wait_until("it reads", || has_read(decoder, image.len()));
        send_signal("TERM", decoder);
        send_signal("INT", decoder);
        server.signal("TERM");
        (decoder, asked.join().unwrap())
    });
    let answer = answer.expect("an accepted request has an answer");
    assert!(answer.status == 200 || answer.status == 503, "{}", answer.text());
    assert!(!answer.text().contains("signal"), "{}", answer.text());
    assert_eq!(server.wait().code(), Some(0));
    assert!(!is_there(decoder));
}

/// Whether a process has read so many bytes.
fn has_read(process: u32, bytes: usize) -> bool {
    let Ok(io) = fs::read_to_string(format!("/proc/{process}/io")) else { return true };
    let read = io.lines().find_map(|line| line.strip_prefix("rchar: ")).unwrap();
    read.parse::<usize>().unwrap() >= bytes
}

#[test]
fn no_process_outlives_a_service_that_is_killed() {
    let mut server = Server::start(&FLAGS);
    let image = KINDS[2].1(LARGE.0, LARGE.1);
    let client = begin(&server, &image);
    let decoder = decoder_of(&server);
    server.kill();
    let killed = Instant::now();
    // Whoever has inherited it may not have taken note of its end.
    while processor_time(decoder).is_some() {
        assert!(killed.elapsed() < PATIENCE);
    }
    drop(client);
}

#[test]
fn where_no_process_can_be_started_the_picture_is_decoded_all_the_same() {
    let hidden = |script: &str| {
        let mut command = Command::new("unshare");
        command.args(["--user", "--map-root-user", "--mount", "sh", "-c", script]);
        command.arg(program().get_program());
        for (name, value) in program().get_envs() {
            assert!(value.is_none(), "it only takes settings away");
            command.env_remove(name);
        }
        command
    };
    let script = "mount -t tmpfs tmpfs /proc && exec \"$0\" \"$@\"";
    if !hidden(script).arg("--version").output().is_ok_and(|output| output.status.success()) {
        return println!("skipped: /proc could not be hidden from the service");
    }
    let server = Server::start_as(hidden(script), &FLAGS, Arc::default());
    let image = KINDS[0].1(3600, 2500);
    let answer = server.mesh(QUERY, &[], &image);
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(outcome(&server, "not_started"), 1.0);
    assert!(server.log().contains("no process could be started"), "{}", server.log());
}
