//! A bound on the error of every sample, checked exactly, pixel by pixel, and holes whose borders no
//! face crosses.
//!
//! Let `den` be twice a face's area and `num / den` its interpolant at a pixel of sample `s`. The
//! bound is kept where `num - s den` lies between two whole numbers, which the face determines.

use crate::control::{Cancelled, Poller};
use crate::face_error::scan_conversion::{Interpolant, try_for_each_row};
use crate::image::{Image, Point};
use crate::triangulation::predicates::orientation;
use std::ops::RangeInclusive;

/// Stands for the error of a face that breaks the bound: more than any mesh has, and twice as much
/// is still a number.
pub(crate) const BROKEN: u64 = 1 << 61;

/// The parts of a sample's step in which a [`Tolerance`] counts.
const PARTS: i64 = 1 << 16;

/// Farther than any sample, in parts of a step.
const FARTHEST: u64 = 1 << 32;

/// How far an approximation may be from each sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tolerance {
    /// In parts of a step of the samples.
    parts: i64,
    /// Whether a difference of exactly that much above the sample is too large.
    excludes_end: bool,
}

impl Tolerance {
    /// That of an approximation rounded to whole numbers, halves up.
    pub(crate) fn of_rounded(most: u16) -> Self {
        Self { parts: i64::from(most) * PARTS + PARTS / 2, excludes_end: true }
    }

    /// That of an approximation which is not rounded.
    pub(crate) fn of_surface(most: f64) -> Self {
        Self { parts: (most * PARTS as f64).floor() as i64, excludes_end: false }
    }

    /// The differences of numerators that keep the bound, of a face of this area.
    fn kept(self, double_area: i64) -> RangeInclusive<i64> {
        // Areas are below 2^31 and parts at most 2^32, so that quotients are below 2^47.
        let scaled = i128::from(self.parts) * i128::from(double_area);
        let most = scaled.div_euclid(PARTS.into()) as i64;
        let excludes_most = self.excludes_end && scaled.rem_euclid(PARTS.into()) == 0;
        -most..=most - i64::from(excludes_most)
    }
}

/// The samples that an approximation must stay near.
#[derive(Clone, Copy)]
pub(crate) struct Bound<'a> {
    pub(crate) image: &'a Image,
    pub(crate) tolerance: Tolerance,
    /// Whether pixels of alpha 0 are holes, whose borders faces must not cross.
    pub(crate) has_holes: bool,
}

