//! Fills the tables with the figures measured and published.

use crate::cases::{Case, Series};
use crate::grid::{Figure, Grid, Row, Unit, rank_columns, summarize};
use crate::measure::{PictureResults, Results};
use crate::published::Published;
use crate::statistics::{maximum, mean, median, minimum, win_percent};
use crate::tables::{Content, Table, cases_of};

/// A statistic of differences.
type Statistic = fn(&[f64]) -> f64;

/// Those that the tables show.
const STATISTICS: [(Unit, Statistic); 4] = [
    (Unit::MinimumDb, minimum),
    (Unit::MedianDb, median),
    (Unit::MaximumDb, maximum),
    (Unit::WinPercent, win_percent),
];

/// What the grids of a table are filled from.
pub struct Source<'a> {
    /// The figures measured.
    pub results: &'a Results,
    /// The figures published.
    pub published: &'a Published,
}

impl Table {
    /// The figures of the table, without the parts that there are no pictures for.
    #[must_use]
    pub fn grids(&self, source: &Source<'_>) -> Vec<Grid> {
        let part = |components| Part { table: self.id(components), components, source };
        let mut grids = match (self.content)() {
            Content::Ranking { ranked, beside } => part(3).ranking(&ranked, &beside),
            Content::Duel(pair) => {
                let [one, other] = &*pair;
                part(one.components).duel(one, other)
            }
            Content::AverageRanks(lists) => {
                lists.iter().map(|list| part(list[0].components).average_ranks(list)).collect()
            }
            Content::Figures(lists, unit) => {
                lists.iter().map(|list| part(list[0].components).figures(list, unit)).collect()
            }
            Content::Differences(lists) => {
                lists.iter().map(|list| part(list[0].0.components).differences(list)).collect()
            }
        };
        grids.retain(|grid| !grid.rows.is_empty());
        grids
    }
}

/// A table for images of one number of components.
struct Part<'a> {
    table: String,
    components: usize,
    source: &'a Source<'a>,
}

impl<'a> Part<'a> {
    /// A grid of this part.
    fn grid(&self, what: &str, rows: Vec<Row>) -> Grid {
        let kind = if self.components == 1 { "gray" } else { "colour" };
        let caption = match self.table.as_str() {
            "4.2a" | "4.3a" => format!("(a) {kind}, {what}"),
            "4.2b" | "4.3b" => format!("(b) {kind}, {what}"),
            _ => format!("{kind}, {what}"),
        };
        Grid { table: self.table.clone(), caption, components: self.components, rows }
    }

    /// The pictures of this part.
    fn pictures(&self) -> impl Iterator<Item = &'a PictureResults> + use<'a> {
        self.source.results.pictures(self.components)
    }

    /// A method's figures for a picture, one for each density.
    fn of(&self, picture: &PictureResults, series: &Series, unit: Unit) -> Vec<Figure> {
        let figure = |case: Case| {
            let outcome = picture.outcome(&case);
            let value = match unit {
                Unit::Seconds => outcome.and_then(|outcome| outcome.seconds),
                _ => outcome.map(|outcome| outcome.psnr_db),
            };
            let published = self.source.published.find(&self.table, &picture.stem, &case, unit);
            Figure { value: value.unwrap_or(f64::NAN), published }
        };
        cases_of(series).map(figure).collect()
    }

    /// Methods' figures for a picture.
    fn block(&self, picture: &PictureResults, list: &[Series], unit: Unit) -> Vec<Vec<Figure>> {
        list.iter().map(|series| self.of(picture, series, unit)).collect()
    }

    /// One method's PSNR less another's, for every picture.
    fn differences_of(&self, one: &Series, other: &Series) -> Vec<Vec<Figure>> {
        let difference = |picture| {
            let [one, other] = [one, other].map(|series| self.of(picture, series, Unit::PsnrDb));
            one.iter().zip(other).map(|(&one, other)| one.minus(other)).collect()
        };
        self.pictures().map(difference).collect()
    }

