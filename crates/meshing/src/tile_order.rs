//! An order of lattice points that keeps neighbours in the plane near each other in memory.
//!
//! By rows the neighbours above and below are a whole row of points away; by square tiles, row by
//! row within each, most of them are within the same few lines of memory, and at any time removal
//! works on few tiles.

use crate::mesh::Point;

/// Columns and rows of a tile, as a power of two.
const TILE: u32 = 5;

/// The indices of points that lie within `width` columns and `height` rows, tile by tile, in their
/// given order within each.
pub(crate) fn tile_order(points: &[Point], width: usize, height: usize) -> Vec<u32> {
    let per_row = (width >> TILE) + 1;
    let tile_of = |p: &Point| (p.y as usize >> TILE) * per_row + (p.x as usize >> TILE);
    let mut starts = vec![0u32; per_row * ((height >> TILE) + 1) + 1];
    for point in points {
        starts[tile_of(point) + 1] += 1;
    }
    for tile in 1..starts.len() {
        starts[tile] += starts[tile - 1];
    }
    let mut order = vec![0; points.len()];
    for (i, point) in points.iter().enumerate() {
        let start = &mut starts[tile_of(point)];
        order[*start as usize] = i as u32;
        *start += 1;
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_comes_once_and_those_of_a_tile_together() {
        let points: Vec<Point> =
            (0..70).flat_map(|y| (0..100).map(move |x| Point::new(x, y))).collect();
        let order = tile_order(&points, 100, 70);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..7000));
        let tiles = order.iter().map(|&i| (points[i as usize].y / 32, points[i as usize].x / 32));
        assert!(tiles.is_sorted());
        assert_eq!(order[..33], (0..32).chain([100]).collect::<Vec<_>>());
    }
}
