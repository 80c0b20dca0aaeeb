//! The order in which a PNG stores its rows: from the top, or in the seven passes of Adam7.

use crate::canvas::Row;

/// First column, first row, and the steps to the next column and row of each pass of Adam7.
const PASSES: [[usize; 4]; 7] = [
    [0, 0, 8, 8],
    [4, 0, 8, 8],
    [0, 4, 4, 8],
    [2, 0, 4, 4],
    [0, 2, 2, 4],
    [1, 0, 2, 2],
    [0, 1, 1, 2],
];

/// The one pass of a picture that is not interlaced.
const WHOLE: [[usize; 4]; 1] = [[0, 0, 1, 1]];

/// Every row that the file stores, in order; passes without a pixel have none.
pub(super) fn stored_rows(
    width: usize,
    height: usize,
    interlaced: bool,
) -> impl Iterator<Item = Row> {
    let passes: &[[usize; 4]] = if interlaced { &PASSES } else { &WHOLE };
    passes.iter().filter(move |&&[first, ..]| first < width).flat_map(
        move |&[first, first_y, step, step_y]| {
            (first_y..height).step_by(step_y).map(move |y| Row { y, first, step })
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_passes_store_every_pixel_once() {
        for (width, height) in [(2, 2), (3, 9), (8, 8), (17, 5)] {
            let mut seen = vec![0; width * height];
            for row in stored_rows(width, height, true) {
                for x in (row.first..width).step_by(row.step) {
                    seen[row.y * width + x] += 1;
                }
            }
            assert_eq!(seen, vec![1; width * height], "{width}x{height}");
        }
    }

    #[test]
    fn without_interlacing_rows_follow_each_other() {
        let rows: Vec<Row> = stored_rows(5, 3, false).collect();
        assert_eq!(rows, [Row::whole(0), Row::whole(1), Row::whole(2)]);
    }
}
