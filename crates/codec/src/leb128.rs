//! Whole numbers of any size in groups of 7 bits, from the lowest: LEB128, as in DWARF and
//! WebAssembly.

/// Appends a number.
pub(crate) fn append(mut number: u64, bytes: &mut Vec<u8>) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

/// Reads a number of `groups` groups at most, and leaves what follows it; `None` when it ends early,
/// has more groups, or more than 64 bits.
pub(crate) fn take(stream: &mut &[u8], groups: usize) -> Option<u64> {
    let mut number = 0;
    for group in 0..groups {
        let (&byte, rest) = stream.split_first()?;
        *stream = rest;
        let bits = u64::from(byte & 0x7f);
        let shifted = bits << (7 * group);
        if shifted >> (7 * group) != bits {
            return None;
        }
        number |= shifted;
        if byte < 0x80 {
            return Some(number);
        }
    }
    None
}

/// A number with a sign as one without: 2d for d >= 0 and -2d - 1 for d < 0.
pub(crate) fn folded(number: i64) -> u64 {
    ((number << 1) ^ (number >> 63)) as u64
}

/// The number of which that was made.
pub(crate) fn unfolded(folded: u64) -> i64 {
    (folded >> 1) as i64 ^ -((folded & 1) as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_read_back_as_they_were(number in any::<i64>(), shift in 0u32..64) {
            let number = number >> shift;
            let mut bytes = Vec::new();
            append(folded(number), &mut bytes);
            bytes.push(7);
            let mut stream = &bytes[..];
            prop_assert_eq!(take(&mut stream, 10).map(unfolded), Some(number));
            prop_assert_eq!(stream, &[7]);
        }
    }

    #[test]
    fn what_is_no_number_is_refused() {
        assert_eq!(folded(-1), 1);
        assert_eq!(folded(1), 2);
        for bytes in [&[][..], &[0x80], &[0x80, 0x80, 0x80], &[0xff; 10]] {
            assert_eq!(take(&mut &bytes[..], 10), None, "{bytes:?}");
        }
        assert_eq!(take(&mut &[0x80, 0x80, 1][..], 2), None);
        assert_eq!(
            take(&mut &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 2][..], 10),
            None
        );
    }
}
