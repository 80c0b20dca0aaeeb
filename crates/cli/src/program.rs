//! What the program `pixmesh` does with files, without a service: the same engine, parameters and
//! bytes as over HTTP.
//!
//! [`mesh`] makes one mesh and [`batch`] many, [`mesh_file`] converts and renders meshes, [`facts`]
//! compares and describes files. [`parameters`] makes options of the engine's table, [`presets`] lists its
//! presets, and [`work`] shows progress and tells results.

pub mod batch;
pub mod facts;
pub mod mesh;
pub mod mesh_file;
pub mod parameters;
pub mod presets;
pub mod work;

use crate::{CliError, files};
use batch::BatchOrder;
use clap::{Command, Subcommand};
use clap_complete::Shell;
use facts::{CompareOrder, InfoOrder};
use mesh::MeshOrder;
use mesh_file::{ConvertOrder, RenderOrder};
use presets::PresetsOrder;

/// The subcommands that work on files.
#[derive(Subcommand, Debug)]
pub enum FileCommand {
    /// Makes the mesh of a picture.
    #[command(after_long_help = EXIT)]
    Mesh(MeshOrder),
    /// Rebuilds the picture that a mesh describes.
    #[command(after_long_help = EXIT)]
    Render(RenderOrder),
    /// Writes a mesh file in another format.
    #[command(after_long_help = EXIT)]
    Convert(ConvertOrder),
    /// Tells how close a mesh or a picture is to a picture: PSNR, MSE and SSIM.
    #[command(after_long_help = EXIT)]
    Compare(CompareOrder),
    /// Tells what a picture or mesh file is.
    #[command(after_long_help = EXIT)]
    Info(InfoOrder),
    /// Makes the meshes of many pictures; a bad one does not stop the others.
    #[command(after_long_help = EXIT)]
    Batch(BatchOrder),
    /// Lists the presets: parameters for a purpose, which --preset names.
    Presets(PresetsOrder),
    /// Prints a script that completes this program's options in a shell.
    Completions {
        /// Shell to print the script for
        shell: Shell,
    },
    /// Prints the manual page, for man(1).
    Man,
}

/// What the long help ends with.
const EXIT: &str = "\
Exit status:
  0 when all was done, 1 when a file or a parameter's value was refused (of batch: one of them at
  least), 2 when the command line could not be understood.";

impl FileCommand {
    /// Does what it says. `command` is the definition of the whole program.
    ///
    /// # Errors
    /// When a file cannot be read or written, or an option's value is refused.
    pub fn run(&self, command: &mut Command) -> Result<(), CliError> {
        match self {
            Self::Mesh(order) => order.run(),
            Self::Render(order) => order.run(),
            Self::Convert(order) => order.run(),
            Self::Compare(order) => order.run(),
            Self::Info(order) => order.run(),
            Self::Batch(order) => order.run(),
            Self::Presets(order) => order.run(),
            Self::Completions { shell } => {
                let mut text = Vec::new();
                clap_complete::generate(*shell, command, "pixmesh", &mut text);
                files::write(None, &text)
            }
            Self::Man => files::write(None, &crate::document::manual_page(command)?),
        }
    }
}
