//! The portable anymaps, in and out: PBM, PGM and PPM, plain and raw, and PAM.
//!
//! Literature: Jef Poskanzer and Bryan Henderson, the manual pages pbm(5), pgm(5), ppm(5) and
//! pam(5) of Netpbm.

mod read;
mod scanner;
mod write;

pub(crate) use read::open;
pub use write::write_pnm;
