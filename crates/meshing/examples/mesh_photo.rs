//! Meshes a photograph and writes the picture rebuilt from the mesh, and its triangles as SVG.
//!
//! `cargo run --release --example mesh_photo -- photo.jpg rebuilt.png triangles.svg`

use image::DynamicImage;
use pixmesh_meshing::{Image, Method, OnThreads, Point, Target, mesh_image, rasterize};
use std::fmt::Write;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, rebuilt, triangles] = &arguments[..] else {
        return Err("usage: mesh_photo INPUT REBUILT.png TRIANGLES.svg".into());
    };
    let image = Image::try_from(&DynamicImage::ImageRgb8(image::open(input)?.into_rgb8()))?;
    let parameters = Method::Mgprfs.parameters(Target::Percent(2.0));
    let control = OnThreads((), std::thread::available_parallelism()?);
    let made = mesh_image(&image, &parameters, &control)?;
    DynamicImage::from(&rasterize(&made.mesh, &control)?).save(rebuilt)?;

    let (width, height) = (image.width(), image.height());
    let mut svg =
        format!("<svg xmlns='http://www.w3.org/2000/svg' width='{width}' height='{height}'>");
    for &face in made.mesh.faces() {
        // SVG counts rows from the top.
        let [a, b, c] = made.mesh.corners(face).map(|Point { x, y }| (x, height as i32 - 1 - y));
        let (from, to) = (format!("{},{}", a.0, a.1), format!("{},{} {},{}", b.0, b.1, c.0, c.1));
        writeln!(svg, "<path fill='none' stroke='black' stroke-width='.3' d='M{from} {to}z'/>")?;
    }
    Ok(std::fs::write(triangles, svg + "</svg>\n")?)
}
