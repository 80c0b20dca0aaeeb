//! Real database servers and poolers before them, each a process with a folder of its own; killed when
//! dropped.

use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Where Debian's packages have the programs of each version.
const INSTALLED: &str = "/usr/lib/postgresql";
/// Who runs servers where the tests are run by root, for whom they do not run.
const USER: &str = "postgres";
/// How long a server may take to start.
const PATIENCE: Duration = Duration::from_secs(60);

/// The folder with the programs of the newest version, or `None` when there is none and none must be.
pub(crate) fn programs() -> Option<PathBuf> {
    let versions = std::fs::read_dir(INSTALLED).into_iter().flatten().flatten();
    let number = |path: &PathBuf| path.file_name()?.to_str()?.parse::<u32>().ok();
    let newest = versions.map(|entry| entry.path()).max_by_key(number);
    let found = newest.map(|path| path.join("bin")).filter(|path| path.join("initdb").exists());
    found.or_else(|| missing("postgresql"))
}

/// The pooler's program, or `None` when there is none and none must be.
pub(crate) fn pooler() -> Option<PathBuf> {
    let path = PathBuf::from("/usr/sbin/pgbouncer");
    path.exists().then_some(path).or_else(|| missing("pgbouncer"))
}

fn missing(package: &str) -> Option<PathBuf> {
    assert!(std::env::var_os("PIXMESH_REQUIRE_TOOLS").is_none(), "{package} is missing");
    eprintln!("left out: {package} is missing; ./test installs it");
    None
}

/// A database server.
#[derive(Debug)]
pub(crate) struct PostgresServer {
    programs: PathBuf,
    child: Child,
    folder: PathBuf,
    pub(crate) port: u16,
    settings: Vec<String>,
}

impl PostgresServer {
    /// Makes one with settings of its own, as `name=value`, and starts it.
    pub(crate) fn start(programs: &Path, settings: &[&str]) -> Self {
        let folder = new_folder("postgres");
        let made = unprivileged(&programs.join("initdb"))
            .args(["--no-sync", "--auth=trust", "--encoding=UTF8", "--username=pixmesh"])
            .arg("--pgdata")
            .arg(folder.join("data"))
            .stdout(Stdio::null())
            .status();
        assert!(made.unwrap().success(), "initdb");
        let port = free_port();
        let settings: Vec<String> = settings.iter().map(|&setting| setting.into()).collect();
        let child = run(programs, &folder, port, &settings);
        let mut server = Self { programs: programs.to_owned(), child, folder, port, settings };
        server.wait_until_it_answers();
        server
    }

    /// The address that clients use.
    pub(crate) fn url(&self) -> String {
        format!("postgres://pixmesh@127.0.0.1:{}/postgres", self.port)
    }

    /// Ends the processes as if the machine had failed.
    pub(crate) fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Starts it again with what it kept.
    pub(crate) fn restart(&mut self) {
        self.kill();
        self.child = run(&self.programs, &self.folder, self.port, &self.settings);
        self.wait_until_it_answers();
    }

    /// Runs statements.
    pub(crate) fn run_sql(&self, sql: &str) -> String {
        let run = Command::new(self.programs.join("psql"))
            .args(["--no-psqlrc", "--quiet", "--tuples-only", "--no-align", "--command", sql])
            .arg(self.url())
            .output()
            .unwrap();
        assert!(run.status.success(), "{sql}: {}", String::from_utf8_lossy(&run.stderr));
        String::from_utf8_lossy(&run.stdout).trim().to_owned()
    }

    fn wait_until_it_answers(&mut self) {
        let began = Instant::now();
        loop {
            let answers = Command::new(self.programs.join("pg_isready"))
                .args(["--quiet", "--host", "127.0.0.1", "--port", &self.port.to_string()])
                .status();
            if answers.unwrap().success() {
                return;
            }
            // Processes of a server that was killed may have its memory for a moment more.
            if self.child.try_wait().unwrap().is_some() {
                self.child = run(&self.programs, &self.folder, self.port, &self.settings);
            }
            assert!(began.elapsed() < PATIENCE, "{}", self.log());
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// What it logged.
    pub(crate) fn log(&self) -> String {
        std::fs::read_to_string(self.folder.join("log")).unwrap_or_default()
    }
}

impl Drop for PostgresServer {
    fn drop(&mut self) {
        self.kill();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// A pooler before a database server, which lends connections for a transaction each.
#[derive(Debug)]
pub(crate) struct Pooler {
    child: Child,
    folder: PathBuf,
    port: u16,
}

impl Pooler {
    /// Starts one.
    pub(crate) fn start(program: &Path, server: &PostgresServer) -> Self {
        let (folder, port) = (new_folder("pgbouncer"), free_port());
        let file = folder.join("pgbouncer.ini");
        let settings = format!(
            "[databases]\n* = host=127.0.0.1 port={} user=pixmesh\n[pgbouncer]\n\
             listen_addr = 127.0.0.1\nlisten_port = {port}\nunix_socket_dir =\nauth_type = any\n\
             pool_mode = transaction\nmax_client_conn = 500\ndefault_pool_size = 20\n\
             logfile = {}\n",
            server.port,
            folder.join("log").display()
        );
        std::fs::write(&file, settings).unwrap();
        let child = unprivileged(program)
            .arg("--quiet")
            .arg(&file)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let began = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(began.elapsed() < PATIENCE, "the pooler does not start");
            thread::sleep(Duration::from_millis(20));
        }
        Self { child, folder, port }
    }

    /// The address that clients use.
    pub(crate) fn url(&self) -> String {
        format!("postgres://pixmesh@127.0.0.1:{}/postgres", self.port)
    }
}

impl Drop for Pooler {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

fn run(programs: &Path, folder: &Path, port: u16, settings: &[String]) -> Child {
    let log = std::fs::OpenOptions::new().create(true).append(true).open(folder.join("log"));
    let settings = settings.iter().flat_map(|setting| ["-c", setting]);
    unprivileged(&programs.join("postgres"))
        .arg("-D")
        .arg(folder.join("data"))
        .args(["-p", &port.to_string(), "-k", "", "-c", "listen_addresses=127.0.0.1"])
        .args(settings)
        .stdout(Stdio::null())
        .stderr(log.unwrap())
        .spawn()
        .unwrap()
}

/// A command that root runs as somebody else.
fn unprivileged(program: &Path) -> Command {
    if !is_root() {
        return Command::new(program);
    }
    let mut command = Command::new("setpriv");
    command.args(["--reuid", USER, "--regid", USER, "--init-groups"]).arg(program);
    // It may not look into the folder that the tests are run in.
    command.current_dir("/");
    command
}

fn is_root() -> bool {
    let id = Command::new("id").arg("-u").output().unwrap();
    id.stdout.trim_ascii() == b"0"
}

/// A folder that belongs to whoever runs servers.
fn new_folder(name: &str) -> PathBuf {
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let folder =
        std::env::temp_dir().join(format!("pixmesh-{name}-{}-{count}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    if is_root() {
        let given = Command::new("chown").arg(USER).arg(&folder).status().unwrap();
        assert!(given.success(), "chown");
    }
    folder
}

fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}
