//! The density of sample points: the significance of each lattice point over the largest.

pub(crate) mod derivatives;
pub(crate) mod luma;
pub(crate) mod significance;

use crate::control::{Cancelled, Control, POINTS_PER_POLL, Poller, Stage};
use crate::density::derivatives::{BinomialRow, Derivatives, Filter};
use crate::density::luma::guide_picture;
use crate::density::significance::{
    DerivativeRow, GradientTensor, Significance, add_gradients, vector_gradient,
};
use crate::error::MeshingError;
use crate::image::Image;
use crate::parallel::in_row_bands;
use crate::parameters::Parameters;
use crate::parameters::choices::{Guide, Policy, PscTie};

/// Added to the largest significance before it divides: an image without detail has density 0.
const NORMALISATION_FLOOR: f64 = 1e-12;

/// How dense sample points should be: the significance of each lattice point over the largest. One
/// field, or one for each component if the policy diffuses each component on its own.
///
/// ```
/// use pixmesh_meshing::{Density, Image, Parameters, Target};
///
/// let dot = (0..81).map(|i| if i == 40 { 255 } else { 0 }).collect();
/// let image = Image::from_top_down(9, 9, 8, vec![dot])?;
/// let density = Density::new(&image, &Parameters::default().target(Target::Size(20)), &())?;
/// let field = &density.fields()[0];
/// assert_eq!(field.len(), 81);
/// assert!(field[39] > 0.1 && field[0] == 0.0); // dense beside the dot alone
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Density {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) fields: Vec<Vec<f64>>,
}

#[derive(Clone, Copy)]
enum Operator {
    Maximum(Significance),
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
        parameters.policy.check_component_count(image.component_count())?;
        Ok(Self::of_checked(image, parameters, control)?)
    }

    /// [`new`](Self::new) with parameters that are known to be valid for the image.
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
        let is_of_luma = matches!(parameters.policy, Policy::PsbD | Policy::PsbL);
        let guide = if is_of_luma { Guide::Luma } else { Guide::Components };
        let gray = guide_picture(image, guide, control)?;
        let components = gray.as_ref().unwrap_or(image).components();
        let (width, height) = (image.width(), image.height());
        let field_count = if is_apart { components.len() } else { 1 };
        let mut fields: Vec<_> = (0..field_count).map(|_| vec![0.0; width * height]).collect();
        let filter = &Filter::new(parameters);
        // Extended by zeros, an image of one colour would have features along its border.
        let is_flat = is_flat(image, control)?;
        for (i, field) in fields.iter_mut().enumerate().filter(|_| !is_flat) {
            let components = if is_apart { &components[i..=i] } else { components };
            in_row_bands(field, width, control, |first_row, band, control| {
                let mut poller = Poller::new(control, Stage::Density, 0, field_count * height);
                let mut rows = FieldRows {
                    operator,
                    components,
                    filter,
                    fast: BinomialRow::new(parameters, width),
                    derivatives: components
                        .iter()
                        .map(|component| Derivatives::new(filter, component, width))
                        .collect(),
                    derivative_row: DerivativeRow::default(),
                    values: Vec::new(),
                    tensors: Vec::new(),
                };
                for (y, row) in (first_row..).zip(band.chunks_exact_mut(width)) {
                    poller.done = i * height + y;
                    rows.evaluate(y, row, &mut poller)?;
                }
                Ok(())
            })?;
        }
        let mut density = Self { width, height, fields };
        // Fields of zeros that nobody writes take no memory.
        if !is_flat {
            density.normalise(control)?;
        }
        Ok(density)
    }

    /// The fields, a number in `0.0..=1.0` for each lattice point, row by row from the bottom.
    #[must_use]
    pub fn fields(&self) -> &[Vec<f64>] {
        &self.fields
    }

    fn normalise(&mut self, control: &dyn Control) -> Result<(), Cancelled> {
        let rows = self.fields.len() * self.height;
        let mut largest: f64 = 0.0;
        for chunk in self.fields.iter().flat_map(|field| field.chunks(POINTS_PER_POLL)) {
            control.poll(Stage::Density, rows, rows)?;
            largest = largest.max(maximum(chunk));
        }
        let divisor = largest + NORMALISATION_FLOOR;
        for field in &mut self.fields {
            in_row_bands(field, self.width, control, |_, band, control| {
                for chunk in band.chunks_mut(POINTS_PER_POLL) {
                    control.poll(Stage::Density, rows, rows)?;
                    chunk.iter_mut().for_each(|value| *value /= divisor);
                }
                Ok(())
            })?;
        }
        Ok(())
    }
}

