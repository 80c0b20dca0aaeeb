//! The squared error of small faces of pictures of up to 8 bits, sixteen lattice points at a time.
//!
//! The picture lies in strips of four rows, column by column, so that a vector reads a block of four
//! columns and four rows from any column on. A face visits the blocks of its bounding box; which
//! points of a block belong to it, three linear functions tell, one for each edge, and the same
//! three, weighted by the samples at the vertices, are the numerators of the interpolant. A face of
//! some twenty points has six blocks in the place of eight short rows, and nothing is to be found out
//! for each row.
//!
//! All is 32-bit floating point, and exact up to the quotient. With vertices at most 63 columns and
//! rows apart, a point of a block lies in a box of 70 columns and 68 rows around the face. There
//! each edge function is at most `70 * 68 = 4760`, three of them with weights `4 * 255` at most
//! `14.6 * 10^6 < 2^24`, and so is every sum on the way from one block to the next, since it is the
//! value at some such point. The quotient is below 256 where it counts, so two roundings leave an
//! error below `255 * 2^-23`, less than half of `1 / (4 * 63^2)`, the least distance of a quotient from
//! a tie. Squares are summed up in each lane, which meets one point of a block: of a face
//! at most 16 rows and in all `(63^2 / 2 / 4 + 63) / 4 + 16 < 256` points, and `256 * 255^2 < 2^24`.
//!
//! The vectors are those of the machine the program runs on, chosen as it runs; every lane does the
//! same operations in the same order on all of them (see `PERFORMANCE.md`).

use crate::image::Image;
use crate::mesh::Point;
use fearless_simd::{Level, Simd, dispatch, f32x16, i32x16, mask32x16, prelude::*, u8x16};

/// Stands for the error of a face that is not small.
pub(crate) const TOO_LARGE: u64 = u64::MAX;

/// The most columns and rows between two vertices of a small face.
const LARGEST_EXTENT: i32 = 63;

/// Columns and rows of a block.
const SIDE: i32 = 4;

/// Points of a block, one to a lane.
const LANES: usize = 16;

/// Column and row of each lane's point in a block.
const COLUMNS: [f32; LANES] = [0., 0., 0., 0., 1., 1., 1., 1., 2., 2., 2., 2., 3., 3., 3., 3.];
const ROWS: [f32; LANES] = [0., 1., 2., 3., 0., 1., 2., 3., 0., 1., 2., 3., 0., 1., 2., 3.];

/// Adding this to a number below 2^22 rounds it to a whole number, taking it away leaves that.
const ROUND_TO_NEAREST: f32 = 12_582_912.0; // 1.5 * 2^23

/// By how much a point on an edge is moved to the left to find the face that owns it, and by how
/// much downwards: so little that no other point crosses an edge.
const LEFTWARDS: f32 = 1.0 / 128.0;
const DOWNWARDS: f32 = 1.0 / 16_384.0;

/// A picture of up to four components and 8 bits, a byte for each sample.
pub(crate) struct Pixels {
    level: Level,
    width: usize,
    component_count: usize,
    /// Strips of four rows from the bottom up, in each the components one after the other, the four
    /// samples of each column side by side; and room for two blocks at the last column.
    bytes: Vec<u8>,
}

impl Pixels {
    /// The points of a picture; `None` when it has more components or bits.
    pub(crate) fn new(image: &Image) -> Option<Self> {
        let (width, height) = (image.width(), image.height());
        let component_count = image.component_count();
        if image.precision() > 8 || component_count > 4 {
            return None;
        }
        let side = SIDE as usize;
        let mut bytes = vec![0; height.div_ceil(side) * component_count * width * side + 2 * LANES];
        for (s, strip) in bytes.chunks_exact_mut(component_count * width * side).enumerate() {
            for (c, columns) in strip.chunks_exact_mut(width * side).enumerate() {
                for y in s * side..height.min(s * side + side) {
                    let bytes = columns[y % side..].iter_mut().step_by(side);
                    bytes.zip(image.row(c, y)).for_each(|(byte, &sample)| *byte = sample as u8);
                }
            }
        }
        Some(Self { level: Level::new(), width, component_count, bytes })
    }

