//! A program's manual page and shell completions, made of the definitions that its command line is
//! parsed by.

use crate::CliError;
use clap::{Args, Command};
use clap_complete::Shell;

/// Options that print about the program and do nothing else.
#[derive(Args, Clone, Debug)]
pub struct DocumentOptions {
    /// Print a script that completes this program's options in a shell
    #[arg(long, help_heading = "About this program", value_name = "SHELL", exclusive = true)]
    completions: Option<Shell>,
    /// Print the manual page, for man(1)
    #[arg(long, help_heading = "About this program", exclusive = true)]
    man_page: bool,
}

impl DocumentOptions {
    /// What is to be printed instead of running the program, if anything.
    ///
    /// # Errors
    /// Never in practice: the text is made in memory.
    pub fn text(&self, command: &mut Command) -> Result<Option<Vec<u8>>, CliError> {
        let mut text = Vec::new();
        if let Some(shell) = self.completions {
            let name = command.get_name().to_owned();
            clap_complete::generate(shell, command, name, &mut text);
        } else if self.man_page {
            text = manual_page(command)?;
        } else {
            return Ok(None);
        }
        Ok(Some(text))
    }
}

/// The manual page in roff.
pub(crate) fn manual_page(command: &Command) -> Result<Vec<u8>, CliError> {
    let mut text = Vec::new();
    clap_mangen::Man::new(command.clone())
        .render(&mut text)
        .map_err(|source| CliError::File { name: "standard output".to_owned(), source })?;
    Ok(text)
}
