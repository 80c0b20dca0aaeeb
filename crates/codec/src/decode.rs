//! The two entries: the header alone, and the whole picture.

use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::header::Header;
use crate::limits::Limits;
use crate::{jpeg, png, pnm};
use pixmesh_meshing::Image;

/// The most bytes that a file's metadata may make a decoder hold.
pub(crate) const METADATA_BYTES: usize = 8 << 20;

/// Reads a picture's header and checks it against the limits.
///
/// Needs no pixel buffer, and at most 8 MiB whatever the bytes. The rest of the file is not looked
/// at: a header that passes may still be followed by broken pixels.
///
/// # Errors
/// When there are no bytes, the format is unknown, the header is broken or not supported, the
/// picture is larger than the limits allow, or it has only one column or row.
pub fn probe(bytes: &[u8], limits: &Limits) -> Result<Header, DecodeError> {
    match PictureFormat::sniff(bytes)? {
        PictureFormat::Png => png::probe(bytes, limits),
        PictureFormat::Jpeg => jpeg::probe(bytes, limits),
        PictureFormat::Pnm => pnm::probe(bytes, limits),
    }
}

/// Decodes a picture: its raw samples, upright, alpha as a component like any other.
///
/// Colour profiles and gamma are ignored. Memory is bounded by what the header claims, which is
/// checked first, see [`Header::decode_bytes`]. Bytes after the picture's end are ignored; of an
/// animated PNG the default image is decoded, of a stream of portable anymaps the first.
///
/// # Errors
/// As [`probe`], and when the pixels are broken or end early.
pub fn decode(bytes: &[u8], limits: &Limits) -> Result<Image, DecodeError> {
    match PictureFormat::sniff(bytes)? {
        PictureFormat::Png => png::decode(bytes, limits),
        PictureFormat::Jpeg => jpeg::decode(bytes, limits),
        PictureFormat::Pnm => pnm::decode(bytes, limits),
    }
}