    /// The errors of counter-clockwise faces, [`TOO_LARGE`] for those that are: sums over the
    /// lattice points and components of the squared differences between the rounded interpolant and
    /// the picture.
    pub(crate) fn squared_errors(&self, faces: &[[Point; 3]], errors: &mut Vec<u64>) {
        errors.clear();
        match self.component_count {
            1 => dispatch!(self.level, simd => self.squared_errors_by::<_, 1>(simd, faces, errors)),
            2 => dispatch!(self.level, simd => self.squared_errors_by::<_, 2>(simd, faces, errors)),
            3 => dispatch!(self.level, simd => self.squared_errors_by::<_, 3>(simd, faces, errors)),
            _ => dispatch!(self.level, simd => self.squared_errors_by::<_, 4>(simd, faces, errors)),
        }
    }

    #[inline(always)]
    fn squared_errors_by<S: Simd, const COUNT: usize>(
        &self,
        simd: S,
        faces: &[[Point; 3]],
        errors: &mut Vec<u64>,
    ) {
        for faces in faces.chunks(LANES) {
            let batch = self.batch::<S, COUNT>(simd, faces);
            for face in 0..faces.len() {
                errors.push(match batch.kinds[face] {
                    INNER => self.squared_error::<S, COUNT, false>(simd, &batch, face),
                    OUTERMOST => self.squared_error::<S, COUNT, true>(simd, &batch, face),
                    _ => TOO_LARGE,
                });
            }
        }
    }

    /// What is to be known of up to sixteen faces, side by side.
    #[inline(always)]
    fn batch<S: Simd, const COUNT: usize>(&self, simd: S, faces: &[[Point; 3]]) -> Batch<COUNT> {
        let (mut x, mut y) = ([[0; LANES]; 3], [[0; LANES]; 3]);
        let mut samples = [[[0; LANES]; 3]; COUNT];
        for (face, corners) in faces.iter().enumerate().take(LANES) {
            for (i, &corner) in corners.iter().enumerate() {
                (x[i][face], y[i][face]) = (corner.x, corner.y);
                let place = self.place(corner);
                for (c, samples) in samples.iter_mut().enumerate() {
                    samples[i][face] = self.bytes[place + c * self.width * SIDE as usize].into();
                }
            }
        }
        let (x, y) = (vectors(simd, x), vectors(simd, y));
        let places = Places::new(simd, x, y);
        let mut edges =
            [Edge::new(&places, 1, 2), Edge::new(&places, 2, 0), Edge::new(&places, 0, 1)];
        let double_area = edges[0].start + edges[1].start + edges[2].start;
        let mut planes = [PlaneLanes::NONE; COUNT];
        for (plane, samples) in planes.iter_mut().zip(&samples) {
            let [a, b, c] = vectors(simd, *samples);
            let weights = [(a << 2).to_float(), (b << 2).to_float(), (c << 2).to_float()];
            *plane = PlaneLanes::new(&edges, weights);
        }
        for edge in &mut edges {
            edge.start -= edge.threshold;
        }
        Batch {
            kinds: places.kinds.into(),
            left: places.left.into(),
            blocks: places.blocks.into(),
            first_strip: places.first_strip.into(),
            strips: places.strips.into(),
            edges: [edges[0].lanes(), edges[1].lanes(), edges[2].lanes()],
            planes,
            quarter_reciprocals: (f32x16::splat(simd, 0.25) / double_area).into(),
        }
    }

