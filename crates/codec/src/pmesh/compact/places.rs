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

const WORD: usize = u64::BITS as usize;

/// Which cells of one size are occupied.
struct Grid {
    width: i32,
    height: i32,
    words_each: usize,
    words: Vec<u64>,
}

impl Grid {
    /// The grid of cells of 2^`size` columns and rows.
    fn new(shape: Shape, size: u32) -> Self {
        let [width, height] = [shape.width, shape.height].map(|side| ((side - 1) >> size) + 1);
        let words_each = width.div_ceil(WORD);
        let words = vec![0; words_each * height];
        Self { width: width as i32, height: height as i32, words_each, words }
    }

    fn is_inside(&self, x: i32, y: i32) -> bool {
        (0..self.width).contains(&x) && (0..self.height).contains(&y)
    }

    /// 1 where a cell is occupied, 0 where it is not, and outside the image.
    fn at(&self, x: i32, y: i32) -> usize {
        if !self.is_inside(x, y) {
            return 0;
        }
        let (x, y) = (x as usize, y as usize);
        (self.words[y * self.words_each + x / WORD] >> (x % WORD) & 1) as usize
    }

    fn occupy(&mut self, x: i32, y: i32) {
        let (x, y) = (x as usize, y as usize);
        self.words[y * self.words_each + x / WORD] |= 1 << (x % WORD);
    }

    /// Occupied cells of a part of a row, the columns `from` and after, `count` of them.
    fn sum(&self, from: i32, y: i32, count: i32) -> usize {
        (from..from + count).map(|x| self.at(x, y)).sum()
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
                    mixture.code(coder, contexts, set, truth.at(x, y) == 1)?
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
    // Cells and parents by their distance in columns and rows.
    let near = |dx: i32, dy: i32| cells.at(x + dx, y + dy);
    let beyond = |dx: i32, dy: i32| parents.at((x >> 1) + dx, (y >> 1) + dy);
    let bits = |cells: &[usize]| cells.iter().rev().fold(0, |bits, &cell| bits << 1 | cell);

    let place = (x & 1 | (y & 1) << 1) as usize;
    let siblings = match place {
        0 => 0,
        1 => 1 + near(-1, 0),
        2 => 3 + bits(&[near(0, -1), near(1, -1)]),
        _ => 7 + bits(&[near(-1, 0), near(0, -1), near(-1, -1)]),
    };
    let around = bits(&[near(-1, 0), near(0, -1), near(-1, -1), near(1, -1)]);
    let farther = bits(&[
        near(-2, 0),
        near(0, -2),
        near(-2, -1),
        near(2, -1),
        near(-1, -2),
        near(1, -2),
        near(-3, 0),
        near(0, -3),
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
    let before =
        (1..4).map(|dy| cells.sum(x - 3, y - dy, 7)).sum::<usize>() + cells.sum(x - 3, y, 3);
    let (px, py) = (x >> 1, y >> 1);
    let ahead = parents.sum(px + 1, py, 2)
        + parents.sum(px - 2, py + 1, 5)
        + parents.sum(px - 2, py + 2, 5);

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
