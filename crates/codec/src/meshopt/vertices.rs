//! Vertices: byte by byte, the difference to the vertex before, in as few bits as sixteen of them
//! need.

/// First byte of the stream: its kind and version 0.
const HEADER: u8 = 0xA0;

/// The most bytes of a block's vertices.
const BLOCK_BYTES: usize = 8192;

/// The most vertices of a block.
const BLOCK_VERTICES: usize = 256;

/// Bytes that are coded with the same number of bits.
const GROUP: usize = 16;

/// The least bytes at the stream's end.
const TAIL_BYTES: usize = 32;

/// Compresses vertices of `stride` bytes each, a multiple of four.
pub(crate) fn compress_vertices(vertices: &[u8], stride: usize) -> Vec<u8> {
    let mut stream = vec![HEADER];
    let first = vertices.get(..stride).unwrap_or_default();
    let block_vertices = (BLOCK_BYTES / stride.max(1) / GROUP * GROUP).clamp(GROUP, BLOCK_VERTICES);
    let mut last = first.to_vec();
    for block in vertices.chunks(block_vertices * stride) {
        for (k, last) in last.iter_mut().enumerate() {
            let column = block.iter().skip(k).step_by(stride);
            let deltas: Vec<u8> = column
                .map(|&byte| {
                    let delta = zigzag(byte.wrapping_sub(*last));
                    *last = byte;
                    delta
                })
                .collect();
            compress_bytes(deltas, &mut stream);
        }
    }
    stream.resize(stream.len() + TAIL_BYTES.saturating_sub(stride), 0);
    stream.extend_from_slice(first);
    stream
}

/// Small differences of either sign as small numbers.
fn zigzag(delta: u8) -> u8 {
    (delta << 1) ^ ((delta as i8) >> 7) as u8
}

/// Appends bytes in groups: two bits for each group's number of bits, then the groups.
fn compress_bytes(mut bytes: Vec<u8>, stream: &mut Vec<u8>) {
    bytes.resize(bytes.len().next_multiple_of(GROUP), 0);
    let header = stream.len();
    let group_count = bytes.len() / GROUP;
    stream.resize(header + group_count.div_ceil(4), 0);
    for (index, group) in bytes.chunks_exact(GROUP).enumerate() {
        let (code, bits) = cheapest(group);
        stream[header + index / 4] |= code << (index % 4 * 2);
        compress_group(group, bits, stream);
    }
}

/// The code and the number of bits that make a group shortest.
fn cheapest(group: &[u8]) -> (u8, u32) {
    let cost = |bits: u32| match bits {
        0 if group.iter().all(|&byte| byte == 0) => 0,
        0 => usize::MAX,
        8 => GROUP,
        _ => GROUP * bits as usize / 8 + group.iter().filter(|&&b| b >= sentinel(bits)).count(),
    };
    let choices = [(0, 0), (1, 2), (2, 4), (3, 8)];
    choices.into_iter().min_by_key(|&(_, bits)| cost(bits)).unwrap_or((3, 8))
}

/// The largest value of `bits` bits, which means that a whole byte follows the group.
fn sentinel(bits: u32) -> u8 {
    ((1_u32 << bits) - 1) as u8
}

/// Appends a group, the first byte in the most significant bits.
fn compress_group(group: &[u8], bits: u32, stream: &mut Vec<u8>) {
    match bits {
        0 => {}
        8 => stream.extend_from_slice(group),
        _ => {
            let sentinel = sentinel(bits);
            for packed in group.chunks(8 / bits as usize) {
                let byte = packed.iter().fold(0, |byte, &b| byte << bits | b.min(sentinel));
                stream.push(byte);
            }
            stream.extend(group.iter().filter(|&&byte| byte >= sentinel));
        }
    }
}
