//! The two entries: the header alone, and the whole picture.

use crate::alpha::Alpha;
use crate::assembly::Assembly;
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::header::Header;
use crate::limits::Limits;
use crate::wanted::{Wanted, always};
use crate::{bmp, gif, jpeg, png, pnm, tiff, webp};
use pixmesh_meshing::Image;

/// The most bytes that a file's metadata may make a decoder hold.
pub(crate) const METADATA_BYTES: usize = 8 << 20;

/// How pictures are decoded.
///
/// ```
/// use pixmesh_codec::{Alpha, DecodeOptions};
///
/// let pam = b"P7\nWIDTH 2\nHEIGHT 2\nDEPTH 2\nMAXVAL 255\nENDHDR\nabcdefgh";
/// let options = DecodeOptions { alpha: Alpha::Drop, ..DecodeOptions::default() };
/// assert_eq!(options.probe(pam).unwrap().component_count, 1);
/// assert_eq!(options.decode(pam).unwrap().component_count(), 1);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecodeOptions {
    /// The sizes that pictures may have.
    pub limits: Limits,
    /// What becomes of alpha.
    pub alpha: Alpha,
    /// Whether a JPEG, PNG, GIF or PNM that ends early is taken as far as it goes: what is missing
    /// is black or, in a JPEG, what its decoder makes of it, usually gray. Without it every file
    /// that ends early is refused.
    pub lenient: bool,
}

impl DecodeOptions {
    /// Reads a picture's header and checks it against the limits, see [`probe`].
    ///
    /// # Errors
    /// As [`probe`].
    pub fn probe(&self, bytes: &[u8]) -> Result<Header, DecodeError> {
        let limits = &self.limits;
        let header = match PictureFormat::sniff(bytes)? {
            PictureFormat::Png => png::probe(bytes, limits),
            PictureFormat::Jpeg => jpeg::probe(bytes, limits),
            PictureFormat::Pnm => pnm::probe(bytes, limits),
            PictureFormat::WebP => webp::probe(bytes, limits),
            PictureFormat::Gif => gif::probe(bytes, limits),
            PictureFormat::Tiff => tiff::probe(bytes, limits),
            PictureFormat::Bmp => bmp::probe(bytes, limits),
        };
        header.map(|header| self.alpha.of_header(header))
    }

    /// Decodes a picture, see [`decode`].
    ///
    /// # Errors
    /// As [`decode`].
    pub fn decode(&self, bytes: &[u8]) -> Result<Image, DecodeError> {
        self.decode_while(bytes, &always)
    }

    /// Decodes a picture, see [`decode`], for as long as it is wanted.
    ///
    /// Of most files little more is read once it is not. What does not read cannot be stopped, which
    /// is the second half of a progressive JPEG, a lossy WebP as a whole and the last steps of a
    /// lossless one: see [`may_stop_late`](Self::may_stop_late).
    ///
    /// # Errors
    /// [`DecodeError::Cancelled`] when it is no longer wanted, else as [`decode`].
    pub fn decode_while(&self, bytes: &[u8], wanted: &Wanted<'_>) -> Result<Image, DecodeError> {
        wanted()?;
        let canvas = match PictureFormat::sniff(bytes)? {
            PictureFormat::Png => png::decode(bytes, self, wanted),
            PictureFormat::Jpeg => jpeg::decode(bytes, self, wanted),
            PictureFormat::Pnm => pnm::decode(bytes, self, wanted),
            PictureFormat::WebP => webp::decode(bytes, self, wanted),
            PictureFormat::Gif => gif::decode(bytes, self, wanted),
            PictureFormat::Tiff => tiff::decode(bytes, self, wanted),
            PictureFormat::Bmp => bmp::decode(bytes, self, wanted),
        };
        canvas?.into_image(self.alpha, wanted)
    }

    /// Whether [`decode_while`](Self::decode_while) may go on with this file for a tenth of a second or
    /// longer after its picture is no longer wanted.
    ///
    /// So it is with large pictures in progressive JPEG and in WebP. Who must stop sooner decodes them
    /// where that can be ended as a whole, with [`decode_stored`](Self::decode_stored), and puts them
    /// together with [`assemble`](Self::assemble).
    #[must_use]
    pub fn may_stop_late(&self, bytes: &[u8]) -> bool {
        match PictureFormat::sniff(bytes) {
            Ok(PictureFormat::Jpeg) => jpeg::may_stop_late(bytes, &self.limits),
            Ok(PictureFormat::WebP) => webp::may_stop_late(bytes, &self.limits),
            _ => false,
        }
    }

    /// The first half of [`decode`] for a file that [may stop late](Self::may_stop_late): its samples
    /// of 8 bits as they are stored, the components of a pixel side by side, rows from the top.
    ///
    /// # Errors
    /// As [`decode`], and [`DecodeError::Unsupported`] for files of other formats.
    pub fn decode_stored(&self, bytes: &[u8]) -> Result<Vec<u8>, DecodeError> {
        match PictureFormat::sniff(bytes)? {
            PictureFormat::Jpeg => jpeg::decode_stored(bytes, self, &always),
            PictureFormat::WebP => webp::decode_stored(bytes, self, &always),
            other => Err(in_one_piece(other)),
        }
    }

    /// The second half of [`decode`]: an image that is made of the samples that
    /// [`decode_stored`](Self::decode_stored) gives of the same file with the same options.
    ///
    /// # Errors
    /// As [`probe`], [`DecodeError::Unsupported`] for files of other formats than JPEG and WebP, and
    /// [`DecodeError::Cancelled`] when it is no longer wanted.
    pub fn assemble(&self, bytes: &[u8], wanted: &Wanted<'_>) -> Result<Assembly, DecodeError> {
        let canvas = match PictureFormat::sniff(bytes)? {
            PictureFormat::Jpeg => jpeg::canvas(bytes, &self.limits, wanted)?,
            PictureFormat::WebP => webp::canvas(bytes, &self.limits, wanted)?,
            other => return Err(in_one_piece(other)),
        };
        Ok(Assembly::new(canvas, self.alpha))
    }
}

fn in_one_piece(format: PictureFormat) -> DecodeError {
    format.unsupported("it is decoded in one piece")
}

/// Reads a picture's header and checks it against the limits, alpha kept.
///
/// Needs no pixel buffer, and at most 8 MiB whatever the bytes. The pixels are not looked at: a
/// header that passes may still be followed by broken ones.
///
/// # Errors
/// When there are no bytes, the format is unknown, the header is broken or not supported, the
/// picture is larger than the limits allow, or it has only one column or row.
pub fn probe(bytes: &[u8], limits: &Limits) -> Result<Header, DecodeError> {
    DecodeOptions { limits: *limits, ..DecodeOptions::default() }.probe(bytes)
}

/// Decodes a picture: its raw samples, upright, alpha as a component like any other.
///
/// Colour profiles and gamma (gAMA, cHRM, sRGB, cICP and iCCP of PNG, ICC profiles of the others)
/// are ignored: samples are taken as they are stored. Memory is bounded by what the header claims,
/// which is checked first, see [`Header::decode_bytes`]. Bytes after the picture's end are ignored;
/// of an animation the first frame is decoded (of an animated PNG its default image), of a stream of
/// portable anymaps or a TIFF of several pages the first.
///
/// # Errors
/// As [`probe`], and when the pixels are broken or end early.
pub fn decode(bytes: &[u8], limits: &Limits) -> Result<Image, DecodeError> {
    DecodeOptions { limits: *limits, ..DecodeOptions::default() }.decode(bytes)
}
