//! The program `make_model`.

use clap::Parser;
use pixmesh_cli::make_model::MakeModel;
use std::process::ExitCode;

fn main() -> ExitCode {
    pixmesh_cli::exit("make_model", MakeModel::parse().run())
}
