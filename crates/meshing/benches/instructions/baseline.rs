//! The counts that those of today are compared with.

use crate::Fallible;
use crate::callgrind::Counts;
use crate::part::Part;
use std::collections::BTreeMap;
use std::fmt::{self, Write};

/// The largest growth over the baseline that passes, in per cent.
pub(crate) const MOST_RISE_PERCENT: u64 = 5;

/// A function is listed from one in this many instructions of its part.
const PARTS_OF_LEAST: u64 = 2000;

/// Functions named where a part fails.
const NAMED_FUNCTIONS: usize = 6;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/instructions/baseline.txt");

const HEAD: &str = "\
# Instructions of each part, and of the functions that have the most of their own.
# Written by: cargo bench -p pixmesh-meshing --bench instructions -- --record
";

/// What was recorded.
pub(crate) struct Baseline {
    /// The architecture and the vectors that the kernels chose.
    pub(crate) machine: String,
    /// The version of the compiler.
    pub(crate) compiler: String,
    parts: BTreeMap<String, Counts>,
}

impl Baseline {
    pub(crate) fn new(machine: String, compiler: String, counts: Vec<(Part, Counts)>) -> Self {
        let parts = counts.into_iter().map(|(part, counts)| (part.to_string(), counts)).collect();
        Self { machine, compiler, parts }
    }

    /// Reads the file: lines of a keyword and its values, functions below their part.
    pub(crate) fn read() -> Fallible<Self> {
        let text = std::fs::read_to_string(FILE).map_err(|error| format!("{FILE}: {error}"))?;
        let (mut machine, mut compiler) = (String::new(), String::new());
        let mut parts: BTreeMap<String, Counts> = BTreeMap::new();
        let mut last = String::new();
        for line in text.lines().filter(|line| !line.is_empty() && !line.starts_with('#')) {
            let (keyword, values) = line.trim_start().split_once(' ').unwrap_or((line, ""));
            match (keyword, values.split_once(' ')) {
                ("machine", _) => values.clone_into(&mut machine),
                ("compiler", _) => values.clone_into(&mut compiler),
                ("part", Some((count, name))) => {
                    name.clone_into(&mut last);
                    let counts = Counts { total: count.parse()?, of_functions: BTreeMap::new() };
                    parts.insert(name.to_owned(), counts);
                }
                ("own", Some((count, name))) => {
                    let part = parts.get_mut(&last).ok_or("a function above all parts")?;
                    part.of_functions.insert(name.to_owned(), count.parse()?);
                }
                _ => return Err(format!("{FILE}: unknown line: {line}").into()),
            }
        }
        Ok(Self { machine, compiler, parts })
    }

    pub(crate) fn write(&self) -> Fallible<()> {
        let mut text = HEAD.to_owned();
        writeln!(text, "machine {}\ncompiler {}", self.machine, self.compiler)?;
        for (part, counts) in &self.parts {
            writeln!(text, "\npart {} {part}", counts.total)?;
            let mut functions: Vec<_> = counts.of_functions.iter().collect();
            functions.retain(|&(_, &own)| own >= counts.total / PARTS_OF_LEAST);
            functions.sort_by_key(|&(name, &own)| (std::cmp::Reverse(own), name));
            for (name, own) in functions {
                writeln!(text, "    own {own} {name}")?;
            }
        }
        std::fs::write(FILE, text).map_err(|error| format!("{FILE}: {error}").into())
    }
}

/// A function with more instructions of its own than in the baseline.
struct Risen {
    name: String,
    /// Those of the baseline, where the function was worth recording.
    before: Option<u64>,
    after: u64,
    /// By how much it rose at least.
    rise: u64,
}

/// A part then and now.
pub(crate) struct Comparison {
    part: Part,
    before: u64,
    after: u64,
    /// The functions whose own counts rose most, the largest rise first.
    risen: Vec<Risen>,
}

impl Comparison {
    pub(crate) fn new(part: Part, counts: &Counts, baseline: &Baseline) -> Fallible<Self> {
        let before = baseline
            .parts
            .get(&part.to_string())
            .ok_or_else(|| format!("the baseline has no part {part}: record it again"))?;
        let unrecorded = before.total / PARTS_OF_LEAST;
        let mut risen = Vec::new();
        for (name, &after) in &counts.of_functions {
            let before = before.of_functions.get(name).copied();
            let rise = after.saturating_sub(before.unwrap_or(unrecorded));
            if rise > 0 {
                risen.push(Risen { name: name.clone(), before, after, rise });
            }
        }
        risen.sort_by_key(|function| std::cmp::Reverse(function.rise));
        risen.truncate(NAMED_FUNCTIONS);
        Ok(Self { part, before: before.total, after: counts.total, risen })
    }

    pub(crate) fn has_failed(&self) -> bool {
        self.after * 100 > self.before * (100 + MOST_RISE_PERCENT)
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { part, before, after, risen } = self;
        let rise = (*after as f64 / *before as f64 - 1.0) * 100.0;
        let title = part.to_string();
        write!(formatter, "{title:<22} {before:>12} -> {after:>12} {rise:>+7.2} %")?;
        if rise < -(MOST_RISE_PERCENT as f64) {
            write!(formatter, "  less than the baseline's: record it again to keep that")?;
        }
        if self.has_failed() {
            write!(formatter, "  FAILED; the functions whose own counts rose most:")?;
            for Risen { name, before, after, .. } in risen {
                let before = before.map_or("not recorded".to_owned(), |before| before.to_string());
                write!(formatter, "\n    {before:>12} -> {after:>12}  {name}")?;
            }
        }
        Ok(())
    }
}
