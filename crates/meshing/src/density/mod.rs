//! The density of sample points: the significance of each lattice point over the largest.

pub(crate) mod derivatives;
pub(crate) mod luma;
pub(crate) mod significance;

use crate::control::{Cancelled, Control, POINTS_PER_POLL, Stage, rows_per_poll};
use crate::density::derivatives::{BinomialRow, Derivatives, Filter, Order};
use crate::density::luma::luma;
use crate::density::significance::{
    DerivativeRow, GradientTensor, Significance, add_gradients, vector_gradient,
};
use crate::error::MeshingError;
use crate::image::Image;
use crate::parallel::in_row_bands;
use crate::parameters::Parameters;
use crate::parameters::choices::{Policy, PscTie};
use fearless_simd::{Level, Simd, dispatch};

/// Added to the largest significance before it divides, so that an image without any detail has
/// density 0 and not 0/0.
const NORMALISATION_FLOOR: f64 = 1e-12;

/// How densely sample points should lie: fields of `width * height` numbers in `0.0..=1.0`, row 0
/// at the bottom.
///
/// There is one field, or one per component where the policy diffuses each component on its own.
#[derive(Clone, Debug, PartialEq)]
pub struct Density {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) fields: Vec<Vec<f64>>,
}

/// How the components of an image give one field.
#[derive(Clone, Copy)]
enum Operator {
    /// The largest of the components' significances.
    Maximum(Significance),
    /// The mean of the components' significances.
    Mean(Significance),
    VectorGradient(PscTie),
}

impl Density {
    /// Computes the density of an image by the policy and the filters of the parameters.
    ///
    /// # Errors
    /// When a parameter is out of its bounds, the policy is not defined for the image's number of
    /// components, or the control cancels.
    pub fn new(
        image: &Image,
        parameters: &Parameters,
        control: &dyn Control,
    ) -> Result<Self, MeshingError> {
        parameters.check()?;
        parameters.check_policy(image.component_count())?;
        Ok(Self::of_checked(image, parameters, control)?)
    }

