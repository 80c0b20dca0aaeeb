//! Real PostgreSQL servers and PgBouncer poolers: processes with temporary folders, killed when dropped.
//!
//! Servers refuse to run as root, so tests that root runs start them as the user `postgres`.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on has failed")]

use std::fs;
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The folder in which Debian's packages install the programs of each version.
const INSTALLED: &str = "/usr/lib/postgresql";
const POOLER: &str = "/usr/sbin/pgbouncer";
/// The user that runs servers for root.
const USER: &str = "postgres";
/// How long a server may take to start.
const START_TIME: Duration = Duration::from_secs(60);

/// The folder with the programs of the newest version.
fn programs() -> PathBuf {
    let versions = fs::read_dir(INSTALLED).into_iter().flatten().flatten();
    let number = |path: &PathBuf| path.file_name()?.to_str()?.parse::<u32>().ok();
    let newest = versions.map(|entry| entry.path()).max_by_key(number);
    let found = newest.map(|path| path.join("bin")).filter(|path| path.join("initdb").exists());
    found.expect("PostgreSQL is missing; ./test installs it")
}

/// A database server with the superuser `pixmesh`, who needs no password.
#[derive(Debug)]
pub struct PostgresServer {
    programs: PathBuf,
    child: Child,
    /// A file system of its own, which is unmounted before the folder is removed.
    disk: Option<Disk>,
    folder: TempDir,
    /// The port on 127.0.0.1.
    pub port: u16,
    settings: Vec<String>,
}

/// A file system in memory.
#[derive(Debug)]
struct Disk(PathBuf);

impl Disk {
    /// Mounts a file system of so many MiB.
    fn mount(path: &Path, mib: u32) -> Self {
        let options = format!("size={mib}m");
        succeed(Command::new("mount").args(["-t", "tmpfs", "-o", &options, "tmpfs"]).arg(path));
        give_to_server_user(path);
        Self(path.to_owned())
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("--lazy").arg(&self.0).status();
    }
}

impl PostgresServer {
    /// Starts a server with settings, each as `name=value`.
    ///
    /// # Panics
    /// When PostgreSQL is not installed or the server does not start.
    #[must_use]
    pub fn start(settings: &[&str]) -> Self {
        Self::start_with(settings, &[])
    }

    /// Starts a server with settings, and with files (name, text) in its data folder.
    ///
    /// # Panics
    /// When PostgreSQL is not installed or the server does not start.
    #[must_use]
    pub fn start_with(settings: &[&str], files: &[(&str, &str)]) -> Self {
        Self::start_in(server_folder(), None, settings, files)
    }

    /// Starts a server on a disk of so many MiB, with segments of the log of 1 MiB.
    ///
    /// # Panics
    /// When PostgreSQL is not installed, the server does not start, or the user may not mount file
    /// systems.
    #[must_use]
    pub fn start_on_disk(mib: u32, settings: &[&str]) -> Self {
        let folder = server_folder();
        let disk = Disk::mount(folder.path(), mib);
        Self::start_in(folder, Some(disk), settings, &[])
    }

    fn start_in(
        folder: TempDir,
        disk: Option<Disk>,
        settings: &[&str],
        files: &[(&str, &str)],
    ) -> Self {
        let programs = programs();
        let data = folder.path().join("data");
        match disk {
            Some(_) => initialize(&programs, &data, &["--wal-segsize=1"]),
            None => copy(&template(&programs), &data),
        }
        for (name, text) in files {
            let path = data.join(name);
            fs::write(&path, text).unwrap();
            succeed(Command::new("chmod").arg("600").arg(&path));
            give_to_server_user(&path);
        }
        let settings = settings.iter().map(|&setting| setting.to_owned()).collect();
        let mut server = Self::run_in(&programs, folder, settings);
        server.disk = disk;
        server
    }

    /// Starts a synchronous standby of this server: a commit returns when both have it.
    ///
    /// # Panics
    /// When the standby does not start or does not connect.
    #[must_use]
    pub fn synchronous_standby(&self) -> Self {
        let folder = server_folder();
        let mut copy = as_server_user(&self.programs.join("pg_basebackup"));
        copy.args(["--checkpoint=fast", "--no-sync", "--write-recovery-conf", "--dbname"]);
        succeed(copy.arg(self.url()).arg("--pgdata").arg(folder.path().join("data")));
        let standby = Self::run_in(&self.programs, folder, self.settings.clone());
        self.run_sql("ALTER SYSTEM SET synchronous_standby_names = '*'");
        self.run_sql("SELECT pg_reload_conf()");
        let began = Instant::now();
        while self.run_sql("SELECT sync_state FROM pg_stat_replication") != "sync" {
            assert!(began.elapsed() < START_TIME, "{}", standby.log());
            thread::sleep(Duration::from_millis(20));
        }
        standby
    }