impl Bound<'_> {
    /// Whether a face keeps the bound with the image's samples at its corners.
    pub(crate) fn is_kept_by_samples(
        &self,
        corners: [Point; 3],
        poller: &mut Poller<'_>,
    ) -> Result<bool, Cancelled> {
        self.is_kept(corners, |c| self.samples(corners, c), poller)
    }

    fn samples(&self, corners: [Point; 3], c: usize) -> [u16; 3] {
        corners.map(|p| self.image.sample(c, p.x as usize, p.y as usize))
    }

    /// Whether a face with these values at its corners, by component, keeps the bound.
    pub(crate) fn is_kept(
        &self,
        corners: [Point; 3],
        values: impl Fn(usize) -> [u16; 3],
        poller: &mut Poller<'_>,
    ) -> Result<bool, Cancelled> {
        if self.is_hole(corners) {
            return Ok(self.stray(corners, values, poller)?.is_none());
        }
        for c in 0..self.image.component_count() {
            let interpolant = Interpolant::new(corners, values(c));
            let kept = self.tolerance.kept(interpolant.double_area());
            let found = try_for_each_row(corners, |y, first, end| {
                poller.step((end - first) as usize).map_err(Some)?;
                let samples = &self.image.row(c, y as usize)[first as usize..end as usize];
                let mut differences = interpolant.differences(first, y, samples);
                let is_kept = differences.all(|difference| kept.contains(&difference));
                if is_kept { Ok(()) } else { Err(None) }
            });
            match found {
                Ok(()) => {}
                Err(None) => return Ok(false),
                Err(Some(cancelled)) => return Err(cancelled),
            }
        }
        Ok(true)
    }

    /// How far the approximation by a face with the image's samples is from a sample at most, in parts
    /// of a step, and the first such pixel; `None` where the face keeps the bound.
    pub(crate) fn farthest(
        &self,
        corners: [Point; 3],
        poller: &mut Poller<'_>,
    ) -> Result<Option<(u64, Point)>, Cancelled> {
        if self.is_hole(corners) {
            let stray = self.stray(corners, |c| self.samples(corners, c), poller)?;
            return Ok(stray.map(|at| (FARTHEST, at)));
        }
        let (mut worst, mut breaks) = (None::<(u64, Point)>, false);
        for c in 0..self.image.component_count() {
            let interpolant = Interpolant::new(corners, self.samples(corners, c));
            let kept = self.tolerance.kept(interpolant.double_area());
            let (mut most, mut at) = (0, None);
            try_for_each_row(corners, |y, first, end| {
                poller.step((end - first) as usize)?;
                let samples = &self.image.row(c, y as usize)[first as usize..end as usize];
                let differences = interpolant.differences(first, y, samples);
                for (x, difference) in (first..).zip(differences) {
                    breaks |= !kept.contains(&difference);
                    if difference.abs() > most {
                        (most, at) = (difference.abs(), Some(Point::new(x, y)));
                    }
                }
                Ok(())
            })?;
            let parts =
                i128::from(most) * i128::from(PARTS) / i128::from(interpolant.double_area());
            if let Some(at) = at
                && worst.is_none_or(|(farthest, _)| parts as u64 > farthest)
            {
                worst = Some((parts as u64, at));
            }
        }
        Ok(worst.filter(|_| breaks))
    }

    /// Whether a face belongs to a hole.
    pub(crate) fn is_hole(&self, corners: [Point; 3]) -> bool {
        self.has_holes && corners.iter().any(|&corner| self.is_hole_at(corner))
    }

    fn is_hole_at(&self, Point { x, y }: Point) -> bool {
        let alpha = self.image.component_count() - 1;
        self.image.sample(alpha, x as usize, y as usize) == 0
    }

    /// Whether a pixel of a hole is beside one of the surface: such pixels stay vertices, so that no
    /// edge of the surface crosses the hole.
    fn is_beside_surface(&self, Point { x, y }: Point) -> bool {
        let (right, top) = (self.image.width() as i32 - 1, self.image.height() as i32 - 1);
        let rows = (y - 1).max(0)..=(y + 1).min(top);
        rows.into_iter().any(|y| {
            ((x - 1).max(0)..=(x + 1).min(right)).any(|x| !self.is_hole_at(Point::new(x, y)))
        })
    }

    /// The first pixel that a face of a hole must not have: one beside the surface, or one of the
    /// surface, unless it lies on an edge of the surface that keeps the bound.
    fn stray(
        &self,
        corners: [Point; 3],
        values: impl Fn(usize) -> [u16; 3],
        poller: &mut Poller<'_>,
    ) -> Result<Option<Point>, Cancelled> {
        let colors = 0..self.image.component_count() - 1;
        let interpolants: Vec<Interpolant> =
            colors.map(|c| Interpolant::new(corners, values(c))).collect();
        let kept = self.tolerance.kept(orientation(corners[0], corners[1], corners[2]));
        let is_on_border = |at: Point| {
            let [a, b, c] = corners;
            let on_edge = [(a, b), (b, c), (c, a)].into_iter().any(|(from, to)| {
                orientation(from, to, at) == 0 && !self.is_hole_at(from) && !self.is_hole_at(to)
            });
            on_edge
                && (0..).zip(&interpolants).all(|(c, interpolant)| {
                    let sample = self.image.sample(c, at.x as usize, at.y as usize);
                    interpolant.differences(at.x, at.y, &[sample]).all(|d| kept.contains(&d))
                })
        };
        let mut stray = None;
        try_for_each_row(corners, |y, first, end| {
            poller.step((end - first) as usize)?;
            let pixels = (first..end).map(|x| Point::new(x, y));
            let is_stray = |&at: &Point| {
                let is_allowed = corners.contains(&at)
                    || if self.is_hole_at(at) {
                        !self.is_beside_surface(at)
                    } else {
                        is_on_border(at)
                    };
                !is_allowed
            };
            stray = stray.or_else(|| pixels.into_iter().find(is_stray));
            Ok::<(), Cancelled>(())
        })?;
        Ok(stray)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::poller;
    use crate::face_error::scan_conversion::for_each_row;
    use proptest::prelude::*;

    const SIDE: usize = 12;

    proptest! {
        #[test]
        fn keeps_the_bound_where_each_rounded_pixel_does(
            coordinates in prop::array::uniform6(0i32..SIDE as i32),
            samples in prop::collection::vec(0u16..9, 2 * SIDE * SIDE),
            most in 0u16..9,
        ) {
            let components = samples.chunks(SIDE * SIDE).map(<[u16]>::to_vec).collect();
            let image = Image::from_bottom_up(SIDE, SIDE, 8, components).unwrap();
            let mut corners = [0, 2, 4].map(|i| Point::new(coordinates[i], coordinates[i + 1]));
            if orientation(corners[0], corners[1], corners[2]) < 0 {
                corners.swap(1, 2);
            }
            prop_assume!(orientation(corners[0], corners[1], corners[2]) > 0);
            let (mut largest, mut farthest) = (0, 0.0f64);
            for c in 0..2 {
                let at = |p: Point| image.sample(c, p.x as usize, p.y as usize);
                let [a, b, d] = corners;
                for_each_row(corners, |y, first, end| {
                    for x in first..end {
                        let p = Point::new(x, y);
                        let area = orientation(a, b, d);
                        let weights =
                            [orientation(b, d, p), orientation(d, a, p), orientation(a, b, p)];
                        let values = corners.map(|corner| i64::from(at(corner)));
                        let sum: i64 = weights.iter().zip(values).map(|(w, v)| w * v).sum();
                        let rounded = (2 * sum + area).div_euclid(2 * area);
                        largest = largest.max(rounded.abs_diff(at(p).into()));
                        farthest = farthest.max((sum as f64 / area as f64 - f64::from(at(p))).abs());
                    }
                });
            }
            let bound = Bound { image: &image, tolerance: Tolerance::of_rounded(most), has_holes: false };
            let keeps = largest <= u64::from(most);
            prop_assert_eq!(bound.is_kept_by_samples(corners, &mut poller()), Ok(keeps));
            match bound.farthest(corners, &mut poller()).unwrap() {
                None => prop_assert!(keeps),
                Some((parts, _)) => {
                    prop_assert!(!keeps);
                    prop_assert!((parts as f64 / PARTS as f64 - farthest).abs() < 1e-4);
                }
            }
        }
    }
}
