//! The paint of a triangle: a colour, or a linear gradient of one component.

use crate::choices::Shading;
use crate::lines::Lines;
use pixmesh_meshing::Point;
use std::io::Write;

/// What of the colours a layer shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layer {
    /// All of them.
    Color,
    /// The first component, as gray.
    Gray,
    Red,
    Green,
    Blue,
    /// Alpha, as gray.
    Alpha,
}

impl Layer {
    /// The layer's name in the document.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Color | Self::Gray => "t",
            Self::Red => "r",
            Self::Green => "g",
            Self::Blue => "b",
            Self::Alpha => "a",
        }
    }

    /// How the layer is drawn over the others.
    pub(super) fn style(self) -> &'static str {
        match self {
            Self::Red | Self::Green | Self::Blue => " style=\"mix-blend-mode:screen\"",
            _ => "",
        }
    }

    /// The component of a colour that the layer shows.
    fn component(self, [red, green, blue, alpha]: [u8; 4]) -> u8 {
        match self {
            Self::Color | Self::Gray | Self::Red => red,
            Self::Green => green,
            Self::Blue => blue,
            Self::Alpha => alpha,
        }
    }

    /// The colour in which the layer shows a value.
    fn shown(self, value: u8) -> [u8; 3] {
        match self {
            Self::Red => [value, 0, 0],
            Self::Green => [0, value, 0],
            Self::Blue => [0, 0, value],
            Self::Color | Self::Gray | Self::Alpha => [value; 3],
        }
    }
}

/// Appends a path's start up to its fill and stroke, before it a gradient where one is needed.
pub(super) fn put_fill<W: Write>(
    layer: Layer,
    shading: Shading,
    index: usize,
    corners: [Point; 3],
    colours: [[u8; 4]; 3],
    lines: &mut Lines<'_, W>,
) {
    let values = colours.map(|colour| layer.component(colour));
    if layer == Layer::Color {
        put_flat(mean_colour(colours), lines);
    } else if shading == Shading::Flat {
        let sum: u32 = values.iter().map(|&value| u32::from(value)).sum();
        put_flat(layer.shown(mean(sum)), lines);
    } else if values == [values[0]; 3] {
        put_flat(layer.shown(values[0]), lines);
    } else {
        let name = layer.name();
        put_gradient(layer, index, corners, values, lines);
        for paint in ["<path fill=\"url(#", ")\" stroke=\"url(#"] {
            lines.text(paint);
            lines.text(name);
            lines.integer(index);
        }
        lines.text(")\"");
    }
}

/// A third of a sum, rounded to the nearest.
fn mean(sum: u32) -> u8 {
    ((2 * sum + 3) / 6) as u8
}

/// The mean of three colours.
fn mean_colour(colours: [[u8; 4]; 3]) -> [u8; 3] {
    let [[r0, g0, b0, _], [r1, g1, b1, _], [r2, g2, b2, _]] = colours;
    [[r0, r1, r2], [g0, g1, g2], [b0, b1, b2]].map(|part| mean(part.map(u32::from).iter().sum()))
}

/// Appends a path's start with one colour.
fn put_flat<W: Write>(colour: [u8; 3], lines: &mut Lines<'_, W>) {
    lines.text("<path fill=\"");
    put_colour(colour, lines);
    lines.text("\" stroke=\"");
    put_colour(colour, lines);
    lines.text("\"");
}

/// Appends a colour in the fewest digits.
fn put_colour<W: Write>(colour: [u8; 3], lines: &mut Lines<'_, W>) {
    const DIGITS: [&str; 16] =
        ["0", "1", "2", "3", "4", "5", "6", "7", "8", "9", "a", "b", "c", "d", "e", "f"];
    let digit = |value: u8| DIGITS.get(usize::from(value)).copied().unwrap_or("0");
    lines.text("#");
    let short = colour.iter().all(|part| part >> 4 == part & 15);
    for part in colour {
        if !short {
            lines.text(digit(part >> 4));
        }
        lines.text(digit(part & 15));
    }
}

/// Appends the gradient that is linear over the triangle and has the corners' values there.
///
/// The value is `v + gx (x - ax) + gy (y - ay)`, so that it changes along `(gx, gy)` alone: from the
/// corner with the least value, the largest is reached after `(largest - least) / (gx^2 + gy^2)` of
/// that vector.
fn put_gradient<W: Write>(
    layer: Layer,
    index: usize,
    [a, b, c]: [Point; 3],
    values: [u8; 3],
    lines: &mut Lines<'_, W>,
) {
    let [va, vb, vc] = values.map(f64::from);
    let difference = |from: Point, to: Point| [f64::from(to.x - from.x), f64::from(to.y - from.y)];
    let ([bx, by], [cx, cy]) = (difference(a, b), difference(a, c));
    let area = bx * cy - cx * by;
    let (db, dc) = (vb - va, vc - va);
    let (gx, gy) = ((db * cy - dc * by) / area, (dc * bx - db * cx) / area);
    let corners = [(values[0], a), (values[1], b), (values[2], c)];
    let (least, start) = corners.into_iter().min_by_key(|&(value, _)| value).unwrap_or(corners[0]);
    let largest = values.into_iter().max().unwrap_or(least);
    let reach = f64::from(largest - least) / (gx * gx + gy * gy);
    let (x1, y1) = (f64::from(start.x), f64::from(start.y));
    lines.text("<linearGradient id=\"");
    lines.text(layer.name());
    lines.integer(index);
    lines.text("\" gradientUnits=\"userSpaceOnUse\"");
    let ends = [("x1", x1), ("y1", y1), ("x2", x1 + gx * reach), ("y2", y1 + gy * reach)];
    for (name, place) in ends {
        lines.text(" ");
        lines.text(name);
        lines.text("=\"");
        lines.decimal((place * 1e5).round() / 1e5);
        lines.text("\"");
    }
    lines.text("><stop stop-color=\"");
    put_colour(layer.shown(least), lines);
    lines.text("\"/><stop offset=\"1\" stop-color=\"");
    put_colour(layer.shown(largest), lines);
    lines.text("\"/></linearGradient>");
}
