//! The image whose errors choose the points, and its parameters.

use crate::control::{Cancelled, Control};
use crate::density::luma::guide_picture;
use crate::image::Image;
use crate::parameters::{ErrorMetric, Guide, Parameters, Weights};
use crate::quality::ssim_weights::ssim_weights;
use std::borrow::Cow;

/// An image that guides the choice of points: the image to mesh, or a gray picture of it.
pub(crate) struct Guided<'a> {
    pub(crate) image: Cow<'a, Image>,
    /// Parameters for this image, a gray one or not, with the structural similarity as weights.
    pub(crate) parameters: Parameters,
}

impl<'a> Guided<'a> {
    pub(crate) fn new(
        image: &'a Image,
        parameters: &Parameters,
        control: &dyn Control,
    ) -> Result<Self, Cancelled> {
        let by_ssim = parameters.error_metric == ErrorMetric::Ssim && !parameters.is_flat();
        let weights = match &parameters.weights {
            given if by_ssim => Some(ssim_weights(image, given.as_ref(), control)?),
            given => given.clone(),
        };
        let parameters = Parameters { weights, ..parameters.clone() };
        Ok(match guide_picture(image, parameters.guide, control)? {
            None => Self { image: Cow::Borrowed(image), parameters },
            Some(gray) => Self { image: Cow::Owned(gray), parameters: on_gray(parameters) },
        })
    }

    pub(crate) fn weights(&self) -> Option<&[u8]> {
        self.parameters.weights.as_ref().map(Weights::values)
    }

    /// Whether the errors that guide are the squared errors of the image to mesh.
    pub(crate) fn has_squared_errors(&self) -> bool {
        let is_whole = matches!(self.image, Cow::Borrowed(_));
        is_whole && self.weights().is_none() && self.parameters.error_metric.is_squared_difference()
    }
}

fn on_gray(parameters: Parameters) -> Parameters {
    let policy = parameters.policy.of_one_component();
    let error_metric = parameters.error_metric.of_one_component();
    Parameters { policy, error_metric, guide: Guide::Components, ..parameters }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::{Method, Policy, Target};

    #[test]
    fn gray_has_parameters_of_one_component() {
        let own = Method::Cgpr.parameters(Target::Size(50));
        for (&policy, &error_metric) in Policy::ALL.iter().zip(ErrorMetric::ALL.iter().cycle()) {
            let luma = on_gray(Parameters { policy, error_metric, ..own.clone() });
            assert_eq!(luma.guide, Guide::Components);
            assert!(luma.policy.component_count().is_none_or(|count| count == 1), "{policy}");
            assert!(luma.error_metric.component_count().is_none_or(|count| count == 1));
            assert_eq!((luma.target, luma.generator), (own.target, own.generator));
        }
    }

    #[test]
    fn given_weights_scale_those_of_the_similarity() {
        let samples = (0..24 * 24).map(|i| (i * 37 % 101) as u16 + (i / 24) as u16).collect();
        let image = Image::from_bottom_up(24, 24, 8, vec![samples]).unwrap();
        let own = Method::Mgpr.parameters(Target::Size(50)).error_metric(ErrorMetric::Ssim);
        let weights = |given: Option<u8>| {
            let given =
                given.map(|weight| Weights::from_bottom_up(24, 24, vec![weight; 24 * 24]).unwrap());
            let guided = Guided::new(&image, &own.clone().weights(given), &()).unwrap();
            guided.weights().unwrap().to_vec()
        };
        let alone = weights(None);
        assert!(alone.iter().any(|&weight| weight > 1));
        for given in [0, 1, 128, 255] {
            for (&with, &without) in weights(Some(given)).iter().zip(&alone) {
                let expected = f64::from(without) * f64::from(given) / 255.0;
                assert_eq!(f64::from(with), expected.ceil(), "{without} and {given}");
            }
        }
    }
}
