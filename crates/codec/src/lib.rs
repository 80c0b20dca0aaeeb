//! Pictures and triangle meshes in and out of bytes.
//!
//! This is the room that meets hostile bytes: the format is told from the content, never from a
//! name; every limit is checked on the header, before any pixel buffer; metadata is never inflated;
//! and no input makes it panic.
//!
//! | format | in | out |
//! |---|---|---|
//! | PNG | [`decode`] | [`write_png`] |
//! | JPEG | [`decode`] | |
//! | PNM: PBM, PGM, PPM, PAM | [`decode`] | [`write_pnm`] |
//! | MODEL | [`read_model`] | [`write_model`] |
//! | pmesh | [`read_pmesh`], [`read_progression`] | [`write_pmesh`], [`write_progression`] |
//! | glTF 2.0, binary | | [`write_glb`] |
//!
//! Rows of a file come from the top, those of an [`Image`](pixmesh_meshing::Image) from the bottom:
//! decoders and encoders flip once, at this border.
//!
//! # Example
//! ```
//! use pixmesh_codec::{DecodeError, Limits, decode, probe, write_png};
//!
//! let bytes = b"P2 # a plain graymap of three columns and two rows\n3 2 15\n0 5 10\n15 10 5\n";
//! let header = probe(bytes, &Limits::default())?;
//! assert_eq!((header.width, header.height, header.precision), (3, 2, 4));
//!
//! let image = decode(bytes, &Limits::default())?;
//! assert_eq!(image.row(0, 0), [15, 10, 5]);
//!
//! let mut png = Vec::new();
//! write_png(&image, &mut png).unwrap();
//! assert_eq!(decode(&png, &Limits::default())?, image);
//! # Ok::<(), DecodeError>(())
//! ```

mod canvas;
mod decode;
mod error;
mod format;
mod gltf;
mod header;
mod interleave;
mod jpeg;
mod limits;
mod model;
mod orientation;
mod pmesh;
mod png;
mod pnm;

pub use decode::{decode, probe};
pub use error::{DecodeError, EncodeError};
pub use format::PictureFormat;
pub use gltf::write_glb;
pub use header::Header;
pub use limits::Limits;
pub use model::{ModelDefect, ModelError, read_model, write_model, write_model_with_comments};
pub use pmesh::{
    PmeshError, is_pmesh, read_pmesh, read_progression, write_pmesh, write_progression,
};
pub use png::write_png;
pub use pnm::write_pnm;
