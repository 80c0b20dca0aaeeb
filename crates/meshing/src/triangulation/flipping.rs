//! Triangles that are added one by one, and flips until each edge is the preferred one.
//!
//! C. L. Lawson, "Software for C1 surface interpolation", 1977. Each flip lowers the lifted
//! surface, so the flips end. A triangulation without an edge to flip is the Delaunay
//! triangulation; with the lift of `predicates` it is the one with preferred directions.

use crate::control::{Cancelled, Control, POINTS_PER_POLL, Stage};
use crate::image::Point;
use crate::triangulation::predicates::in_circle;
use crate::triangulation::{HalfEdges, NONE, next, previous};

/// Points, flips or pockets between two polls: some tens of microseconds.
pub(super) const STEPS_PER_POLL: usize = 1 << 10;

/// The triangles' half-edges in triples, and after their capacity the outer half-edges. These
/// belong to no triangle and have twins only, so a boundary edge is linked like any other.
pub(super) struct Flipping<'a> {
    points: &'a [Point],
    origins: Vec<u32>,
    twins: Vec<u32>,
    outer: u32,
    suspects: Vec<u32>,
    pub(super) flips: usize,
    control: &'a dyn Control,
}

impl<'a> Flipping<'a> {
    /// No triangles, and `outer_count` outer half-edges.
    pub(super) fn new(points: &'a [Point], outer_count: usize, control: &'a dyn Control) -> Self {
        // There are fewer than two triangles a point.
        let most = 6 * points.len();
        Self {
            points,
            origins: Vec::with_capacity(most),
            // Zeros, because the system has them at no cost.
            twins: vec![0; most + outer_count],
            outer: most as u32,
            suspects: Vec::new(),
            flips: 0,
            control,
        }
    }

    #[inline]
    pub(super) fn outer(&self, number: u32) -> u32 {
        self.outer + number
    }

    #[inline]
    pub(super) fn point(&self, vertex: u32) -> Point {
        self.points[vertex as usize]
    }

    #[inline]
    pub(super) fn twin(&self, h: u32) -> u32 {
        self.twins[h as usize]
    }

    /// Adds a counter-clockwise triangle without twins; returns its first half-edge.
    #[inline]
    pub(super) fn add(&mut self, corners: [u32; 3]) -> u32 {
        let h = self.origins.len() as u32;
        self.origins.extend(corners);
        h
    }

    pub(super) fn poll(&self) -> Result<(), Cancelled> {
        // There are almost two triangles a point.
        self.control.poll(Stage::Triangulate, self.origins.len() / 6, self.points.len())
    }

    #[inline]
    pub(super) fn link(&mut self, h: u32, twin: u32) {
        self.twins[h as usize] = twin;
        self.twins[twin as usize] = h;
    }

    /// Flips the edges that a new triangle requires whose only edge inside the mesh is `h`.
    ///
    /// Edges that get the triangle's third vertex are right, as after the insertion of a point.
    pub(super) fn legalize_around_apex(&mut self, mut h: u32) -> Result<(), Cancelled> {
        loop {
            let twin = self.twin(h);
            if self.is_wrong(h, twin) {
                self.flip(h, twin)?;
                // The other edge of the quadrilateral that now faces the apex; `h` is the first.
                self.suspects.push(next(twin));
            } else {
                match self.suspects.pop() {
                    Some(suspect) => h = suspect,
                    None => return Ok(()),
                }
            }
        }
    }

    /// Flips all edges that are wrong when any of `suspects` may be wrong.
    pub(super) fn legalize(
        &mut self,
        suspects: impl IntoIterator<Item = u32>,
    ) -> Result<(), Cancelled> {
        self.suspects.extend(suspects);
        while let Some(h) = self.suspects.pop() {
            let twin = self.twin(h);
            if self.is_wrong(h, twin) {
                self.flip(h, twin)?;
                self.suspects.extend([h, next(h), twin, next(twin)]);
            }
        }
        Ok(())
    }

    /// Whether an edge is not the preferred diagonal of its quadrilateral.
    #[inline]
    fn is_wrong(&self, h: u32, twin: u32) -> bool {
        if twin >= self.outer {
            return false;
        }
        let [a, b, c, d] =
            [h, next(h), previous(h), previous(twin)].map(|h| self.point(self.origins[h as usize]));
        in_circle(a, b, c, d)
    }

    /// Replaces the diagonal `h` of its quadrilateral by the other one.
    ///
    /// With `h` from `a` to `b`, `c` at its left and `d` at its right, the triangle `abc` becomes
    /// `dbc` and `bad` becomes `cad`, each in its slots, so `bc` and `ad` keep their half-edges.
    fn flip(&mut self, h: u32, twin: u32) -> Result<(), Cancelled> {
        self.flips += 1;
        let (from_c, from_d) = (previous(h), previous(twin));
        let (twin_of_ca, twin_of_db) = (self.twin(from_c), self.twin(from_d));
        self.origins[h as usize] = self.origins[from_d as usize];
        self.link(h, twin_of_db);
        self.origins[twin as usize] = self.origins[from_c as usize];
        self.link(twin, twin_of_ca);
        self.link(from_c, from_d);
        if self.flips.is_multiple_of(STEPS_PER_POLL) { self.poll() } else { Ok(()) }
    }

    /// Origins and twins of the triangles' half-edges, with [`NONE`] for outer half-edges.
    pub(super) fn finish(self) -> Result<HalfEdges, Cancelled> {
        let poll = || self.control.poll(Stage::Triangulate, self.points.len(), self.points.len());
        let (origins, mut twins, outer) = (self.origins, self.twins, self.outer);
        twins.truncate(origins.len());
        for chunk in twins.chunks_mut(POINTS_PER_POLL) {
            poll()?;
            chunk.iter_mut().for_each(|twin| *twin = if *twin < outer { *twin } else { NONE });
        }
        Ok((origins, twins))
    }
}
