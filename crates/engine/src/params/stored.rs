//! Options as they are stored with a job, and read back by a later version of the program.

use super::{MeshOptions, ParameterSet};
use crate::error::{EngineError, InputError};

/// The version of stored options. It grows when a parameter changes its name or its meaning, and
/// [`MeshOptions::of_stored`] then translates the versions before.
const VERSION: u32 = 1;

impl MeshOptions {
    /// The options as a text that [`of_stored`](Self::of_stored) reads: the version, a semicolon and
    /// the [`query`](Self::query). The format of a preset is stored as one that is asked for.
    #[must_use]
    pub fn stored(&self) -> String {
        let format = self.format.or(self.usual_format);
        format!("{VERSION};{}", Self { format, ..self.clone() }.query())
    }

    /// Reads stored options. A text without a version is a query, as version 1 has it.
    ///
    /// # Errors
    /// [`InputError::StoredVersion`] when a later program stored the text, and as
    /// [`ParameterSet::finish`].
    pub fn of_stored(text: &str) -> Result<Self, EngineError> {
        let (version, query) = text.split_once(';').unwrap_or(("1", text));
        match version.parse() {
            Ok(1..=VERSION) => ParameterSet::of_query(Some(query))?.finish(),
            _ => {
                Err(InputError::StoredVersion { found: version.to_owned(), known: VERSION }.into())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stored_options_read_back() {
        let options =
            ParameterSet::of_query(Some("method=med&density=3")).unwrap().finish().unwrap();
        let stored = options.stored();
        assert!(stored.starts_with("1;method=med&density=3"), "{stored}");
        assert_eq!(MeshOptions::of_stored(&stored).unwrap().query(), options.query());
        assert_eq!(MeshOptions::of_stored(&options.query()).unwrap().query(), options.query());
    }

    #[test]
    fn options_of_a_later_version_are_refused() {
        for text in ["2;density=3", "0;density=3", ";density=3", "x;density=3"] {
            let error = MeshOptions::of_stored(text).unwrap_err();
            let refused = matches!(error, EngineError::Input(InputError::StoredVersion { .. }));
            assert!(refused, "{text}: {error}");
        }
    }
}
