//! The program `pixmesh`: `serve`, `worker`, `health`, `doctor`, `config`, `key` and
//! `openapi`.

use clap::{Parser, Subcommand};
use pixmesh::access::{NewKey, issue};
use pixmesh::config::{self, HealthSettings, Settings};
use pixmesh::server::Role;
use pixmesh::{doctor, health, routes, server};
use std::error::Error;
use std::io::{self, Write};
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Pictures to triangle meshes, over HTTP.
#[derive(Parser)]
#[command(version, arg_required_else_help = true)]
struct Program {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Serves until SIGTERM or SIGINT.
    Serve(Settings),
    /// Does jobs of a queue that nodes share, until SIGTERM or SIGINT. It listens for health and
    /// metrics alone.
    Worker(Settings),
    /// Asks a running service whether it is ready: exit status 0 when it is, 1 when not.
    Health(HealthSettings),
    /// Prints every setting in force, after the checks that `serve` makes.
    Config(Settings),
    /// Checks whether the service would work here with these settings: a self-test of the meshes, the
    /// data folder, memory and addresses. Exit status 1 when something is wrong.
    Doctor(Settings),
    /// Makes keys for --keys-file.
    #[command(subcommand)]
    Key(KeyCommand),
    /// Prints the interface as an OpenAPI document.
    Openapi,
}

#[derive(Subcommand)]
enum KeyCommand {
    /// Prints a new key, and adds its line to a file.
    New(NewKey),
}

fn main() -> ExitCode {
    let program = Program::try_parse().unwrap_or_else(|error| {
        // The parser names the flag alone.
        if let Some(variable) = config::variable_of_error(&error, std::env::args()) {
            let _ = writeln!(io::stderr(), "{variable} is wrong:");
        }
        error.exit()
    });
    let command = program.command;
    match config::check_environment(std::env::vars_os()).and_then(|()| run(command)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(io::stderr(), "pixmesh: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> Result<(), Box<dyn Error>> {
    match command {
        Command::Serve(settings) => server::run(&settings.checked()?, Role::Serve)?,
        Command::Worker(settings) => server::run(&settings.checked_for_work()?, Role::Work)?,
        Command::Health(settings) => health::ask(&settings)?,
        Command::Config(settings) => write!(io::stdout(), "{}", settings.checked()?)?,
        Command::Doctor(settings) => doctor::examine(&settings)?,
        Command::Key(KeyCommand::New(order)) => issue(&order)?,
        Command::Openapi => write!(io::stdout(), "{}", routes::openapi_document())?,
    }
    Ok(())
}
