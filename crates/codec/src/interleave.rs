//! Rows of an image as files store them: the samples of a pixel side by side.

use pixmesh_meshing::Image;

/// Replaces `bytes` with the first `component_count` samples of each pixel of row `y`, converted.
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
    for c in 0..component_count {
        let places = bytes.chunks_exact_mut(bytes_per_sample).skip(c).step_by(component_count);
        for (place, &sample) in places.zip(image.row(c, y)) {
            match place {
                [high, low] => [*high, *low] = convert(sample).to_be_bytes(),
                [low] => *low = convert(sample) as u8,
                _ => {}
            }
        }
    }
}
