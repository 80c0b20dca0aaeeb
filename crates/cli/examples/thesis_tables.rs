//! The program `thesis_tables`, where examples are looked for:
//!
//! ```text
//! cargo run --release -p pixmesh-cli --example thesis_tables -- FOLDER [--published FILE]
//! ```

use clap::Parser;
use pixmesh_cli::thesis::ThesisTables;
use std::process::ExitCode;

fn main() -> ExitCode {
    pixmesh_cli::exit("thesis_tables", ThesisTables::parse().run())
}
