//! `pixmesh presets`: parameters for a purpose, and what each is for.

use super::work::print;
use crate::CliError;
use clap::Args;
use pixmesh_engine::params::{PRESETS, Preset};
use serde_json::json;

/// The presets, to list.
#[derive(Args, Debug)]
pub struct PresetsOrder {
    /// Tell them as one line of JSON, as GET /v1/presets does
    #[arg(long)]
    json: bool,
}

impl PresetsOrder {
    /// Prints every preset.
    ///
    /// # Errors
    /// When standard output cannot be written.
    pub fn run(&self) -> Result<(), CliError> {
        if self.json {
            let presets: Vec<_> = PRESETS.iter().map(Preset::row).collect();
            return print(&json!({ "presets": presets }).to_string());
        }
        let texts: Vec<_> = PRESETS.iter().map(text).collect();
        print(&texts.join("\n\n"))
    }
}

/// What a preset is for, what it is not for, and the options that it stands for.
fn text(preset: &Preset) -> String {
    let &Preset { name, about, not_for, format, parameters, .. } = preset;
    let format = format.map(|format| ("format", format.name()));
    let options = parameters.iter().copied().chain(format);
    let options = options.map(|(name, text)| format!("--{}={text}", name.replace('_', "-")));
    let options = options.collect::<Vec<_>>().join(" ");
    format!("{name}: {about}\n  Not for {not_for}\n  {options}")
}
