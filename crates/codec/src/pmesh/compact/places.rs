//! Points as the occupied cells of a quadtree, from the whole image down to single lattice points.
//!
//! A cell of 2^k columns and rows is occupied when it holds a point. The four cells of half that size
//! within an occupied one are decisions; those that hold a corner of the image are occupied, as is
//! the last of four where the others are empty. Cells of one size follow each other by row, then
//! column, so that all around the parent and half of what is around a cell itself is known.

use super::arithmetic::{Coder, Stop};
use super::mixing::Mixture;
use pixmesh_meshing::{Point, Shape};

/// Sizes of cells that contexts tell apart.
const SIZES: usize = 15;

/// Places within the parent with what is known of the parent's other cells: 1 + 2 + 4 + 8.
const SIBLINGS: usize = 15;

/// Columns at the left of a grid that are never occupied.
const LEFT: i32 = 3;

/// Which cells of one size are occupied.
struct Grid {
    width: i32,
    height: i32,
    /// Bytes of a row: a bit for each column from -3 on, and two bytes more than there are columns.
    stride: usize,
    bytes: Vec<u8>,
}

impl Grid {
    /// The grid of cells of 2^`size` columns and rows.
    fn new(shape: Shape, size: u32) -> Self {
        let [width, height] = [shape.width, shape.height].map(|side| ((side - 1) >> size) + 1);
        let stride = width / 8 + 3;
        let bytes = vec![0; stride * height];
        Self { width: width as i32, height: height as i32, stride, bytes }
    }

    fn is_inside(&self, x: i32, y: i32) -> bool {
        (0..self.width).contains(&x) && (0..self.height).contains(&y)
    }

    /// Which cells of a row are occupied, a bit for each of the columns `x - 3` to `x + 4`, for `x` from
    /// 0 to `width`; none outside the image.
    fn around(&self, x: i32, y: i32) -> usize {
        if !(0..self.height).contains(&y) {
            return 0;
        }
        // The column x - 3 is the bit x.
        let at = y as usize * self.stride + x as usize / 8;
        let both = u16::from_le_bytes([self.bytes[at], self.bytes[at + 1]]);
        usize::from(both) >> (x % 8) & 0xff
    }

    /// 1 where a cell is occupied, 0 where it is not.
    fn at(&self, x: i32, y: i32) -> usize {
        self.around(x, y) >> LEFT & 1
    }

    fn occupy(&mut self, x: i32, y: i32) {
        let bit = (x + LEFT) as usize;
        self.bytes[y as usize * self.stride + bit / 8] |= 1 << (bit % 8);
    }

    fn holds_corner(&self, x: i32, y: i32) -> bool {
        (x == 0 || x == self.width - 1) && (y == 0 || y == self.height - 1)
    }

    /// Whether a cell is the last of four and the others are empty.
    fn is_only(&self, x: i32, y: i32) -> bool {
        let is_last = |at: i32, side: i32| at & 1 == 1 || at == side - 1;
        let (left, low) = (x & !1, y & !1);
        is_last(x, self.width)
            && is_last(y, self.height)
            && self.at(left, low) + self.at(left + 1, low) + self.at(left, low + 1) == 0
    }
}

/// Codes `count` points in any order, `points` of a writer; returns them by row, then column.
pub(super) fn code_places<C: Coder>(
    shape: Shape,
    count: usize,
    points: &[Point],
    coder: &mut C,
) -> Result<Vec<Point>, Stop> {
    let sizes = usize::BITS - (shape.width.max(shape.height) - 1).leading_zeros();
    let mut mixture = Mixture::new(INPUT_SIZES, SIZES * 4);
    let mut parents = Grid::new(shape, sizes);
    parents.occupy(0, 0);
    let mut occupied = vec![(0, 0)];
    for size in (0..sizes).rev() {
        let mut truth = Grid::new(shape, if C::READS { sizes } else { size });
        points.iter().for_each(|point| truth.occupy(point.x >> size, point.y >> size));
        let mut cells = Grid::new(shape, size);
        let mut next = Vec::with_capacity(count.min(2 * occupied.len()));
        for row in occupied.chunk_by(|a, b| a.1 == b.1) {
            let below = row.iter().flat_map(|&(x, y)| [(2 * x, 2 * y), (2 * x + 1, 2 * y)]);
            let above = row.iter().flat_map(|&(x, y)| [(2 * x, 2 * y + 1), (2 * x + 1, 2 * y + 1)]);
            for (x, y) in below.chain(above) {
                if !cells.is_inside(x, y) {
                    continue;
                }
                let is_occupied = cells.holds_corner(x, y) || cells.is_only(x, y) || {
                    let (contexts, set) = contexts_of(&cells, &parents, size, x, y);
                    mixture.code(coder, contexts, set, !C::READS && truth.at(x, y) == 1)?
                };
                if is_occupied && next.len() == count {
                    return Err(Stop::Damaged);
                }
                if is_occupied {
                    cells.occupy(x, y);
                    next.push((x, y));
                }
            }
        }
        (parents, occupied) = (cells, next);
    }
    if occupied.len() != count {
        return Err(Stop::Damaged);
    }
    Ok(occupied.into_iter().map(|(x, y)| Point::new(x, y)).collect())
}