    /// The density by parameters that are known to be in their bounds and defined for the image.
    pub(crate) fn of_checked(
        image: &Image,
        parameters: &Parameters,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        use Operator::{Maximum, Mean, VectorGradient};
        use Significance::{Mmsodd, Mol};
        let operator = match parameters.policy {
            Policy::PsaD | Policy::PsbD | Policy::PsdMaxD | Policy::PseD => Maximum(Mmsodd),
            Policy::PsaL | Policy::PsbL | Policy::PsdMaxL | Policy::PseL => Maximum(Mol),
            Policy::PsdAvgD => Mean(Mmsodd),
            Policy::PsdAvgL => Mean(Mol),
            Policy::Psc => VectorGradient(parameters.psc_tie),
        };
        let is_apart = matches!(parameters.policy, Policy::PseD | Policy::PseL);
        let gray = match parameters.policy {
            Policy::PsbD | Policy::PsbL => Some(luma(image, control)?),
            _ => None,
        };
        let components = gray.as_ref().unwrap_or(image).components();
        let (width, height) = (image.width(), image.height());
        let field_count = if is_apart { components.len() } else { 1 };
        let mut fields: Vec<_> = (0..field_count).map(|_| vec![0.0; width * height]).collect();
        // Extended by zeros, an image of one colour would have features along its border.
        let is_flat = image.is_flat();
        for (i, field) in fields.iter_mut().enumerate().filter(|_| !is_flat) {
            let components = if is_apart { &components[i..=i] } else { components };
            let filter = FieldFilter::new(components, width, operator, parameters);
            let (rows_before, row_count) = (i * height, field_count * height);
            filter.fill(field, rows_before, row_count, control)?;
        }
        let mut density = Self { width, height, fields };
        density.normalise(control)?;
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

    /// Divides all fields by their common maximum.
    fn normalise(&mut self, control: &dyn Control) -> Result<(), Cancelled> {
        let rows = self.fields.len() * self.height;
        let level = Level::new();
        let mut largest: f64 = 0.0;
        for chunk in self.fields.iter().flat_map(|field| field.chunks(POINTS_PER_POLL)) {
            control.poll(Stage::Density, rows, rows)?;
            largest = largest.max(dispatch!(level, simd => maximum(simd, chunk)));
        }
        let divisor = largest + NORMALISATION_FLOOR;
        for field in &mut self.fields {
            in_row_bands(field, self.width, control, |_, band, control| {
                for chunk in band.chunks_mut(POINTS_PER_POLL) {
                    control.poll(Stage::Density, rows, rows)?;
                    dispatch!(level, simd => divide(simd, chunk, divisor));
                }
                Ok(())
            })?;
        }
        Ok(())
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

/// What makes one field of one or more components.
struct FieldFilter<'a> {
    components: &'a [Vec<u16>],
    width: usize,
    operator: Operator,
    parameters: &'a Parameters,
    filter: Filter,
}

impl<'a> FieldFilter<'a> {
    fn new(
        components: &'a [Vec<u16>],
        width: usize,
        operator: Operator,
        parameters: &'a Parameters,
    ) -> Self {
        let order = match operator {
            Operator::Maximum(_) | Operator::Mean(_) => Order::Second,
            Operator::VectorGradient(_) => Order::First,
        };
        Self { components, width, operator, parameters, filter: Filter::new(parameters, order) }
    }

    /// Computes all rows of a field, `rows_before` of `row_count` rows being done before.
    fn fill(
        &self,
        field: &mut [f64],
        rows_before: usize,
        row_count: usize,
        control: &dyn Control,
    ) -> Result<(), Cancelled> {
        let interval = rows_per_poll(self.width * self.components.len());
        in_row_bands(field, self.width, control, |first_row, band, control| {
            let mut rows = FieldRows::new(self);
            for (i, row) in band.chunks_exact_mut(self.width).enumerate() {
                let y = first_row + i;
                if i.is_multiple_of(interval) {
                    control.poll(Stage::Density, rows_before + y, row_count)?;
                }
                rows.evaluate(y, row);
            }
            Ok(())
        })
    }
}

/// Computes one row of a field after the other.
struct FieldRows<'a> {
    filter: &'a FieldFilter<'a>,
    fast: Option<BinomialRow>,
    derivatives: Vec<Derivatives<'a>>,
    derivative_row: DerivativeRow,
    values: Vec<f64>,
    tensors: Vec<GradientTensor>,
}

impl<'a> FieldRows<'a> {
    fn new(filter: &'a FieldFilter<'a>) -> Self {
        let derivatives =
            |component: &'a Vec<u16>| Derivatives::new(&filter.filter, component, filter.width);
        Self {
            filter,
            fast: BinomialRow::new(filter.parameters, filter.width),
            derivatives: filter.components.iter().map(derivatives).collect(),
            derivative_row: DerivativeRow::default(),
            values: vec![0.0; filter.width],
            tensors: Vec::new(),
        }
    }

    /// Row `y` of the field.
    fn evaluate(&mut self, y: usize, row: &mut [f64]) {
        match self.filter.operator {
            Operator::Maximum(significance) => self.aggregate(significance, y, row, maximise),
            Operator::Mean(significance) => {
                self.aggregate(significance, y, row, add);
                let count = self.filter.components.len() as f64;
                row.iter_mut().for_each(|value| *value /= count);
            }
            Operator::VectorGradient(tie) => {
                self.tensors.clear();
                self.tensors.resize(row.len(), [0.0; 3]);
                for derivatives in &mut self.derivatives {
                    derivatives.row(y, &mut self.derivative_row);
                    add_gradients(&self.derivative_row, &mut self.tensors);
                }
                // The filter's first derivatives are doubled.
                let divisor = 2.0 * self.filter.filter.divisor;
                for (value, &tensor) in row.iter_mut().zip(&self.tensors) {
                    *value = vector_gradient(tensor, tie) / divisor;
                }
            }
        }
    }

    /// The significance of the first component, into which `merge` brings the others.
    fn aggregate(
        &mut self,
        significance: Significance,
        y: usize,
        row: &mut [f64],
        merge: impl Fn(&mut [f64], &[f64]),
    ) {
        self.significance_of(0, significance, y, row);
        let mut values = std::mem::take(&mut self.values);
        for component in 1..self.derivatives.len() {
            self.significance_of(component, significance, y, &mut values);
            merge(row, &values);
        }
        self.values = values;
    }

