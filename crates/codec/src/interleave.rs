//! Rows of an image as files store them: the samples of a pixel side by side.

use pixmesh_meshing::Image;
use pixmesh_meshing::alpha::{has_alpha, straight};

/// Replaces `bytes` with the first `component_count` samples of each pixel of row `y`, converted.
/// Where the last component is alpha, colours become straight.
///
/// Samples take `bytes_per_sample` bytes: 1, or 2 with the more significant first.
pub(crate) fn interleave_row(
    image: &Image,
    y: usize,
    component_count: usize,
    bytes_per_sample: usize,
    convert: impl Fn(u16) -> u16,
    bytes: &mut Vec<u8>,
) {
    bytes.resize(image.width() * component_count * bytes_per_sample, 0);
    let (last, largest) = (image.component_count() - 1, image.max_sample());
    for c in 0..component_count {
        let put = |place: &mut [u8], sample| match place {
            [high, low] => [*high, *low] = convert(sample).to_be_bytes(),
            [low] => *low = convert(sample) as u8,
            _ => {}
        };
        let places = bytes.chunks_exact_mut(bytes_per_sample).skip(c).step_by(component_count);
        let row = places.zip(image.row(c, y));
        if has_alpha(last + 1) && c < last {
            let row = row.zip(image.row(last, y));
            row.for_each(|((place, &sample), &alpha)| put(place, straight(sample, alpha, largest)));
        } else {
            row.for_each(|(place, &sample)| put(place, sample));
        }
    }
}
