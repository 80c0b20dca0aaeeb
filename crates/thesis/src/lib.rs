//! The program that prints the tables of the thesis for any folder of pictures.
//!
//! "Effective Techniques for Generating Delaunay Mesh Models of Single- and Multi-Component
//! Images" (thesis, University of Victoria) compares its methods in Tables 3.2 to 3.9 and 4.1 to
//! 4.4. The program makes every mesh that these need and prints the tables with the published
//! figures beside, so that anyone can check that pixmesh reproduces the thesis.
//!
//! In reading order: [`cases`] names the methods, [`tables`] says which tables compare which,
//! [`pictures`] reads the folder, [`measure`] makes the meshes, [`journal`] keeps what is done,
//! [`statistics`] and [`grid`] turn it into figures, with which [`fill`] fills the tables,
//! [`published`] and [`agreement`] compare, and [`sheets`] writes.

pub mod agreement;
pub mod cases;
pub mod csv;
pub mod fill;
pub mod grid;
pub mod journal;
pub mod measure;
pub mod pictures;
pub mod progress;
pub mod published;
pub mod sheets;
pub mod statistics;
pub mod tables;

use clap::Parser;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use fill::Source;
use journal::Journal;
use measure::{Results, Survey};
use pixmesh_cli::{CliError, files};
use published::Published;
use sheets::{Section, TableFormat};
use std::fs::File;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::thread;
use tables::{TABLES, Table};
use thiserror::Error;

/// Why there are no tables.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ThesisError {
    /// A file or a picture cannot be read, or a mesh cannot be made.
    #[error(transparent)]
    Program(#[from] CliError),
    /// The folder holds nothing that could be meshed.
    #[error("{name}: there is no picture of one or three components")]
    NoPictures {
        /// The folder's name.
        name: String,
    },
    /// A line of the published figures cannot be read.
    #[error("{name}, line {line}: {reason}")]
    Published {
        /// The file's name.
        name: String,
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// The file for the journal holds something else.
    #[error("{name} is no journal of this program: its first line is not '{}'", journal::HEADER)]
    NotAJournal {
        /// The file's name.
        name: String,
    },
    /// Another run writes the journal.
    #[error("{name} is in use by another run")]
    JournalInUse {
        /// The file's name.
        name: String,
    },
}

/// Prints the tables of the thesis for a folder of pictures.
///
/// Makes the meshes of Tables 3.2 to 3.9 and 4.1 to 4.4 for every PNG, JPEG and PNM picture of the
/// folder, those of three components in colour and in gray, and prints PSNR, ranks, differences
/// and win ratios; with --published, the published figures stand in parentheses. With --journal, a
/// run that was stopped goes on where it was.
#[derive(Parser, Debug)]
#[command(name = "thesis_tables", version)]
pub struct ThesisTables {
    /// Folder of pictures
    folder: PathBuf,
    /// CSV file of published figures: table, image, components, method, density_percent, unit, value
    #[arg(long, value_name = "FILE")]
    published: Option<PathBuf>,
    /// Table to print, more than once for several [default: all]
    #[arg(long = "table", value_name = "NUMBER", value_parser = table_parser())]
    tables: Vec<Table>,
    /// Print only the statistics over all pictures
    #[arg(long)]
    summaries: bool,
    /// Format of the tables
    #[arg(long, value_enum, default_value_t = TableFormat::Text)]
    format: TableFormat,
    /// File to write instead of standard output
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Meshes to make at the same time, but for those of Table 4.3 [default: cores]
    #[arg(long, value_name = "NUMBER")]
    threads: Option<NonZeroUsize>,
    /// File that keeps every finished mesh's figures; those it has are not computed again
    #[arg(long, value_name = "FILE")]
    journal: Option<PathBuf>,
}

/// A parser of the tables' numbers.
fn table_parser() -> impl TypedValueParser<Value = Table> {
    PossibleValuesParser::new(TABLES.iter().map(|table| table.number)).try_map(|number| {
        TABLES.into_iter().find(|table| table.number == number).ok_or("unknown table")
    })
}

impl ThesisTables {
    /// Runs the program.
    ///
    /// # Errors
    /// When the folder holds no picture, the published figures or the journal cannot be read, or
    /// the journal or the tables cannot be written.
    pub fn run(&self) -> Result<(), ThesisError> {
        let published = self.read_published()?;
        let paths = pictures::files_of(&self.folder)?;
        self.output.as_deref().map_or(Ok(()), check_writable)?;
        let results = self.measure(&paths)?;
        if results.pictures(1).next().is_none() {
            let name = self.folder.display().to_string();
            return Err(ThesisError::NoPictures { name });
        }
        let text = self.print(&Source { results: &results, published: &published });
        Ok(files::write(self.output.as_ref(), text.as_bytes())?)
    }

    /// The tables to print, in order.
    fn tables(&self) -> Vec<Table> {
        let wanted = |table: &Table| self.tables.iter().any(|own| own.number == table.number);
        TABLES.into_iter().filter(|table| self.tables.is_empty() || wanted(table)).collect()
    }

    /// Reads the published figures, if there are any.
    fn read_published(&self) -> Result<Published, ThesisError> {
        let Some(path) = &self.published else { return Ok(Published::default()) };
        let bytes = files::read(Some(path))?;
        let (text, name) = (String::from_utf8_lossy(&bytes), path.display().to_string());
        Published::read(&text, &name, tables::all_series())
    }

    /// Makes every mesh.
    fn measure(&self, paths: &[PathBuf]) -> Result<Results, ThesisError> {
        let journal = self.journal.as_deref().map_or(Ok(Journal::default()), Journal::open)?;
        let cores = || thread::available_parallelism().map_or(1, NonZeroUsize::get);
        let threads = self.threads.map_or_else(cores, NonZeroUsize::get);
        Survey { jobs: &tables::jobs(&self.tables()), threads, journal: &journal }
            .run(paths)
            .map_err(Into::into)
    }

    /// The tables in the format asked for.
    fn print(&self, source: &Source<'_>) -> String {
        let mut sections = Vec::new();
        let mut grids = Vec::new();
        for table in self.tables() {
            let mut own = table.grids(source);
            own.retain(|grid| !self.summaries || grid.is_summary());
            if !own.is_empty() {
                let heading = format!("{}: {}", table.name(), table.title);
                sections.push(Section { heading, sheets: own.iter().map(sheets::sheet).collect() });
            }
            grids.extend(own);
        }
        let agreement = agreement::sheets(source.published, source.results);
        if !agreement.is_empty() {
            sections.push(Section { heading: "Agreement".to_owned(), sheets: agreement });
        }
        match self.format {
            TableFormat::Text => sheets::text(&sections),
            TableFormat::Csv => sheets::csv(&grids),
            TableFormat::Markdown => sheets::markdown(&sections),
        }
    }
}

/// Checks that a file can be written, before there is much to write; what it holds stays.
fn check_writable(path: &Path) -> Result<(), ThesisError> {
    let opened = File::options().append(true).create(true).open(path);
    opened.map_err(|source| CliError::File { name: path.display().to_string(), source })?;
    Ok(())
}
