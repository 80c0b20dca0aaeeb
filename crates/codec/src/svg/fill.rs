//! The paint of a triangle: a colour, or a linear gradient of one component.

use crate::choices::Shading;
use crate::lines::Lines;
use crate::rounding::rounded_quotient;
use pixmesh_meshing::Point;
use std::io::{self, Write};

/// What of the colours a layer of triangles shows, and how it is drawn.
#[derive(Clone, Copy)]
pub(super) struct Layer {
    /// The layer's name in the document.
    pub(super) name: &'static str,
    /// An attribute that says how the layer is drawn over the others.
    pub(super) style: &'static str,
    /// Which of red, green, blue and alpha the layer shows; `None` for the colour itself.
    component: Option<usize>,
    /// Red, green and blue of the least value over 0 of the component.
    hue: [u8; 3],
}

const SCREEN: &str = " style=\"mix-blend-mode:screen\"";

impl Layer {
    pub(super) const COLOR: Self = Self { name: "t", style: "", component: None, hue: [1; 3] };
    /// The first component, as gray.
    pub(super) const GRAY: Self = Self { component: Some(0), ..Self::COLOR };
    pub(super) const RED: Self =
        Self { name: "r", style: SCREEN, component: Some(0), hue: [1, 0, 0] };
    pub(super) const GREEN: Self =
        Self { name: "g", style: SCREEN, component: Some(1), hue: [0, 1, 0] };
    pub(super) const BLUE: Self =
        Self { name: "b", style: SCREEN, component: Some(2), hue: [0, 0, 1] };
    /// Alpha, as gray.
    pub(super) const ALPHA: Self = Self { name: "a", component: Some(3), ..Self::COLOR };

    /// The colour in which the layer shows a value of its component.
    fn shown(self, value: u8) -> [u8; 3] {
        self.hue.map(|part| part * value)
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
) -> io::Result<()> {
    let mean = |component: usize| {
        let sum = colours.iter().map(|colour| u64::from(colour[component])).sum();
        rounded_quotient(sum, 3) as u8
    };
    let Some(component) = layer.component else {
        put_flat([0, 1, 2].map(mean), lines);
        return Ok(());
    };
    let values = colours.map(|colour| colour[component]);
    if shading == Shading::Flat || values == [values[0]; 3] {
        put_flat(layer.shown(mean(component)), lines);
        return Ok(());
    }
    put_gradient(layer, index, corners, values, lines)?;
    let name = layer.name;
    write!(lines, "<path fill=\"url(#{name}{index})\" stroke=\"url(#{name}{index})\"")
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
    let digit = |value: u8| usize::from(value)..usize::from(value) + 1;
    let short = colour.iter().all(|part| part >> 4 == part & 15);
    lines.text("#");
    for part in colour {
        if !short {
            lines.text(&"0123456789abcdef"[digit(part >> 4)]);
        }
        lines.text(&"0123456789abcdef"[digit(part & 15)]);
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
) -> io::Result<()> {
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
    let name = layer.name;
    write!(lines, "<linearGradient id=\"{name}{index}\" gradientUnits=\"userSpaceOnUse\" x1=\"")?;
    let ends = [x1, y1, x1 + gx * reach, y1 + gy * reach];
    for (place, next) in ends.into_iter().zip(["\" y1=\"", "\" x2=\"", "\" y2=\"", ""]) {
        lines.decimal((place * 1e5).round() / 1e5);
        lines.text(next);
    }
    lines.text("\"><stop stop-color=\"");
    put_colour(layer.shown(least), lines);
    lines.text("\"/><stop offset=\"1\" stop-color=\"");
    put_colour(layer.shown(largest), lines);
    lines.text("\"/></linearGradient>");
    Ok(())
}
