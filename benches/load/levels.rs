//! The levels that the service keeps, and whether figures reach them.

use crate::report::Result;
use serde::Deserialize;
use std::collections::BTreeMap;

/// One level.
#[derive(Debug, Deserialize)]
pub(crate) struct Level {
    pub(crate) objective: String,
    pub(crate) unit: String,
    at_least: Option<f64>,
    at_most: Option<f64>,
    /// The bound in the short form, beside whatever else the machine does.
    short: Option<f64>,
}

/// All of them, by name.
pub(crate) struct Levels(BTreeMap<String, Level>);

impl Level {
    /// Whether a figure reaches it.
    pub(crate) fn is_met(&self, figure: f64, is_short: bool) -> bool {
        let bound = |full: f64| if is_short { self.short.unwrap_or(full) } else { full };
        self.at_least.is_none_or(|least| figure >= bound(least))
            && self.at_most.is_none_or(|most| figure <= bound(most))
    }

    /// The bound, as people write it.
    pub(crate) fn bound(&self) -> String {
        let unit = &self.unit;
        match (self.at_least, self.at_most) {
            (Some(least), _) => format!("≥ {least} {unit}"),
            (_, Some(most)) => format!("≤ {most} {unit}"),
            _ => String::new(),
        }
    }
}

impl Levels {
    pub(crate) fn read() -> Self {
        Self(serde_json::from_str(include_str!("levels.json")).unwrap())
    }

    pub(crate) fn get(&self, name: &str) -> &Level {
        self.0.get(name).unwrap_or_else(|| panic!("there is no level {name}"))
    }

    /// The names, S2 before S10.
    pub(crate) fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.0.keys().map(String::as_str).collect();
        names.sort_by_key(|name| (name.trim_end_matches(char::is_alphabetic).len(), *name));
        names
    }

    /// Prints what a run found, and says whether it reaches every level.
    pub(crate) fn print(&self, result: &Result, is_short: bool) -> bool {
        for row in &result.rows {
            println!("   {}", row.join("  "));
        }
        let mut all = true;
        for (name, figure) in &result.figures {
            let level = self.get(name);
            let is_met = level.is_met(*figure, is_short);
            all &= is_met;
            let verdict = if is_met { "met" } else { "NOT MET" };
            println!("   {name} {verdict}: {figure:.3} {} ({})", level.unit, level.objective);
        }
        for note in &result.notes {
            println!("   {note}");
        }
        all
    }
}
