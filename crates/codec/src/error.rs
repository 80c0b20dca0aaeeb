//! Errors of decoding and of writing.

use crate::format::PictureFormat;
use pixmesh_meshing::{Cancelled, ImageError};
use std::io;
use thiserror::Error;

/// Why a picture is not decoded.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum DecodeError {
    /// There are no bytes at all.
    #[error("the file is empty")]
    Empty,
    /// The first bytes are those of no format that is read here.
    #[error("the file is neither PNG, JPEG, PNM, WebP, GIF, TIFF nor BMP")]
    UnknownFormat,
    /// The first bytes are those of a format that other programs read.
    #[error("{name} is not read: convert the file first, for example with `{conversion}`")]
    Unread {
        /// Name of the format.
        name: &'static str,
        /// The command that converts such a file.
        conversion: &'static str,
    },
    /// The header claims more pixels than are allowed.
    #[error(
        "an image of {width}x{height} has {pixels} pixels, more than the limit of {limit}: scale \
         it down first, for example with `magick photo.png -resize '{limit}@>' smaller.png`"
    )]
    TooManyPixels {
        /// Columns claimed.
        width: u64,
        /// Rows claimed.
        height: u64,
        /// Their product; `u64::MAX` when it is that or more.
        pixels: u64,
        /// The most pixels allowed.
        limit: u64,
    },
    /// The header claims more columns or rows than are allowed.
    #[error(
        "an image of {width}x{height} has a side over the limit of {limit} pixels: scale it down \
         first, for example with `magick photo.png -resize '{limit}x{limit}>' smaller.png`"
    )]
    SideTooLong {
        /// Columns claimed.
        width: u64,
        /// Rows claimed.
        height: u64,
        /// The most columns or rows allowed.
        limit: usize,
    },
    /// What the file carries beside its pixels would take too much memory.
    #[error("the metadata of the {format} file takes more than {limit} bytes")]
    MetadataTooLarge {
        /// The file's format.
        format: PictureFormat,
        /// The most bytes allowed.
        limit: usize,
    },
    /// Decoding would hold more bytes than [`DecodeOptions::max_bytes`](crate::DecodeOptions).
    #[error("decoding takes {needed} bytes of memory, more than the {allowed} allowed")]
    TooMuchMemory {
        /// Bytes that decoding needs.
        needed: u64,
        /// The most bytes allowed.
        allowed: u64,
    },
    /// The bytes break the rules of their format, or end early.
    #[error("the {format} file cannot be decoded: {reason}")]
    Malformed {
        /// The file's format.
        format: PictureFormat,
        /// What is wrong, and where.
        reason: String,
    },
    /// The format allows it, but it is not read here.
    #[error("the {format} file cannot be decoded: {reason}")]
    Unsupported {
        /// The file's format.
        format: PictureFormat,
        /// What is not supported.
        reason: String,
    },
    /// The picture cannot be meshed.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The picture is no longer wanted.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Why a picture or mesh was not written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// The format has no way to store that many components.
    #[error("{format} stores 1 to {maximum} components, not {actual}")]
    ComponentCount {
        /// Name of the format.
        format: &'static str,
        /// Components of the image.
        actual: usize,
        /// The most that the format stores.
        maximum: usize,
    },
    /// The format holds meshes of the preferred-directions Delaunay triangulation only.
    #[error("{format} holds no faces, and those of this mesh are not what its points determine")]
    Connectivity {
        /// Name of the format.
        format: &'static str,
    },
    /// The format keeps an order of vertices, of meshes whose points alone say everything else.
    #[error(
        "{format} keeps no order of the vertices of a mesh of connectivity free, values fitted or reconstruction flat"
    )]
    NotOfPointsAlone {
        /// Name of the format.
        format: &'static str,
    },
    /// The format holds meshes of elevation models in degrees only.
    #[error(
        "terrain is for elevation models in degrees of EPSG:4326 whose rows go to the south and columns \
         to the east: reproject yours first, for example with `gdalwarp -t_srs EPSG:4326 model.tif \
         degrees.tif`"
    )]
    NotInDegrees,
    /// A relief is to follow a component that the image does not have.
    #[error("the relief is to follow component {component} (counted from 0) of {count}")]
    NoSuchComponent {
        /// The component asked for, counted from 0.
        component: usize,
        /// Components of the image.
        count: usize,
    },
    /// The file would be longer than its format can say.
    #[error("the {format} file would take {bytes} bytes, more than the {limit} that it can have")]
    TooLarge {
        /// Name of the format.
        format: &'static str,
        /// Bytes needed.
        bytes: u64,
        /// The most bytes of such a file.
        limit: u64,
    },
    /// The file is no longer wanted.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// Writing failed.
    #[error(transparent)]
    Io(#[from] io::Error),
}