const INPUT_SIZES: [usize; 6] = [
    SIZES * SIBLINGS * 16,
    3 * SIBLINGS * 256,
    SIBLINGS * 4096,
    SIZES * SIBLINGS * 49,
    SIZES * SIBLINGS,
    SIZES * SIBLINGS * 1024,
];

/// The contexts and the set of weights of a cell.
fn contexts_of(
    cells: &Grid,
    parents: &Grid,
    size: u32,
    x: i32,
    y: i32,
) -> ([usize; INPUT_SIZES.len()], usize) {
    let row = |dy: i32| cells.around(x, y + dy);
    let parent_row = |dy: i32| parents.around(x >> 1, (y >> 1) + dy);
    let cells = [row(0), row(-1), row(-2), row(-3)];
    let parents = [parent_row(-1), parent_row(0), parent_row(1), parent_row(2)];
    // Cells and parents by their distance in columns and rows.
    let near = |dx: i32, dy: usize| cells[dy] >> (LEFT + dx) & 1;
    let beyond = |dx: i32, dy: i32| parents[(dy + 1) as usize] >> (LEFT + dx) & 1;
    let bits = |cells: &[usize]| cells.iter().rev().fold(0, |bits, &cell| bits << 1 | cell);
    let sum = |row: usize, columns: usize| (row & columns).count_ones() as usize;

    let place = (x & 1 | (y & 1) << 1) as usize;
    let siblings = match place {
        0 => 0,
        1 => 1 + near(-1, 0),
        2 => 3 + bits(&[near(0, 1), near(1, 1)]),
        _ => 7 + bits(&[near(-1, 0), near(0, 1), near(-1, 1)]),
    };
    let around = bits(&[near(-1, 0), near(0, 1), near(-1, 1), near(1, 1)]);
    let farther = bits(&[
        near(-2, 0),
        near(0, 2),
        near(-2, 1),
        near(2, 1),
        near(-1, 2),
        near(1, 2),
        near(-3, 0),
        near(0, 3),
    ]);
    let parents_around = bits(&[
        beyond(-1, 0),
        beyond(1, 0),
        beyond(0, -1),
        beyond(0, 1),
        beyond(-1, -1),
        beyond(1, -1),
        beyond(-1, 1),
        beyond(1, 1),
    ]);
    let parents_ahead = bits(&[
        beyond(2, 0),
        beyond(0, 2),
        beyond(1, 0),
        beyond(0, 1),
        beyond(1, 1),
        beyond(-1, 1),
    ]);
    // Seven columns around the cell, five and the two next around the parent.
    let before =
        sum(cells[0], 0b111) + cells[1..].iter().map(|&row| sum(row, 0b111_1111)).sum::<usize>();
    let ahead =
        sum(parents[1], 0b11_0000) + sum(parents[2], 0b11_1110) + sum(parents[3], 0b11_1110);

    let size = (size as usize).min(SIZES - 1);
    let sized = size * SIBLINGS + siblings;
    let contexts = [
        sized * 16 + around,
        (size.min(2) * SIBLINGS + siblings) * 256 + parents_around,
        siblings * 4096 + (farther << 4 | around),
        sized * 49 + 7 * class(before) + class(ahead),
        sized,
        sized * 1024 + (around << 6 | parents_ahead),
    ];
    (contexts, size * 4 + place)
}

/// 0, 1, 2, 3 to 4, 5 to 7, 8 to 12, and more, as 0 to 6.
fn class(number: usize) -> usize {
    [1, 2, 3, 5, 8, 13].into_iter().filter(|&least| number >= least).count()
}
