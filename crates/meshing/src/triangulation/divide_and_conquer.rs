//! Triangulation by halving the points and merging the halves, in time `n log n` for any points.
//!
//! Leonidas Guibas and Jorge Stolfi, "Primitives for the manipulation of general subdivisions and
//! the computation of Voronoi diagrams", 1985. The points are halved in the order of their rows, so
//! they need no sorting; what the paper calls left is below here.

use crate::control::{Cancelled, Control, Stage};
use crate::image::Point;
use crate::triangulation::predicates::{in_circle, orientation};
use crate::triangulation::{NONE, POINTS_PER_POLL};

/// On the way to triangles, marks the half-edges that have the outside at their left or are gone.
const OUTSIDE: u32 = NONE - 1;

/// The half-edges of the triangles: their origins and twins.
type HalfEdges = (Vec<u32>, Vec<u32>);

/// Triangulates distinct points given by row, then column; collinear ones have no triangles.
pub(super) fn triangulate(points: &[Point], control: &dyn Control) -> Result<HalfEdges, Cancelled> {
    if points.len() < 3 {
        return Ok((Vec::new(), Vec::new()));
    }
    let mut subdivision = Subdivision::new(points, control);
    let (hull, _) = subdivision.triangulate(0, points.len() as u32)?;
    Ok(subdivision.into_triangles(hull))
}

/// Two half-edges of a hull: the counter-clockwise one out of its lowest vertex, and the clockwise
/// one out of its uppermost.
type Extremes = (u32, u32);

/// Edges as pairs of half-edges, `e` and `e ^ 1`, in rings around their origins.
struct Subdivision<'a> {
    points: &'a [Point],
    control: &'a dyn Control,
    /// Steps since the last poll.
    steps: usize,
    /// Points that have edges.
    reached: u32,
    /// The vertex at which each half-edge begins.
    origins: Vec<u32>,
    /// The next half-edge of the same origin, counter-clockwise.
    following: Vec<u32>,
    /// The next one clockwise.
    preceding: Vec<u32>,
    /// Even half-edges of edges that are gone.
    free: Vec<u32>,
}

impl<'a> Subdivision<'a> {
    fn new(points: &'a [Point], control: &'a dyn Control) -> Self {
        // Fewer than three edges a point.
        let most = 6 * points.len();
        let [origins, following, preceding] = [0; 3].map(|_| Vec::with_capacity(most));
        let (steps, reached, free) = (0, 0, Vec::new());
        Self { points, control, steps, reached, origins, following, preceding, free }
    }

    /// Triangulates the points of a range.
    fn triangulate(&mut self, from: u32, to: u32) -> Result<Extremes, Cancelled> {
        self.reached = to.min(from + 3);
        match to - from {
            2 => Ok(self.segment(from)),
            3 => Ok(self.triangle(from)),
            count => {
                let middle = from + count / 2;
                let lower = self.triangulate(from, middle)?;
                let upper = self.triangulate(middle, to)?;
                self.merge(lower, upper)
            }
        }
    }

    /// Two points.
    fn segment(&mut self, first: u32) -> Extremes {
        let edge = self.make(first, first + 1);
        (edge, edge ^ 1)
    }

    /// Three points.
    fn triangle(&mut self, first: u32) -> Extremes {
        let (a, b) = (self.make(first, first + 1), self.make(first + 1, first + 2));
        self.splice(a ^ 1, b);
        let turn = orientation(self.place(first), self.place(first + 1), self.place(first + 2));
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
        let (lower, upper) = self.tangent(lower_inner, upper_inner);
        let mut base = self.connect(upper ^ 1, lower);
        if self.origin(lower) == self.origin(lowest) {
            lowest = base ^ 1;
        }
        if self.origin(upper) == self.origin(uppermost) {
            uppermost = base;
        }
        while let Some(next) = self.raise(base) {
            base = next;
            self.poll()?;
        }
        Ok((lowest, uppermost))
    }

    /// The half-edges of both hulls out of the ends of their common tangent.
    fn tangent(&self, mut lower: u32, mut upper: u32) -> (u32, u32) {
        loop {
            if self.is_left_of(self.origin(upper), lower) {
                lower = self.following_at_left(lower);
            } else if self.is_right_of(self.origin(lower), upper) {
                upper = self.following[upper as usize ^ 1];
            } else {
                return (lower, upper);
            }
        }
    }

