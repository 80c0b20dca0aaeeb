//! The program `rasterize_model`.

use clap::Parser;
use pixmesh_cli::rasterize_model::RasterizeModel;
use std::process::ExitCode;

fn main() -> ExitCode {
    pixmesh_cli::exit("rasterize_model", RasterizeModel::parse().run())
}
