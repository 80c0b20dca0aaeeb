//! The commands of the documents, run from the first to the last of each as they are printed.

use crate::pictures::disc;
use crate::server::{Server, program};
use crate::tools::{checkout, require, run, text};
use pixmesh_engine::ParameterSet;
use pixmesh_engine::params::{TABLE, Takes};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

/// Commands that are not run here, by their first words, and why.
const NOT_RUN: [(&str, &str); 19] = [
    ("./test", "it runs these tests"),
    ("cargo install --path .", "the program is on the path already"),
    ("pixmesh mesh docs/images/picture.png --weights", "it needs a picture that the reader paints"),
    ("pixmesh doctor", "it judges the machine"),
    ("cargo install --path crates/cli", "the programs are on the path already"),
    ("cargo install cargo-fuzz", "it installs a program of others"),
    ("cd fuzz && cargo +nightly fuzz run", "it needs a nightly compiler and runs ten minutes"),
    ("cargo install cargo-llvm-cov cargo-gamma", "it installs programs of others"),
    ("cargo llvm-cov", "it builds everything anew"),
    ("cargo gamma run", "it builds everything anew and runs for hours"),
    ("docker build ", "it needs a container engine; deploy/container/verify builds the image"),
    ("docker run ", "it needs a container engine; deploy/container/verify runs the image"),
    ("docker buildx build", "it needs a container engine and a registry"),
    ("rustup target add", "it installs a part of the compiler"),
    ("export CARGO_TARGET_AARCH64", "it serves the next command alone"),
    ("cargo build --bins --workspace --target", "it needs a compiler for ARM"),
    ("pip install -r docs/terrain", "it installs programs of others"),
    ("cargo build --release", "it builds everything anew"),
    ("docs/terrain/compare.py", "it needs programs of others and runs for minutes"),
];

/// Commands of many nodes: `tests/cluster/document.rs` runs them with a database and a store.
const OF_MANY_NODES: [&str; 2] = ["pixmesh serve --queue", "pixmesh worker --queue"];

/// What Cargo would build anew, and the program that it has built for the tests.
const BUILT: [(&str, &str); 3] = [
    ("cargo run --release -p pixmesh-cli --example quality --", "quality"),
    ("cargo run --release -p pixmesh-thesis --", "thesis_tables"),
    ("cargo run --release --", "pixmesh"),
];

/// Published figures of a picture, as `docs/thesis.md` describes the file.
const FIGURES: &str = "table,image,components,method,density_percent,unit,value\n\
    4.2b,lena,1,MED,0.5,psnr_db,12.35\n";

/// All documents that print commands for users and maintainers.
fn documents() -> Vec<PathBuf> {
    let mut documents = vec![checkout("README.md"), checkout("CONTRIBUTING.md")];
    for folder in ["docs", "deploy", "tools"] {
        add_documents(&checkout(folder), &mut documents);
    }
    documents
}

fn add_documents(folder: &Path, documents: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            add_documents(&path, documents);
        } else if path.extension().is_some_and(|extension| extension == "md") {
            documents.push(path);
        }
    }
}

/// The commands of a document, each in one line with single spaces.
fn commands(document: &Path) -> Vec<String> {
    let text = fs::read_to_string(document).unwrap();
    let mut commands = Vec::new();
    for block in text.split("```").skip(1).step_by(2) {
        let (language, body) = block.split_once('\n').unwrap();
        match language {
            "sh" => commands.extend(commands_of_block(body)),
            "yaml" | "rust" | "js" | "python" | "text" => {}
            _ => panic!("{}: a block in {language:?}", document.display()),
        }
    }
    commands
}

fn commands_of_block(body: &str) -> Vec<String> {
    let lines = body.replace("\\\n", " ");
    let words = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
    let is_command = |line: &String| !line.is_empty() && !line.starts_with('#');
    lines.lines().map(words).filter(is_command).collect()
}

fn is_run(command: &str) -> bool {
    let elsewhere = NOT_RUN.iter().map(|(first, _)| first).chain(&OF_MANY_NODES);
    !elsewhere.into_iter().any(|first| command.starts_with(first))
}

/// Somebody who reads documents in a copy of the checkout, with the programs installed.
struct Reader {
    folder: PathBuf,
    server: Option<Server>,
    printed: String,
}

impl Reader {
    fn new(test: &str) -> Self {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(test);
        let _ = fs::remove_dir_all(&folder);
        for pictures in ["FOLDER", "pictures"] {
            fs::create_dir_all(folder.join(pictures)).unwrap();
            for name in ["lena.png", "kodim23.png"] {
                fs::write(folder.join(pictures).join(name), disc(40, 32, 3)).unwrap();
            }
        }
        fs::write(folder.join("FIGURES.csv"), FIGURES).unwrap();
        let heights = "crates/codec/tests/samples/elevation/f32_tiled.tif";
        fs::copy(checkout(heights), folder.join("model.tif")).unwrap();
        run(Command::new("cp").arg("-r").args(["docs", "tools"].map(checkout)).arg(&folder));
        fs::create_dir(folder.join("target")).unwrap();
        std::os::unix::fs::symlink(built(), folder.join("target/release")).unwrap();
        Self { folder, server: None, printed: String::new() }
    }

