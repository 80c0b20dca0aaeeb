//! The examples that run from a shell, against a service that needs a key.

use crate::keys::KeysFile;
use crate::server::Server;
use crate::tools::{checkout, require, run, text};
use std::path::PathBuf;
use std::process::Command;

const PICTURE: &str = "docs/images/picture.png";
/// What every example says of the picture.
const FIGURES: &str = "1966 vertices, 3877 faces, 43.";

/// A service with a key.
struct Service {
    server: Server,
    key: String,
    folder: PathBuf,
}

impl Service {
    fn start(test: &str) -> Self {
        let file = KeysFile::new(test);
        let key = file.issue("examples");
        let server = Server::start(&["--keys-file", file.path()]);
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(test);
        std::fs::create_dir_all(&folder).unwrap();
        Self { server, key, folder }
    }

    /// A command that knows the service, in a folder of its own.
    fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.env("PIXMESH_URL", format!("http://{}", self.server.public));
        command.env("PIXMESH_KEY", &self.key).current_dir(&self.folder);
        command
    }
}

#[test]
fn curl_makes_a_mesh_and_shows_a_refusal() {
    require("curl");
    let service = Service::start("example-curl");
    let script = checkout("examples/mesh.sh");
    let figures = run(service.command("bash").arg(&script).arg(checkout(PICTURE)));
    assert!(figures.to_lowercase().contains("mesh-vertices: 1966"), "{figures}");
    assert!(service.folder.join("mesh.model").exists());
    let refused = service
        .command("bash")
        .arg(script)
        .arg(checkout(PICTURE))
        .arg("density=0")
        .output()
        .unwrap();
    assert!(!refused.status.success() && text(&refused).contains("parameter-out-of-range"));
}

#[test]
fn curl_follows_a_job_and_shows_a_refusal() {
    require("curl");
    let service = Service::start("example-curl-job");
    let call = |query: &str| {
        let mut command = service.command("bash");
        command.arg(checkout("examples/job.sh")).arg(checkout(PICTURE)).arg(query);
        command
    };
    let first = run(&mut call("density=2"));
    assert!(
        first.contains(r#""state":"queued""#) && first.contains(r#""vertices":1966"#),
        "{first}"
    );
    let model = std::fs::read_to_string(service.folder.join("mesh.model")).unwrap();
    assert!(model.contains("OFF\n1966 "), "{model:.40}");
    assert!(std::fs::read(service.folder.join("rebuilt.png")).unwrap().starts_with(b"\x89PNG"));
    let again = run(&mut call("density=2"));
    assert_eq!(id_in(&first), id_in(&again), "the same word is the same job");
    let refused = call("density=0").output().unwrap();
    assert!(!refused.status.success());
    assert!(text(&refused).contains("parameter-out-of-range"), "{}", text(&refused));
}

/// The id of the first job that is spoken of.
fn id_in(output: &str) -> &str {
    let (_, rest) = output.split_once(r#""id":""#).unwrap();
    rest.split('"').next().unwrap()
}

#[test]
fn python_follows_a_job_and_shows_a_refusal() {
    require("python3");
    makes_a_mesh("example-python-job", "python3", "examples/job.py");
}

#[test]
fn javascript_follows_a_job_and_shows_a_refusal() {
    require("node");
    makes_a_mesh("example-javascript-job", "node", "examples/job.mjs");
}

#[test]
fn python_makes_a_mesh_and_shows_a_refusal() {
    require("python3");
    makes_a_mesh("example-python", "python3", "examples/mesh.py");
}

#[test]
fn javascript_makes_a_mesh_and_shows_a_refusal() {
    require("node");
    makes_a_mesh("example-javascript", "node", "examples/mesh.mjs");
}

fn makes_a_mesh(test: &str, program: &str, script: &str) {
    let service = Service::start(test);
    let call = |parameters: &[&str]| {
        let mut command = service.command(program);
        command.arg(checkout(script)).arg(checkout(PICTURE)).args(parameters);
        command
    };
    assert!(run(&mut call(&[])).contains(FIGURES));
    let refused = call(&["density=5", "size=100"]).output().unwrap();
    assert!(!refused.status.success());
    assert!(text(&refused).contains("conflicting-parameters"), "{}", text(&refused));
    let nobody = call(&[]).env("PIXMESH_KEY", "wrong").output().unwrap();
    assert!(text(&nobody).contains("unauthorized"), "{}", text(&nobody));
}

#[test]
fn the_typed_client_compiles_against_the_document_and_runs() {
    require("npm");
    require("examples/typescript/node_modules");
    let folder = checkout("examples/typescript");
    let npm =
        |script: &str| Command::new("npm").args(["run", script]).current_dir(&folder).output();
    for script in ["generate", "build"] {
        let output = npm(script).unwrap();
        assert!(output.status.success(), "{}", text(&output));
    }
    let service = Service::start("example-typescript");
    let program = folder.join("build/mesh.js");
    let printed = run(service.command("node").arg(program).arg(checkout(PICTURE)));
    assert!(printed.contains(FIGURES), "{printed}");
    assert!(printed.contains("methods: ed, med,"), "{printed}");
    assert!(printed.contains("job: completed, 986 vertices"), "{printed}");
    assert!(printed.contains("refused: /problems/conflicting-parameters, size"), "{printed}");
    let mistake = folder.join("mistake.ts");
    let text_of_mistake = "import createClient from 'openapi-fetch';\n\
        import type { paths } from './schema.js';\n\
        await createClient<paths>().GET('/v1/meshse');\n";
    std::fs::write(&mistake, text_of_mistake).unwrap();
    let flags = ["tsc", "--noEmit", "--module", "nodenext", "--target", "es2022", "mistake.ts"];
    let output = Command::new("npx").args(flags).current_dir(&folder).output().unwrap();
    std::fs::remove_file(mistake).unwrap();
    assert!(!output.status.success(), "a path that is not in the document does not compile");
}
