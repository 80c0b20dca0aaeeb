//! Which lattice points of a rectangle are vertices.

use crate::image::Point;

/// A rectangle of lattice points, some of them taken by vertices; no point beyond it is.
#[derive(Clone)]
pub(crate) struct Occupancy {
    /// The lowest column and row.
    left: i32,
    bottom: i32,
    columns: usize,
    /// Whether each point is taken, row by row.
    taken: Vec<bool>,
}

impl Occupancy {
    /// The points of an image of `width` columns and `height` rows, some of them taken.
    pub(crate) fn of_image(width: usize, height: usize, points: &[Point]) -> Self {
        let mut occupancy =
            Self { left: 0, bottom: 0, columns: width, taken: vec![false; width * height] };
        points.iter().for_each(|&p| occupancy.take(p));
        occupancy
    }

    /// The least rectangle of all points, which are taken.
    pub(crate) fn around(points: &[Point]) -> Self {
        let range = |of: fn(&Point) -> i32| {
            let (least, most) = (points.iter().map(of).min(), points.iter().map(of).max());
            (least.unwrap_or(0), most.map_or(0, |most| most + 1))
        };
        let ((left, right), (bottom, top)) = (range(|p| p.x), range(|p| p.y));
        let (columns, rows) = ((right - left) as usize, (top - bottom) as usize);
        let mut occupancy = Self { left, bottom, columns, taken: vec![false; columns * rows] };
        points.iter().for_each(|&p| occupancy.take(p));
        occupancy
    }

    /// Columns and rows.
    pub(crate) fn size(&self) -> (usize, usize) {
        (self.columns, self.taken.len() / self.columns)
    }

    /// Tells whether a point is taken.
    #[inline]
    pub(crate) fn is_taken(&self, p: Point) -> bool {
        self.place(p).is_some_and(|place| self.taken[place])
    }

    /// A vertex comes to a point of the rectangle.
    pub(crate) fn take(&mut self, p: Point) {
        self.set(p, true);
    }

    /// A vertex goes from a point.
    pub(crate) fn leave(&mut self, p: Point) {
        self.set(p, false);
    }

    fn set(&mut self, p: Point, taken: bool) {
        if let Some(place) = self.place(p) {
            self.taken[place] = taken;
        }
    }

    /// Where a point of the rectangle stands.
    #[inline]
    fn place(&self, p: Point) -> Option<usize> {
        let (column, row) = ((p.x - self.left) as usize, (p.y - self.bottom) as usize);
        let place = row.wrapping_mul(self.columns).wrapping_add(column);
        (column < self.columns && row < self.taken.len() / self.columns).then_some(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    proptest! {
        #[test]
        fn the_points_taken_are_those_that_vertices_came_to_and_have_not_left(
            first in prop::collection::btree_set((3i32..12, 5i32..9), 1..20),
            changes in prop::collection::vec((3i32..12, 5i32..9, any::<bool>()), 0..20),
        ) {
            let points: Vec<Point> = first.iter().map(|&(x, y)| Point::new(x, y)).collect();
            let mut around = Occupancy::around(&points);
            let mut of_image = Occupancy::of_image(12, 9, &points);
            let mut taken: BTreeSet<Point> = points.iter().copied().collect();
            let side = |of: fn(&Point) -> i32| {
                let values: BTreeSet<i32> = points.iter().map(of).collect();
                (values.last().unwrap() - values.first().unwrap() + 1) as usize
            };
            let size = (side(|p| p.x), side(|p| p.y));
            prop_assert_eq!((around.size(), of_image.size()), (size, (12, 9)));
            let [low, high] = [i32::min as fn(i32, i32) -> i32, i32::max].map(|least| {
                let x = points.iter().map(|p| p.x).reduce(least).unwrap();
                (x, points.iter().map(|p| p.y).reduce(least).unwrap())
            });
            for (x, y, comes) in changes {
                let p = Point::new(x, y);
                // None comes to a point beyond.
                if !((low.0..=high.0).contains(&x) && (low.1..=high.1).contains(&y)) {
                    continue;
                }
                for occupancy in [&mut around, &mut of_image] {
                    if comes { occupancy.take(p) } else { occupancy.leave(p) }
                }
                if comes { taken.insert(p); } else { taken.remove(&p); }
            }
            for p in (-2..14).flat_map(|x| (-2..12).map(move |y| Point::new(x, y))) {
                prop_assert_eq!(around.is_taken(p), taken.contains(&p));
                prop_assert_eq!(of_image.is_taken(p), taken.contains(&p));
            }
        }
    }
}
