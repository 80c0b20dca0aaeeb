//! An order of lattice points that keeps neighbours in the plane near each other in memory.
//!
//! Row by row, the neighbours above and below a point are a whole row of points away. Tile by tile,
//! row by row within each, most of them are within a few cache lines. The tiles follow the curve of
//! Guy Macdonald Morton, "A computer oriented geodetic data base and a new technique in file
//! sequencing", 1966: consecutive points lie together in the plane.

use crate::control::{Cancelled, Poller};
use crate::image::Point;

const TILE: u32 = 5;

/// The indices of points of an image of this size, tile by tile, in their given order within each.
pub(crate) fn tile_order(
    points: &[Point],
    (width, height): (usize, usize),
    poller: &mut Poller<'_>,
) -> Result<Vec<u32>, Cancelled> {
    let curve = Curve::new((width >> TILE) + 1, (height >> TILE) + 1);
    let tile_of = |p: &Point| curve.index(p.x as usize >> TILE, p.y as usize >> TILE);
    let mut starts = vec![0u32; curve.len + 1];
    for point in points {
        poller.step(1)?;
        starts[tile_of(point) + 1] += 1;
    }
    for tile in 1..starts.len() {
        starts[tile] += starts[tile - 1];
    }
    let mut order = vec![0; points.len()];
    for (i, point) in (0..).zip(points) {
        poller.step(1)?;
        let start = &mut starts[tile_of(point)];
        order[*start as usize] = i;
        *start += 1;
    }
    Ok(order)
}

/// A curve through all tiles: the digits of an index alternate between its column's and row's.
struct Curve {
    /// The part of the index that the column, and that the row of a tile determines.
    of_column: Vec<usize>,
    of_row: Vec<usize>,
    /// The number of indices, some of which have no tile.
    len: usize,
}

impl Curve {
    fn new(columns: usize, rows: usize) -> Self {
        let digits = |count: usize| count.next_power_of_two().trailing_zeros();
        // Where one side is longer, squares of the shorter one follow each other.
        let shared = digits(columns).min(digits(rows));
        let spread = |i: usize| {
            let low = (0..shared).fold(0, |sum, digit| sum | (i >> digit & 1) << (2 * digit));
            (low, i >> shared << (2 * shared))
        };
        Self {
            of_column: (0..columns).map(spread).map(|(low, high)| low | high).collect(),
            of_row: (0..rows).map(spread).map(|(low, high)| low << 1 | high).collect(),
            len: 1 << (digits(columns) + digits(rows)),
        }
    }

    #[inline]
    fn index(&self, column: usize, row: usize) -> usize {
        self.of_column[column] | self.of_row[row]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Stage;

    #[test]
    fn keeps_the_points_of_a_tile_together() {
        let points: Vec<Point> =
            (0..70).flat_map(|y| (0..100).map(move |x| Point::new(x, y))).collect();
        let order =
            tile_order(&points, (100, 70), &mut Poller::new(&(), Stage::Refine, 0, 1)).unwrap();
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..7000));
        let mut tiles: Vec<(i32, i32)> =
            order.iter().map(|&i| (points[i as usize].x / 32, points[i as usize].y / 32)).collect();
        tiles.dedup();
        let square = |x| [(x, 0), (x + 1, 0), (x, 1), (x + 1, 1)];
        let below = [square(0), square(2)].concat();
        assert_eq!(tiles, [below, vec![(0, 2), (1, 2), (2, 2), (3, 2)]].concat());
        assert_eq!(order[..33], (0..32).chain([100]).collect::<Vec<_>>());
    }

    #[test]
    fn tiles_have_different_indices() {
        for (columns, rows) in [(1, 1), (1, 9), (9, 1), (3, 3), (2, 13), (13, 2), (8, 8)] {
            let curve = Curve::new(columns, rows);
            let tiles = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
            let mut indices: Vec<usize> = tiles.map(|(x, y)| curve.index(x, y)).collect();
            indices.sort_unstable();
            indices.dedup();
            assert_eq!(indices.len(), columns * rows);
            assert!(indices.iter().all(|&index| index < curve.len));
            assert!(curve.len < 4 * columns * rows);
        }
    }
}
