//! The tables of the thesis: which methods each compares, and how.

use crate::cases::{Case, DENSITIES, POLICIES, Series};
use crate::grid::Unit;
use crate::measure::Job;
use pixmesh_meshing::Method;
use pixmesh_meshing::parameters::{Policy, Startup};
use std::collections::HashMap;

/// A table of the thesis, by number.
#[derive(Clone, Copy, Debug)]
pub struct Table {
    /// Its number.
    pub number: &'static str,
    /// What it shows.
    pub title: &'static str,
    /// Makes what it is made of.
    pub(super) content: fn() -> Content,
}

/// What a table is made of.
pub(super) enum Content {
    /// PSNR and ranks of methods, and PSNR of others beside them.
    Ranking { ranked: Vec<Series>, beside: Vec<Series> },
    /// PSNR of two methods and their difference.
    Duel(Box<[Series; 2]>),
    /// Average ranks of methods, for each number of components.
    AverageRanks(Vec<Vec<Series>>),
    /// PSNR or seconds of methods, for each number of components.
    Figures(Vec<Vec<Series>>, Unit),
    /// Differences of pairs of methods, for each number of components.
    Differences(Vec<Vec<(Series, Series)>>),
}

/// Every table, in order.
pub const TABLES: [Table; 12] = [
    Table {
        number: "3.2",
        title: "Policies in ED-like methods with classic start-up, colour",
        content: || Content::Ranking {
            ranked: POLICIES.map(|policy| Series::ed_like(policy, Startup::Classic)).to_vec(),
            beside: Vec::new(),
        },
    },
    Table {
        number: "3.3",
        title: "Mirroring against classic start-up in ED-like methods, colour",
        content: || startups(Series::ed_like, Policy::PsdMaxD),
    },
    Table {
        number: "3.4",
        title: "MMSODD against MoL in ED-like methods with classic start-up, gray",
        content: || gray_policies(Series::ed_like, Startup::Classic),
    },
    Table {
        number: "3.5",
        title: "Mirroring against classic start-up in ED-like methods, gray",
        content: || startups(Series::ed_like, Policy::PsaD),
    },
    Table {
        number: "3.6",
        title: "Policies in GPRFSED-like methods with mirroring, colour",
        content: || Content::Ranking {
            ranked: POLICIES.map(|p| Series::gprfsed_like(p, Startup::Mirroring)).to_vec(),
            beside: [Policy::PsbD, Policy::PsbL]
                .map(|policy| Series::gprfsed_like(policy, Startup::Mirroring).on_colours())
                .to_vec(),
        },
    },
    Table {
        number: "3.7",
        title: "Mirroring against classic start-up in GPRFSED-like methods, colour",
        content: || startups(Series::gprfsed_like, Policy::PsdMaxD),
    },
    Table {
        number: "3.8",
        title: "MMSODD against MoL in GPRFSED-like methods with mirroring, gray",
        content: || gray_policies(Series::gprfsed_like, Startup::Mirroring),
    },
    Table {
        number: "3.9",
        title: "Mirroring against classic start-up in GPRFSED-like methods, gray",
        content: || startups(Series::gprfsed_like, Policy::PsaD),
    },
    Table {
        number: "4.1",
        title: "Average ranks of the methods",
        content: || Content::AverageRanks(methods()),
    },
    Table {
        number: "4.2",
        title: "PSNR of the methods",
        content: || Content::Figures(methods(), Unit::PsnrDb),
    },
    Table {
        number: "4.3",
        title: "Seconds of the methods",
        content: || Content::Figures(methods(), Unit::Seconds),
    },
    Table {
        number: "4.4",
        title: "The proposed methods against the earlier ones",
        content: || Content::Differences(rivals()),
    },
];

/// Mirroring against classic start-up.
fn startups(like: fn(Policy, Startup) -> Series, policy: Policy) -> Content {
    Content::Duel(
        [Startup::Mirroring, Startup::Classic].map(|startup| like(policy, startup)).into(),
    )
}

/// PSA(D) against PSA(L).
fn gray_policies(like: fn(Policy, Startup) -> Series, startup: Startup) -> Content {
    Content::Duel([Policy::PsaD, Policy::PsaL].map(|policy| like(policy, startup)).into())
}

