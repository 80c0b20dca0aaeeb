//! The program `thesis_tables`.

use clap::Parser;
use pixmesh_thesis::ThesisTables;
use std::process::ExitCode;

fn main() -> ExitCode {
    pixmesh_cli::exit("thesis_tables", ThesisTables::parse().run())
}
