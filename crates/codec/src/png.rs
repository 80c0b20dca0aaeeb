//! PNG, in and out.
//!
//! Literature: W3C, "Portable Network Graphics (PNG) Specification (Third Edition)", 2025.

mod interlace;
mod pixels;
mod read;
mod write;

pub(crate) use read::open;
pub(crate) use write::{Samples, write_rows};
pub use write::{write_png, write_png_while};
