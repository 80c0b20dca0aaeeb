//! The command-line programs `make_model` and `rasterize_model`, and the part of `pixmesh` that works
//! on files.
//!
//! The first two are filters: standard input to standard output, so that they stand in pipes as the
//! programs of the thesis do; `--input` and `--output` name files instead. They call the same
//! functions as the service: `pixmesh-codec` at the borders, `pixmesh-meshing` in between.
//!
//! [`make_model`] and [`rasterize_model`] are the programs. [`options`] reads the first one's
//! parameters, [`output`] writes its formats, [`attendant`] shows its progress, [`files`] reads and
//! writes files and streams, and [`document`] prints manual pages and completions. [`program`] has the
//! subcommands of `pixmesh`.

pub mod attendant;
pub mod document;
pub mod files;
pub mod make_model;
pub mod options;
pub mod output;
pub mod program;
pub mod rasterize_model;

use std::fmt::Display;
use std::io::{self, Write};
use std::process::ExitCode;
use thiserror::Error;

/// Why a program failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CliError {
    /// A file could not be read or written.
    #[error("{name}: {source}")]
    File {
        /// The file's name, or that of the stream.
        name: String,
        /// What the system says.
        source: io::Error,
    },
    /// The input is not a picture that can be read.
    #[error("{name}: {source}")]
    Picture {
        /// The file's name, or that of the stream.
        name: String,
        /// What is wrong with it.
        source: pixmesh_codec::DecodeError,
    },
    /// The input is not a mesh, or holds none of the size asked for.
    #[error("{name}: {source}")]
    Mesh {
        /// The file's name, or that of the stream.
        name: String,
        /// What is wrong with it.
        source: pixmesh_codec::MeshFileError,
    },
    /// A texture is asked for, and the picture is not given.
    #[error("--texture embed needs --image: the picture that the mesh was made of")]
    NoImage,
    /// The picture to show is not of the mesh's size.
    #[error(
        "--image has {} by {} pixels and the mesh {} by {}: give the picture that the mesh was \
         made of",
        picture.0, picture.1, mesh.0, mesh.1
    )]
    OtherSize {
        /// Width and height of the picture.
        picture: (usize, usize),
        /// Width and height of the mesh's image.
        mesh: (usize, usize),
    },
    /// The weights do not fit the picture.
    #[error("{name}: {source}")]
    Weights {
        /// The file's name.
        name: String,
        /// What is wrong with it.
        source: pixmesh_codec::WeightsError,
    },
    /// No format has the ending of the file to write.
    #[error(
        "--output: no format has the ending .{ending}: use one of model, glb, gltf, svg, ply, obj, \
         stl, json, pmesh, terrain, png, pnm, pgm, ppm and pam, or name the format with --format"
    )]
    Ending {
        /// The ending, without its dot.
        ending: String,
    },
    /// The picture cannot be written in this format.
    #[error(transparent)]
    Encode(#[from] pixmesh_codec::EncodeError),
    /// An option is not allowed for this picture.
    #[error(transparent)]
    Generate(#[from] pixmesh_meshing::MeshingError),
    /// A parameter's value is refused, or the work is.
    #[error(transparent)]
    Engine(#[from] pixmesh_engine::EngineError),
    /// A file is refused, or the work on it.
    #[error("{name}: {source}")]
    Refused {
        /// The file's name, or that of the stream.
        name: String,
        /// Why.
        source: Box<pixmesh_engine::EngineError>,
    },
    /// A picture is asked for in a format of meshes.
    #[error("render writes pictures, and {format} is none: use png or pnm, or pixmesh convert")]
    NoPicture {
        /// The format's name.
        format: &'static str,
    },
    /// Standard input is to be read twice.
    #[error("only one of the two files can be standard input")]
    InputTwice,
    /// Two pictures of a batch would become the same file.
    #[error("{name}: {output} is the mesh of another picture of this run: rename one of them")]
    SameName {
        /// The later picture.
        name: String,
        /// The file of both.
        output: String,
    },
    /// Some pictures of a batch failed.
    #[error("{failed} of {all} pictures failed; the others are done")]
    Batch {
        /// How many failed.
        failed: usize,
        /// How many there were.
        all: usize,
    },
    /// The work was cancelled.
    #[error(transparent)]
    Cancelled(#[from] pixmesh_meshing::Cancelled),
}

impl CliError {
    /// Why a file is refused, or the work on it.
    fn of_file(path: Option<&std::path::Path>, source: pixmesh_engine::EngineError) -> Self {
        Self::Refused { name: files::name(path, "standard input"), source: Box::new(source) }
    }
}

/// Ends a program: status 0, or the error on standard error and status 1.
pub fn exit(program: &str, result: Result<(), impl Display>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Nobody is left to tell when standard error is closed too.
            let _ = writeln!(io::stderr(), "{program}: {error}");
            ExitCode::FAILURE
        }
    }
}
