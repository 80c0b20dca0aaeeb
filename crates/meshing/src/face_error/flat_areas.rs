//! Where a picture is of one colour: pages, drawings, skies.
//!
//! A face over such an area has no error, which takes four look-ups to see instead of a walk over
//! its points. Greedy removal from all points of a page meets almost nothing else.
//!
//! Franklin C. Crow, "Summed-area tables for texture mapping", 1984.

use crate::image::{Image, Point};

/// Pictures of which a smaller part has no change of colour do without the table.
const LEAST_PART: f64 = 0.25;

/// Sums of the changes of colour over rectangles of a picture.
pub(crate) struct FlatAreas {
    width: usize,
    /// For each point the number of points left of it or in its column, and below it or in its row,
    /// that differ from their neighbour at the right or above.
    changes: Vec<u32>,
}

impl FlatAreas {
    /// The table of a picture, if enough of that is of one colour.
    pub(crate) fn new(image: &Image) -> Option<Self> {
        let (width, height) = (image.width(), image.height());
        let mut changes = vec![0u32; width * height];
        for component in image.components() {
            mark_changes(component, width, &mut changes);
        }
        let changed: usize = changes.iter().map(|&change| change as usize).sum();
        if changed as f64 > (1.0 - LEAST_PART) * changes.len() as f64 {
            return None;
        }
        sum_up(&mut changes, width);
        Some(Self { width, changes })
    }

    /// Tells whether all points of the smallest rectangle around a face are of one colour.
    #[inline]
    pub(crate) fn is_flat(&self, [a, b, c]: [Point; 3]) -> bool {
        let (left, right) = (a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x));
        let (bottom, top) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        // Of the last column the changes to the right do not count, nor of the last row those
        // upwards, but which of both a change is the table does not tell: with them counted too,
        // an area beside another colour is not recognised, which costs time and no error.
        let sum = |x: i32, y: i32| match (x, y) {
            (-1, _) | (_, -1) => 0,
            (x, y) => self.changes[y as usize * self.width + x as usize],
        };
        sum(right, top) + sum(left - 1, bottom - 1) == sum(left - 1, top) + sum(right, bottom - 1)
    }
}

/// Marks the points that differ from their neighbour at the right or above.
fn mark_changes(component: &[u16], width: usize, changes: &mut [u32]) {
    for (row, marks) in component.chunks_exact(width).zip(changes.chunks_exact_mut(width)) {
        for (pair, mark) in row.windows(2).zip(marks) {
            *mark |= u32::from(pair[0] != pair[1]);
        }
    }
    for ((&sample, &above), mark) in component.iter().zip(&component[width..]).zip(changes) {
        *mark |= u32::from(sample != above);
    }
}

/// Turns marks into sums over everything left of and below each point, itself included.
fn sum_up(changes: &mut [u32], width: usize) {
    for row in changes.chunks_exact_mut(width) {
        let mut sum = 0;
        for mark in row {
            sum += *mark;
            *mark = sum;
        }
    }
    for i in width..changes.len() {
        changes[i] += changes[i - width];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_noisy_picture_has_no_table() {
        let noise = (0..400).map(|i| (i * 7919 % 251) as u16).collect();
        assert!(FlatAreas::new(&Image::from_bottom_up(20, 20, 8, vec![noise]).unwrap()).is_none());
    }

    proptest! {
        #[test]
        fn what_is_called_flat_is_of_one_colour_and_large_flat_areas_are_found(
            spots in prop::collection::vec((0usize..12, 0usize..9, 1u16..3), 0..4),
            places in prop::array::uniform6(0i32..9),
        ) {
            let mut components = vec![vec![7; 12 * 9], vec![9; 12 * 9]];
            for &(x, y, value) in &spots {
                components[x % 2][y * 12 + x] = value;
            }
            let image = Image::from_bottom_up(12, 9, 8, components).unwrap();
            let areas = FlatAreas::new(&image).unwrap();
            let face = [0, 2, 4].map(|i| Point::new(places[i], places[i + 1]));
            let range = |of: fn(Point) -> i32, margin: i32, side: i32| {
                let [a, b, c] = face.map(of);
                a.min(b).min(c)..(a.max(b).max(c) + 1 + margin).min(side)
            };
            // Whether the rectangle, with so many more columns and rows, is of one colour.
            let is_flat = |margin: i32| {
                let (columns, rows) = (range(|p| p.x, margin, 12), range(|p| p.y, margin, 9));
                let first = [0, 1].map(|c| image.sample(c, columns.start as usize, rows.start as usize));
                let mut rows = rows;
                rows.all(|y| columns.clone().all(|x| {
                    [0, 1].map(|c| image.sample(c, x as usize, y as usize)) == first
                }))
            };
            if areas.is_flat(face) {
                prop_assert!(is_flat(0));
            }
            if is_flat(1) {
                prop_assert!(areas.is_flat(face));
            }
        }
    }
}
