//! Renders the README's pictures, meshes one and draws its wireframe and its reconstruction:
//!
//! ```text
//! cargo run --release -p pixmesh-cli --example demonstration -- docs/images
//! ```
//!
//! Everything is computed with the four basic operations and square roots, so the files come out
//! the same on every machine.

mod elevation;
mod picture;
mod wireframe;

use pixmesh_codec::write_png;
use pixmesh_meshing::{Image, Method, Target, mesh_image, rasterize};
use std::error::Error;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args_os().nth(1).ok_or("name a folder to write into")?);
    let picture = picture::balloon_over_hills()?;
    let parameters = Method::Mgprfs.parameters(Target::Percent(2.0));
    let model = mesh_image(&picture, &parameters, &())?;
    save(&folder.join("picture.png"), &picture)?;
    save(&folder.join("elevation.png"), &elevation::mountains()?)?;
    save(&folder.join("wireframe.png"), &wireframe::draw(&picture, &model.mesh, 2)?)?;
    save(&folder.join("rebuilt.png"), &rasterize(&model.mesh, &())?)?;
    let (vertices, faces) = (model.mesh.points().len(), model.mesh.faces().len());
    let psnr_db = model.fidelity.psnr_db();
    writeln!(std::io::stdout(), "{vertices} vertices, {faces} faces, {psnr_db:.2} dB")?;
    Ok(())
}

/// Writes a picture as PNG.
fn save(path: &Path, image: &Image) -> Result<(), Box<dyn Error>> {
    let mut file = BufWriter::new(File::create(path)?);
    write_png(image, &mut file)?;
    Ok(file.flush()?)
}