    /// The error of a small face, which may touch column 0 and row 0 if it is `OUTERMOST`.
    #[inline(always)]
    fn squared_error<S: Simd, const COUNT: usize, const OUTERMOST: bool>(
        &self,
        simd: S,
        batch: &Batch<COUNT>,
        face: usize,
    ) -> u64 {
        let (left, blocks) = (batch.left[face], batch.blocks[face] as usize);
        let quarter_reciprocal = batch.quarter_reciprocals[face];
        let (to_right, to_top) = (f32x16::simd_from(simd, COLUMNS), f32x16::simd_from(simd, ROWS));
        let mut functions = [to_top; 3];
        let (mut per_block, mut per_strip) = ([0.0; 3], [0.0; 3]);
        for (i, edge) in batch.edges.iter().enumerate() {
            let (columns, rows) = (edge.columns[face], edge.rows[face]);
            functions[i] = to_top * columns - to_right * rows + edge.starts[face];
            (per_block[i], per_strip[i]) = (-(SIDE as f32) * rows, SIDE as f32 * columns);
        }
        let mut at_strip = functions;
        let mut numerators_at_strip = [to_top; COUNT];
        for (c, plane) in batch.planes.iter().enumerate() {
            let [a, b, d] = &plane.weights;
            numerators_at_strip[c] = functions[0] * a[face]
                + functions[1] * b[face]
                + functions[2] * d[face]
                + plane.constants[face];
        }
        let mut sums = [f32x16::splat(simd, 0.0); COUNT];
        let first_strip = batch.first_strip[face];
        for strip in first_strip..first_strip + batch.strips[face] {
            let mut rows = [&[][..]; COUNT];
            for (c, row) in rows.iter_mut().enumerate() {
                *row = self.blocks(strip, c, left, blocks);
            }
            let mut moves = [[to_top; 3]; 2];
            if OUTERMOST {
                // Column 0 can be in the first block only.
                moves[0] =
                    moves_inwards(simd, Point::new(left, strip * SIDE), per_block, per_strip);
                moves[1] = moves_inwards(simd, Point::new(1, strip * SIDE), per_block, per_strip);
            }
            let mut at_block = at_strip;
            let mut numerators = numerators_at_strip;
            // Two blocks at a time: most faces have no more in a strip. A second one that the face
            // does not reach adds nothing.
            for pair in 0..blocks / 2 {
                for block in [2 * pair, 2 * pair + 1] {
                    let [f, g, h] = at_block;
                    let is_inside: mask32x16<S> = if OUTERMOST {
                        let [a, b, c] = moves[usize::from(block > 0)];
                        (f + a).min(g + b).min(h + c).simd_gt(0.0)
                    } else {
                        f.min(g).min(h).simd_ge(0.0)
                    };
                    for c in 0..COUNT {
                        let values = (numerators[c] * quarter_reciprocal + ROUND_TO_NEAREST)
                            - ROUND_TO_NEAREST;
                        let samples = numbers(u8x16::simd_from(simd, rows[c][block]));
                        let differences =
                            is_inside.select(values - samples, f32x16::splat(simd, 0.0));
                        sums[c] += differences * differences;
                        numerators[c] += batch.planes[c].per_block[face];
                    }
                    for i in 0..3 {
                        at_block[i] += per_block[i];
                    }
                }
            }
            for i in 0..3 {
                at_strip[i] += per_strip[i];
            }
            for (numerators, plane) in numerators_at_strip.iter_mut().zip(&batch.planes) {
                *numerators += plane.per_strip[face];
            }
        }
        // Below 2^31: no face has more than 2,100 points.
        let mut sum = i32x16::splat(simd, 0);
        for lanes in sums {
            sum += lanes.to_int::<i32x16<S>>();
        }
        sum.reduce_sum() as u64
    }

    /// Where the first component's sample of a point is.
    #[inline(always)]
    fn place(&self, point: Point) -> usize {
        let (x, y, side) = (point.x as usize, point.y as usize, SIDE as usize);
        (y / side * self.component_count * self.width + x) * side + y % side
    }

