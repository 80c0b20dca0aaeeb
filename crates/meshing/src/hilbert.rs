//! Positions along a Hilbert curve, which visits the lattice so that near positions are near
//! points.
//!
//! David Hilbert, "Ueber die stetige Abbildung einer Linie auf ein Flaechenstueck", 1891.

use crate::image::MAX_SIDE;
use crate::mesh::Point;

/// The position of a point along the curve that fills a square of [`MAX_SIDE`] columns.
pub(crate) fn hilbert_index(point: Point) -> u64 {
    let (mut x, mut y) = (point.x as u64, point.y as u64);
    let mut index = 0;
    let mut side = MAX_SIDE as u64 / 2;
    while side > 0 {
        let (right, upper) = (x & side != 0, y & side != 0);
        let quarter = match (right, upper) {
            (false, false) => 0,
            (false, true) => 1,
            (true, true) => 2,
            (true, false) => 3,
        };
        index = 4 * index + quarter;
        // The curve runs through the lower quarters turned.
        if !upper {
            if right {
                (x, y) = (!x & (side - 1), !y & (side - 1));
            }
            (x, y) = (y, x);
        }
        side /= 2;
    }
    index
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_goes_from_each_point_to_a_neighbour() {
        let side = 16;
        let mut points: Vec<Point> =
            (0..side * side).map(|i| Point::new(i % side, i / side)).collect();
        points.sort_by_key(|&p| hilbert_index(p));
        for pair in points.windows(2) {
            assert_eq!((pair[0].x - pair[1].x).abs() + (pair[0].y - pair[1].y).abs(), 1);
        }
    }
}
