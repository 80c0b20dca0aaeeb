//! JPEG, in.
//!
//! Literature: ITU-T T.81, "Digital compression and coding of continuous-tone still images", 1992;
//! ITU-T T.871, "JPEG File Interchange Format", 2011.
//!
//! The decoder fills what is missing with gray and does not report it, not even in its strict mode: a
//! file of 4 KB may claim 12000x12000 pixels and pass. Hence the file is first read here, segment by
//! segment: it must have an end-of-image marker, each component must have a scan, and the scans must
//! be long enough for the blocks of the picture. The decoder gets the file without its metadata, of
//! which only the orientation is used.
//!
//! The decoder is `zune-jpeg`, which `image` uses, too, but there it reads the whole file first and
//! cannot be stopped.
//!
//! Baseline, extended sequential and progressive Huffman coding of 8 bits are read; gray stays gray,
//! YCbCr, RGB, CMYK and YCCK become RGB. Not read, and refused as such: lossless, hierarchical and
//! arithmetic coding, 12 bits, and the few rare samplings that the decoder would get wrong.

mod frame;
mod read;
mod segments;

pub(crate) use read::{open, plain_copy};
