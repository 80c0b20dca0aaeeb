//! The examples that run from a shell, against a service that needs a key.

use crate::keys::KeysFile;
use crate::server::Server;
use crate::tools::{checkout, require, run, text};
use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

const PICTURE: &str = "docs/images/picture.png";
/// What every example says of the picture.
pub(crate) const FIGURES: &str = "1966 vertices, 3877 faces, 43.";

/// A query that the service refuses.
const REFUSED: &str = "density=5&size=100";

/// An example that runs against a service with a key, in a folder of its own.
struct Example {
    server: Server,
    key: String,
    folder: PathBuf,
    program: &'static str,
    script: PathBuf,
}

impl Example {
    fn new(test: &str, program: &'static str, script: &str) -> Self {
        require(program);
        let file = KeysFile::new(test);
        let key = file.issue("examples");
        let server = Server::start(&["--keys-file", file.path()]);
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(test);
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        Self { server, key, folder, program, script: checkout(script) }
    }

    fn call(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(self.program);
        command.arg(&self.script).args(arguments).current_dir(&self.folder);
        command.env("PIXMESH_URL", format!("http://{}", self.server.public));
        command.env("PIXMESH_KEY", &self.key);
        command
    }

    /// A call with the picture and parameters.
    fn mesh(&self, parameters: &[&str]) -> Command {
        let picture = checkout(PICTURE);
        self.call(&[&[picture.to_str().unwrap()], parameters].concat())
    }

    /// Without arguments it says how it is used.
    fn says_how_it_is_used(&self) {
        let output = self.call(&[]).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(output.stdout.is_empty() && text(&output).starts_with("usage: "));
        assert!(self.files().is_empty(), "{:?}", self.files().keys());
    }

    /// With a picture it saves its results, which begin with these bytes; returns what it printed.
    fn saves(&self, results: &[(&str, &[u8])]) -> String {
        let printed = run(&mut self.mesh(&[]));
        let files = self.files();
        assert!(files.keys().eq(results.iter().map(|(name, _)| name)), "{:?}", files.keys());
        for (name, beginning) in results {
            assert!(files[*name].starts_with(beginning), "{name}");
        }
        printed
    }

    /// A call that fails says why, and leaves the files as they are.
    fn keeps_its_files(&self, call: &mut Command, reason: &str) {
        let files = self.files();
        let output = call.output().unwrap();
        assert!(!output.status.success(), "{}", text(&output));
        assert!(text(&output).contains(reason), "{}", text(&output));
        assert!(self.files() == files, "{:?} of {:?}", self.files().keys(), files.keys());
    }

    /// Whatever fails, the former results stay.
    fn keeps_its_results(&self, refused: &[&str]) {
        self.keeps_its_files(&mut self.mesh(refused), "conflicting-parameters");
        self.keeps_its_files(self.mesh(&[]).env("PIXMESH_KEY", "wrong"), "unauthorized");
        // No service can be asked at port 0.
        let nobody = "http://127.0.0.1:0";
        self.keeps_its_files(self.mesh(&[]).env("PIXMESH_URL", nobody), "");
    }

    /// The files in the folder, by name.
    fn files(&self) -> BTreeMap<String, Vec<u8>> {
        let entries = fs::read_dir(&self.folder).unwrap().map(Result::unwrap);
        let named = |entry: fs::DirEntry| {
            (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap())
        };
        entries.map(named).collect()
    }
}

const MODEL: (&str, &[u8]) = ("mesh.model", b"384 256 3 8\nOFF\n1966 3877 5842\n");
const GLB: (&str, &[u8]) = ("mesh.glb", b"glTF");

#[test]
fn curl_saves_a_mesh() {
    require("curl");
    let example = Example::new("example-curl", "bash", "examples/mesh.sh");
    example.says_how_it_is_used();
    let figures = example.saves(&[MODEL]);
    assert!(figures.to_lowercase().contains("mesh-vertices: 1966"), "{figures}");
    example.keeps_its_results(&[REFUSED]);
    run(&mut example.mesh(&["density=2&format=glb"]));
    assert!(example.files()[GLB.0].starts_with(GLB.1));
}

#[test]
fn curl_follows_a_job() {
    require("curl");
    let example = Example::new("example-curl-job", "bash", "examples/job.sh");
    example.says_how_it_is_used();
    let first = example.saves(&[MODEL, ("rebuilt.png", b"\x89PNG")]);
    assert!(
        first.contains(r#""state":"queued""#) && first.contains(r#""vertices":1966"#),
        "{first}"
    );
    let again = run(&mut example.mesh(&[]));
    assert_eq!(id_in(&first), id_in(&again), "the same word is the same job");
    example.keeps_its_results(&[REFUSED]);
}

/// The id of the first job that is spoken of.
fn id_in(output: &str) -> &str {
    let (_, rest) = output.split_once(r#""id":""#).unwrap();
    rest.split('"').next().unwrap()
}

#[test]
fn python_saves_a_mesh() {
    makes_a_mesh("example-python", "python3", "examples/mesh.py", MODEL);
}

#[test]
fn python_follows_a_job() {
    makes_a_mesh("example-python-job", "python3", "examples/job.py", GLB);
}

#[test]
fn javascript_saves_a_mesh() {
    makes_a_mesh("example-javascript", "node", "examples/mesh.mjs", MODEL);
}

#[test]
fn javascript_follows_a_job() {
    makes_a_mesh("example-javascript-job", "node", "examples/job.mjs", GLB);
}

fn makes_a_mesh(test: &str, program: &'static str, script: &str, result: (&str, &[u8])) {
    let example = Example::new(test, program, script);
    example.says_how_it_is_used();
    let printed = example.saves(&[result]);
    assert!(printed.contains(FIGURES), "{printed}");
    example.keeps_its_results(&REFUSED.split('&').collect::<Vec<_>>());
}

#[test]
fn the_typed_client_compiles_against_the_document_and_saves_a_mesh() {
    require("npm");
    require("examples/typescript/node_modules");
    let folder = checkout("examples/typescript");
    let npm =
        |script: &str| Command::new("npm").args(["run", script]).current_dir(&folder).output();
    for script in ["generate", "build"] {
        let output = npm(script).unwrap();
        assert!(output.status.success(), "{}", text(&output));
    }
    let built = "examples/typescript/build/mesh.js";
    let example = Example::new("example-typescript", "node", built);
    example.says_how_it_is_used();
    let printed = example.saves(&[MODEL]);
    assert!(printed.contains(FIGURES), "{printed}");
    assert!(printed.contains("methods: ed, med,"), "{printed}");
    assert!(printed.contains("job: completed, 986 vertices"), "{printed}");
    assert!(printed.contains("refused: /problems/conflicting-parameters, size"), "{printed}");
    let wrong_key = &mut example.mesh(&[]);
    example.keeps_its_files(wrong_key.env("PIXMESH_KEY", "wrong"), "unauthorized");
    let mistake = folder.join("mistake.ts");
    let text_of_mistake = "import createClient from 'openapi-fetch';\n\
        import type { paths } from './schema.js';\n\
        await createClient<paths>().GET('/v1/meshse');\n";
    fs::write(&mistake, text_of_mistake).unwrap();
    let flags = ["tsc", "--noEmit", "--module", "nodenext", "--target", "es2022", "mistake.ts"];
    let output = Command::new("npx").args(flags).current_dir(&folder).output().unwrap();
    fs::remove_file(mistake).unwrap();
    assert!(!output.status.success(), "a path that is not in the document does not compile");
}
