//! Triangulation by halving the points and merging the halves, in time `n log n` for any points.
//!
//! Leonidas Guibas and Jorge Stolfi, "Primitives for the manipulation of general subdivisions and
//! the computation of Voronoi diagrams", 1985. The points come in the order of their rows and are
//! halved in this order, so they need no sorting; the paper's left half is the lower half here.

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::image::Point;
use crate::triangulation::predicates::{in_circle, orientation};
use crate::triangulation::{HalfEdges, NONE, STEPS_PER_POINT};

/// Marks half-edges without a triangle at their left: those outside the hull and deleted ones.
const OUTSIDE: u32 = NONE - 1;

/// Triangulates distinct points given by row, then column; collinear ones have no triangles.
pub(super) fn triangulate(points: &[Point], control: &dyn Control) -> Result<HalfEdges, Cancelled> {
    if points.len() < 3 {
        return Ok((Vec::new(), Vec::new()));
    }
    // There are fewer than three edges a point.
    let [origins, following, preceding] = [0; 3].map(|_| Vec::with_capacity(6 * points.len()));
    let poller = Poller::new(control, Stage::Triangulate, 0, points.len());
    let mut subdivision =
        Subdivision { points, poller, origins, following, preceding, free: Vec::new() };
    let (hull, _) = subdivision.triangulate(0, points.len() as u32)?;
    subdivision.into_triangles(hull)
}

/// The counter-clockwise half-edge of a hull out of its lowest vertex, the clockwise of its top.
type Extremes = (u32, u32);

/// Edges as pairs of half-edges, `e` and `e ^ 1`, in rings around their origins.
struct Subdivision<'a> {
    points: &'a [Point],
    poller: Poller<'a>,
    origins: Vec<u32>,
    /// The next half-edge of the same origin, counter-clockwise.
    following: Vec<u32>,
    /// The next one clockwise.
    preceding: Vec<u32>,
    free: Vec<u32>,
}

