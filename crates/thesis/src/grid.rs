//! Figures in rows and columns, each with the published one beside it.

use crate::statistics;

/// What a figure measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// PSNR of a mesh.
    PsnrDb,
    /// Difference of two such.
    DifferenceDb,
    /// Place among methods, 1 for the best.
    Rank,
    /// Mean of such places.
    AverageRank,
    /// Minimum of differences of PSNR.
    MinimumDb,
    /// Median of differences of PSNR.
    MedianDb,
    /// Maximum of differences of PSNR.
    MaximumDb,
    /// Share of differences above zero.
    WinPercent,
    /// Time that a mesh took.
    Seconds,
}

impl Unit {
    /// The name in CSV files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::PsnrDb => "psnr_db",
            Self::DifferenceDb => "difference_db",
            Self::Rank => "rank",
            Self::AverageRank => "average_rank",
            Self::MinimumDb => "minimum_difference_db",
            Self::MedianDb => "median_difference_db",
            Self::MaximumDb => "maximum_difference_db",
            Self::WinPercent => "win_ratio_percent",
            Self::Seconds => "seconds",
        }
    }

    /// The name for readers.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::PsnrDb => "PSNR (dB)",
            Self::DifferenceDb => "difference (dB)",
            Self::Rank => "rank",
            Self::AverageRank => "average rank",
            Self::MinimumDb => "minimum difference (dB)",
            Self::MedianDb => "median difference (dB)",
            Self::MaximumDb => "maximum difference (dB)",
            Self::WinPercent => "win ratio (%)",
            Self::Seconds => "seconds",
        }
    }

    /// A figure as readers see it.
    #[must_use]
    pub fn print(self, value: f64) -> String {
        if value.is_nan() {
            return "-".to_owned();
        }
        match self {
            Self::PsnrDb | Self::AverageRank => format!("{value:.2}"),
            Self::Rank => value.to_string(),
            Self::WinPercent => format!("{value:.1}"),
            Self::Seconds if value < 1.0 => format!("{value:.3}"),
            Self::Seconds => format!("{value:.2}"),
            // Adding zero turns a rounded -0 into +0.
            _ => format!("{:+.2}", (value * 100.0).round() / 100.0 + 0.0),
        }
    }
}

/// A figure, and the published one if there is one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figure {
    /// The figure; NaN where there is none.
    pub value: f64,
    /// The published figure.
    pub published: Option<f64>,
}

impl Figure {
    /// A statistic of figures, published where all of them are.
    #[must_use]
    pub fn of(figures: &[Self], statistic: impl Fn(&[f64]) -> f64) -> Self {
        let values: Vec<f64> = figures.iter().map(|figure| figure.value).collect();
        let published: Option<Vec<f64>> = figures.iter().map(|figure| figure.published).collect();
        Self { value: statistic(&values), published: published.map(|values| statistic(&values)) }
    }

    /// The difference of two figures.
    #[must_use]
    pub fn minus(self, other: Self) -> Self {
        Self::of(&[self, other], |pair| statistics::difference(pair[0], pair[1]))
    }

    /// The rank of each figure.
    #[must_use]
    pub fn ranks(figures: &[Self]) -> Vec<Self> {
        let rank = |i: usize| Self::of(figures, |values| statistics::ranks(values)[i]);
        (0..figures.len()).map(rank).collect()
    }
}

/// Figures of one row.
#[derive(Clone, Debug)]
pub struct Row {
    /// The picture, or none for a statistic over all of them.
    pub image: Option<String>,
    /// The method or methods.
    pub method: String,
    /// What the figures measure.
    pub unit: Unit,
    /// A figure for each density; a statistic has one more, over all densities.
    pub figures: Vec<Figure>,
}

/// Rows under one caption.
#[derive(Clone, Debug)]
pub struct Grid {
    /// The table, as CSV files name it: 3.2b, 4.1, 4.2a.
    pub table: String,
    /// What the rows show.
    pub caption: String,
    /// Components of the images, 1 or 3.
    pub components: usize,
    /// The rows.
    pub rows: Vec<Row>,
}

impl Grid {
    /// Tells whether these are statistics over all pictures.
    #[must_use]
    pub fn is_summary(&self) -> bool {
        self.rows.iter().all(|row| row.image.is_none())
    }
}

/// A statistic of every column of a block, and of the whole block.
#[must_use]
pub fn summarize(block: &[Vec<Figure>], statistic: impl Fn(&[f64]) -> f64) -> Vec<Figure> {
    let width = block.first().map_or(0, Vec::len);
    let column = |i: usize| block.iter().map(|row| row[i]).collect::<Vec<_>>();
    let columns = (0..width).map(|i| Figure::of(&column(i), &statistic));
    columns.chain([Figure::of(&block.concat(), &statistic)]).collect()
}

/// The ranks within every column of a block.
#[must_use]
pub fn rank_columns(block: &[Vec<Figure>]) -> Vec<Vec<Figure>> {
    let width = block.first().map_or(0, Vec::len);
    let column = |i: usize| block.iter().map(|row| row[i]).collect::<Vec<_>>();
    let ranks: Vec<Vec<Figure>> = (0..width).map(|i| Figure::ranks(&column(i))).collect();
    let row = |place: usize| ranks.iter().map(|column| column[place]).collect();
    (0..block.len()).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::{median, minimum, win_percent};

    fn row(values: [f64; 2], published: [Option<f64>; 2]) -> Vec<Figure> {
        let figure = |i: usize| Figure { value: values[i], published: published[i] };
        vec![figure(0), figure(1)]
    }

    fn values(figures: &[Figure]) -> Vec<f64> {
        figures.iter().map(|figure| figure.value).collect()
    }

    fn published(figures: &[Figure]) -> Vec<Option<f64>> {
        figures.iter().map(|figure| figure.published).collect()
    }

    #[test]
    fn a_statistic_is_published_where_all_its_figures_are() {
        let block = [row([1.0, -2.0], [Some(1.5), None]), row([3.0, 5.0], [Some(2.5), Some(6.0)])];
        let medians = summarize(&block, median);
        assert_eq!(values(&medians), [2.0, 1.5, 2.0]);
        assert_eq!(published(&medians), [Some(2.0), None, None]);
        assert_eq!(values(&summarize(&block, minimum)), [1.0, -2.0, -2.0]);
        assert_eq!(values(&summarize(&block, win_percent)), [100.0, 50.0, 75.0]);
    }

    #[test]
    fn each_column_is_ranked_for_itself() {
        let block =
            [row([20.0, 31.0], [Some(20.1), Some(31.0)]), row([21.0, 30.0], [Some(20.1), None])];
        let ranks = rank_columns(&block);
        assert_eq!(values(&ranks[0]), [2.0, 1.0]);
        assert_eq!(values(&ranks[1]), [1.0, 2.0]);
        assert_eq!(published(&ranks[0]), [Some(1.5), None]);
    }

    #[test]
    fn a_difference_of_nothing_has_no_minus() {
        assert_eq!(Unit::DifferenceDb.print(-0.001), "+0.00");
        assert_eq!(Unit::DifferenceDb.print(-0.006), "-0.01");
        assert_eq!(Unit::Rank.print(2.5), "2.5");
        assert_eq!(Unit::PsnrDb.print(f64::INFINITY), "inf");
        assert_eq!(Unit::Seconds.print(f64::NAN), "-");
    }
}