    /// Some blocks of one component of a strip.
    #[inline(always)]
    fn blocks(&self, strip: i32, component: usize, left: i32, count: usize) -> &[[u8; LANES]] {
        let first_column = (strip as usize * self.component_count + component) * self.width;
        let first = (first_column + left as usize) * SIDE as usize;
        &self.bytes[first..].as_chunks().0[..count]
    }
}

/// Kinds of faces: no corner in column 0 or row 0, some, and too large ones.
const INNER: i32 = 0;
const OUTERMOST: i32 = 1;
const LARGE: i32 = 2;

/// Up to sixteen faces, each a lane.
struct Batch<const COUNT: usize> {
    kinds: [i32; LANES],
    /// The first column of the first block, and the number of blocks in each strip, an even one.
    left: [i32; LANES],
    blocks: [i32; LANES],
    first_strip: [i32; LANES],
    strips: [i32; LANES],
    /// Each opposite to a vertex.
    edges: [EdgeLanes; 3],
    planes: [PlaneLanes; COUNT],
    /// A quarter of the reciprocals of twice the areas.
    quarter_reciprocals: [f32; LANES],
}

/// The vertices of faces and the blocks that they visit.
struct Places<S: Simd> {
    x: [i32x16<S>; 3],
    y: [i32x16<S>; 3],
    kinds: i32x16<S>,
    left: i32x16<S>,
    blocks: i32x16<S>,
    first_strip: i32x16<S>,
    strips: i32x16<S>,
}

impl<S: Simd> Places<S> {
    #[inline(always)]
    fn new(simd: S, x: [i32x16<S>; 3], y: [i32x16<S>; 3]) -> Self {
        let (left, right) = (x[0].min(x[1]).min(x[2]), x[0].max(x[1]).max(x[2]));
        let (bottom, top) = (y[0].min(y[1]).min(y[2]), y[0].max(y[1]).max(y[2]));
        let inner = i32x16::splat(simd, INNER);
        let outermost = i32x16::splat(simd, OUTERMOST);
        let is_large = (right - left).max(top - bottom).simd_gt(LARGEST_EXTENT);
        let is_outermost = left.min(bottom).simd_eq(0);
        let kinds =
            is_large.select(i32x16::splat(simd, LARGE), is_outermost.select(outermost, inner));
        // A face owns no points of its first column and row, but for those of the picture's.
        let owned = is_outermost.select(i32x16::splat(simd, 0), i32x16::splat(simd, 1));
        let (left, first_strip) = (left + owned, (bottom + owned) >> 2);
        Self {
            x,
            y,
            kinds,
            left,
            blocks: (((right - left) >> 3) + 1) << 1,
            first_strip,
            strips: (top >> 2) - first_strip + 1,
        }
    }
}

/// The edge functions of faces, for the edges opposite to a vertex: at a point of the plane twice the
/// area of the triangle that it makes with the edge.
struct Edge<S: Simd> {
    columns: f32x16<S>,
    rows: f32x16<S>,
    /// At the first point of the face's first block.
    start: f32x16<S>,
    /// The least value at points of the face.
    threshold: f32x16<S>,
}

/// The same as it is kept, with the start less the threshold, so that a point belongs to the face
/// where no function is negative.
struct EdgeLanes {
    columns: [f32; LANES],
    rows: [f32; LANES],
    starts: [f32; LANES],
}

impl<S: Simd> Edge<S> {
    /// The edge between two vertices.
    #[inline(always)]
    fn new(places: &Places<S>, from: usize, to: usize) -> Self {
        let Places { x, y, left, first_strip, .. } = places;
        let (columns, rows) = (x[to] - x[from], y[to] - y[from]);
        let start = columns * ((*first_strip << 2) - y[from]) - rows * (*left - x[from]);
        // On an edge a point belongs to the face when it is inside after a move to the left, or, if
        // that is along the edge, downwards. Outermost faces look at each point.
        let is_outside: mask32x16<S> = (rows * (2 * LARGEST_EXTENT)).simd_le(columns);
        let inner = i32x16::splat(rows.simd, OUTERMOST) - places.kinds;
        let threshold = is_outside.select(inner, i32x16::splat(rows.simd, 0));
        Self {
            columns: columns.to_float(),
            rows: rows.to_float(),
            start: start.to_float(),
            threshold: threshold.to_float(),
        }
    }

