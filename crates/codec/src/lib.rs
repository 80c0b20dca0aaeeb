//! Decodes pictures, and reads and writes triangle meshes.
//!
//! The input may be hostile. The format is detected from the content, never from a name; every limit
//! is checked on the header, before any pixel buffer is allocated; metadata is never inflated; no
//! input makes a function panic.
//!
//! | format | in | out |
//! |---|---|---|
//! | PNG | [`decode`] | [`write_png`], [`write_png_while`] |
//! | PNM: PBM, PGM, PPM, PAM | [`decode`] | [`write_pnm`] |
//! | JPEG, WebP, GIF, TIFF, BMP | [`decode`] | |
//! | MODEL | [`read_model`] | [`write_model`] |
//! | pmesh | [`read_pmesh`], [`read_progression`] | [`write_pmesh`], [`write_pmesh_while`], [`write_rounded_pmesh`], [`write_progression`] |
//! | MODEL or pmesh, by the content | [`probe_mesh`], [`read_mesh_while`] | |
//! | every [`Format`] of meshes | | [`encode`] |
//!
//! [`DecodeOptions`] choose what becomes of alpha and of files that end early, and limit the memory
//! of decoding. [`EncodeOptions`] choose how a mesh is stored. [`Geometry`] places a mesh in space:
//! flat, as a relief of its luma or of a component, or as a solid on a base.
//! [`DecodeOptions::decode_terrain_while`] tells the place of an elevation model and what its samples
//! mean, which MODEL and pmesh keep: [`MeshHeader::terrain`]. [`DecodeOptions::heights_while`] gives its
//! heights.
//! [`DecodeOptions::decode_while`] and the other functions ending in `_while` stop when their result
//! is no longer [`Wanted`]. [`read_weights`] reads a picture that weighs the points of another.
//!
//! Files store rows from the top, an [`Image`](pixmesh_meshing::Image) from the bottom: decoders and
//! encoders reverse the rows.
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

mod alpha;
mod bmp;
mod canvas;
mod choices;
mod color;
mod decode;
mod encode;
mod error;
mod face_order;
mod format;
mod gif;
mod gltf;
mod guard;
mod header;
mod interleave;
mod jpeg;
mod json;
mod leb128;
mod limits;
mod lines;
mod mesh_file;
mod mesh_format;
mod mesh_header;
mod meshopt;
mod model;
mod obj;
mod orientation;
mod packed;
mod ply;
mod pmesh;
mod png;
mod pnm;
mod quantized_mesh;
mod raster;
mod rounding;
mod shown;
mod stl;
mod surface;
mod svg;
mod terrain;
mod tiff;
mod unread;
mod wanted;
mod webp;
mod weights;

pub use alpha::Alpha;
pub use choices::{
    Coloring, Compression, LengthUnit, PngCompression, ReliefSource, Shading, Texturing, UpAxis,
};
pub use decode::{DecodeOptions, decode, probe};
pub use encode::{Encodable, EncodeOptions, encode, estimated_bytes};
pub use error::{DecodeError, EncodeError};
pub use format::PictureFormat;

pub use gltf::Texture;
pub use guard::in_guarded_decoder;
pub use header::Header;
pub use limits::Limits;
pub use mesh_file::{MeshFileError, probe_mesh, read_mesh_while};
pub use mesh_format::Format;
pub use mesh_header::MeshHeader;
pub use model::{
    ModelDefect, ModelError, model_comments, probe_model, read_model, read_model_bytes,
    read_model_while, write_model, write_model_with_comments,
};
pub use pixmesh_terrain::Heights;
pub use pmesh::{
    PmeshError, is_pmesh, probe_pmesh, read_pmesh, read_pmesh_while, read_progression,
    read_progression_while, write_pmesh, write_pmesh_while, write_progression, write_rounded_pmesh,
};
pub use png::{write_png, write_png_while};
pub use pnm::write_pnm;
pub use surface::{Geometry, Relief, ReliefHeight, ZOffset};
pub use terrain::{Nodata, Terrain};
pub use wanted::Wanted;
pub use weights::{WeightsError, probe_weights, read_weights, read_weights_while};
