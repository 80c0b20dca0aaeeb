//! Premultiplied colours: how images and meshes hold colours where there is alpha.
//!
//! The last of two or of four components is alpha. The colours before it are premultiplied: each
//! is the colour times the alpha. So errors weigh what is seen, a colour hidden by alpha 0 neither
//! bleeds nor costs vertices, and interpolation stays linear. Files hold straight colours; they
//! give the same premultiplied ones again.
//!
//! Literature: Thomas Porter and Tom Duff, "Compositing digital images", 1984.

/// Whether the last of so many components is alpha.
///
/// ```
/// use pixmesh_meshing::alpha::has_alpha;
/// assert!(has_alpha(2) && has_alpha(4) && !has_alpha(3));
/// ```
#[must_use]
pub fn has_alpha(component_count: usize) -> bool {
    matches!(component_count, 2 | 4)
}

/// Multiplies colours by their alphas, where `largest` is opaque; rounded, halves up.
///
/// ```
/// let mut reds = [200, 200, 200];
/// pixmesh_meshing::alpha::premultiply(&mut reds, &[0, 51, 255], 255);
/// assert_eq!(reds, [0, 40, 200]);
/// ```
pub fn premultiply(colors: &mut [u16], alphas: &[u16], largest: u16) {
    for (color, &alpha) in colors.iter_mut().zip(alphas) {
        *color = premultiplied(*color, alpha, largest);
    }
}

/// The same for sample vectors of any number of components, one after the other.
pub fn premultiply_vectors(samples: &mut [u16], component_count: usize, largest: u16) {
    of_vectors(samples, component_count, |color, alpha| premultiplied(color, alpha, largest));
}

/// The straight colours of sample vectors, one after the other; 0 where alpha is 0.
/// [`premultiply_vectors`] gives the same premultiplied colours again.
///
/// ```
/// use pixmesh_meshing::alpha::{premultiply_vectors, straighten_vectors};
/// let mut gray_alpha = [40, 51, 7, 7, 0, 0];
/// straighten_vectors(&mut gray_alpha, 2, 255);
/// assert_eq!(gray_alpha, [200, 51, 255, 7, 0, 0]);
/// premultiply_vectors(&mut gray_alpha, 2, 255);
/// assert_eq!(gray_alpha, [40, 51, 7, 7, 0, 0]);
/// ```
pub fn straighten_vectors(samples: &mut [u16], component_count: usize, largest: u16) {
    of_vectors(samples, component_count, |color, alpha| straight(color, alpha, largest));
}

fn of_vectors(samples: &mut [u16], count: usize, change: impl Fn(u16, u16) -> u16) {
    if !has_alpha(count) {
        return;
    }
    for vector in samples.chunks_exact_mut(count) {
        if let [colors @ .., alpha] = vector {
            colors.iter_mut().for_each(|color| *color = change(*color, *alpha));
        }
    }
}

fn premultiplied(color: u16, alpha: u16, largest: u16) -> u16 {
    if alpha == largest {
        return color;
    }
    let [color, alpha, largest] = [color, alpha, largest].map(u64::from);
    ((2 * color * alpha + largest) / (2 * largest)) as u16
}

/// The straight colour of a premultiplied one, rounded, halves up; 0 where alpha is 0.
#[must_use]
pub fn straight(color: u16, alpha: u16, largest: u16) -> u16 {
    if alpha == largest || alpha == 0 {
        return if alpha == 0 { 0 } else { color };
    }
    let [color, alpha, opaque] = [color, alpha, largest].map(u64::from);
    (((2 * color * opaque + alpha) / (2 * alpha)) as u16).min(largest)
}

/// The straight colour nearest to `wanted` among those that [`premultiply`] to this one.
pub(crate) fn straight_near(wanted: u16, color: u16, alpha: u16, largest: u16) -> u16 {
    if alpha == 0 {
        return wanted;
    }
    let [color, alpha, opaque] = [color, alpha, largest].map(u64::from);
    let least = (opaque * (2 * color).saturating_sub(1)).div_ceil(2 * alpha);
    let most = (opaque * (2 * color + 1) - 1) / (2 * alpha);
    u64::from(wanted).max(least).min(most.min(opaque)) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn straight_colors_premultiply_to_the_same_again() {
        for largest in [1_u16, 15, 255] {
            for alpha in 0..=largest {
                for color in 0..=alpha {
                    let back = |color| premultiplied(color, alpha, largest);
                    assert_eq!(back(straight(color, alpha, largest)), color, "{alpha}");
                    let all: Vec<u16> = (0..=largest).filter(|&s| back(s) == color).collect();
                    for wanted in 0..=largest {
                        let nearest = all.iter().min_by_key(|s| s.abs_diff(wanted));
                        assert_eq!(Some(&straight_near(wanted, color, alpha, largest)), nearest);
                    }
                }
            }
        }
        for (color, alpha) in [(0, 1), (1, 1), (65_534, 65_534), (30_000, 65_535), (3, 40_000)] {
            let straight = straight(color, alpha, u16::MAX);
            assert_eq!(premultiplied(straight, alpha, u16::MAX), color);
        }
    }
}