/// The methods of Chapter 4, for colour and for gray.
fn methods() -> Vec<Vec<Series>> {
    use Method as M;
    let colour = [M::Ced, M::Med, M::Cgprfsed, M::Mgprfs, M::Cgpr, M::Mgpr];
    let gray = [M::Ed, M::Med, M::Gprfsed, M::Mgprfs, M::Gpr];
    vec![
        colour.map(|method| Series::method(method, 3)).to_vec(),
        gray.map(|method| Series::method(method, 1)).to_vec(),
    ]
}

/// Each proposed method with an earlier one, for colour and for gray.
fn rivals() -> Vec<Vec<(Series, Series)>> {
    use Method as M;
    let colour =
        [(M::Med, M::Ced), (M::Mgprfs, M::Cgprfsed), (M::Mgprfs, M::Cgpr), (M::Mgprfs, M::Mgpr)];
    let gray = [(M::Med, M::Ed), (M::Mgprfs, M::Gprfsed), (M::Mgprfs, M::Gpr)];
    let pairs = |list: &[(M, M)], components| {
        let pair = |&(a, b)| (Series::method(a, components), Series::method(b, components));
        list.iter().map(pair).collect()
    };
    vec![pairs(&colour, 3), pairs(&gray, 1)]
}

impl Content {
    /// Every method that the table shows.
    fn series(self) -> Vec<Series> {
        match self {
            Self::Ranking { ranked, beside } => [ranked, beside].concat(),
            Self::Duel(pair) => pair.to_vec(),
            Self::AverageRanks(lists) | Self::Figures(lists, _) => lists.concat(),
            Self::Differences(lists) => {
                lists.concat().into_iter().flat_map(|(one, other)| [one, other]).collect()
            }
        }
    }

    /// Tells whether the table shows how long its meshes take.
    fn is_timed(&self) -> bool {
        matches!(self, Self::Figures(_, Unit::Seconds))
    }
}

/// The methods of all tables.
#[must_use]
pub fn all_series() -> Vec<Series> {
    TABLES.iter().flat_map(|table| (table.content)().series()).collect()
}

/// The meshes that tables need, each once.
#[must_use]
pub fn jobs(tables: &[Table]) -> Vec<Job> {
    let mut jobs: Vec<Job> = Vec::new();
    let mut places = HashMap::new();
    for table in tables {
        let content = (table.content)();
        let timed = content.is_timed();
        for case in content.series().iter().flat_map(cases_of) {
            let place = *places.entry((case.components, case.code.clone())).or_insert(jobs.len());
            match jobs.get_mut(place) {
                Some(job) => job.timed |= timed,
                None => jobs.push(Job { case, timed }),
            }
        }
    }
    jobs
}

/// The meshes of a method at every density.
pub(super) fn cases_of(series: &Series) -> impl Iterator<Item = Case> + use<'_> {
    DENSITIES.iter().map(|&density| series.case(density))
}

impl Table {
    /// The table's name, as the thesis has it.
    #[must_use]
    pub fn name(&self) -> String {
        let part = if self.number.starts_with('3') { "(b)" } else { "" };
        format!("Table {}{part}", self.number)
    }

    /// The table's name in CSV files, for images of 1 or 3 components.
    pub(super) fn id(&self, components: usize) -> String {
        let part = match (self.number, components) {
            ("4.2" | "4.3", 3) => "a",
            ("4.1" | "4.4", _) => "",
            _ => "b",
        };
        format!("{}{part}", self.number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_that_several_tables_show_is_made_once() {
        let of = |numbers: &[&str]| {
            let tables: Vec<Table> =
                TABLES.into_iter().filter(|table| numbers.contains(&table.number)).collect();
            jobs(&tables).len()
        };
        assert_eq!(of(&["4.1", "4.2", "4.3", "4.4"]), 11 * 5);
        assert_eq!(of(&["3.2", "3.3"]), 10 * 5);
        assert_eq!(of(&["3.3", "4.2"]), (11 + 1) * 5);
    }

    #[test]
    fn only_the_meshes_of_the_table_of_seconds_are_timed() {
        let jobs = jobs(&TABLES);
        assert_eq!(jobs.iter().filter(|job| job.timed).count(), 11 * 5);
    }
}