    /// Figures of methods for every picture.
    fn figures(&self, list: &[Series], unit: Unit) -> Grid {
        let rows = |picture| named_rows(picture, list, self.block(picture, list, unit), unit);
        self.grid(unit.words(), self.pictures().flat_map(rows).collect())
    }

    /// PSNR of methods, their ranks and their average ranks.
    fn ranking(&self, ranked: &[Series], beside: &[Series]) -> Vec<Grid> {
        let ranks = |picture| {
            let ranks = rank_columns(&self.block(picture, ranked, Unit::PsnrDb));
            named_rows(picture, ranked, ranks, Unit::Rank)
        };
        let ranks = self.pictures().flat_map(ranks).collect();
        vec![
            self.figures(&[ranked, beside].concat(), Unit::PsnrDb),
            self.grid("rank", ranks),
            self.average_ranks(ranked),
        ]
    }

    /// Mean ranks of methods over all pictures.
    fn average_ranks(&self, list: &[Series]) -> Grid {
        let ranks = |picture| rank_columns(&self.block(picture, list, Unit::PsnrDb));
        let ranks: Vec<Vec<Vec<Figure>>> = self.pictures().map(ranks).collect();
        let row = |(place, series): (usize, &Series)| {
            let block: Vec<Vec<Figure>> = ranks.iter().map(|block| block[place].clone()).collect();
            summary_row(&series.label, Unit::AverageRank, summarize(&block, mean))
        };
        let rows = list.iter().enumerate().map(row);
        let rows = if ranks.is_empty() { Vec::new() } else { rows.collect() };
        self.grid("average rank over all pictures", rows)
    }

    /// PSNR of two methods, their differences and the statistics of these.
    fn duel(&self, one: &Series, other: &Series) -> Vec<Grid> {
        let list = [one.clone(), other.clone()];
        let differences = self.differences_of(one, other);
        let rows = |(picture, difference): (&PictureResults, &Vec<Figure>)| {
            let mut rows =
                named_rows(picture, &list, self.block(picture, &list, Unit::PsnrDb), Unit::PsnrDb);
            rows.push(Row {
                image: Some(picture.name.clone()),
                method: "first less second".to_owned(),
                unit: Unit::DifferenceDb,
                figures: difference.clone(),
            });
            rows
        };
        let rows = self.pictures().zip(&differences).flat_map(rows).collect();
        vec![
            self.grid("PSNR and difference (dB)", rows),
            self.differences(&[(one.clone(), other.clone())]),
        ]
    }

    /// Statistics of the differences of pairs of methods.
    fn differences(&self, pairs: &[(Series, Series)]) -> Grid {
        let rows = |(one, other): &(Series, Series)| {
            let block = self.differences_of(one, other);
            let name = format!("{} less {}", one.label, other.label);
            let statistics = if block.is_empty() { &[][..] } else { &STATISTICS };
            let row = |&(unit, statistic): &(Unit, Statistic)| {
                summary_row(&name, unit, summarize(&block, statistic))
            };
            statistics.iter().map(row).collect::<Vec<_>>()
        };
        self.grid("differences of PSNR over all pictures", pairs.iter().flat_map(rows).collect())
    }
}

/// A row for each method of a picture.
fn named_rows(
    picture: &PictureResults,
    list: &[Series],
    block: Vec<Vec<Figure>>,
    unit: Unit,
) -> Vec<Row> {
    let row = |(series, figures): (&Series, Vec<Figure>)| {
        let (image, method) = (Some(picture.name.clone()), series.label.clone());
        Row { image, method, unit, figures }
    };
    list.iter().zip(block).map(row).collect()
}

/// A row of a statistic over all pictures.
fn summary_row(name: &str, unit: Unit, figures: Vec<Figure>) -> Row {
    Row { image: None, method: name.to_owned(), unit, figures }
}
