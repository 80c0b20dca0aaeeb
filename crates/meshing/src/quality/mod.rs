//! How close two images are.

pub(crate) mod fidelity;
mod gaussian_window;
pub(crate) mod ssim;
pub(crate) mod ssim_weights;
