//! Triangulation by a line that sweeps the rows upwards.
//!
//! Each point meets the front, the upper boundary of what is triangulated, in the edge or vertex
//! beneath it, which the front finds by column, and is connected to it; wrong edges are flipped
//! (`flipping`), and pockets that the point has made narrow are filled at once, so that few flips
//! are needed later. After the last row the remaining pockets are filled. Borut Zalik, "An
//! efficient sweep-line Delaunay triangulation algorithm", 2005.
//!
//! A point needs less than one flip on average where points are spread as in pictures, but points
//! can be placed so that almost every one flips the edges to almost all others. So flips are
//! counted, and too many of them end the sweep without a result.

use crate::control::{Cancelled, Control, Stage};
use crate::image::Point;
use crate::triangulation::flipping::Flipping;
use crate::triangulation::front::{Front, Node};
use crate::triangulation::predicates::orientation;
use crate::triangulation::{NONE, POINTS_PER_POLL};

/// Flips per point that end the sweep. With all of them it takes about as long as what then takes
/// its place.
const MOST_FLIPS: usize = 8;

/// The half-edges of a triangulation: their origins and twins.
type HalfEdges = (Vec<u32>, Vec<u32>);

/// Triangulates points given by row, then column, that hold the corners of a rectangle around all
/// of them; `None` when it would take too many flips.
pub(super) fn triangulate(
    points: &[Point],
    control: &dyn Control,
) -> Result<Option<HalfEdges>, Cancelled> {
    let mut sweep = Sweep::new(points);
    let bottom_row = points.iter().take_while(|p| p.y == points[0].y).count();
    let mut poll_at = 0;
    for vertex in bottom_row..points.len() {
        let work = vertex + sweep.triangles.flips();
        if work >= poll_at {
            control.poll(Stage::Triangulate, vertex, points.len())?;
            poll_at = work + POINTS_PER_POLL;
        }
        sweep.insert(vertex as u32);
        if sweep.triangles.flips() > MOST_FLIPS * points.len() {
            return Ok(None);
        }
    }
    sweep.fill_all();
    Ok(Some(sweep.triangles.finish()))
}

/// What is triangulated of the rows behind the line.
#[derive(Debug)]
struct Sweep<'a> {
    triangles: Flipping<'a>,
    /// The outer half-edge `triangles.outer(c)` is that of the front from column `c` to the next.
    front: Front,
    /// The column of the left side.
    left: i32,
    /// The outer half-edge at the other sides.
    side: u32,
}

impl<'a> Sweep<'a> {
    /// The line at the first row, whose points are the front.
    fn new(points: &'a [Point]) -> Self {
        let left = points[0].x;
        let width = (points[points.len() - 1].x - left) as u32 + 1;
        let triangles = Flipping::new(points, width as usize + 1);
        let side = triangles.outer(width);
        let mut sweep = Self { triangles, front: Front::new(width as usize), left, side };
        let mut last = NONE;
        for (vertex, point) in (0..).zip(points.iter().take_while(|p| p.y == points[0].y)) {
            let column = sweep.column(*point);
            sweep.front.insert_after(last, column, vertex);
            sweep.triangles.link(sweep.triangles.outer(column), side);
            last = column;
        }
        sweep
    }

    fn column(&self, point: Point) -> u32 {
        (point.x - self.left) as u32
    }

    /// The place of the front's vertex in a column.
    #[inline]
    fn place(&self, column: u32) -> Point {
        self.triangles.point(self.front.vertex(column))
    }

    /// Connects the next point to the front.
    fn insert(&mut self, vertex: u32) {
        let column = self.column(self.triangles.point(vertex));
        let beneath = self.front.at_or_before(column);
        if beneath < column {
            self.insert_over_edge(vertex, column, beneath);
        } else {
            self.insert_over_vertex(vertex, column);
        }
        self.fill_narrow_right(column);
        self.fill_narrow_left(column);
    }

    /// Connects a point to the edge beneath it, which begins in the column `left`.
    fn insert_over_edge(&mut self, vertex: u32, column: u32, left: u32) {
        let Node { vertex: from, right, .. } = self.front.node(left);
        let base = self.triangles.add([from, self.front.vertex(right), vertex]);
        self.triangles.link(base, self.beneath(left));
        self.triangles.link(base + 1, self.triangles.outer(column));
        self.triangles.link(base + 2, self.triangles.outer(left));
        self.front.insert_after(left, column, vertex);
        self.triangles.legalize_around_apex(base);
    }

