//! Whether the kernels and formats do on this machine what they do on every other.

use super::Finding;
use super::delaunay;
use pixmesh_codec::{
    Encodable, EncodeOptions, Format, Limits, decode, encode, read_model, write_model, write_png,
};
use pixmesh_meshing::{Approximation, Fidelity, Image, Method, Target, mesh_image, rasterize};
use sha2::{Digest, Sha256};
use std::fmt::Write;

const WIDTH: usize = 192;
const HEIGHT: usize = 128;
/// Percent of the pixels.
const DENSITY: f64 = 3.0;
/// The SHA-256 of MED's mesh as MODEL: the same on every machine, as long as the method stays.
const DIGEST: &str = "b6af9a38f95bfb5c3e5f632679d123340a1d0913473115ba7e63dff1dfe4c20e";

/// Meshes the picture by several methods, and checks each mesh.
pub(super) fn check() -> Finding {
    let picture = picture()?;
    let mut facts = Vec::new();
    for method in [Method::Med, Method::Mgprfs, Method::Mgpr, Method::Ced] {
        let model = made(&picture, method)?;
        delaunay::check(&model.mesh).map_err(|defect| format!("{method}: {defect}"))?;
        check_fidelity(&picture, &model).map_err(|defect| format!("{method}: {defect}"))?;
        if made(&picture, method)?.mesh != model.mesh {
            return Err(format!("{method} does not make the same mesh twice"));
        }
        let (faces, psnr_db) = (model.mesh.faces().len(), model.fidelity.psnr_db());
        facts.push(format!("{method} {faces} faces {psnr_db:.2} dB"));
    }
    Ok(format!("{}: Delaunay by an independent library, too", facts.join(", ")))
}

/// Writes and reads the picture and its mesh.
pub(super) fn check_codec() -> Finding {
    let picture = picture()?;
    let mut png = Vec::new();
    write_png(&picture, &mut png).map_err(|error| error.to_string())?;
    if decode(&png, &Limits::default()).as_ref() != Ok(&picture) {
        return Err("a PNG does not read back as it was written".into());
    }
    let mesh = made(&picture, Method::Med)?.mesh;
    let mut model = Vec::new();
    write_model(&mesh, &mut model).map_err(|error| error.to_string())?;
    if read_model(&model, &Limits::default()).as_ref() != Ok(&mesh) {
        return Err("a MODEL does not read back as it was written".into());
    }
    let mut glb = Vec::new();
    let source = Encodable::new(&mesh);
    encode(&source, Format::Glb, &EncodeOptions::default(), &mut glb, &|| Ok(()))
        .map_err(|error| error.to_string())?;
    let digest = Sha256::digest(&model).iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    });
    if digest != DIGEST {
        return Err(format!("the mesh differs from that of other machines: {digest}"));
    }
    Ok(format!("PNG {} bytes, MODEL {} bytes, glTF {} bytes", png.len(), model.len(), glb.len()))
}

/// A disc on a gradient, of three components.
fn picture() -> Result<Image, String> {
    let sample = |c: usize, x: usize, y: usize| {
        let inside = x.abs_diff(WIDTH / 3).pow(2) + y.abs_diff(HEIGHT / 2).pow(2) < 40 * 40;
        let gradient = [x * 200 / WIDTH, y * 200 / HEIGHT, (x * y) % 251][c];
        if inside { 240 - gradient as u16 / 4 } else { gradient as u16 }
    };
    let component =
        |c| (0..WIDTH * HEIGHT).map(|i| sample(c, i % WIDTH, i / WIDTH)).collect::<Vec<u16>>();
    Image::from_top_down(WIDTH, HEIGHT, 8, (0..3).map(component).collect())
        .map_err(|error| error.to_string())
}

fn made(picture: &Image, method: Method) -> Result<Approximation, String> {
    let parameters = method.parameters(Target::Percent(DENSITY));
    mesh_image(picture, &parameters, &()).map_err(|error| format!("{method}: {error}"))
}

/// Whether the mesh's figures are those of the picture rebuilt from it.
fn check_fidelity(picture: &Image, model: &Approximation) -> Result<(), String> {
    let rebuilt = rasterize(&model.mesh, &()).map_err(|error| error.to_string())?;
    let measured = Fidelity::between(picture, &rebuilt, &()).map_err(|error| error.to_string())?;
    let (told, found) = (model.fidelity.mse(), measured.mse());
    if told == found { Ok(()) } else { Err(format!("the error is told as {told}, but is {found}")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pixmesh_meshing::Mesh;

    #[test]
    fn what_is_built_here_is_well() {
        assert_eq!(check().map(|_| ()), Ok(()));
        assert_eq!(check_codec().map(|_| ()), Ok(()));
    }

    #[test]
    fn a_mesh_that_is_not_delaunay_is_found_out() {
        let mesh = made(&picture().unwrap(), Method::Med).unwrap().mesh;
        assert_eq!(delaunay::check(&mesh), Ok(()));
        let flipped = flip_an_edge(&mesh);
        let defect = delaunay::check(&flipped).unwrap_err();
        assert!(defect.contains("circle"), "{defect}");
    }

    /// The mesh with one edge flipped inside its convex quadrilateral: still a mesh, of the same
    /// points.
    fn flip_an_edge(mesh: &Mesh) -> Mesh {
        let faces = mesh.faces();
        let candidates = (0..faces.len()).flat_map(|f| (0..f).map(move |g| (f, g)));
        for (f, g) in candidates {
            for turn in 0..3 {
                let [a, b, c] = [0, 1, 2].map(|k| faces[f][(k + turn) % 3]);
                let Some(at) = (0..3).find(|&k| faces[g][k] == b && faces[g][(k + 1) % 3] == a)
                else {
                    continue;
                };
                let d = faces[g][(at + 2) % 3];
                let mut flipped = faces.to_vec();
                (flipped[f], flipped[g]) = ([a, d, c], [d, b, c]);
                let samples = mesh.samples().to_vec();
                let made = Mesh::new(mesh.shape(), mesh.points().to_vec(), samples, flipped, &());
                if let Ok(made) = made
                    && delaunay::check(&made).is_err()
                {
                    return made;
                }
            }
        }
        panic!("no edge can be flipped");
    }
}
