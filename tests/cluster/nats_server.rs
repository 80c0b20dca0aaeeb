//! Real servers of the broker, each a process with a folder of its own; killed when dropped.

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Where `./test` installs the server.
const INSTALLED: &str = "tests/cluster/.venv/bin/nats-server";

/// The program, or `None` when there is none and none must be.
pub(crate) fn program() -> Option<PathBuf> {
    let folders = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
    if let Some(installed) = folders.map(|folder| folder.join(INSTALLED)).find(|path| path.exists())
    {
        return Some(installed);
    }
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&paths).map(|folder| folder.join("nats-server"));
    if let Some(found) = found.into_iter().find(|path| path.exists()) {
        return Some(found);
    }
    assert!(std::env::var_os("PIXMESH_REQUIRE_TOOLS").is_none(), "nats-server is missing");
    eprintln!("left out: nats-server is missing; ./test installs it");
    None
}

/// A port that is free now.
pub(crate) fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// A server.
#[derive(Debug)]
pub(crate) struct NatsServer {
    program: PathBuf,
    child: Child,
    flags: Vec<String>,
    folder: PathBuf,
    pub(crate) port: u16,
}

impl NatsServer {
    /// Starts one with JetStream, which syncs what it is given before it says so.
    pub(crate) fn start(program: &Path) -> Self {
        Self::start_with(program, "jetstream { sync_interval: always, store_dir: \"STORE\" }")
    }

    /// Starts one with a configuration, in which `STORE` stands for its folder.
    pub(crate) fn start_with(program: &Path, configuration: &str) -> Self {
        Self::start_at(program, free_port(), configuration)
    }

    /// Starts three that know each other: everything is on a majority of them.
    pub(crate) fn start_cluster(program: &Path) -> Vec<Self> {
        let routes: [u16; 3] = std::array::from_fn(|_| free_port());
        let others = routes.map(|port| format!("nats://127.0.0.1:{port}")).join(", ");
        let start = |n: usize| {
            let configuration = format!(
                "server_name: n{n}\njetstream {{ sync_interval: always, store_dir: \"STORE\" }}\n\
                 cluster {{ name: pixmesh, listen: \"127.0.0.1:{}\", routes: [{others}] }}",
                routes[n]
            );
            Self::start_with(program, &configuration)
        };
        (0..3).map(start).collect()
    }

    /// Starts one at a port.
    pub(crate) fn start_at(program: &Path, port: u16, configuration: &str) -> Self {
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let folder =
            std::env::temp_dir().join(format!("pixmesh-nats-{}-{count}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let file = configured(&folder, configuration);
        let log = folder.join("log").display().to_string();
        let flags = vec![
            "--addr".into(),
            "127.0.0.1".into(),
            "--port".into(),
            port.to_string(),
            "--config".into(),
            file.display().to_string(),
            "--log".into(),
            log,
        ];
        let child = run(program, &flags);
        let server = Self { program: program.to_owned(), child, flags, folder, port };
        server.wait_until_it_listens();
        server
    }

    /// The address that clients use.
    pub(crate) fn address(&self) -> String {
        format!("nats://127.0.0.1:{}", self.port)
    }

    /// Ends the process as if the machine had failed.
    pub(crate) fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Starts it again with what it kept.
    pub(crate) fn restart(&mut self) {
        self.kill();
        self.child = run(&self.program, &self.flags);
        self.wait_until_it_listens();
    }

    /// The same with another configuration.
    pub(crate) fn restart_with(&mut self, configuration: &str) {
        configured(&self.folder, configuration);
        self.restart();
    }

    fn wait_until_it_listens(&self) {
        let began = Instant::now();
        while std::net::TcpStream::connect(("127.0.0.1", self.port)).is_err() {
            assert!(began.elapsed() < Duration::from_secs(20), "{}", self.log());
            thread::sleep(Duration::from_millis(10));
        }
    }

    /// What it logged.
    pub(crate) fn log(&self) -> String {
        std::fs::read_to_string(self.folder.join("log")).unwrap_or_default()
    }
}

/// Writes a server's configuration into its folder, and returns where it is.
fn configured(folder: &Path, configuration: &str) -> PathBuf {
    let file = folder.join("server.conf");
    let store = folder.join("store").display().to_string();
    std::fs::write(&file, configuration.replace("STORE", &store)).unwrap();
    file
}

fn run(program: &Path, flags: &[String]) -> Child {
    let mut command = Command::new(program);
    command.args(flags).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

impl Drop for NatsServer {
    fn drop(&mut self) {
        self.kill();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
