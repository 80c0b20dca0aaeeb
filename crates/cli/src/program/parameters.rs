//! Options of the engine's table of parameters: HTTP's names, values and ranges.

use crate::CliError;
use clap::builder::PossibleValuesParser;
use clap::{Arg, ArgMatches, Args, Command, Error, FromArgMatches};
use pixmesh_codec::Format;
use pixmesh_engine::params::{Parameter, TABLE, Takes, WRITING};
use pixmesh_engine::{MeshOptions, ParameterSet};
use std::path::Path;

/// Parameters as they are given, by their names in the table: all, or those that say how a mesh file
/// is written.
#[derive(Clone, Debug, Default)]
pub struct Given<const ALL: bool>(Vec<(&'static str, String)>);

/// Parameters of the mesh of a picture.
pub type MeshParameters = Given<true>;

/// Parameters of the file of a mesh.
pub type WritingParameters = Given<false>;

/// What a mesh file's own parameters are beside [`WRITING`].
const OF_MESH_FILES: [&str; 3] = ["size", "format", "reconstruction"];

/// What only the service's jobs take.
const OF_JOBS: &str = "keep_image";

impl<const ALL: bool> Given<ALL> {
    fn rows() -> impl Iterator<Item = &'static Parameter> {
        let is_of_files = |name| WRITING.contains(&name) || OF_MESH_FILES.contains(&name);
        let rows = TABLE.iter().filter(|row| row.name != OF_JOBS);
        rows.filter(move |row| ALL || is_of_files(row.name))
    }

    /// The text given for a parameter.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&str> {
        self.0.iter().find(|(known, _)| *known == name).map(|(_, text)| text.as_str())
    }

    /// What the parameters mean together, as the engine has it.
    ///
    /// # Errors
    /// When a value is out of its range, or two exclude each other.
    pub fn options(&self) -> Result<MeshOptions, CliError> {
        let mut set = ParameterSet::default();
        self.0.iter().try_for_each(|(name, text)| set.add(name, text))?;
        Ok(set.finish()?)
    }

    /// The options by which a mesh file is written. Size and reconstruction change the mesh.
    ///
    /// # Errors
    /// As [`Self::options`].
    pub fn writing(&self) -> Result<MeshOptions, CliError> {
        let pairs = self.0.iter().map(|(name, text)| (*name, text.as_str()));
        let pairs = pairs.filter(|(name, _)| WRITING.contains(name));
        Ok(ParameterSet::default().finish()?.written_by(pairs)?)
    }
}

/// The format: the one given, else that of the file's ending, else `otherwise`.
///
/// # Errors
/// When no format has the ending.
pub fn format(
    given: Option<Format>,
    output: Option<&Path>,
    otherwise: Format,
) -> Result<Format, CliError> {
    let ending = output.and_then(Path::extension).and_then(|ending| ending.to_str());
    match (given, ending) {
        (Some(format), _) => Ok(format),
        (None, None) => Ok(otherwise),
        (None, Some(ending)) => Format::of_file_ending(ending)
            .ok_or_else(|| CliError::Ending { ending: ending.to_owned() }),
    }
}

impl<const ALL: bool> Args for Given<ALL> {
    fn augment_args(command: Command) -> Command {
        Self::rows().fold(command, |command, row| command.arg(argument(row)))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<const ALL: bool> FromArgMatches for Given<ALL> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let given =
            |row: &Parameter| Some((row.name, matches.get_one::<String>(row.name)?.clone()));
        Ok(Self(Self::rows().filter_map(given).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// The option of a parameter; its short help has the everyday ones alone.
fn argument(row: &Parameter) -> Arg {
    let short = match row.name {
        "size" => Some('n'),
        "method" => Some('m'),
        "format" => Some('f'),
        "preset" => Some('p'),
        _ => None,
    };
    let option = Arg::new(row.name)
        .long(row.name.replace('_', "-"))
        .help_heading("Parameters, as over HTTP")
        .hide_short_help(short.is_none())
        .allow_negative_numbers(true);
    let option =
        match row.name {
            "format" => option
                .help("Format to write [default: by the ending of --output, else the preset's]"),
            "preset" => option
                .help("Parameters for a purpose; those given beside it win. See pixmesh presets"),
            _ => option.help(row.about),
        };
    let option = short.into_iter().fold(option, Arg::short);
    match row.takes {
        Takes::Word(names) => option.value_parser(PossibleValuesParser::new(names)),
        Takes::Flag => option.num_args(0..=1).require_equals(true).default_missing_value("true"),
        Takes::Decimal { least, most } => option.value_name(format!("{least} to {most}")),
        Takes::Whole { least, most } => option.value_name(format!("{least} to {most}")),
        Takes::Pattern(_) => option.value_name("CHOICE"),
    }
}
