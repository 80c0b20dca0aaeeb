//! Triangulation by a line that sweeps the rows upwards.
//!
//! Borut Zalik, "An efficient sweep-line Delaunay triangulation algorithm", 2005. The front is the
//! upper boundary of the triangles so far. Each point is connected to the edge or the vertex of the
//! front below it. Then wrong edges are flipped (see `flipping`), and narrow pockets of the front
//! beside the point are filled, which saves flips; the others are filled after the last row.
//!
//! In pictures a point takes less than one flip on average, but some points make almost every
//! insertion flip almost all edges. Above a number of flips the sweep ends without a result.

use crate::control::{Cancelled, Control};
use crate::image::Point;
use crate::triangulation::flipping::{Flipping, STEPS_PER_POLL};
use crate::triangulation::front::{Front, LEFT, RIGHT};
use crate::triangulation::predicates::orientation;
use crate::triangulation::{HalfEdges, NONE};

/// The most flips per point. They take about as long as divide and conquer of the same points.
const MOST_FLIPS: usize = 8;

/// Triangulates points given by row, then column, that hold the corners of a rectangle around all
/// of them; `None` when that takes too many flips.
pub(super) fn triangulate(
    points: &[Point],
    control: &dyn Control,
) -> Result<Option<HalfEdges>, Cancelled> {
    let bottom_row = points.iter().take_while(|p| p.y == points[0].y).count();
    let mut sweep = Sweep::new(points, bottom_row, control);
    for vertex in bottom_row..points.len() {
        if (vertex - bottom_row).is_multiple_of(STEPS_PER_POLL) {
            sweep.triangles.poll()?;
        }
        sweep.insert(vertex as u32)?;
        if sweep.triangles.flips > MOST_FLIPS * points.len() {
            return Ok(None);
        }
    }
    sweep.fill_all()?;
    sweep.triangles.finish().map(Some)
}

/// The columns of three successive vertices of the front, from left to right.
type Pocket = [u32; 3];

/// The triangles of the rows below the line, and their front.
struct Sweep<'a> {
    triangles: Flipping<'a>,
    /// The front's edge from column `c` to the next vertex is the outer half-edge number `c`.
    front: Front,
    left: i32,
    /// The one outer half-edge for all edges at the other sides of the rectangle.
    side: u32,
}

impl<'a> Sweep<'a> {
    /// Starts with the points of the bottom row as the front.
    fn new(points: &'a [Point], bottom_row: usize, control: &'a dyn Control) -> Self {
        let left = points[0].x;
        let width = (points[points.len() - 1].x - left) as u32 + 1;
        let triangles = Flipping::new(points, width as usize + 1, control);
        let side = triangles.outer(width);
        let mut sweep = Self { triangles, front: Front::new(width as usize), left, side };
        let mut last = NONE;
        for vertex in 0..bottom_row as u32 {
            let column = sweep.column(vertex);
            sweep.front.insert_after(last, column, vertex);
            sweep.triangles.link(sweep.triangles.outer(column), side);
            last = column;
        }
        sweep
    }

    fn column(&self, vertex: u32) -> u32 {
        (self.triangles.point(vertex).x - self.left) as u32
    }

    fn vertex(&self, column: u32) -> u32 {
        self.front.node(column).vertex
    }

    /// The triangle's half-edge at the front's edge from a column to the next vertex.
    fn below(&self, column: u32) -> u32 {
        self.triangles.twin(self.triangles.outer(column))
    }

    fn insert(&mut self, vertex: u32) -> Result<(), Cancelled> {
        let column = self.column(vertex);
        let left = self.front.at_or_before(column);
        if left < column {
            self.insert_over_edge(vertex, column, left)?;
        } else {
            self.insert_over_vertex(vertex, column)?;
        }
        for side in [RIGHT, LEFT] {
            while let Some(pocket) = self.pocket(column, side)
                && self.is_narrow(pocket)
            {
                self.fill(pocket)?;
            }
        }
        Ok(())
    }

