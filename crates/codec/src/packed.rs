//! Samples of 1, 2, 4, 8 or 16 bits, packed into bytes.

/// Replaces `samples` with all that `bytes` hold at `depth` bits each, most significant first.
pub(crate) fn unpack(bytes: &[u8], depth: u8, samples: &mut Vec<u16>) {
    samples.clear();
    match depth {
        16 => samples.extend(bytes.as_chunks().0.iter().map(|&pair| u16::from_be_bytes(pair))),
        8 => samples.extend(bytes.iter().map(|&byte| u16::from(byte))),
        _ => {
            let mask = u16::MAX >> (16 - depth);
            for &byte in bytes {
                let shifts = (0..8).step_by(usize::from(depth)).rev();
                samples.extend(shifts.map(|shift| (u16::from(byte) >> shift) & mask));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_unpacked_from_the_most_significant_bit() {
        let mut samples = Vec::new();
        unpack(&[0b1010_0001], 1, &mut samples);
        assert_eq!(samples, [1, 0, 1, 0, 0, 0, 0, 1]);
        unpack(&[0b1110_0100], 2, &mut samples);
        assert_eq!(samples, [3, 2, 1, 0]);
        unpack(&[0xA5], 4, &mut samples);
        assert_eq!(samples, [10, 5]);
        unpack(&[1, 2, 3, 4, 5], 16, &mut samples);
        assert_eq!(samples, [0x0102, 0x0304]);
    }
}
