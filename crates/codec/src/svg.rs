//! SVG, out: every face a triangle, flat or with a gradient, without seams.
//!
//! A user unit is a pixel, `y` down, and a lattice point lies in the middle of its pixel. Renderers
//! smooth each triangle's edges by itself, so that the background would shine through between two
//! that touch. Hence all triangles are drawn twice: first with a stroke of their own colour two pixels
//! wide, which closes the seams and covers the half pixel around the mesh, then without it, so that
//! every triangle has its exact shape on top.
//!
//! A gradient of three corners' colours is linear in each component, but in a direction of its own.
//! So red, green and blue are three layers, each of linear gradients from black, that screen blending
//! adds up exactly; gray needs one. Alpha is a mask of the same triangles, drawn in the same way, so
//! that strokes are not seen through each other.
//!
//! Literature: W3C, "Scalable Vector Graphics (SVG) 2", 2018, and "Compositing and Blending Level 1".

mod fill;

use crate::choices::Shading;
use crate::color::Colors;
use crate::error::EncodeError;
use crate::lines::Lines;
use crate::shown::Shown;
use fill::{Layer, put_fill};
use pixmesh_meshing::alpha::has_alpha;
use pixmesh_meshing::{Point, Shape};
use std::io::{self, Write};

/// Writes a mesh as SVG: the size in pixels, and the pixels' middles at whole numbers.
pub(crate) fn write_svg(
    mesh: &Shown<'_>,
    shading: Shading,
    out: &mut impl Write,
) -> Result<(), EncodeError> {
    let Shape { width, height, component_count, .. } = mesh.shape();
    let colors = Colors::new(mesh.shape());
    // A face with a colour needs no gradient.
    let shading = if mesh.face_samples().is_some() { Shading::Flat } else { shading };
    let mut lines = Lines::new(out);
    writeln!(
        lines,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"-.5 -.5 {width} {height}\">"
    )?;
    if has_alpha(component_count) {
        writeln!(
            lines,
            "<mask id=\"alpha\" maskUnits=\"userSpaceOnUse\" x=\"-.5\" y=\"-.5\" width=\"100%\" \
             height=\"100%\" style=\"mask-type:luminance\" color-interpolation=\"sRGB\">"
        )?;
        put_layer(mesh, &colors, shading, Layer::ALPHA, &mut lines)?;
        writeln!(lines, "</mask>\n<g mask=\"url(#alpha)\">")?;
    }
    match (shading, component_count) {
        (Shading::Flat, _) => put_layer(mesh, &colors, shading, Layer::COLOR, &mut lines)?,
        (Shading::Gradient, 1 | 2) => {
            put_layer(mesh, &colors, shading, Layer::GRAY, &mut lines)?;
        }
        (Shading::Gradient, _) => {
            writeln!(lines, "<g style=\"isolation:isolate\">")?;
            for layer in [Layer::RED, Layer::GREEN, Layer::BLUE] {
                put_layer(mesh, &colors, shading, layer, &mut lines)?;
            }
            writeln!(lines, "</g>")?;
        }
    }
    if has_alpha(component_count) {
        writeln!(lines, "</g>")?;
    }
    writeln!(lines, "</svg>")?;
    lines.flush()?;
    Ok(())
}

/// Appends all triangles of a layer, and draws them with strokes and without.
fn put_layer<W: Write>(
    mesh: &Shown<'_>,
    colors: &Colors,
    shading: Shading,
    layer: Layer,
    lines: &mut Lines<'_, W>,
) -> io::Result<()> {
    let Layer { name, style, .. } = layer;
    writeln!(lines, "<g{style}><defs><g id=\"{name}\">")?;
    let top = mesh.shape().height as i32 - 1;
    for (index, &face) in mesh.faces().iter().enumerate() {
        let corners = mesh.corners(face).map(|point| Point::new(point.x, top - point.y));
        let colours = match mesh.face_samples() {
            Some(samples) => {
                let count = mesh.shape().component_count;
                [colors.rgba(&samples[index * count..][..count]); 3]
            }
            None => face.map(|vertex| colors.rgba(mesh.vertex_samples(vertex as usize))),
        };
        put_fill(layer, shading, index, corners, colours, lines)?;
        put_triangle(corners, lines);
        lines.end("\"/>\n")?;
    }
    writeln!(
        lines,
        "</g></defs><use href=\"#{name}\" stroke-width=\"2\" stroke-linejoin=\"round\"/>\
         <use href=\"#{name}\" stroke-width=\"0\"/></g>"
    )
}

/// Appends the path's data: the first corner, then the steps to the others.
fn put_triangle<W: Write>([a, b, c]: [Point; 3], lines: &mut Lines<'_, W>) {
    lines.text(" d=\"M");
    for (command, x, y) in
        [("", a.x, a.y), ("l", b.x - a.x, b.y - a.y), (" ", c.x - b.x, c.y - b.y)]
    {
        lines.text(command);
        lines.integer(x);
        if y >= 0 {
            lines.text(" ");
        }
        lines.integer(y);
    }
    lines.text("z");
}
