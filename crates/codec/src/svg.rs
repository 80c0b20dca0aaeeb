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
use fill::{Layer, put_fill};
use pixmesh_meshing::{Mesh, Point};
use std::io::{self, Write};

/// Writes a mesh as SVG.
///
/// # Errors
/// Whatever `out` fails with.
pub fn write_svg(mesh: &Mesh, shading: Shading, out: &mut impl Write) -> Result<(), EncodeError> {
    let colors = Colors::new(mesh.shape());
    let mut lines = Lines::new(out);
    put_root(mesh, &mut lines)?;
    if colors.has_alpha() {
        let box_ = "x=\"-.5\" y=\"-.5\" width=\"100%\" height=\"100%\"";
        lines.text("<mask id=\"alpha\" maskUnits=\"userSpaceOnUse\" ");
        lines.text(box_);
        lines.end(" style=\"mask-type:luminance\" color-interpolation=\"sRGB\">\n")?;
        put_layer(mesh, &colors, shading, Layer::Alpha, &mut lines)?;
        lines.end("</mask>\n<g mask=\"url(#alpha)\">\n")?;
    }
    match (shading, mesh.shape().component_count) {
        (Shading::Flat, _) => put_layer(mesh, &colors, shading, Layer::Color, &mut lines)?,
        (Shading::Gradient, 1 | 2) => {
            put_layer(mesh, &colors, shading, Layer::Gray, &mut lines)?;
        }
        (Shading::Gradient, _) => {
            lines.end("<g style=\"isolation:isolate\">\n")?;
            for layer in [Layer::Red, Layer::Green, Layer::Blue] {
                put_layer(mesh, &colors, shading, layer, &mut lines)?;
            }
            lines.end("</g>\n")?;
        }
    }
    if colors.has_alpha() {
        lines.end("</g>\n")?;
    }
    lines.end("</svg>\n")?;
    lines.flush()?;
    Ok(())
}

/// Appends the root's start: the size in pixels, and the pixels' middles at whole numbers.
fn put_root<W: Write>(mesh: &Mesh, lines: &mut Lines<'_, W>) -> io::Result<()> {
    let (width, height) = (mesh.shape().width, mesh.shape().height);
    lines.text("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"");
    lines.integer(width);
    lines.text("\" height=\"");
    lines.integer(height);
    lines.text("\" viewBox=\"-.5 -.5 ");
    lines.integer(width);
    lines.text(" ");
    lines.integer(height);
    lines.end("\">\n")
}

/// Appends all triangles of a layer, and draws them with strokes and without.
fn put_layer<W: Write>(
    mesh: &Mesh,
    colors: &Colors,
    shading: Shading,
    layer: Layer,
    lines: &mut Lines<'_, W>,
) -> io::Result<()> {
    let name = layer.name();
    lines.text("<g");
    lines.text(layer.style());
    lines.text("><defs><g id=\"");
    lines.text(name);
    lines.end("\">\n")?;
    let top = mesh.shape().height as i32 - 1;
    for (index, &face) in mesh.faces().iter().enumerate() {
        let corners = mesh.corners(face).map(|point| Point::new(point.x, top - point.y));
        let colours = face.map(|vertex| colors.rgba(mesh.vertex_samples(vertex as usize)));
        put_fill(layer, shading, index, corners, colours, lines);
        put_triangle(corners, lines);
        lines.end("\"/>\n")?;
    }
    lines.text("</g></defs><use href=\"#");
    lines.text(name);
    lines.text("\" stroke-width=\"2\" stroke-linejoin=\"round\"/><use href=\"#");
    lines.text(name);
    lines.end("\" stroke-width=\"0\"/></g>\n")
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