    /// Makes a standby the primary.
    ///
    /// # Panics
    /// When the standby is not promoted.
    pub fn promote(&self) {
        self.run_sql("ALTER SYSTEM RESET synchronous_standby_names");
        assert_eq!(self.run_sql("SELECT pg_promote(true, 60)"), "t", "{}", self.log());
    }

    fn run_in(programs: &Path, folder: TempDir, settings: Vec<String>) -> Self {
        let port = free_port();
        let child = run(programs, folder.path(), port, &settings);
        let programs = programs.to_owned();
        let mut server = Self { programs, child, folder, port, settings, disk: None };
        server.wait_until_it_answers();
        server
    }

    /// The address that clients use.
    #[must_use]
    pub fn url(&self) -> String {
        url(self.port)
    }

    /// Ends the server without a shutdown, like a failure of its machine.
    pub fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Starts the server again with the same data and port.
    ///
    /// # Panics
    /// When the server does not start.
    pub fn restart(&mut self) {
        self.kill();
        self.child = run(&self.programs, self.folder.path(), self.port, &self.settings);
        self.wait_until_it_answers();
    }

    /// Runs statements, and returns the values that they print.
    ///
    /// # Panics
    /// When one fails.
    pub fn run_sql(&self, sql: &str) -> String {
        let run = self.psql(sql).output().unwrap();
        assert!(run.status.success(), "{sql}: {}", String::from_utf8_lossy(&run.stderr));
        String::from_utf8_lossy(&run.stdout).trim().to_owned()
    }

    /// All tables and their rows as statements.
    ///
    /// # Panics
    /// When `pg_dump` fails.
    #[must_use]
    pub fn dump(&self) -> String {
        let run = Command::new(self.programs.join("pg_dump")).arg(self.url()).output().unwrap();
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        String::from_utf8(run.stdout).unwrap()
    }

    /// Executes a dump.
    ///
    /// # Panics
    /// When a statement fails.
    pub fn restore(&self, dump: &str) {
        let file = self.folder.path().join("dump.sql");
        fs::write(&file, dump).unwrap();
        let mut psql = Command::new(self.programs.join("psql"));
        psql.args(["--no-psqlrc", "--quiet", "--set=ON_ERROR_STOP=1", "--file"]);
        succeed(psql.arg(file).arg(self.url()).stdout(Stdio::null()));
    }

    /// The folder of the server's files.
    #[must_use]
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Whether the server's process runs.
    ///
    /// # Panics
    /// Never in practice.
    pub fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    /// A command that runs statements.
    #[must_use]
    pub fn psql(&self, sql: &str) -> Command {
        let mut command = Command::new(self.programs.join("psql"));
        command.args(["--no-psqlrc", "--quiet", "--tuples-only", "--no-align", "--command", sql]);
        command.arg(self.url());
        command
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
            // The shared memory of a killed server may be in use for a moment more.
            if self.child.try_wait().unwrap().is_some() {
                self.child = run(&self.programs, self.folder.path(), self.port, &self.settings);
            }
            assert!(began.elapsed() < START_TIME, "{}", self.log());
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// The text of its log.
    #[must_use]
    pub fn log(&self) -> String {
        fs::read_to_string(self.folder.path().join("log")).unwrap_or_default()
    }
}

impl Drop for PostgresServer {
    fn drop(&mut self) {
        self.kill();
        self.disk = None;
    }
}

/// A pooler in transaction mode in front of a server.
#[derive(Debug)]
pub struct Pooler {
    child: Child,
    _folder: TempDir,
    port: u16,
}

impl Pooler {
    /// Starts a pooler.
    ///
    /// # Panics
    /// When PgBouncer is not installed or does not start.
    #[must_use]
    pub fn start(server: &PostgresServer) -> Self {
        Self::start_with(server, "", &[])
    }

    /// Starts a pooler that requires TLS, with a certificate and its key as PEM.
    ///
    /// # Panics
    /// When PgBouncer is not installed or does not start.
    #[must_use]
    pub fn start_with_tls(server: &PostgresServer, certificate: &str, key: &str) -> Self {
        let settings = "client_tls_sslmode = require\nclient_tls_cert_file = pooler.crt\n\
                        client_tls_key_file = pooler.key\n";
        Self::start_with(server, settings, &[("pooler.crt", certificate), ("pooler.key", key)])
    }

