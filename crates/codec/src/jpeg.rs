//! JPEG, in.
//!
//! Literature: ITU-T T.81, "Digital compression and coding of continuous-tone still images", 1992;
//! ITU-T T.871, "JPEG File Interchange Format", 2011.
//!
//! The decoder fills what is missing with gray and does not report it, in its strict mode neither: a
//! file of 4 KB may claim 12000x12000 pixels and pass. Hence the file is first walked here, segment
//! by segment: it must run up to its end-of-image marker, each component must have a scan, and the
//! scans must be long enough to hold the blocks that the size asks for. What the decoder then gets is that walk's result, without the metadata: the
//! orientation is all that is taken from it.
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
