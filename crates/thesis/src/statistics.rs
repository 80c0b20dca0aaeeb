//! The statistics of the tables: ranks, differences, minimum, median, maximum, win ratio.

/// `a - b`, where two perfect copies, both of infinite PSNR, do not differ.
#[must_use]
pub fn difference(a: f64, b: f64) -> f64 {
    if a == b { 0.0 } else { a - b }
}

/// The rank of each value, 1 for the largest; equal values share the mean of their places.
#[must_use]
pub fn ranks(values: &[f64]) -> Vec<f64> {
    let rank = |value: &f64| {
        let larger = values.iter().filter(|other| *other > value).count();
        let equal = values.iter().filter(|other| *other == value).count();
        larger as f64 + (equal as f64 + 1.0) / 2.0
    };
    values.iter().map(rank).collect()
}

/// The arithmetic mean.
#[must_use]
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The least value.
#[must_use]
pub fn minimum(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}

/// The largest value.
#[must_use]
pub fn maximum(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}

/// The middle value, or the mean of the two in the middle; NaN of none.
#[must_use]
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    match (sorted.len().is_multiple_of(2), sorted.get(middle)) {
        (_, None) => f64::NAN,
        (false, Some(&value)) => value,
        (true, Some(&upper)) => mean(&[sorted[middle - 1], upper]),
    }
}

/// The share of differences above zero, in percent.
#[must_use]
pub fn win_percent(differences: &[f64]) -> f64 {
    let wins = differences.iter().filter(|&&difference| difference > 0.0).count();
    100.0 * wins as f64 / differences.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_value_ranks_first_and_equal_ones_share_their_places() {
        assert_eq!(ranks(&[20.0, 30.0, 25.0]), [3.0, 1.0, 2.0]);
        assert_eq!(ranks(&[20.0, 30.0, 20.0, 10.0]), [2.5, 1.0, 2.5, 4.0]);
        assert_eq!(ranks(&[f64::INFINITY, 1.0, f64::INFINITY]), [1.5, 3.0, 1.5]);
        assert_eq!(ranks(&[]), [0.0; 0]);
    }

    #[test]
    fn the_median_of_an_even_number_lies_between_the_two_in_the_middle() {
        assert_eq!(median(&[3.0, -1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median(&[]).is_nan());
    }

    #[test]
    fn a_draw_is_no_win() {
        assert_eq!(win_percent(&[0.5, 0.0, -0.1, 0.2]), 50.0);
        assert_eq!(win_percent(&[difference(f64::INFINITY, f64::INFINITY)]), 0.0);
    }

    #[test]
    fn extremes_and_mean_are_as_computed_by_hand() {
        let differences = [0.3, -0.2, 0.5];
        assert_eq!((minimum(&differences), maximum(&differences)), (-0.2, 0.5));
        assert_eq!(mean(&[1.0, 2.0, 6.0]), 3.0);
    }
}