    fn start_with(server: &PostgresServer, more: &str, files: &[(&str, &str)]) -> Self {
        assert!(Path::new(POOLER).exists(), "{POOLER} is missing; ./test installs it");
        let (folder, port) = (server_folder(), free_port());
        let file = folder.path().join("pgbouncer.ini");
        let settings = format!(
            "[databases]\n* = host=127.0.0.1 port={} user=pixmesh\n[pgbouncer]\n\
             listen_addr = 127.0.0.1\nlisten_port = {port}\nunix_socket_dir =\nauth_type = any\n\
             pool_mode = transaction\nmax_client_conn = 500\ndefault_pool_size = 20\n\
             logfile = {}\n{more}",
            server.port,
            folder.path().join("log").display()
        );
        fs::write(&file, settings).unwrap();
        for (name, text) in files {
            fs::write(folder.path().join(name), text).unwrap();
            give_to_server_user(&folder.path().join(name));
        }
        let child = as_server_user(Path::new(POOLER))
            .current_dir(folder.path())
            .arg("--quiet")
            .arg(&file)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let began = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(began.elapsed() < START_TIME, "the pooler does not start");
            thread::sleep(Duration::from_millis(20));
        }
        Self { child, _folder: folder, port }
    }

    /// The address that clients use.
    #[must_use]
    pub fn url(&self) -> String {
        url(self.port)
    }
}

impl Drop for Pooler {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Makes a new data folder.
fn initialize(programs: &Path, data: &Path, more: &[&str]) {
    let mut initdb = as_server_user(&programs.join("initdb"));
    initdb.args(["--no-sync", "--auth=trust", "--encoding=UTF8", "--username=pixmesh"]);
    succeed(initdb.args(more).arg("--pgdata").arg(data).stdout(Stdio::null()));
}

/// A new data folder to copy, which takes a tenth of the time of making one. It lies beside the test
/// programs, is made once for a version, and no server runs in it.
fn template(programs: &Path) -> PathBuf {
    let version = programs.parent().and_then(Path::file_name).unwrap().to_string_lossy();
    let template = std::env::current_exe().unwrap().with_file_name(format!("postgresql-{version}"));
    if !template.exists() {
        // The server's user may not write there.
        let (folder, beside) =
            (server_folder(), TempDir::new_in(template.parent().unwrap()).unwrap());
        let (made, copied) = (folder.path().join("data"), beside.path().join("data"));
        initialize(programs, &made, &[]);
        copy(&made, &copied);
        // Another test may have made it meanwhile.
        let moved = fs::rename(copied, &template);
        assert!(template.exists(), "{moved:?}");
    }
    template
}

/// Copies a folder with owners and permissions.
fn copy(from: &Path, to: &Path) {
    succeed(Command::new("cp").arg("--archive").arg(from).arg(to));
}

/// The address of the database behind a port of this machine.
#[must_use]
pub fn url(port: u16) -> String {
    format!("postgres://pixmesh@127.0.0.1:{port}/postgres")
}

/// A free port of this machine.
///
/// # Panics
/// When there is none.
#[must_use]
pub fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

fn run(programs: &Path, folder: &Path, port: u16, settings: &[String]) -> Child {
    let log = fs::OpenOptions::new().create(true).append(true).open(folder.join("log"));
    let settings = settings.iter().flat_map(|setting| ["-c", setting]);
    as_server_user(&programs.join("postgres"))
        .arg("-D")
        .arg(folder.join("data"))
        .args(["-p", &port.to_string(), "-k", "", "-c", "listen_addresses=127.0.0.1"])
        .args(settings)
        .stdout(Stdio::null())
        .stderr(log.unwrap())
        .spawn()
        .unwrap()
}

/// A command that runs as the server's user.
fn as_server_user(program: &Path) -> Command {
    if !is_root() {
        return Command::new(program);
    }
    let mut command = Command::new("setpriv");
    command.args(["--reuid", USER, "--regid", USER, "--init-groups"]).arg(program);
    // That user may not read the folder that the tests run in.
    command.current_dir("/");
    command
}

fn is_root() -> bool {
    let id = Command::new("id").arg("-u").output().unwrap();
    id.stdout.trim_ascii() == b"0"
}

/// A temporary folder of the server's user.
fn server_folder() -> TempDir {
    let folder = TempDir::with_prefix("pixmesh-postgres-").unwrap();
    give_to_server_user(folder.path());
    folder
}

fn give_to_server_user(path: &Path) {
    if is_root() {
        succeed(Command::new("chown").arg(USER).arg(path));
    }
}

#[track_caller]
fn succeed(command: &mut Command) {
    let status = command.status().unwrap();
    assert!(status.success(), "{command:?}");
}
