//! Significance of each point, aggregated over the components and normalised.

use super::stencil::{Derivatives, Plane, Stencils};
use pixmesh_meshing::parameters::{Policy, PscTie};
use pixmesh_meshing::{Image, Parameters};

/// The density fields that the parameters' policy gives an image, each row by row.
pub(crate) fn density(image: &Image, parameters: &Parameters) -> Vec<Vec<f64>> {
    let luma = [luma(image)];
    let of_components = |measure: Measure| {
        let of = |samples: &Vec<u16>| field(samples, image.width(), parameters, measure);
        image.components().iter().map(of).collect::<Vec<_>>()
    };
    let of_luma = |measure| vec![field(&luma[0], image.width(), parameters, measure)];
    let fields = match parameters.policy {
        Policy::PsaD | Policy::PseD => of_components(mmsodd),
        Policy::PsaL | Policy::PseL => of_components(mol),
        Policy::PsbD => of_luma(mmsodd),
        Policy::PsbL => of_luma(mol),
        Policy::Psc => vec![vector_gradient(image, parameters)],
        Policy::PsdMaxD => vec![pointwise(&of_components(mmsodd), maximum)],
        Policy::PsdMaxL => vec![pointwise(&of_components(mol), maximum)],
        Policy::PsdAvgD => vec![pointwise(&of_components(mmsodd), mean)],
        Policy::PsdAvgL => vec![pointwise(&of_components(mol), mean)],
    };
    if is_flat(image) { cleared(fields) } else { normalised(fields) }
}

/// The integer luma of three components; empty for any other number of them.
pub(crate) fn luma(image: &Image) -> Vec<u16> {
    let [r, g, b] = image.components() else { return Vec::new() };
    let of = |i: usize| {
        let (r, g, b) = (f64::from(r[i]), f64::from(g[i]), f64::from(b[i]));
        (0.299 * r + 0.587 * g + 0.114 * b).floor() as u16
    };
    (0..r.len()).map(of).collect()
}

/// The gray picture of three components as the thesis made its gray images.
pub(crate) fn thesis_gray(image: &Image) -> Vec<u16> {
    let [r, g, b] = image.components() else { return Vec::new() };
    let of = |i: usize| {
        (77 * u64::from(r[i]) + 150 * u64::from(g[i]) + 29 * u64::from(b[i]) + 128) / 256
    };
    (0..r.len()).map(|i| of(i) as u16).collect()
}

/// Significance of one point, of its derivatives as numbers.
type Measure = fn(fxx: f64, fyy: f64, fxy: f64) -> f64;

fn mmsodd(fxx: f64, fyy: f64, fxy: f64) -> f64 {
    let a = (fxx + fyy) / 2.0;
    let b = ((fxx - fyy).powi(2) / 4.0 + fxy * fxy).sqrt();
    (a + b).abs().max((a - b).abs())
}

fn mol(fxx: f64, fyy: f64, _: f64) -> f64 {
    (fxx + fyy).abs()
}

fn field(samples: &[u16], width: usize, parameters: &Parameters, measure: Measure) -> Vec<f64> {
    let stencils = Stencils::new(parameters);
    let quotient = |value: i128| value as f64 / stencils.divisor as f64;
    let of = |d: &Derivatives| measure(quotient(d.fxx), quotient(d.fyy), quotient(d.fxy));
    stencils.derivatives(&Plane::new(samples, width)).iter().map(of).collect()
}

/// The vector gradient; whether `gxx = gyy` is decided in integers.
fn vector_gradient(image: &Image, parameters: &Parameters) -> Vec<f64> {
    let stencils = Stencils::new(parameters);
    let of = |samples: &Vec<u16>| stencils.derivatives(&Plane::new(samples, image.width()));
    let components: Vec<Vec<Derivatives>> = image.components().iter().map(of).collect();
    let magnitude = |i: usize| {
        let total = |product: fn(&Derivatives) -> i128| -> i128 {
            components.iter().map(|component| product(&component[i])).sum()
        };
        let (gxx, gyy) = (total(|d| d.fx * d.fx), total(|d| d.fy * d.fy));
        let gxy = total(|d| d.fx * d.fy);
        larger_stretch(gxx, gyy, gxy, parameters.psc_tie) / stencils.divisor as f64
    };
    (0..image.pixel_count()).map(magnitude).collect()
}

fn larger_stretch(gxx: i128, gyy: i128, gxy: i128, tie: PscTie) -> f64 {
    let sum = (gxx + gyy) as f64;
    if gxx == gyy && tie == PscTie::Published {
        return (sum / 2.0).sqrt();
    }
    let (difference, gxy) = ((gxx - gyy) as f64, gxy as f64);
    ((sum + (difference * difference + 4.0 * gxy * gxy).sqrt()) / 2.0).sqrt()
}

fn pointwise(fields: &[Vec<f64>], of: fn(&[f64]) -> f64) -> Vec<f64> {
    let at = |i: usize| of(&fields.iter().map(|field| field[i]).collect::<Vec<_>>());
    (0..fields[0].len()).map(at).collect()
}

fn maximum(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn normalised(mut fields: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let largest = fields.iter().flatten().copied().fold(0.0, f64::max);
    fields.iter_mut().flatten().for_each(|value| *value /= largest + 1e-12);
    fields
}

/// A picture of one colour has no feature, though its extension by zeros has.
fn cleared(mut fields: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    fields.iter_mut().flatten().for_each(|value| *value = 0.0);
    fields
}

/// Tells whether the picture has one colour.
pub(crate) fn is_flat(image: &Image) -> bool {
    image.components().iter().all(|samples| samples.iter().all(|s| *s == samples[0]))
}