    /// The significance of row `y` of one component.
    fn significance_of(
        &mut self,
        component: usize,
        significance: Significance,
        y: usize,
        values: &mut [f64],
    ) {
        if let Some(fast) = &mut self.fast {
            fast.evaluate(significance, &self.filter.components[component], y, values);
        } else {
            self.derivatives[component].row(y, &mut self.derivative_row);
            significance.evaluate(&self.derivative_row, self.filter.filter.divisor, values);
        }
    }
}

/// Raises each value to the other row's; none is NaN.
fn maximise(row: &mut [f64], values: &[f64]) {
    #[inline(always)]
    fn by<S: Simd>(_: S, row: &mut [f64], values: &[f64]) {
        row.iter_mut().zip(values).for_each(|(a, &b)| *a = if b > *a { b } else { *a });
    }
    dispatch!(Level::new(), simd => by(simd, row, values));
}

/// Adds the other row to a row.
fn add(row: &mut [f64], values: &[f64]) {
    row.iter_mut().zip(values).for_each(|(sum, &value)| *sum += value);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::tests::Recorder;
    use crate::parameters::choices::Smoothing;
    use crate::parameters::{ParameterError, Target};

    fn colour(width: usize, height: usize) -> Image {
        let plane = |c: usize| (0..width * height).map(|i| (i * (c + 7) % 251) as u16).collect();
        Image::from_bottom_up(width, height, 8, (0..3).map(plane).collect()).unwrap()
    }

    fn with_policy(policy: Policy) -> Parameters {
        Parameters { policy, ..Parameters::default().target(Target::Percent(50.0)) }
    }

    #[test]
    fn progress_ascends_to_all_rows() {
        for policy in [Policy::PsbD, Policy::Psc, Policy::PsdAvgL, Policy::PseD] {
            let recorder = Recorder::default();
            Density::new(&colour(1000, 600), &with_policy(policy), &recorder).unwrap();
            let total = if policy == Policy::PseD { 1800 } else { 600 };
            let mut reports = recorder.reports();
            reports.retain(|report| report.2 > 1);
            assert!(reports.len() > 9 && reports.is_sorted_by_key(|report| report.1));
            assert_eq!(reports.last(), Some(&(Stage::Density, total, total)));
        }
    }

    #[test]
    fn polls_are_frequent_in_any_shape() {
        for (width, height) in [(20, 60_000), (1100, 1100), (60_000, 20)] {
            for policy in [Policy::PsdMaxD, Policy::Psc, Policy::PseL] {
                let recorder = Recorder::default();
                Density::new(&colour(width, height), &with_policy(policy), &recorder).unwrap();
                // The samples of three components, once for each interval.
                let least = 3 * width * height / POINTS_PER_POLL;
                assert!(recorder.reports().len() >= least, "{width} by {height}, {policy}");
            }
        }
    }

    #[test]
    fn parameters_out_of_bounds_are_refused() {
        let own = with_policy(Policy::PsdMaxD);
        for (smoothing_order, smoothing) in [(0, Smoothing::Mean), (2, Smoothing::Binomial)] {
            let even = Parameters { smoothing_order, smoothing, ..own.clone() };
            let refused = Density::new(&colour(4, 4), &even, &());
            assert!(matches!(refused, Err(MeshingError::Parameter(_))), "{refused:?}");
        }
        let refused = Density::new(&colour(4, 4), &with_policy(Policy::PsaD), &());
        let Err(MeshingError::Parameter(error)) = refused else { panic!("{refused:?}") };
        assert!(matches!(error, ParameterError::ComponentCount { needed: 1, actual: 3, .. }));
    }

    #[test]
    fn all_passes_can_be_cancelled() {
        for policy in [Policy::PsbD, Policy::Psc, Policy::PsdMaxD] {
            let (image, parameters) = (colour(600, 400), with_policy(policy));
            let recorder = Recorder::default();
            Density::new(&image, &parameters, &recorder).unwrap();
            for poll in 0..recorder.reports().len() {
                let cancelled = Density::new(&image, &parameters, &Recorder::cancelling_at(poll));
                assert_eq!(cancelled, Err(MeshingError::Cancelled(Cancelled)));
            }
        }
    }
}