    /// Connects a point to the edge below it, which begins in the column `left`.
    fn insert_over_edge(&mut self, vertex: u32, column: u32, left: u32) -> Result<(), Cancelled> {
        let right = self.front.node(left).neighbours[RIGHT];
        let base = self.triangles.add([self.vertex(left), self.vertex(right), vertex]);
        self.triangles.link(base, self.below(left));
        self.triangles.link(base + 1, self.triangles.outer(column));
        self.triangles.link(base + 2, self.triangles.outer(left));
        self.front.insert_after(left, column, vertex);
        self.triangles.legalize_around_apex(base)
    }

    /// Connects a point to the vertex below it and the neighbours of that vertex in the front.
    fn insert_over_vertex(&mut self, vertex: u32, column: u32) -> Result<(), Cancelled> {
        let [left, right] = self.front.node(column).neighbours;
        let below = self.vertex(column);
        let (mut upright, mut suspects) = (self.side, [self.side; 3]);
        if left != NONE {
            let base = self.triangles.add([self.vertex(left), below, vertex]);
            self.triangles.link(base, self.below(left));
            self.triangles.link(base + 1, self.side);
            self.triangles.link(base + 2, self.triangles.outer(left));
            (upright, suspects[0]) = (base + 1, base);
        }
        if right != NONE {
            let base = self.triangles.add([below, self.vertex(right), vertex]);
            self.triangles.link(base, self.below(column));
            self.triangles.link(base + 1, self.triangles.outer(column));
            self.triangles.link(base + 2, upright);
            (suspects[1], suspects[2]) = (base, base + 2);
        }
        self.front.replace(column, vertex);
        self.triangles.legalize(suspects.into_iter().filter(|&h| h != self.side))
    }

    /// The pocket that begins with the vertex of a column and extends to one side.
    fn pocket(&self, column: u32, side: usize) -> Option<Pocket> {
        let bottom = self.front.node(column).neighbours[side];
        if bottom == NONE {
            return None;
        }
        let far = self.front.node(bottom).neighbours[side];
        let pocket = if side == LEFT { [far, bottom, column] } else { [column, bottom, far] };
        (far != NONE).then_some(pocket)
    }

    /// Whether the angle of a pocket, measured above its middle vertex, is below 108 degrees. The
    /// result depends on no such angle, only the number of flips does.
    fn is_narrow(&self, pocket: Pocket) -> bool {
        let [left, bottom, right] = self.points(pocket);
        let (lx, ly) = (i64::from(left.x - bottom.x), i64::from(left.y - bottom.y));
        let (rx, ry) = (i64::from(right.x - bottom.x), i64::from(right.y - bottom.y));
        let (sine, cosine) = (rx * ly - ry * lx, lx * rx + ly * ry);
        sine > 0 && 3 * cosine + sine > 0
    }

    fn points(&self, pocket: Pocket) -> [Point; 3] {
        pocket.map(|column| self.triangles.point(self.vertex(column)))
    }

    fn fill(&mut self, pocket: Pocket) -> Result<(), Cancelled> {
        let [left, bottom, _] = pocket;
        let base = self.triangles.add(pocket.map(|column| self.vertex(column)));
        self.triangles.link(base, self.below(left));
        self.triangles.link(base + 1, self.below(bottom));
        self.triangles.link(base + 2, self.triangles.outer(left));
        self.front.remove(bottom);
        self.triangles.legalize([base, base + 1])
    }

    fn fill_all(&mut self) -> Result<(), Cancelled> {
        let (mut left, mut pockets) = (0, 0_usize);
        while let Some(pocket) = self.pocket(left, RIGHT) {
            if pockets.is_multiple_of(STEPS_PER_POLL) {
                self.triangles.poll()?;
            }
            pockets += 1;
            let [a, b, c] = self.points(pocket);
            if orientation(a, b, c) > 0 {
                self.fill(pocket)?;
                // The pocket at the left may have become convex.
                let before = self.front.node(left).neighbours[LEFT];
                left = if before == NONE { left } else { before };
            } else {
                left = pocket[1];
            }
        }
        Ok(())
    }
}
