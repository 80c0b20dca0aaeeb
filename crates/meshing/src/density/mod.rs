//! An image's density of sample points: significance, aggregated over components and normalised.

pub(crate) mod filter;
pub(crate) mod luma;
pub(crate) mod second_derivatives;
pub(crate) mod significance;

use crate::control::{Cancelled, Control, Stage};
use crate::density::filter::{Filter, Order};
use crate::density::luma::luma;
use crate::density::second_derivatives::SecondDerivatives;
use crate::density::significance::{Significance, poll_row, vector_gradient};
use crate::image::Image;
use crate::parallel::in_row_bands;
use crate::parameters::Parameters;
use crate::parameters::choices::Policy;
use fearless_simd::{Level, Simd, dispatch};

/// What the largest significance is raised by before it divides, so that a picture without any
/// detail has density 0 and not 0/0.
const NORMALISATION_FLOOR: f64 = 1e-12;

/// How densely sample points should lie: fields of `width * height` numbers in `0.0..=1.0`, row 0
/// at the bottom.
///
/// There is one field, but one per component where the policy diffuses each component on its own.
#[derive(Clone, Debug, PartialEq)]
pub struct Density {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) fields: Vec<Vec<f64>>,
}

/// How the significance of several components becomes one.
#[derive(Clone, Copy)]
enum Aggregation {
    Maximum,
    Mean,
    /// Not at all: one field per component.
    Apart,
}