    /// Connects a point to the vertex beneath it and its neighbours in the front.
    fn insert_over_vertex(&mut self, vertex: u32, column: u32) {
        let Node { vertex: beneath, left, right } = self.front.node(column);
        let (mut upright, mut suspects) = (self.side, [self.side; 3]);
        if left != NONE {
            let base = self.triangles.add([self.front.vertex(left), beneath, vertex]);
            self.triangles.link(base, self.beneath(left));
            self.triangles.link(base + 1, self.side);
            self.triangles.link(base + 2, self.triangles.outer(left));
            (upright, suspects[0]) = (base + 1, base);
        }
        if right != NONE {
            let base = self.triangles.add([beneath, self.front.vertex(right), vertex]);
            self.triangles.link(base, self.beneath(column));
            self.triangles.link(base + 1, self.triangles.outer(column));
            self.triangles.link(base + 2, upright);
            (suspects[1], suspects[2]) = (base, base + 2);
        }
        self.front.replace(column, vertex);
        self.triangles.legalize(suspects.into_iter().filter(|&h| h != self.side));
    }

    /// The half-edge beneath the front's edge from a column to the next.
    #[inline]
    fn beneath(&self, column: u32) -> u32 {
        self.triangles.twin(self.triangles.outer(column))
    }

    /// Fills pockets at the right of a vertex while they are narrow.
    fn fill_narrow_right(&mut self, column: u32) {
        loop {
            let bottom = self.front.node(column).right;
            if bottom == NONE {
                return;
            }
            let far = self.front.node(bottom).right;
            if far == NONE || !self.is_narrow(column, bottom, far) {
                return;
            }
            self.fill(column, bottom, far);
        }
    }

    /// Fills pockets at the left of a vertex while they are narrow.
    fn fill_narrow_left(&mut self, column: u32) {
        loop {
            let bottom = self.front.node(column).left;
            if bottom == NONE {
                return;
            }
            let far = self.front.node(bottom).left;
            if far == NONE || !self.is_narrow(far, bottom, column) {
                return;
            }
            self.fill(far, bottom, column);
        }
    }

    /// Tells whether the front turns at its vertex in the column `bottom` by an angle under 108
    /// degrees, seen from above. The angle decides nothing but how many flips are needed.
    #[inline]
    fn is_narrow(&self, left: u32, bottom: u32, right: u32) -> bool {
        let [left, bottom, right] = [left, bottom, right].map(|column| self.place(column));
        let (lx, ly) = (i64::from(left.x - bottom.x), i64::from(left.y - bottom.y));
        let (rx, ry) = (i64::from(right.x - bottom.x), i64::from(right.y - bottom.y));
        let (sine, cosine) = (rx * ly - ry * lx, lx * rx + ly * ry);
        sine > 0 && 3 * cosine + sine > 0
    }

    /// Puts a triangle on three vertices of the front that follow each other.
    fn fill(&mut self, left: u32, bottom: u32, right: u32) {
        let corners = [left, bottom, right].map(|column| self.front.vertex(column));
        let base = self.triangles.add(corners);
        self.triangles.link(base, self.beneath(left));
        self.triangles.link(base + 1, self.beneath(bottom));
        self.triangles.link(base + 2, self.triangles.outer(left));
        self.front.remove(bottom);
        self.triangles.legalize([base, base + 1]);
    }

    /// Fills all pockets, so that the front becomes the row of the upper corners.
    fn fill_all(&mut self) {
        let mut left = 0;
        loop {
            let bottom = self.front.node(left).right;
            if bottom == NONE {
                return;
            }
            let right = self.front.node(bottom).right;
            if right == NONE {
                return;
            }
            let places = [left, bottom, right].map(|column| self.place(column));
            if orientation(places[0], places[1], places[2]) > 0 {
                self.fill(left, bottom, right);
                // The pocket before may have opened.
                let before = self.front.node(left).left;
                left = if before == NONE { left } else { before };
            } else {
                left = bottom;
            }
        }
    }
}
