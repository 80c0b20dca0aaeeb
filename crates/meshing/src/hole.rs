//! The hole that a removed vertex leaves, and the triangles that fill it.
//!
//! Removing a vertex of a preferred-directions Delaunay triangulation changes only the triangles at
//! that vertex, and the hole is filled by the triangulation of its boundary. The fill is found
//! without touching the mesh: the triangle at one edge of the boundary has as its third vertex the
//! one whose circle through the edge holds no other; it splits the rest of the boundary in two,
//! each filled in the same way. A hole has six vertices on average; the time is quadratic in the
//! number of vertices in the worst case.

use crate::mesh::Point;
use crate::predicates::{in_circle, orientation};

/// A triangle of the fill.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct HoleTriangle {
    /// Its vertices as places on the boundary, counter-clockwise and ascending.
    pub(crate) corners: [u32; 3],
    /// What lies beyond its side from the last corner to the first.
    pub(crate) base: Base,
}

/// What lies beyond the side of a triangle that faces the triangle found before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Base {
    /// The boundary's last edge, from its last vertex to its first.
    Boundary,
    /// The side from the first corner to the second of the triangle of this index.
    FirstSide(u32),
    /// The side from the second corner to the third of the triangle of this index.
    SecondSide(u32),
}

/// A part of the boundary that is still to be filled: the places from `from` to `to`.
#[derive(Clone, Copy)]
struct Gap {
    from: u32,
    to: u32,
    base: Base,
}

/// Fills holes; keeps its memory from one to the next.
#[derive(Default)]
pub(crate) struct HoleFiller {
    gaps: Vec<Gap>,
    triangles: Vec<HoleTriangle>,
}

impl HoleFiller {
    /// The triangles that fill the hole with the given boundary of at least three points,
    /// counter-clockwise; each after the one beyond its base.
    pub(crate) fn fill(&mut self, boundary: &[Point]) -> &[HoleTriangle] {
        self.triangles.clear();
        self.gaps.push(Gap { from: 0, to: boundary.len() as u32 - 1, base: Base::Boundary });
        while let Some(Gap { from, to, base }) = self.gaps.pop() {
            let apex = apex(boundary, from, to);
            let triangle = self.triangles.len() as u32;
            self.triangles.push(HoleTriangle { corners: [from, apex, to], base });
            if to - apex > 1 {
                self.gaps.push(Gap { from: apex, to, base: Base::SecondSide(triangle) });
            }
            if apex - from > 1 {
                self.gaps.push(Gap { from, to: apex, base: Base::FirstSide(triangle) });
            }
        }
        &self.triangles
    }

    /// The triangles of the last fill.
    pub(crate) fn triangles(&self) -> &[HoleTriangle] {
        &self.triangles
    }
}

/// The place between `from` and `to` whose vertex makes the triangle of the triangulation with the
/// edge from `to` to `from`: left of that edge, and no other such vertex in its circle.
#[inline]
fn apex(boundary: &[Point], from: u32, to: u32) -> u32 {
    let [a, b] = [from, to].map(|place| boundary[place as usize]);
    let mut best = from + 1;
    let mut found = to - from == 2;
    for place in from + 1..to {
        let candidate = boundary[place as usize];
        if found && place == best {
            continue;
        }
        if orientation(a, candidate, b) > 0
            && (!found || in_circle(a, boundary[best as usize], b, candidate))
        {
            best = place;
            found = true;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_is_cut_along_the_preferred_direction() {
        let square = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| Point::new(x, y));
        for rotation in 0..4 {
            let mut boundary = square;
            boundary.rotate_left(rotation);
            let mut filler = HoleFiller::default();
            let triangles = filler.fill(&boundary);
            assert_eq!(triangles.len(), 2);
            for triangle in triangles {
                let corners = triangle.corners.map(|place| boundary[place as usize]);
                assert!(corners.contains(&square[0]) && corners.contains(&square[2]));
            }
        }
    }

    #[test]
    fn a_concave_boundary_is_filled_inside_only() {
        let boundary = [(0, 0), (6, 0), (3, 1), (6, 6), (0, 6)].map(|(x, y)| Point::new(x, y));
        let mut filler = HoleFiller::default();
        let triangles = filler.fill(&boundary);
        let double_area: i64 = triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.corners.map(|place| boundary[place as usize]);
                assert!(orientation(a, b, c) > 0);
                orientation(a, b, c)
            })
            .sum();
        assert_eq!(double_area, 72 - 18);
    }
}