    /// The cross edge after `base`, with the triangle between them; `None` at the other tangent.
    fn raise(&mut self, base: u32) -> Option<u32> {
        let lower = self.candidate(base, self.following[base as usize ^ 1], Side::Lower);
        let upper = self.candidate(base, self.preceding[base as usize], Side::Upper);
        match (lower, upper) {
            (None, None) => None,
            (Some(lower), None) => Some(self.connect(base ^ 1, lower ^ 1)),
            (None, Some(upper)) => Some(self.connect(upper, base ^ 1)),
            (Some(lower), Some(upper)) => {
                let (at_lower, at_upper) = (self.destination(lower), self.destination(upper));
                let is_upper =
                    self.in_circle(at_lower, self.origin(lower), self.origin(upper), at_upper);
                Some(if is_upper {
                    self.connect(upper, base ^ 1)
                } else {
                    self.connect(base ^ 1, lower ^ 1)
                })
            }
        }
    }

    /// The edge of one side that could make a triangle with `base`, after taking away those in
    /// the way of it; `None` when all lie behind.
    fn candidate(&mut self, base: u32, first: u32, side: Side) -> Option<u32> {
        if !self.is_right_of(self.destination(first), base) {
            return None;
        }
        let (origin, destination) = (self.origin(base), self.destination(base));
        let mut edge = first;
        loop {
            let ring = match side {
                Side::Lower => &self.following,
                Side::Upper => &self.preceding,
            };
            let next = ring[edge as usize];
            let apex = self.destination(edge);
            if !self.in_circle(destination, origin, apex, self.destination(next)) {
                return Some(edge);
            }
            self.delete(edge);
            edge = next;
        }
    }

    /// Polls the control from time to time.
    fn poll(&mut self) -> Result<(), Cancelled> {
        self.steps += 1;
        if self.steps < POINTS_PER_POLL {
            return Ok(());
        }
        self.steps = 0;
        self.control.poll(Stage::Triangulate, self.reached as usize, self.points.len())
    }

    #[inline]
    fn place(&self, vertex: u32) -> Point {
        self.points[vertex as usize]
    }

    #[inline]
    fn origin(&self, e: u32) -> u32 {
        self.origins[e as usize]
    }

    #[inline]
    fn destination(&self, e: u32) -> u32 {
        self.origins[e as usize ^ 1]
    }

    /// The half-edge after `e` around the face at its left.
    #[inline]
    fn following_at_left(&self, e: u32) -> u32 {
        self.preceding[e as usize ^ 1]
    }

    #[inline]
    fn is_left_of(&self, vertex: u32, e: u32) -> bool {
        let [p, q, r] = [vertex, self.origin(e), self.destination(e)].map(|v| self.place(v));
        orientation(p, q, r) > 0
    }

    #[inline]
    fn is_right_of(&self, vertex: u32, e: u32) -> bool {
        self.is_left_of(vertex, e ^ 1)
    }

    #[inline]
    fn in_circle(&self, a: u32, b: u32, c: u32, d: u32) -> bool {
        in_circle(self.place(a), self.place(b), self.place(c), self.place(d))
    }

    /// Makes an edge by itself, in the place of one that is gone where there is any.
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

    /// Joins the rings of two half-edges, or parts them when they are one.
    #[inline]
    fn splice(&mut self, a: u32, b: u32) {
        let (after_a, after_b) = (self.following[a as usize], self.following[b as usize]);
        self.following[a as usize] = after_b;
        self.following[b as usize] = after_a;
        self.preceding[after_b as usize] = a;
        self.preceding[after_a as usize] = b;
    }

    /// Makes an edge from the end of `a` to the beginning of `b`, which have the same face at the
    /// left.
    fn connect(&mut self, a: u32, b: u32) -> u32 {
        let e = self.make(self.destination(a), self.origin(b));
        self.splice(e, self.following_at_left(a));
        self.splice(e ^ 1, b);
        e
    }

    /// Takes an edge out.
    fn delete(&mut self, e: u32) {
        for e in [e, e ^ 1] {
            self.splice(e, self.preceding[e as usize]);
        }
        self.free.push(e & !1);
    }

    /// The triangles, given a half-edge of the hull, counter-clockwise.
    ///
    /// Gives each array back as soon as it is not needed any more, so as not to hold all at once.
    fn into_triangles(self, hull: u32) -> HalfEdges {
        let Self { origins, following, preceding, free, .. } = self;
        let following_at_left = |e: u32| preceding[e as usize ^ 1];
        // The number of each half-edge among those of the triangles.
        let mut numbers = following;
        numbers.fill(NONE);
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
            let mut e = first;
            while numbers[e as usize] == NONE {
                numbers[e as usize] = edges.len() as u32;
                edges.push(e);
                e = following_at_left(e);
            }
        }
        drop(preceding);
        let triangle_origins = edges.iter().map(|&e| origins[e as usize]).collect();
        drop(origins);
        for e in &mut edges {
            let twin = numbers[*e as usize ^ 1];
            *e = if twin == OUTSIDE { NONE } else { twin };
        }
        (triangle_origins, edges)
    }
}

/// The two triangulations that are merged.
#[derive(Clone, Copy)]
enum Side {
    Lower,
    Upper,
}
