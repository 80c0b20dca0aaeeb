//! What moves to all the places around a vertex will do, eight places of a row at a time.

use crate::face_error::quadratic_model::MoveForecast;
use crate::face_error::small_face::{LANES, Pixels, SAMPLES_READ};
use crate::face_error::small_face_samples::Sample;
use crate::image::Point;
use fearless_simd::{Simd, dispatch, f32x8, i32x8, prelude::*};

/// Columns and rows to the places farthest away.
pub(crate) const REACH: i32 = 2;

/// Rows of such places.
const ROWS: usize = 2 * REACH as usize + 1;

/// The changes of the squared error foreseen for moves from one place to those around.
#[derive(Clone, Copy)]
pub(crate) struct Foreseen {
    /// Rows of changes, from the place `REACH` columns and rows before the one in the middle on.
    changes: [[f32; LANES]; ROWS],
}

impl Foreseen {
    /// The change for a move by at most [`REACH`] columns and rows; of a place beyond the picture it
    /// means nothing.
    #[inline]
    pub(crate) fn change(&self, (columns, rows): (i32, i32)) -> f32 {
        self.changes[(rows + REACH) as usize][(columns + REACH) as usize]
    }
}

impl<T: Sample> Pixels<T> {
    /// The changes of the squared error foreseen for moves from one place to all those around.
    pub(super) fn foreseen_around(&self, forecast: &MoveForecast, from: Point) -> Foreseen {
        let (x, y) = (from.x - REACH, from.y - REACH);
        let height = self.point_count() / self.width;
        let is_inside =
            x >= 0 && y >= 0 && x as usize + LANES <= self.width && y as usize + ROWS <= height;
        match self.stride {
            1 if is_inside => {
                dispatch!(self.level, simd => self.foreseen_by::<_, 1>(simd, forecast, from))
            }
            4 if is_inside => {
                dispatch!(self.level, simd => self.foreseen_by::<_, 4>(simd, forecast, from))
            }
            _ => self.foreseen_one_by_one(forecast, from, height),
        }
    }

    fn foreseen_one_by_one(&self, forecast: &MoveForecast, from: Point, height: usize) -> Foreseen {
        let mut changes = [[0.0; LANES]; ROWS];
        for (y, row) in (from.y - REACH..).zip(&mut changes) {
            for (x, change) in (from.x - REACH..).zip(&mut row[..ROWS]) {
                if (0..self.width as i32).contains(&x) && (0..height as i32).contains(&y) {
                    *change = self.foreseen(forecast, from, Point::new(x, y));
                }
            }
        }
        Foreseen { changes }
    }

    /// The same operations in the same order as for one place.
    #[inline(always)]
    fn foreseen_by<S: Simd, const STRIDE: usize>(
        &self,
        simd: S,
        forecast: &MoveForecast,
        from: Point,
    ) -> Foreseen {
        let ahead = |lane| lane as i32 - REACH;
        let x = i32x8::simd_from(simd, std::array::from_fn(ahead)).to_float::<f32x8<S>>();
        let [xx, xy, yy] = forecast.of_way.map(|coefficient| f32x8::splat(simd, coefficient));
        let at = |y: i32| (y as usize * self.width + (from.x - REACH) as usize) * STRIDE;
        let before = &self.samples[at(from.y) + REACH as usize * STRIDE..];
        let changes = std::array::from_fn(|row| {
            let y = (row as i32 - REACH) as f32;
            let after = &self.samples[at(from.y - REACH + row as i32)..];
            let way = x * forecast.columns + forecast.rows * y;
            let way = way + xx * x * x + xy * x * y + yy * y * y;
            let mut terms = f32x8::splat(simd, 0.0);
            for (c, &before) in before[..STRIDE].iter().enumerate() {
                let difference = T::component::<S, STRIDE>(simd, after, c) - before.into();
                let with_way = x * forecast.by_columns[c] + forecast.by_rows[c] * y;
                let leaning = difference * forecast.squares[c] + forecast.samples[c] + with_way;
                terms += difference * leaning;
            }
            (way + terms).into()
        });
        Foreseen { changes }
    }

    /// Points of the picture.
    fn point_count(&self) -> usize {
        (self.samples.len() - SAMPLES_READ) / self.stride
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn all_places_are_foreseen_as_each_of_them_is(
            (width, height) in (3usize..24, 3usize..24),
            component_count in 1usize..=4,
            coefficients in prop::array::uniform25(-1e3f32..1e3),
            (column, row, seed) in (0.0..1.0, 0.0..1.0, 0usize..1000),
        ) {
            let plane = |c: usize| {
                let sample = |i: usize| (((i + seed) * 40_503 + c * 9_973) >> 5) as u16 % 256;
                (0..width * height).map(sample).collect()
            };
            let components = (0..component_count).map(plane).collect();
            let image = Image::from_bottom_up(width, height, 8, components).unwrap();
            let pixels = Pixels::<u8>::new(&image).unwrap();
            let words = Pixels::<u16>::new(&image).unwrap();
            let mut next = coefficients.into_iter();
            let mut four = || {
                let mut four = [0.0; 4];
                four[..component_count].fill_with(|| next.next().unwrap());
                four
            };
            let forecast = MoveForecast {
                samples: four(),
                squares: four(),
                by_columns: four(),
                by_rows: four(),
                columns: coefficients[20],
                rows: coefficients[21],
                of_way: [coefficients[22], coefficients[23], coefficients[24]],
            };
            let at = |part: f64, count: usize| (part * count as f64) as i32;
            let from = Point::new(at(column, width), at(row, height));
            let around = pixels.foreseen_around(&forecast, from);
            let around_words = words.foreseen_around(&forecast, from);
            for (dx, dy) in (-REACH..=REACH).flat_map(|dy| (-REACH..=REACH).map(move |dx| (dx, dy))) {
                let to = Point::new(from.x + dx, from.y + dy);
                if (0..width as i32).contains(&to.x) && (0..height as i32).contains(&to.y) {
                    let expected = pixels.foreseen(&forecast, from, to);
                    prop_assert_eq!(words.foreseen(&forecast, from, to), expected);
                    prop_assert_eq!(around.change((dx, dy)), expected);
                    prop_assert_eq!(around_words.change((dx, dy)), expected);
                }
            }
        }
    }
}
