//! The colours of sample vectors as sRGB of 8 bits, for formats that hold no more.

use pixmesh_meshing::Shape;

/// Converts the samples of an image: one component is gray, two are gray and alpha, three RGB, four
/// RGBA; of five and more the first three are RGB.
pub(crate) struct Colors {
    /// What each sample becomes, rounded to the nearest, halves up.
    table: Vec<u8>,
    has_alpha: bool,
}

impl Colors {
    pub(crate) fn new(shape: Shape) -> Self {
        let largest = u32::from(u16::MAX >> (16 - shape.precision));
        let scale = |sample: u32| ((510 * sample + largest) / (2 * largest)) as u8;
        let table = (0..=largest).map(scale).collect();
        Self { table, has_alpha: matches!(shape.component_count, 2 | 4) }
    }

    /// Whether the last component is alpha.
    pub(crate) fn has_alpha(&self) -> bool {
        self.has_alpha
    }

    /// Red, green, blue and alpha.
    pub(crate) fn rgba(&self, samples: &[u16]) -> [u8; 4] {
        let scale = |sample: u16| self.table.get(usize::from(sample)).copied().unwrap_or(255);
        match *samples {
            [gray] => [scale(gray), scale(gray), scale(gray), 255],
            [gray, alpha] => [scale(gray), scale(gray), scale(gray), scale(alpha)],
            [red, green, blue, alpha] => [scale(red), scale(green), scale(blue), scale(alpha)],
            [red, green, blue, ..] => [scale(red), scale(green), scale(blue), 255],
            [] => [0, 0, 0, 255],
        }
    }
}
