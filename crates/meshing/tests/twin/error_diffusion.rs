//! Floyd-Steinberg error diffusion over a buffer of the whole picture, and the search for its
//! threshold.

use pixmesh_meshing::parameters::{Policy, Scan, Startup};
use pixmesh_meshing::{Parameters, Point};

/// The most thresholds that the search tries.
const STEPS: usize = 60;

/// Density fields of one shape, and how they are diffused.
pub(crate) struct Diffusion<'a> {
    pub(crate) width: usize,
    pub(crate) fields: &'a [Vec<f64>],
    pub(crate) parameters: &'a Parameters,
}

/// The result of the search for a threshold, before the corners are added.
pub(crate) struct Chosen {
    /// Whether each point is selected, row by row.
    pub(crate) marks: Vec<bool>,
    /// Whether their number is within the tolerance.
    pub(crate) met: bool,
    /// How near any value came to the threshold that decided on it, over all thresholds tried and
    /// relative to that threshold: when it is of the order of rounding errors, the order of
    /// additions decides.
    pub(crate) margin: f64,
}

/// One pass: what it selects, what its buffer ends as, how near to the threshold it came.
struct Pass {
    marks: Vec<bool>,
    buffer: Vec<f64>,
    margin: f64,
}

impl Diffusion<'_> {
    /// Selects about `size` points.
    pub(crate) fn choose(&self, size: usize) -> Chosen {
        let starts: Vec<(Vec<f64>, f64)> =
            self.fields.iter().map(|field| self.start(field, size)).collect();
        let mut margin = starts.iter().map(|(_, margin)| *margin).fold(f64::INFINITY, f64::min);
        let try_out = |tau: f64| {
            let mut union = vec![false; self.fields[0].len()];
            for (field, (start, _)) in self.fields.iter().zip(&starts) {
                let pass = self.diffuse(field, start, tau, self.height());
                margin = margin.min(pass.margin);
                union.iter_mut().zip(pass.marks).for_each(|(mark, new)| *mark |= new);
            }
            union
        };
        let (marks, met) =
            search(try_out, first_tau(&self.fields[0], size), size, self.tolerance());
        Chosen { marks, met, margin }
    }

    fn height(&self) -> usize {
        self.fields[0].len() / self.width
    }

    fn tolerance(&self) -> usize {
        let is_union = matches!(self.parameters.policy, Policy::PseD | Policy::PseL);
        let own = if is_union && self.fields.len() > 1 { 15 } else { 10 };
        self.parameters.tolerance.unwrap_or(own)
    }

    /// The errors that row 0 of a field starts with.
    fn start(&self, field: &[f64], size: usize) -> (Vec<f64>, f64) {
        if self.parameters.startup == Startup::Classic {
            return (vec![0.0; self.width], f64::INFINITY);
        }
        let rows = field.chunks_exact(self.width);
        let mut mirrored: Vec<f64> = rows.skip(1).rev().flatten().copied().collect();
        mirrored.extend(vec![0.0; self.width]);
        let tau = self.fields.len() as f64 * first_tau(field, size);
        let pass = self.diffuse(&mirrored, &vec![0.0; self.width], tau, self.height() - 1);
        (pass.buffer[self.width * (self.height() - 1)..].to_vec(), pass.margin)
    }

    /// Diffuses the first `rows` rows of a field, the errors in `start` added to its row 0.
    fn diffuse(&self, field: &[f64], start: &[f64], tau: f64, rows: usize) -> Pass {
        let mut b = field.to_vec();
        b.iter_mut().zip(start).for_each(|(value, error)| *value += error);
        let mut marks = vec![false; b.len()];
        let mut margin = f64::INFINITY;
        for y in 0..rows {
            let leftwards = self.parameters.scan == Scan::Serpentine && y % 2 == 1;
            let dir: i64 = if leftwards { -1 } else { 1 };
            for step in 0..self.width {
                let x = if leftwards { self.width - 1 - step } else { step };
                let index = y * self.width + x;
                let old = b[index];
                marks[index] = old >= tau;
                margin = margin.min((old - tau).abs() / tau);
                let e = if marks[index] { old - 2.0 * tau } else { old };
                for (target, weight) in self.weights(x as i64, y as i64, dir) {
                    b[target] += weight * e;
                }
            }
        }
        Pass { marks, buffer: b, margin }
    }

    /// The neighbours inside the picture and their weights.
    fn weights(&self, x: i64, y: i64, dir: i64) -> Vec<(usize, f64)> {
        let all =
            [(x + dir, y, 7.0), (x - dir, y + 1, 3.0), (x, y + 1, 5.0), (x + dir, y + 1, 1.0)];
        let (width, height) = (self.width as i64, self.height() as i64);
        let inside = |&(x, y, _): &(i64, i64, f64)| (0..width).contains(&x) && y < height;
        let kept: Vec<_> = all.into_iter().filter(inside).collect();
        let whole = if self.parameters.leaky {
            16.0
        } else {
            kept.iter().map(|&(_, _, sixteenths)| sixteenths).sum()
        };
        kept.iter().map(|&(x, y, part)| ((y * width + x) as usize, part / whole)).collect()
    }
}

/// The threshold to begin with.
fn first_tau(field: &[f64], size: usize) -> f64 {
    field.iter().sum::<f64>() / (2.0 * size as f64)
}

/// Tries thresholds until the number selected is within `tolerance` of `size`; else the nearest.
fn search(
    mut try_out: impl FnMut(f64) -> Vec<bool>,
    first: f64,
    size: usize,
    tolerance: usize,
) -> (Vec<bool>, bool) {
    let (mut tau, mut lower, mut upper) = (first, None, None);
    let mut nearest: Option<(usize, Vec<bool>)> = None;
    for _ in 0..STEPS {
        let marks = try_out(tau);
        let count = marks.iter().filter(|mark| **mark).count();
        let distance = count.abs_diff(size);
        if distance <= tolerance {
            return (marks, true);
        }
        if nearest.as_ref().is_none_or(|(best, _)| distance < *best) {
            nearest = Some((distance, marks));
        }
        if count > size {
            lower = Some(tau);
        } else {
            upper = Some(tau);
        }
        tau = match (lower, upper) {
            (Some(lower), Some(upper)) => (lower + upper) / 2.0,
            (Some(_), None) => tau * 2.0,
            _ => tau / 2.0,
        };
    }
    (nearest.map(|(_, marks)| marks).unwrap_or_default(), false)
}

/// The selected points and the four corners, by row, then column.
pub(crate) fn with_corners(marks: &[bool], width: usize) -> Vec<Point> {
    let height = marks.len() / width;
    let is_corner = |x: usize, y: usize| (x == 0 || x == width - 1) && (y == 0 || y == height - 1);
    let lattice = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    lattice
        .filter(|&(x, y)| marks[y * width + x] || is_corner(x, y))
        .map(|(x, y)| Point::new(x as i32, y as i32))
        .collect()
}