    /// Runs the commands of a document. One that serves runs until the next one that does.
    fn follow(&mut self, document: &Path) {
        let mut script = String::new();
        for command in commands(document).iter().filter(|command| is_run(command)) {
            let (cargo, program) =
                BUILT.iter().find(|(cargo, _)| command.starts_with(cargo)).unwrap_or(&("", ""));
            let command = format!("{program}{}", &command[cargo.len()..]);
            if let Some(flags) = command.strip_prefix("pixmesh serve") {
                self.run(&script);
                self.serve(flags);
                script.clear();
            } else {
                script += &format!("{command}\n");
            }
        }
        self.run(&script);
    }

    fn serve(&mut self, flags: &str) {
        self.server = None;
        let mut command = program();
        command.current_dir(&self.folder);
        let flags: Vec<_> = flags.split_whitespace().collect();
        self.server = Some(Server::start_as(command, &flags, Arc::default()));
    }

    /// Runs commands, which reach the service at its ports. The last line that was printed, that
    /// of a new key, is `KEY`.
    fn run(&mut self, script: &str) {
        let mut script = script.to_owned();
        if let Some(server) = &self.server {
            script = script
                .replace("127.0.0.1:8080", &server.public.to_string())
                .replace("127.0.0.1:8081", &server.operations.to_string());
        }
        let python = checkout("crates/codec/tests/readers/venv/bin");
        let inherited = std::env::var_os("PATH").unwrap();
        let path = [built(), built().join("examples"), python]
            .into_iter()
            .chain(std::env::split_paths(&inherited));
        let output = Command::new("sh")
            .args(["-ec", &script])
            .current_dir(&self.folder)
            .env("PATH", std::env::join_paths(path).unwrap())
            .env("KEY", self.printed.lines().last().unwrap_or_default())
            .output()
            .unwrap();
        assert!(output.status.success(), "{script}{}", text(&output));
        self.printed += &String::from_utf8(output.stdout).unwrap();
    }

