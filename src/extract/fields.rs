//! Query and form parameters of resources that do not take all mesh parameters.

use crate::problem::Problem;
use pixmesh_engine::InputError;
use pixmesh_engine::params::{ParameterSet, WRITING, pairs_of_query, unknown};
use std::sync::LazyLock;

/// The parameters of a mesh that was made before, and is written in another way.
pub static CONVERSION: LazyLock<Vec<&str>> =
    LazyLock::new(|| [&["format", "size", "reconstruction"][..], &WRITING[..]].concat());

/// Those of them that matter where a picture is written.
pub const RECONSTRUCTION: [&str; 4] = ["format", "size", "reconstruction", "png_compression"];

/// Collects parameters.
pub trait Fields: Send {
    /// Adds one.
    ///
    /// # Errors
    /// What is wrong with it.
    fn add(&mut self, name: &str, text: &str) -> Result<(), Problem>;
}

/// The texts of a few parameters, each given at most once.
#[derive(Clone, Debug)]
pub struct Few {
    known: &'static [&'static str],
    given: Vec<(&'static str, String)>,
}

impl Few {
    /// None of those known so far.
    #[must_use]
    pub fn of(known: &'static [&'static str]) -> Self {
        Self { known, given: Vec::new() }
    }

    /// Those that a query gives.
    ///
    /// # Errors
    /// `query-malformed`, `unknown-parameter` or `duplicate-parameter`.
    pub fn of_query(known: &'static [&'static str], query: Option<&str>) -> Result<Self, Problem> {
        let mut few = Self::of(known);
        for pair in pairs_of_query(query) {
            let (name, text) = pair?;
            few.add(&name, &text)?;
        }
        Ok(few)
    }

    /// The names and texts given, in their order.
    pub fn pairs(&self) -> impl Iterator<Item = (&str, &str)> {
        self.given.iter().map(|(name, text)| (*name, text.as_str()))
    }

    /// The same as a query.
    #[must_use]
    pub fn query(&self) -> String {
        let pairs = self.pairs().map(|(name, text)| format!("{name}={}", text.replace('#', "%23")));
        pairs.collect::<Vec<_>>().join("&")
    }

    /// The text given for one.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&str> {
        let found = self.given.iter().find(|(given, _)| *given == name);
        found.map(|(_, text)| text.as_str())
    }
}

impl Fields for Few {
    fn add(&mut self, name: &str, text: &str) -> Result<(), Problem> {
        let known = self.known.iter().find(|known| **known == name);
        let known = known.ok_or_else(|| unknown(name, self.known))?;
        if self.get(known).is_some() {
            return Err(InputError::Repeated(name.to_owned()).into());
        }
        self.given.push((known, text.to_owned()));
        Ok(())
    }
}

impl Fields for ParameterSet {
    fn add(&mut self, name: &str, text: &str) -> Result<(), Problem> {
        Ok(Self::add(self, name, text)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::Kind;

    #[test]
    fn few_parameters_follow_the_rules_of_all() {
        let of = |query| Few::of_query(&["state", "limit"], Some(query));
        assert_eq!(of("limit=5&state=queued").unwrap().get("limit"), Some("5"));
        assert_eq!(of("").unwrap().get("limit"), None);
        for (query, kind) in [
            ("limti=5", Kind::UnknownParameter),
            ("limit=5&limit=5", Kind::DuplicateParameter),
            ("limit=%zz", Kind::QueryMalformed),
        ] {
            assert_eq!(of(query).unwrap_err().kind(), kind, "{query}");
        }
        assert_eq!(of("limti=5").unwrap_err().value()["nearest"], "limit");
    }
}