impl Subdivision<'_> {
    fn triangulate(&mut self, from: u32, to: u32) -> Result<Extremes, Cancelled> {
        self.poller.done = to.min(from + 3) as usize;
        match to - from {
            2 => {
                let edge = self.make(from, from + 1);
                Ok((edge, edge ^ 1))
            }
            3 => Ok(self.triangle(from)),
            count => {
                let middle = from + count / 2;
                let lower = self.triangulate(from, middle)?;
                let upper = self.triangulate(middle, to)?;
                self.merge(lower, upper)
            }
        }
    }

    fn triangle(&mut self, first: u32) -> Extremes {
        let (a, b) = (self.make(first, first + 1), self.make(first + 1, first + 2));
        self.splice(a ^ 1, b);
        let turn = orientation(self.point(first), self.point(first + 1), self.point(first + 2));
        if turn == 0 {
            return (a, b ^ 1);
        }
        let c = self.connect(b, a);
        if turn > 0 { (a, b ^ 1) } else { (c ^ 1, c) }
    }

    /// Merges two triangulations, of which one lies below the other.
    fn merge(
        &mut self,
        (mut lowest, lower_inner): Extremes,
        (upper_inner, mut uppermost): Extremes,
    ) -> Result<Extremes, Cancelled> {
        let (lower, upper) = self.tangent(lower_inner, upper_inner)?;
        let mut base = self.connect(upper ^ 1, lower);
        if self.origin(lower) == self.origin(lowest) {
            lowest = base ^ 1;
        }
        if self.origin(upper) == self.origin(uppermost) {
            uppermost = base;
        }
        while let Some(next) = self.raise(base)? {
            base = next;
        }
        Ok((lowest, uppermost))
    }

    /// The half-edges of both hulls out of the ends of their common tangent.
    fn tangent(&mut self, mut lower: u32, mut upper: u32) -> Result<(u32, u32), Cancelled> {
        loop {
            self.poller.step(STEPS_PER_POINT)?;
            if self.is_left_of(self.origin(upper), lower) {
                lower = self.following_at_left(lower);
            } else if self.is_right_of(self.origin(lower), upper) {
                upper = self.following(upper ^ 1);
            } else {
                return Ok((lower, upper));
            }
        }
    }

    /// The cross edge after `base`, with the triangle between them; `None` at the other tangent.
    fn raise(&mut self, base: u32) -> Result<Option<u32>, Cancelled> {
        let lower = self.candidate(base, self.following(base ^ 1), Self::following)?;
        let upper = self.candidate(base, self.preceding(base), Self::preceding)?;
        let takes_upper = match (lower, upper) {
            (Some(lower), Some(upper)) => self.in_circle(
                self.destination(lower),
                self.origin(lower),
                self.origin(upper),
                self.destination(upper),
            ),
            _ => upper.is_some(),
        };
        Ok(if takes_upper {
            upper.map(|upper| self.connect(upper, base ^ 1))
        } else {
            lower.map(|lower| self.connect(base ^ 1, lower ^ 1))
        })
    }

    /// The edge of one side that may make a triangle with `base`, after the deletion of the edges
    /// that cross this triangle's circle; `None` when no edge of the side lies above `base`.
    fn candidate(
        &mut self,
        base: u32,
        first: u32,
        next: fn(&Self, u32) -> u32,
    ) -> Result<Option<u32>, Cancelled> {
        if !self.is_right_of(self.destination(first), base) {
            return Ok(None);
        }
        let (origin, destination) = (self.origin(base), self.destination(base));
        let mut edge = first;
        loop {
            self.poller.step(STEPS_PER_POINT)?;
            let next = next(self, edge);
            let apex = self.destination(edge);
            if !self.in_circle(destination, origin, apex, self.destination(next)) {
                return Ok(Some(edge));
            }
            self.delete(edge);
            edge = next;
        }
    }

    fn point(&self, vertex: u32) -> Point {
        self.points[vertex as usize]
    }

    fn origin(&self, e: u32) -> u32 {
        self.origins[e as usize]
    }

    fn destination(&self, e: u32) -> u32 {
        self.origins[e as usize ^ 1]
    }

    fn following(&self, e: u32) -> u32 {
        self.following[e as usize]
    }

    fn preceding(&self, e: u32) -> u32 {
        self.preceding[e as usize]
    }

    /// The half-edge after `e` around the face at its left.
    fn following_at_left(&self, e: u32) -> u32 {
        self.preceding(e ^ 1)
    }

    fn is_left_of(&self, vertex: u32, e: u32) -> bool {
        let [p, q, r] = [vertex, self.origin(e), self.destination(e)].map(|v| self.point(v));
        orientation(p, q, r) > 0
    }

    fn is_right_of(&self, vertex: u32, e: u32) -> bool {
        self.is_left_of(vertex, e ^ 1)
    }

    fn in_circle(&self, a: u32, b: u32, c: u32, d: u32) -> bool {
        in_circle(self.point(a), self.point(b), self.point(c), self.point(d))
    }

    /// Makes an unconnected edge, with the half-edges of a deleted one if there is any.
    fn make(&mut self, origin: u32, destination: u32) -> u32 {
        let e = self.free.pop().unwrap_or_else(|| {
            let e = self.origins.len() as u32;
            for all in [&mut self.origins, &mut self.following, &mut self.preceding] {
                all.extend([NONE; 2]);
            }
            e
        });
        for (e, origin) in [(e, origin), (e ^ 1, destination)] {
            self.origins[e as usize] = origin;
            self.following[e as usize] = e;
            self.preceding[e as usize] = e;
        }
        e
    }

    /// Joins the rings of two half-edges; splits their ring if they share one.
    fn splice(&mut self, a: u32, b: u32) {
        let (after_a, after_b) = (self.following(a), self.following(b));
        self.following[a as usize] = after_b;
        self.following[b as usize] = after_a;
        self.preceding[after_b as usize] = a;
        self.preceding[after_a as usize] = b;
    }

    /// Makes an edge from the end of `a` to the beginning of `b`, with the same face at their left.
    fn connect(&mut self, a: u32, b: u32) -> u32 {
        let e = self.make(self.destination(a), self.origin(b));
        self.splice(e, self.following_at_left(a));
        self.splice(e ^ 1, b);
        e
    }

    fn delete(&mut self, e: u32) {
        for e in [e, e ^ 1] {
            self.splice(e, self.preceding(e));
        }
        self.free.push(e & !1);
    }

    /// The triangles, given a half-edge of the hull, counter-clockwise.
    ///
    /// Each array is freed after its last use, so that not all are in memory at once.
    fn into_triangles(self, hull: u32) -> Result<HalfEdges, Cancelled> {
        let Self { mut poller, origins, following, preceding, free, .. } = self;
        let mut poll = || poller.step(1);
        let following_at_left = |e: u32| preceding[e as usize ^ 1];
        // The number of each half-edge among those of the triangles.
        let mut numbers = following;
        for number in &mut numbers {
            poll()?;
            *number = NONE;
        }
        for e in free {
            numbers[e as usize..][..2].fill(OUTSIDE);
        }
        let mut e = hull ^ 1;
        while numbers[e as usize] == NONE {
            numbers[e as usize] = OUTSIDE;
            e = following_at_left(e);
        }
        let mut edges = Vec::with_capacity(numbers.len());
        for first in 0..numbers.len() as u32 {
            poll()?;
            let mut e = first;
            while numbers[e as usize] == NONE {
                numbers[e as usize] = edges.len() as u32;
                edges.push(e);
                e = following_at_left(e);
            }
        }
        drop(preceding);
        let mut triangle_origins = Vec::with_capacity(edges.len());
        for &e in &edges {
            poll()?;
            triangle_origins.push(origins[e as usize]);
        }
        drop(origins);
        for e in &mut edges {
            poll()?;
            let twin = numbers[*e as usize ^ 1];
            *e = if twin == OUTSIDE { NONE } else { twin };
        }
        Ok((triangle_origins, edges))
    }
}