    #[inline(always)]
    fn lanes(&self) -> EdgeLanes {
        EdgeLanes {
            columns: self.columns.into(),
            rows: self.rows.into(),
            starts: self.start.into(),
        }
    }
}

/// Four times the numerators of one component's interpolants, plus one, so that ties round up.
#[derive(Clone, Copy)]
struct PlaneLanes {
    /// Four times the samples at the vertices, each of which weighs the function of the edge
    /// opposite.
    weights: [[f32; LANES]; 3],
    /// What is to be added to that.
    constants: [f32; LANES],
    per_block: [f32; LANES],
    per_strip: [f32; LANES],
}

impl PlaneLanes {
    const NONE: Self = Self {
        weights: [[0.0; LANES]; 3],
        constants: [0.0; LANES],
        per_block: [0.0; LANES],
        per_strip: [0.0; LANES],
    };

    #[inline(always)]
    fn new<S: Simd>(edges: &[Edge<S>; 3], [a, b, c]: [f32x16<S>; 3]) -> Self {
        let [f, g, h] = edges;
        let rows = a * f.rows + b * g.rows + c * h.rows;
        let columns = a * f.columns + b * g.columns + c * h.columns;
        Self {
            weights: [a.into(), b.into(), c.into()],
            constants: (a * f.threshold + b * g.threshold + c * h.threshold + 1.0).into(),
            per_block: (rows * -(SIDE as f32)).into(),
            per_strip: (columns * SIDE as f32).into(),
        }
    }
}

/// By how much the edge functions of an outermost face differ from 0 at points on its edges, in the
/// block that begins at `place`: points are moved to the left and much less downwards, but those of
/// column 0 to the right and those of row 0 upwards. A point belongs to the face where all functions
/// are positive after that. The moves are tiny beside whole numbers, so roundings don't matter.
#[inline(always)]
fn moves_inwards<S: Simd>(
    simd: S,
    place: Point,
    per_block: [f32; 3],
    per_strip: [f32; 3],
) -> [f32x16<S>; 3] {
    let leftwards = one_but_backwards(simd, COLUMNS, place.x);
    let downwards = one_but_backwards(simd, ROWS, place.y);
    let mut moves = [leftwards; 3];
    for i in 0..3 {
        moves[i] = leftwards * (per_block[i] * (-LEFTWARDS / SIDE as f32))
            + downwards * (per_strip[i] * (-DOWNWARDS / SIDE as f32));
    }
    moves
}

/// 1 in the lanes whose column or row is not 0, and -1 where it is.
#[inline(always)]
fn one_but_backwards<S: Simd>(simd: S, steps: [f32; LANES], place: i32) -> f32x16<S> {
    let is_first: mask32x16<S> = f32x16::simd_from(simd, steps).simd_eq(-place as f32);
    is_first.select(f32x16::splat(simd, -1.0), f32x16::splat(simd, 1.0))
}

/// Three vectors of these lanes.
#[inline(always)]
fn vectors<S: Simd>(simd: S, [a, b, c]: [[i32; LANES]; 3]) -> [i32x16<S>; 3] {
    [i32x16::simd_from(simd, a), i32x16::simd_from(simd, b), i32x16::simd_from(simd, c)]
}

/// Bytes as numbers.
#[inline(always)]
fn numbers<S: Simd>(bytes: u8x16<S>) -> f32x16<S> {
    let (first, second) = bytes.widen();
    let ((a, b), (c, d)) = (first.widen(), second.widen());
    a.combine(b).combine(c.combine(d)).to_float()
}
