//! The program `pixmesh`: with the feature `cli` the subcommands that work on files, `mesh`, `render`,
//! `convert`, `compare`, `info`, `batch`, `presets`, `completions` and `man`; with the feature `service` `serve`,
//! `worker`, `health`, `jobs`, `backup`, `check`, `doctor`, `config`, `key` and `openapi`.

use clap::{Parser, Subcommand};
use std::error::Error;
use std::io::{self, Write};
use std::process::ExitCode;

/// Without huge pages memory is returned in small parts; version 2 of the allocator makes up for the time that
/// they saved. `MIMALLOC_PURGE_DELAY=0` in the environment returns it at once.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Turns pictures into triangle meshes, here or over HTTP.
#[derive(Parser)]
#[command(name = "pixmesh", version, arg_required_else_help = true)]
struct Program {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    #[cfg(feature = "cli")]
    #[command(flatten)]
    File(Box<pixmesh_cli::program::FileCommand>),
    #[cfg(feature = "service")]
    #[command(flatten)]
    Service(Box<service::ServiceCommand>),
}

fn main() -> ExitCode {
    let program = Program::try_parse().unwrap_or_else(|error| {
        // The parser names the flag alone.
        #[cfg(feature = "service")]
        if let Some(variable) = pixmesh::config::variable_of_error(&error, std::env::args()) {
            let _ = writeln!(io::stderr(), "{variable} is wrong:");
        }
        error.exit()
    });
    match run(program.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(io::stderr(), "pixmesh: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> Result<(), Box<dyn Error>> {
    match command {
        #[cfg(feature = "cli")]
        Command::File(command) => {
            Ok(command.run(&mut <Program as clap::CommandFactory>::command())?)
        }
        #[cfg(feature = "service")]
        Command::Service(command) => service::run(*command),
    }
}

#[cfg(feature = "service")]
mod service {
    //! The subcommands of the service.

    use clap::Subcommand;
    use pixmesh::access::{self, KeysFile, NewKey, RevokedKey};
    use pixmesh::config::{self, HealthSettings, Settings};
    use pixmesh::data::{self, Backup, DataFolder};
    use pixmesh::server::Role;
    use pixmesh::{doctor, health, operate, routes, server};
    use std::error::Error;
    use std::io::{self, Write};

    #[derive(Subcommand)]
    pub(super) enum ServiceCommand {
        /// Serves until SIGTERM or SIGINT.
        Serve(Settings),
        /// Runs the jobs of a shared queue until SIGTERM or SIGINT. It listens for health and metrics
        /// only.
        Worker(Settings),
        /// Asks a running service whether it is ready: exit status 0 if it is, 1 if not.
        Health(HealthSettings),
        /// Prints every setting in force, after the checks that `serve` makes.
        Config(Settings),
        /// Checks whether the service works on this machine with these settings: the kernels, the data
        /// folder, memory and addresses. Exit status 1 if a check fails.
        Doctor(Settings),
        /// Lists, retries, cancels and deletes jobs of a running service, and pauses their intake and work.
        Jobs(operate::Order),
        /// Copies the jobs of --data-dir to a folder, while the service may run. A service can start with it.
        Backup(Backup),
        /// Checks the jobs of --data-dir or of a backup: database, records, pictures and meshes. Exit
        /// status 1 when something is damaged.
        Check(DataFolder),
        /// Creates, lists and revokes the keys of --keys-file.
        #[command(subcommand)]
        Key(KeyCommand),
        /// Prints the OpenAPI document of the service.
        Openapi,
    }

    #[derive(Subcommand)]
    pub(super) enum KeyCommand {
        /// Prints a new key, and adds its line to a file.
        New(NewKey),
        /// Prints the names of the keys in a file, and what each may do.
        List(KeysFile),
        /// Takes a key, or all keys of a name, out of a file.
        Revoke(RevokedKey),
    }

    pub(super) fn run(command: ServiceCommand) -> Result<(), Box<dyn Error>> {
        config::check_environment(std::env::vars_os())?;
        match command {
            ServiceCommand::Serve(settings) => server::run(&settings.checked()?, Role::Serve)?,
            ServiceCommand::Worker(settings) => {
                server::run(&settings.checked_for_work()?, Role::Work)?;
            }
            ServiceCommand::Health(settings) => health::ask(&settings)?,
            ServiceCommand::Config(settings) => write!(io::stdout(), "{}", settings.checked()?)?,
            ServiceCommand::Doctor(settings) => doctor::examine(&settings)?,
            ServiceCommand::Jobs(order) => operate::operate(&order)?,
            ServiceCommand::Backup(order) => data::back_up(&order)?,
            ServiceCommand::Check(folder) => data::check(&folder)?,
            ServiceCommand::Key(KeyCommand::New(order)) => access::issue(&order)?,
            ServiceCommand::Key(KeyCommand::List(file)) => access::list(&file)?,
            ServiceCommand::Key(KeyCommand::Revoke(order)) => access::revoke(&order)?,
            ServiceCommand::Openapi => write!(io::stdout(), "{}", routes::openapi_document())?,
        }
        Ok(())
    }
}
