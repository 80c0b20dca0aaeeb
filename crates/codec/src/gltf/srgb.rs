//! From samples, which are sRGB, to the linear light that glTF's vertex colours are.
//!
//! Literature: IEC 61966-2-1, "Default RGB colour space - sRGB", 1999.

/// The linear value, 0 to 1, of an sRGB value, 0 to 1.
pub(super) fn linear(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { power_2_4((value + 0.055) / 1.055) }
}

/// `x^2.4` for `x` in `0.09..=1`, as `x^2` times the fifth root of `x^2`.
///
/// Newton's method from 1 comes down to the root step by step, and stops when rounding lets it go
/// no lower. It takes only the four operations that IEEE 754 rounds correctly, whereas `powf` may
/// differ from one mathematical library to the next: so every machine writes the same bytes.
fn power_2_4(x: f64) -> f64 {
    let square = x * x;
    let mut root = 1.0_f64;
    loop {
        let fourth = (root * root) * (root * root);
        let next = (4.0 * root + square / fourth) / 5.0;
        if next >= root {
            return square * root;
        }
        root = next;
    }
}

/// A value of 0 to 1 as a normalised 16-bit integer, halves up.
pub(super) fn to_u16(value: f64) -> u16 {
    (value * f64::from(u16::MAX) + 0.5) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fifth_root_agrees_with_the_library_s_power() {
        for i in 0..=100_000 {
            let x = 0.09 + 0.91 * f64::from(i) / 100_000.0;
            let (ours, theirs) = (power_2_4(x), x.powf(2.4));
            assert!((ours - theirs).abs() <= 4e-16, "{x}: {ours} and {theirs}");
        }
    }

    #[test]
    fn the_middle_gray_of_8_bits_is_a_fifth_of_the_light() {
        let light = |sample: f64| to_u16(linear(sample / 255.0));
        assert_eq!([0.0, 10.0, 11.0, 128.0, 255.0].map(light), [0, 199, 219, 14146, 65535]);
    }
}
