//! The error of one point by each metric, in the whole numbers that removal compares.

use pixmesh_meshing::Image;
use pixmesh_meshing::parameters::ErrorMetric;

/// The error of one point's sample vector.
pub(crate) fn error(metric: ErrorMetric, before: &[i128], after: &Vec<i128>) -> u64 {
    let differences = || before.iter().zip(after).map(|(a, b)| (a - b).abs());
    let squares = || differences().map(|d| d * d).sum::<i128>();
    let error = match metric {
        ErrorMetric::MeanCompSe | ErrorMetric::VecSe | ErrorMetric::Ssim => squares(),
        ErrorMetric::MeanCompAe => differences().sum(),
        ErrorMetric::LumaSe => (luma(before) - luma(after)).pow(2),
        ErrorMetric::LumaAe => (luma(before) - luma(after)).abs(),
        ErrorMetric::YcbcrVecSe => squared_distance(before, after),
        // In steps of 1/256, rounded down.
        ErrorMetric::YcbcrVecAe => {
            let squared = 65_536 * squared_distance(before, after);
            (0..).take_while(|root| root * root <= squared).last().unwrap()
        }
    };
    error as u64
}

/// The mean error per point that a sum stands for.
pub(crate) fn mean(metric: ErrorMetric, sum: u64, image: &Image) -> f64 {
    let per_point = match metric {
        ErrorMetric::MeanCompSe | ErrorMetric::MeanCompAe => image.component_count() as f64,
        ErrorMetric::YcbcrVecAe => 256.0,
        _ => 1.0,
    };
    sum as f64 / (per_point * image.pixel_count() as f64)
}

fn luma(colour: &[i128]) -> i128 {
    let [r, g, b] = [0, 1, 2].map(|c| colour[c] as f64);
    (0.299 * r + 0.587 * g + 0.114 * b).floor() as i128
}

fn squared_distance(before: &[i128], after: &[i128]) -> i128 {
    let cb = |c: &[i128]| (-168_736 * c[0] - 331_264 * c[1] + 500_000 * c[2]).div_euclid(1_000_000);
    let cr = |c: &[i128]| (500_000 * c[0] - 418_688 * c[1] - 81_312 * c[2]).div_euclid(1_000_000);
    (luma(before) - luma(after)).pow(2)
        + (cb(before) - cb(after)).pow(2)
        + (cr(before) - cr(after)).pow(2)
}