impl Density {
    /// Computes the density that the parameters' policy and filters give an image.
    ///
    /// The policy must be defined for the image's number of components, see
    /// [`Parameters::plan`]; the vector gradient is computed of any number.
    ///
    /// # Errors
    /// When the control cancels.
    pub fn new(
        image: &Image,
        parameters: &Parameters,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        use Aggregation::{Apart, Maximum, Mean};
        use Significance::{Mmsodd, Mol};
        let of = |significance, aggregation| {
            aggregate(image, parameters, significance, aggregation, control)
        };
        let fields = match parameters.policy {
            Policy::PsaD | Policy::PsdMaxD => of(Mmsodd, Maximum)?,
            Policy::PsaL | Policy::PsdMaxL => of(Mol, Maximum)?,
            Policy::PsdAvgD => of(Mmsodd, Mean)?,
            Policy::PsdAvgL => of(Mol, Mean)?,
            Policy::PseD => of(Mmsodd, Apart)?,
            Policy::PseL => of(Mol, Apart)?,
            Policy::PsbD => aggregate(&luma(image), parameters, Mmsodd, Maximum, control)?,
            Policy::PsbL => aggregate(&luma(image), parameters, Mol, Maximum, control)?,
            Policy::Psc => {
                let filter = Filter::new(parameters);
                let (components, tie) = (image.components(), parameters.psc_tie);
                vec![vector_gradient(&filter, components, image.width(), tie, control)?]
            }
        };
        let mut density = Self { width: image.width(), height: image.height(), fields };
        if image.is_flat() {
            density.clear();
        }
        density.normalise();
        Ok(density)
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The fields, each `width * height` numbers in `0.0..=1.0`, row 0 at the bottom.
    #[must_use]
    pub fn fields(&self) -> &[Vec<f64>] {
        &self.fields
    }

    /// Sets all fields to 0: a picture of one colour has no feature, though the extension of it
    /// by zeros would make one of its border.
    fn clear(&mut self) {
        self.fields.iter_mut().flatten().for_each(|value| *value = 0.0);
    }

    /// Divides all fields by their common maximum.
    fn normalise(&mut self) {
        let level = Level::new();
        let largest = |field: &Vec<f64>| dispatch!(level, simd => maximum(simd, field));
        let largest = self.fields.iter().map(largest).fold(0.0, f64::max);
        let divisor = largest + NORMALISATION_FLOOR;
        for field in &mut self.fields {
            dispatch!(level, simd => divide(simd, field, divisor));
        }
    }
}

/// The largest of numbers that are not negative.
#[inline(always)]
fn maximum<S: Simd>(_: S, values: &[f64]) -> f64 {
    let (chunks, rest) = values.as_chunks::<16>();
    let mut lanes = [0.0; 16];
    for chunk in chunks {
        for (lane, &value) in lanes.iter_mut().zip(chunk) {
            *lane = if value > *lane { value } else { *lane };
        }
    }
    lanes.iter().chain(rest).copied().fold(0.0, f64::max)
}

#[inline(always)]
fn divide<S: Simd>(_: S, values: &mut [f64], divisor: f64) {
    for value in values {
        *value /= divisor;
    }
}

/// The significance of each component, brought together in one field or left apart.
fn aggregate(
    image: &Image,
    parameters: &Parameters,
    significance: Significance,
    aggregation: Aggregation,
    control: &dyn Control,
) -> Result<Vec<Vec<f64>>, Cancelled> {
    let filter = Filter::new(parameters);
    let (width, height, count) = (image.width(), image.height(), image.component_count());
    let field_count = if matches!(aggregation, Aggregation::Apart) { count } else { 1 };
    let mut fields = vec![vec![0.0; image.pixel_count()]; field_count];
    for (c, component) in image.components().iter().enumerate() {
        let field = &mut fields[c.min(field_count - 1)];
        // The first one of a field is written without reading: pages that were read before they are
        // written are mapped twice, and the second time interrupts all threads.
        let is_first = c < field_count;
        let poll = |y, control: &dyn Control| poll_row(control, c * height + y, count * height);
        if SecondDerivatives::new(parameters, component, width).is_some() {
            in_row_bands(field, width, control, |first_row, band, control| {
                let sweep = SecondDerivatives::new(parameters, component, width);
                let (Some(mut sweep), mut values) = (sweep, vec![0.0; width]) else {
                    return Ok(());
                };
                for (y, row) in (first_row..).zip(band.chunks_exact_mut(width)) {
                    poll(y, control)?;
                    if is_first {
                        sweep.evaluate(significance, y, row);
                    } else {
                        sweep.evaluate(significance, y, &mut values);
                        merge(row, &values, aggregation);
                    }
                }
                Ok(())
            })?;
        } else {
            let mut values = vec![0.0; width];
            filter.for_each_row(component, width, Order::Second, |y, row| {
                poll(y, control)?;
                let whole = &mut field[y * width..][..width];
                if is_first {
                    significance.evaluate(row, filter.divisor(), whole);
                } else {
                    significance.evaluate(row, filter.divisor(), &mut values);
                    merge(whole, &values, aggregation);
                }
                Ok(())
            })?;
        }
    }
    if matches!(aggregation, Aggregation::Mean) {
        fields.iter_mut().flatten().for_each(|value| *value /= count as f64);
    }
    control.poll(Stage::Density, count * height, count * height)?;
    Ok(fields)
}

/// Brings one component's row into the field's.
fn merge(field: &mut [f64], values: &[f64], aggregation: Aggregation) {
    let level = Level::new();
    dispatch!(level, simd => merge_by(simd, field, values, aggregation));
}

#[inline(always)]
fn merge_by<S: Simd>(_: S, field: &mut [f64], values: &[f64], aggregation: Aggregation) {
    let pairs = field.iter_mut().zip(values);
    match aggregation {
        // Neither is NaN nor negative.
        Aggregation::Maximum => {
            pairs.for_each(|(sum, &value)| *sum = if value > *sum { value } else { *sum });
        }
        Aggregation::Mean => pairs.for_each(|(sum, &value)| *sum += value),
        // Each component is the first one of its field.
        Aggregation::Apart => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::Target;
    use std::sync::Mutex;

    /// Writes down what it hears.
    #[derive(Default)]
    struct Record(Mutex<Vec<(Stage, usize, usize)>>);

    impl Control for Record {
        fn poll(&self, stage: Stage, done: usize, total: usize) -> Result<(), Cancelled> {
            self.0.lock().unwrap().push((stage, done, total));
            Ok(())
        }
    }

    #[test]
    fn rows_of_all_components_are_counted_as_they_are_done() {
        let plane = |c: usize| (0..8 * 96).map(|i| (i * (c + 7) % 251) as u16).collect();
        let image = Image::from_bottom_up(8, 96, 8, (0..3).map(plane).collect()).unwrap();
        for smoothing_order in [1, 3, 5] {
            let parameters = Parameters {
                smoothing_order,
                ..Parameters::default().target(Target::Percent(50.0))
            };
            let record = Record::default();
            Density::new(&image, &parameters, &record).unwrap();
            let heard = record.0.into_inner().unwrap();
            assert!(heard.len() > 9, "{heard:?}");
            assert!(heard.is_sorted_by(|a, b| a.1 < b.1), "{heard:?}");
            assert_eq!(heard.last(), Some(&(Stage::Density, 288, 288)));
        }
    }

    #[test]
    fn rows_of_all_components_are_counted_where_they_make_one_gradient() {
        let plane = |c: usize| (0..8 * 96).map(|i| (i * (c + 7) % 251) as u16).collect();
        let image = Image::from_bottom_up(8, 96, 8, (0..3).map(plane).collect()).unwrap();
        let own = Parameters::default().target(Target::Percent(50.0));
        let record = Record::default();
        Density::new(&image, &Parameters { policy: Policy::Psc, ..own }, &record).unwrap();
        let heard = record.0.into_inner().unwrap();
        assert!(heard.iter().all(|&(stage, _, rows)| (stage, rows) == (Stage::Density, 288)));
        for row in (0..288).step_by(32) {
            assert!(heard.contains(&(Stage::Density, row, 288)), "{row} is not in {heard:?}");
        }
    }
}