/// Whether every component is one sample repeated.
fn is_flat(image: &Image, control: &dyn Control) -> Result<bool, Cancelled> {
    for samples in image.components() {
        for chunk in samples.chunks(POINTS_PER_POLL) {
            control.poll(Stage::Density, 0, 1)?;
            if chunk.iter().any(|&sample| sample != samples[0]) {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

/// The largest of numbers that are not negative, sixteen at a time in the machine's vectors.
fn maximum(values: &[f64]) -> f64 {
    let (chunks, rest) = values.as_chunks::<16>();
    let mut lanes = [0.0; 16];
    chunks.iter().for_each(|chunk| maximise(&mut lanes, chunk));
    lanes.iter().chain(rest).copied().fold(0.0, f64::max)
}

/// Replaces each value by the other row's if that is larger; none is NaN.
fn maximise(row: &mut [f64], values: &[f64]) {
    row.iter_mut().zip(values).for_each(|(a, &b)| *a = if b > *a { b } else { *a });
}

struct FieldRows<'a> {
    operator: Operator,
    components: &'a [Vec<u16>],
    filter: &'a Filter,
    fast: Option<BinomialRow>,
    derivatives: Vec<Derivatives<'a>>,
    derivative_row: DerivativeRow,
    values: Vec<f64>,
    tensors: Vec<GradientTensor>,
}

impl FieldRows<'_> {
    fn evaluate(
        &mut self,
        y: usize,
        row: &mut [f64],
        poller: &mut Poller<'_>,
    ) -> Result<(), Cancelled> {
        match self.operator {
            Operator::Maximum(significance) => {
                self.aggregate(significance, y, row, maximise, poller)
            }
            Operator::Mean(significance) => {
                let add = |row: &mut [f64], values: &[f64]| {
                    row.iter_mut().zip(values).for_each(|(sum, &value)| *sum += value);
                };
                self.aggregate(significance, y, row, add, poller)?;
                let count = self.components.len() as f64;
                row.iter_mut().for_each(|value| *value /= count);
                Ok(())
            }
            Operator::VectorGradient(tie) => {
                self.tensors.clear();
                self.tensors.resize(row.len(), [0.0; 3]);
                for derivatives in &mut self.derivatives {
                    derivatives.row(y, &mut self.derivative_row, poller)?;
                    add_gradients(&self.derivative_row, &mut self.tensors);
                }
                // The filter's first derivatives are doubled.
                let divisor = 2.0 * self.filter.divisor;
                for (value, &tensor) in row.iter_mut().zip(&self.tensors) {
                    *value = vector_gradient(tensor, tie) / divisor;
                }
                Ok(())
            }
        }
    }

    /// The significance of the first component, merged with that of each other component.
    fn aggregate(
        &mut self,
        significance: Significance,
        y: usize,
        row: &mut [f64],
        merge: fn(&mut [f64], &[f64]),
        poller: &mut Poller<'_>,
    ) -> Result<(), Cancelled> {
        self.values.resize(row.len(), 0.0);
        for component in 0..self.components.len() {
            let target = if component == 0 { &mut *row } else { &mut self.values[..] };
            if let Some(fast) = &mut self.fast {
                poller.step(target.len())?;
                fast.evaluate(significance, &self.components[component], y, target);
            } else {
                self.derivatives[component].row(y, &mut self.derivative_row, poller)?;
                significance.evaluate(&self.derivative_row, self.filter.divisor, target);
            }
            if component > 0 {
                merge(row, &self.values);
            }
        }
        Ok(())
    }
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
    fn polls_are_frequent_within_a_wide_row() {
        let (width, height) = (300_000, 3);
        let long = with_policy(Policy::PsdMaxD).smoothing_order(21);
        let recorder = Recorder::default();
        Density::new(&colour(width, height), &long, &recorder).unwrap();
        // Three stencils of three components, each with 20 weights or more in x.
        let least = 3 * 3 * 20 * height;
        assert!(recorder.reports().len() >= least);
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
