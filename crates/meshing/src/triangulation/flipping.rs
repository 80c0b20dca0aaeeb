//! Triangles that are added one by one and flipped until each edge is the preferred one.
//!
//! C. L. Lawson, "Software for C1 surface interpolation", 1977: flips lower the lifted surface, so
//! they end, and where no edge asks for one the triangulation is the Delaunay triangulation, of the
//! lift of `predicates` the one with preferred directions.

use crate::image::Point;
use crate::triangulation::predicates::in_circle;
use crate::triangulation::{NONE, next, previous};

/// Half-edges in triples, and beyond them the numbers of outer half-edges, which belong to no
/// triangle but know their twins; so an edge of the boundary needs no care when it moves.
#[derive(Debug)]
pub(super) struct Flipping<'a> {
    points: &'a [Point],
    origins: Vec<u32>,
    twins: Vec<u32>,
    /// The first outer half-edge.
    outer: u32,
    /// Edges still to be looked at.
    suspects: Vec<u32>,
    flips: usize,
}

impl<'a> Flipping<'a> {
    /// No triangles yet, and so many outer half-edges.
    pub(super) fn new(points: &'a [Point], outer_count: usize) -> Self {
        // Fewer than two triangles a point.
        let most = 6 * points.len();
        Self {
            points,
            origins: Vec::with_capacity(most),
            twins: vec![NONE; most + outer_count],
            outer: most as u32,
            suspects: Vec::new(),
            flips: 0,
        }
    }

    /// An outer half-edge.
    #[inline]
    pub(super) fn outer(&self, number: u32) -> u32 {
        self.outer + number
    }

    /// The place of a vertex.
    #[inline]
    pub(super) fn point(&self, vertex: u32) -> Point {
        self.points[vertex as usize]
    }

    /// The half-edge opposite to another one.
    #[inline]
    pub(super) fn twin(&self, h: u32) -> u32 {
        self.twins[h as usize]
    }

    /// Flips made so far.
    pub(super) fn flips(&self) -> usize {
        self.flips
    }

    /// Adds a counter-clockwise triangle; returns its first half-edge. It has no twins yet.
    #[inline]
    pub(super) fn add(&mut self, corners: [u32; 3]) -> u32 {
        let h = self.origins.len() as u32;
        self.origins.extend(corners);
        h
    }

    /// Makes two half-edges opposite to each other.
    #[inline]
    pub(super) fn link(&mut self, h: u32, twin: u32) {
        self.twins[h as usize] = twin;
        self.twins[twin as usize] = h;
    }

    /// Flips what must be after a triangle has joined the mesh at the half-edge `h` alone.
    ///
    /// Edges that get the triangle's third vertex stay, as in the insertion of a point.
    pub(super) fn legalize_around_apex(&mut self, mut h: u32) {
        loop {
            let twin = self.twin(h);
            if self.is_to_flip(h, twin) {
                self.flip(h, twin);
                // The two edges of the quadrilateral that the apex has come to see.
                self.suspects.push(next(twin));
            } else {
                match self.suspects.pop() {
                    Some(suspect) => h = suspect,
                    None => return,
                }
            }
        }
    }

    /// Flips what must be when any of these edges may be wrong.
    pub(super) fn legalize(&mut self, edges: impl IntoIterator<Item = u32>) {
        self.suspects.extend(edges);
        while let Some(h) = self.suspects.pop() {
            let twin = self.twin(h);
            if self.is_to_flip(h, twin) {
                self.flip(h, twin);
                self.suspects.extend([h, next(h), twin, next(twin)]);
            }
        }
    }

    #[inline]
    fn is_to_flip(&self, h: u32, twin: u32) -> bool {
        if twin >= self.outer {
            return false;
        }
        let [a, b, c, d] =
            [h, next(h), previous(h), previous(twin)].map(|h| self.point(self.origins[h as usize]));
        in_circle(a, b, c, d)
    }

    /// Replaces the diagonal `h` of its quadrilateral by the other one.
    ///
    /// With `h` from `a` to `b`, `c` at its left and `d` at its right, the triangles `a b c` and
    /// `b a d` become `d b c` in the slots of the first and `c a d` in those of the second, which
    /// leaves `b c` and `a d` where they are.
    fn flip(&mut self, h: u32, twin: u32) {
        self.flips += 1;
        let (from_c, from_d) = (previous(h), previous(twin));
        let (beyond_ca, beyond_db) = (self.twin(from_c), self.twin(from_d));
        self.origins[h as usize] = self.origins[from_d as usize];
        self.link(h, beyond_db);
        self.origins[twin as usize] = self.origins[from_c as usize];
        self.link(twin, beyond_ca);
        self.link(from_c, from_d);
    }

    /// Origins and twins of all half-edges, [`NONE`] where a twin is an outer half-edge.
    pub(super) fn finish(self) -> (Vec<u32>, Vec<u32>) {
        let Self { origins, mut twins, outer, .. } = self;
        twins.truncate(origins.len());
        for twin in &mut twins {
            *twin = if *twin < outer { *twin } else { NONE };
        }
        (origins, twins)
    }
}
