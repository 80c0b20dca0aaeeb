//! How close two images are.

pub(crate) mod fidelity;
pub(crate) mod ssim;
pub(crate) mod ssim_weights;
