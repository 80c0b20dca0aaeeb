//! The two entry points: a picture's header, and the whole picture.

use crate::alpha::Alpha;
use crate::canvas::Canvas;
use crate::error::DecodeError;
use crate::format::PictureFormat;
use crate::guard::guarded;
use crate::header::Header;
use crate::limits::Limits;
use crate::terrain::{Nodata, Terrain};
use crate::wanted::{Wanted, always};
use crate::{bmp, gif, jpeg, png, pnm, tiff, webp};
use pixmesh_meshing::Image;
use pixmesh_meshing::alpha::has_alpha;
use pixmesh_terrain::Heights;

/// The most bytes that a decoder may allocate for a file's metadata.
pub(crate) const METADATA_BYTES: usize = 8 << 20;

/// A picture whose header has been read and is within the limits.
pub(crate) struct Opened<'a> {
    header: Header,
    decode: Box<dyn FnOnce() -> Result<Canvas, DecodeError> + 'a>,
}

impl<'a> Opened<'a> {
    /// A picture with this header, alpha kept, and the function that decodes its pixels.
    pub(crate) fn new(
        header: Header,
        decode: impl FnOnce() -> Result<Canvas, DecodeError> + 'a,
    ) -> Self {
        Self { header, decode: Box::new(decode) }
    }
}

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
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DecodeOptions {
    /// The most pixels, columns and rows.
    pub limits: Limits,
    /// What becomes of alpha.
    pub alpha: Alpha,
    /// Whether a JPEG, PNG, GIF or PNM that ends early is decoded up to its end: missing pixels are
    /// black or, in a JPEG, what the decoder fills in, usually gray. Otherwise such files are refused.
    pub lenient: bool,
    /// The height of a step of an elevation model's samples, over 0; `None` for that of whole numbers,
    /// an eighth of [`bound`](Self::bound), or the smallest that 16 bits allow.
    pub step: Option<f64>,
    /// The largest error of heights that is wanted of the mesh.
    pub bound: Option<f64>,
    /// What becomes of samples of an elevation model that are missing.
    pub nodata: Nodata,
    /// The most bytes that decoding may allocate, copies of the file itself not counted; `None` for no
    /// limit but those on the size. See [`Header::decode_bytes`].
    pub max_bytes: Option<u64>,
}

impl DecodeOptions {
    /// Reads a picture's header and checks it against the limits, see [`probe`].
    ///
    /// # Errors
    /// As [`probe`].
    pub fn probe(&self, bytes: &[u8]) -> Result<Header, DecodeError> {
        let format = PictureFormat::sniff(bytes)?;
        let header = |wanted: &Wanted<'_>| Ok(self.open(format, bytes, wanted)?.header);
        guarded(format, &always, header).map(|header| self.alpha.of_header(header))
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
    /// Decoders poll `wanted` when they read. Three decoders work for long without reading: the last
    /// part of a progressive JPEG of 40 megapixels takes up to 0.23 s, of a lossless WebP 0.33 s,
    /// and a lossy WebP 0.6 s.
    ///
    /// # Errors
    /// [`DecodeError::Cancelled`] when it is no longer wanted, else as [`decode`].
    pub fn decode_while(&self, bytes: &[u8], wanted: &Wanted<'_>) -> Result<Image, DecodeError> {
        self.decode_terrain_while(bytes, wanted).map(|(image, _)| image)
    }

    /// The same, with what the samples mean where the file is an elevation model.
    ///
    /// # Errors
    /// As [`Self::decode_while`].
    pub fn decode_terrain_while(
        &self,
        bytes: &[u8],
        wanted: &Wanted<'_>,
    ) -> Result<(Image, Option<Terrain>), DecodeError> {
        wanted()?;
        let format = PictureFormat::sniff(bytes)?;
        let canvas = guarded(format, wanted, |wanted| {
            let Opened { header, decode } = self.open(format, bytes, wanted)?;
            self.check_memory(&header)?;
            decode()
        });
        let canvas = canvas?;
        let terrain = canvas.terrain;
        let image = canvas.into_image(self.alpha, wanted)?;
        // Holes need the alpha that says where they are.
        let has_alpha = has_alpha(image.component_count());
        let of_image =
            |terrain: Terrain| Terrain { has_holes: terrain.has_holes && has_alpha, ..terrain };
        Ok((image, terrain.map(of_image)))
    }

    /// The heights of an elevation model in the units of the file, with what it says of them; `None`
    /// where the file is a picture.
    ///
    /// # Errors
    /// As [`Self::decode_while`].
    pub fn heights_while(
        &self,
        bytes: &[u8],
        wanted: &Wanted<'_>,
    ) -> Result<Option<Heights>, DecodeError> {
        wanted()?;
        let format = PictureFormat::sniff(bytes)?;
        if format != PictureFormat::Tiff {
            return Ok(None);
        }
        guarded(format, wanted, |wanted| tiff::heights(bytes, self, wanted))
    }

    /// Checks that decoding a picture of this stored header takes no more memory than it may.
    pub(crate) fn check_memory(&self, stored: &Header) -> Result<(), DecodeError> {
        let needed = self.needed_bytes(stored);
        match self.max_bytes.filter(|&allowed| needed > allowed) {
            Some(allowed) => Err(DecodeError::TooMuchMemory { needed, allowed }),
            None => Ok(()),
        }
    }

    fn open<'a>(
        &'a self,
        format: PictureFormat,
        bytes: &'a [u8],
        wanted: &'a Wanted<'a>,
    ) -> Result<Opened<'a>, DecodeError> {
        match format {
            PictureFormat::Png => png::open(bytes, self, wanted),
            PictureFormat::Jpeg => jpeg::open(bytes, self, wanted),
            PictureFormat::Pnm => pnm::open(bytes, self, wanted),
            PictureFormat::WebP => webp::open(bytes, self, wanted),
            PictureFormat::Gif => gif::open(bytes, self, wanted),
            PictureFormat::Tiff => tiff::open(bytes, self, wanted),
            PictureFormat::Bmp => bmp::open(bytes, self, wanted),
        }
    }

    /// The most bytes that decoding a picture of this stored header allocates: what the format's
    /// decoder needs, the stored planes, and the planes of a gray picture composed over a colour.
    fn needed_bytes(&self, stored: &Header) -> u64 {
        let (count, decoded) = (stored.component_count, self.alpha.of_header(*stored));
        let planes =
            if decoded.component_count > count { 1 + decoded.component_count } else { count };
        stored.decoder_bytes() + stored.image_bytes(planes)
    }
}

/// Reads a picture's header and checks it against the limits, alpha kept.
///
/// Needs no pixel buffer, and at most 8 MiB whatever the bytes; for the tags of a TIFF 40 MiB. The
/// pixels are not looked at: a header that passes may still be followed by broken ones.
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
/// which is checked first, and by [`DecodeOptions::max_bytes`], see [`Header::decode_bytes`]. Bytes
/// after the picture's end are ignored. Of an animation the first frame is decoded (of an animated
/// PNG its default image), of a stream of portable anymaps or a TIFF of several pages the first.
///
/// # Errors
/// As [`probe`], and when the pixels are broken or end early.
pub fn decode(bytes: &[u8], limits: &Limits) -> Result<Image, DecodeError> {
    DecodeOptions { limits: *limits, ..DecodeOptions::default() }.decode(bytes)
}
