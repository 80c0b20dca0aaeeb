//! Bytes to pixels, under limits.

use pixmesh_codec::{Alpha, DecodeOptions, Limits};

/// Small, so that many pictures are tried in a second.
const LIMITS: Limits = Limits { max_pixels: 1 << 16, max_side: 4096 };

/// Decodes a picture in every way.
pub fn run(bytes: &[u8]) {
    for (alpha, lenient) in [
        (Alpha::Keep, false),
        (Alpha::Keep, true),
        (Alpha::Cut(Alpha::CUT), true),
        (Alpha::Drop, true),
        (Alpha::Over([1, 2, 3]), true),
    ] {
        let options = DecodeOptions { limits: LIMITS, alpha, lenient, ..DecodeOptions::default() };
        let probed = options.probe(bytes);
        if let Ok(image) = options.decode(bytes) {
            let shape = probed.expect("what is decoded has a header").shape();
            assert_eq!((shape.width, shape.height), (image.width(), image.height()));
            // An elevation model has an alpha only where a sample is missing.
            let is_like = image.component_count() == shape.component_count;
            assert!(is_like || (image.component_count(), shape.component_count) == (1, 2));
            assert_eq!(shape.precision, image.precision());
            let largest = image.components().iter().flatten().max().copied().unwrap_or(0);
            assert!(largest <= image.max_sample());
        }
    }
}