    fn file(&self, name: &str) -> Vec<u8> {
        fs::read(self.folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    fn text(&self, name: &str) -> String {
        String::from_utf8(self.file(name)).unwrap()
    }
}

/// The folder of the programs, which `cargo test --workspace` builds before it runs the tests.
fn built() -> PathBuf {
    Path::new(env!("CARGO_BIN_EXE_pixmesh")).parent().unwrap().to_owned()
}

#[test]
fn the_commands_of_the_readme_work_as_printed() {
    require("curl");
    let mut reader = Reader::new("readme");
    reader.follow(&checkout("README.md"));
    assert!(reader.file("picture.model").starts_with(b"384 256 3 8\nOFF\n1966 3877 5842\n"));
    for name in ["picture.glb", "job.glb", "mountains.glb"] {
        assert!(reader.file(name).starts_with(b"glTF"), "{name}");
    }
    for name in ["rebuilt.png", "small.png"] {
        assert!(reader.file(name).starts_with(b"\x89PNG"), "{name}");
    }
    assert!(reader.text("headers.txt").contains("mesh-vertices: 1000"));
    let printed = &reader.printed;
    assert!(printed.contains("\"state\":\"completed\""), "the job was followed: {printed}");
    assert!(printed.contains("PSNR 43.5"), "the figure of the first picture: {printed}");
}

#[test]
fn the_commands_of_the_other_documents_work_as_printed() {
    let mut reader = Reader::new("documents");
    for document in documents().iter().skip(1) {
        reader.follow(document);
    }
    assert!(reader.text("tables.md").contains("(12.35)"));
    assert!(reader.text("JOURNAL.csv").lines().count() > 100);
    let quality = reader.text("docs/quality.md");
    assert!(quality != fs::read_to_string(checkout("docs/quality.md")).unwrap());
    assert!(reader.text("docs/quality/figures.csv").contains("kodim23-colour,"));
    assert!(reader.file("model.glb").starts_with(b"glTF"));
    assert!(reader.printed.contains("| lena-colour | optimal 5 |"), "{}", reader.printed);
    assert!(reader.printed.contains("\"ssim\":0.9"), "{}", reader.printed);
    assert!(reader.file("rebuilt.ppm").starts_with(b"P6"));
    assert_eq!(reader.file("gamma.toml"), fs::read(checkout("tools/mutants/gamma.toml")).unwrap());
}

/// The guide's page of parameters, from the table that the parser works by.
fn parameters_page() -> String {
    let defaults = ParameterSet::of_query(None).unwrap().finish().unwrap();
    let mut page = String::from(
        "# Parameters\n\nThe names over HTTP and in forms; the program writes `-` for `_`. A default is that of the method \
         `mgprfs`;\nwhere there is none, the parameter is not set.\n\n\
         | parameter | values | default | what |\n|---|---|---|---|\n",
    );
    for row in &TABLE {
        let values = match row.takes {
            Takes::Decimal { least, most } => format!("{least} to {most}"),
            Takes::Whole { least, most } => format!("{least} to {most}, whole"),
            Takes::Flag => "`true`, `false`".into(),
            Takes::Word(words) => format!("`{}`", words.join("`, `")),
            Takes::Pattern(pattern) => format!("`{}`", pattern.replace('|', "\\|")),
        };
        let default = row.show(&defaults).map(|value| format!("`{value}`")).unwrap_or_default();
        let about = row.about.replace('|', "\\|");
        page += &format!("| `{}` | {values} | {default} | {about} |\n", row.name);
    }
    page
}

/// `PIXMESH_WRITE_DOCUMENTS=1` writes the page.
#[test]
fn the_page_of_parameters_is_that_of_the_table() {
    let path = checkout("docs/guide/parameters.md");
    if std::env::var_os("PIXMESH_WRITE_DOCUMENTS").is_some() {
        fs::write(&path, parameters_page()).unwrap();
    }
    let written = fs::read_to_string(&path).unwrap();
    assert!(
        written == parameters_page(),
        "PIXMESH_WRITE_DOCUMENTS=1 cargo test --test clients parameters writes docs/guide/parameters.md anew"
    );
}

/// The targets of a document's links and pictures, but those on the network.
fn links(text: &str) -> impl Iterator<Item = &str> {
    let targets = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    targets.filter(|target| !target.contains("://"))
}

/// The anchor of a heading, as Markdown's renderers make it.
fn anchor(heading: &str) -> String {
    let kept = heading
        .to_lowercase()
        .replace(|letter: char| !letter.is_alphanumeric() && !" -_".contains(letter), "");
    kept.trim().replace(' ', "-")
}

#[test]
fn links_of_the_documents_lead_to_files_and_headings() {
    for document in documents() {
        let text = fs::read_to_string(&document).unwrap();
        for link in links(&text) {
            let (path, heading) = link.split_once('#').unwrap_or((link, ""));
            let target = match path {
                "" => document.clone(),
                path => document.parent().unwrap().join(path),
            };
            assert!(target.exists(), "{}: {link}", document.display());
            let is_found = heading.is_empty() || {
                let text = fs::read_to_string(&target).unwrap();
                let headings = text.lines().filter_map(|line| line.strip_prefix('#'));
                headings
                    .map(|line| anchor(line.trim_start_matches('#').trim()))
                    .any(|anchor| anchor == heading)
            };
            assert!(is_found, "{}: {link}", document.display());
        }
    }
}

#[test]
fn the_guide_lists_every_page() {
    let listed = fs::read_to_string(checkout("docs/SUMMARY.md")).unwrap();
    let mut pages = Vec::new();
    add_documents(&checkout("docs"), &mut pages);
    let pages = pages.iter().map(|page| page.strip_prefix(checkout("docs")).unwrap());
    let missing: Vec<_> = pages
        .filter(|page| *page != Path::new("SUMMARY.md"))
        .filter(|page| !listed.contains(&format!("({})", page.display())))
        .collect();
    assert!(missing.is_empty(), "{missing:?}");
}

#[test]
fn every_exception_stands_for_a_command_in_the_documents() {
    let printed: Vec<String> = documents().iter().flat_map(|path| commands(path)).collect();
    let not_run = NOT_RUN.iter().map(|(first, _)| first);
    let built = BUILT.iter().map(|(first, _)| first);
    let idle: Vec<_> = not_run
        .chain(&OF_MANY_NODES)
        .chain(built)
        .filter(|first| !printed.iter().any(|command| command.starts_with(*first)))
        .collect();
    assert!(idle.is_empty(), "no document has {idle:?}");
}

#[test]
fn containers_publish_their_ports_to_their_machine_alone() {
    let printed: Vec<String> = documents().iter().flat_map(|path| commands(path)).collect();
    let mut published = 0;
    for command in printed.iter().filter(|command| command.starts_with("docker run ")) {
        for port in command.split(" -p ").skip(1) {
            assert!(port.starts_with("127.0.0.1:"), "{command}");
            published += 1;
        }
    }
    assert!(published > 0);
}

#[test]
fn the_service_listens_where_the_readme_says() {
    let readme = fs::read_to_string(checkout("README.md")).unwrap();
    let defaults = run(program().args(["serve", "--help"]));
    for address in ["127.0.0.1:8080", "127.0.0.1:8081"] {
        assert!(defaults.contains(address) && readme.contains(address), "{address}");
    }
}

#[test]
fn every_setting_that_the_limits_name_exists() {
    let limits = fs::read_to_string(checkout("docs/guide/limits.md")).unwrap();
    let help = run(program().args(["serve", "--help"]));
    let named = limits.split('`').filter(|word| word.starts_with("--"));
    let unknown: Vec<&str> = named
        .filter(|flag| !help.contains(&format!("{flag} ")) && !help.contains(&format!("{flag}\n")))
        .collect();
    assert!(unknown.is_empty(), "{unknown:?}");
}

#[test]
fn the_report_on_load_has_no_values_as_rust_prints_them() {
    let report = fs::read_to_string(checkout("docs/load.md")).unwrap();
    for debugging in ["Some(", "None", "Ok(", "Err(", "[(", " { ", "::"] {
        assert!(!report.contains(debugging), "{debugging}");
    }
}
