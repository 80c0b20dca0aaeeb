//! SVG and glTF as Chromium draws them, the latter with three.js, beside our own rasteriser.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

use crate::samples::{node_folder, written};
use pixmesh_codec::{
    Compression, EncodeOptions, Format, Geometry, Limits, Relief, Shading, Texture, decode,
    write_png,
};
use pixmesh_meshing::{Image, Mesh, Method, Target, mesh_image, rasterize};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

/// A landscape of a bright disc over a gradient, with a dark stripe: edges, curves and slopes.
fn picture(component_count: usize) -> Image {
    let sample = |x: i32, y: i32, c: usize| -> u16 {
        let disc = (x - 60).pow(2) + (y - 70).pow(2) < 900;
        let stripe = (x + 2 * y) % 90 < 12;
        match (disc, stripe, c) {
            (true, _, 0) => 240,
            (true, _, 1) => 200,
            (true, _, _) => 60,
            (_, true, _) => 20,
            (.., 0) => (40 + x) as u16,
            (.., 1) => (50 + y) as u16,
            (.., 2) => (250 - x) as u16,
            _ => (255 - y) as u16,
        }
    };
    let plane = |c: usize| -> Vec<u16> {
        let places = (0..HEIGHT as i32).flat_map(|y| (0..WIDTH as i32).map(move |x| (x, y)));
        places.map(|(x, y)| sample(x, y, c)).collect()
    };
    Image::from_bottom_up(WIDTH, HEIGHT, 8, (0..component_count).map(plane).collect()).unwrap()
}

/// Waves without edges, as in photographs out of focus.
fn waves() -> Image {
    let plane = |c: usize| -> Vec<u16> {
        let sample = |x: usize, y: usize| {
            let (x, y) = (x as f64 / 9.0, y as f64 / 13.0);
            (128.0 + 60.0 * (x + y * (c + 1) as f64).sin() + 50.0 * (y - x).cos()) as u16
        };
        (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| sample(x, y))).collect()
    };
    Image::from_bottom_up(WIDTH, HEIGHT, 8, (0..3).map(plane).collect()).unwrap()
}

fn mesh_of(image: &Image) -> Mesh {
    let parameters = Method::Mgprfs.parameters(Target::Percent(4.0));
    mesh_image(image, &parameters, &()).unwrap().mesh
}

/// A folder that is gone with the test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("pixmesh-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn write(&self, name: &str, write: impl FnOnce(&mut Vec<u8>)) -> PathBuf {
        let mut bytes = Vec::new();
        write(&mut bytes);
        let path = self.0.join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    fn write_mesh(
        &self,
        name: &str,
        mesh: &Mesh,
        format: Format,
        options: &EncodeOptions<'_>,
    ) -> PathBuf {
        self.write(name, |bytes| *bytes = written(mesh, format, options).unwrap())
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // `PIXMESH_KEEP_RENDERINGS` names a folder for those who want to look at the pictures.
        if let Some(kept) = std::env::var_os("PIXMESH_KEEP_RENDERINGS") {
            std::fs::create_dir_all(&kept).unwrap();
            for entry in std::fs::read_dir(&self.0).unwrap() {
                let path = entry.unwrap().path();
                std::fs::copy(&path, Path::new(&kept).join(path.file_name().unwrap())).unwrap();
            }
        }
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Draws files on a background and gives the pictures.
fn render(jobs: &[(PathBuf, &str)]) -> Vec<Image> {
    render_tilted(&jobs.iter().map(|(path, b)| (path.clone(), *b, 0.0)).collect::<Vec<_>>())
}

fn render_tilted(jobs: &[(PathBuf, &str, f64)]) -> Vec<Image> {
    let programs = node_folder("playwright-core");
    let out = |index: usize| jobs[index].0.with_extension(format!("{index}.png"));
    let job = |(index, (path, background, tilt)): (usize, &(PathBuf, &str, f64))| {
        json!({
            "path": path, "width": WIDTH, "height": HEIGHT, "background": background,
            "out": out(index), "tilt": tilt,
        })
    };
    let list: Vec<Value> = jobs.iter().enumerate().map(job).collect();
    let mut command = Command::new("node");
    command.arg("render.mjs").current_dir(programs).env("CHROMIUM", chromium());
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("Node.js is missing: install nodejs");
    child.stdin.take().unwrap().write_all(json!(list).to_string().as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        let report: Value = serde_json::from_str(line).unwrap();
        assert_eq!(report["errors"], json!([]), "{line}");
    }
    let read = |index: usize| decode(&std::fs::read(out(index)).unwrap(), &Limits::default());
    (0..jobs.len()).map(|index| read(index).unwrap()).collect()
}

/// The browser: `CHROMIUM` names it, else Debian's is looked for.
fn chromium() -> PathBuf {
    let named = std::env::var_os("CHROMIUM").map(PathBuf::from);
    let usual = ["/usr/bin/chromium", "/usr/bin/chromium-browser"].map(PathBuf::from);
    let mut candidates = named.into_iter().chain(usual);
    candidates.find(|path| path.is_file()).expect("Chromium is missing: install chromium")
}

/// The sample of a component that a drawn picture shows where the mesh has a lattice point, gray
/// pictures being drawn as RGB.
fn shown(drawn: &Image, c: usize, x: usize, y: usize) -> i32 {
    drawn.sample(c, x, y).into()
}

/// How far two pictures differ: the mean and the largest difference of a sample, without the
/// outermost pixels, whose middles lie on the mesh's border.
fn difference(drawn: &Image, expected: &Image) -> (f64, i32) {
    let (mut sum, mut largest, mut count) = (0_i64, 0, 0);
    for c in 0..3 {
        for y in 1..HEIGHT - 1 {
            for x in 1..WIDTH - 1 {
                let component = if expected.component_count() < 3 { 0 } else { c };
                let wanted = i32::from(expected.sample(component, x, y));
                let off = (shown(drawn, c, x, y) - wanted).abs();
                sum += i64::from(off);
                largest = largest.max(off);
                count += 1;
            }
        }
    }
    (sum as f64 / f64::from(count), largest)
}

/// sRGB of 8 bits as linear light of 16 bits, and back.
fn linear(sample: u16) -> u16 {
    let value = f64::from(sample) / 255.0;
    let light = if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) };
    (light * 65535.0).round() as u16
}

fn gamma(light: u16) -> u16 {
    let light = f64::from(light) / 65535.0;
    let value =
        if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
    (value * 255.0).round() as u16
}

/// The light of each vertex in a GLB without compression, component by component.
fn light_of(mesh: &Mesh) -> Vec<u16> {
    let bytes = written(mesh, Format::Glb, &EncodeOptions::default()).unwrap();
    let json_length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let document: Value = serde_json::from_slice(&bytes[20..20 + json_length]).unwrap();
    let buffer = &bytes[28 + json_length..];
    let offset = document["bufferViews"][1]["byteOffset"].as_u64().unwrap() as usize;
    let colors = buffer[offset..].chunks_exact(8).take(mesh.points().len());
    let count = mesh.shape().component_count;
    let part = |color: &[u8], c: usize| u16::from_le_bytes([color[2 * c], color[2 * c + 1]]);
    colors.flat_map(|color| (0..count).map(move |c| part(color, c))).collect()
}

/// What our rasteriser makes of a mesh whose vertices have this light, which is interpolated as
/// clients of glTF do it.
fn rasterized_in_linear_light(mesh: &Mesh, light: Vec<u16>) -> Image {
    let shape = pixmesh_meshing::Shape { precision: 16, ..mesh.shape() };
    let linear =
        Mesh::new(shape, mesh.points().to_vec(), light, mesh.faces().to_vec(), &()).unwrap();
    let light = rasterize(&linear, &()).unwrap();
    let planes = light.components().iter();
    let planes = planes.map(|plane| plane.iter().map(|&sample| gamma(sample)).collect()).collect();
    Image::from_bottom_up(light.width(), light.height(), 8, planes).unwrap()
}

#[test]
fn three_js_draws_what_our_rasteriser_makes_of_the_same_mesh() {
    let folder = Folder::new("three");
    let (gray, rgb) = (mesh_of(&picture(1)), mesh_of(&picture(3)));
    let texture = Texture::of_image(&picture(3)).unwrap();
    let mut jobs = Vec::new();
    for (name, mesh) in [("gray", &gray), ("rgb", &rgb)] {
        for compression in Compression::ALL {
            let options = EncodeOptions { compression: *compression, ..EncodeOptions::default() };
            let path = format!("{name}_{compression}.glb");
            jobs.push(folder.write_mesh(&path, mesh, Format::Glb, &options));
        }
    }
    let textured = EncodeOptions { texture: Some(&texture), ..EncodeOptions::default() };
    jobs.push(folder.write_mesh("texture.glb", &rgb, Format::Glb, &textured));
    let quantized = EncodeOptions { compression: Compression::Quantized, ..textured };
    jobs.push(folder.write_mesh("texture_q.gltf", &rgb, Format::Gltf, &quantized));
    let jobs: Vec<_> = jobs.into_iter().map(|path| (path, "#f0f")).collect();
    let drawn = render(&jobs);
    let [gray_shown, rgb_shown] =
        [&gray, &rgb].map(|mesh| rasterized_in_linear_light(mesh, light_of(mesh)));
    let original = picture(3);
    let expected = [
        &gray_shown,
        &gray_shown,
        &gray_shown,
        &rgb_shown,
        &rgb_shown,
        &rgb_shown,
        &original,
        &original,
    ];
    for ((drawn, expected), (path, _)) in drawn.iter().zip(expected).zip(&jobs) {
        let (mean, largest) = difference(drawn, expected);
        println!("{path:?}: mean {mean:.4}, largest {largest}");
        assert!(mean < 0.02, "{path:?}: {mean}");
        assert!(largest <= 4, "{path:?}: {largest}");
    }
    // The colours are fitted, so that the browser shows the mesh better than with exact ones.
    let exact = rgb.samples().iter().map(|&sample| linear(sample)).collect();
    let (exact, meant) = (rasterized_in_linear_light(&rgb, exact), rasterize(&rgb, &()).unwrap());
    let (fitted, exact) = (psnr_db(&drawn[3], &meant), psnr_db(&exact, &meant));
    println!("{fitted:.2} dB with fitted colours, {exact:.2} dB with exact ones");
    assert!(fitted > exact + 0.2, "{fitted} dB with fitted colours, {exact} dB with exact ones");
}

#[test]
fn a_relief_is_lit_by_its_slopes() {
    let folder = Folder::new("relief");
    let mesh = mesh_of(&picture(1));
    let flat = Geometry::default();
    let relief = Geometry { relief: Some(Relief::default()), ..flat };
    let solid = relief.with_base(mesh.shape());
    let mut jobs = Vec::new();
    for (name, geometry) in [("flat", flat), ("relief", relief), ("solid", solid)] {
        for compression in [Compression::None, Compression::Meshopt] {
            let options = EncodeOptions { geometry, compression, ..EncodeOptions::default() };
            let name = format!("{name}_{compression}.glb");
            let path = folder.write_mesh(&name, &mesh, Format::Glb, &options);
            jobs.push((path, "#003", 0.9));
        }
    }
    let drawn = render_tilted(&jobs);
    let [flat, flat_m, relief, relief_m, solid, solid_m] = &drawn[..] else { panic!() };
    for (plain, compressed) in [(flat, flat_m), (relief, relief_m), (solid, solid_m)] {
        let (mean, _) = difference(plain, compressed);
        assert!(mean < 1.5, "{mean}");
    }
    assert!(difference(flat, relief).0 > 5.0);
    assert!(difference(solid, relief).0 > 0.3);
}

#[test]
fn svg_has_no_seams_and_gradients_show_what_our_rasteriser_shows() {
    let folder = Folder::new("svg");
    let images: Vec<Image> = (1..=4).map(picture).collect();
    let meshes: Vec<Mesh> = images.iter().map(mesh_of).collect();
    let one_colour = {
        let mesh = &meshes[0];
        let samples = vec![0; mesh.samples().len()];
        Mesh::new(mesh.shape(), mesh.points().to_vec(), samples, mesh.faces().to_vec(), &())
            .unwrap()
    };
    let mut jobs = Vec::new();
    for shading in Shading::ALL {
        let options = EncodeOptions { shading: *shading, ..EncodeOptions::default() };
        // Black on white: whatever is not black is a seam.
        let name = format!("seams_{shading}.svg");
        let path = folder.write_mesh(&name, &one_colour, Format::Svg, &options);
        jobs.push((path, "#fff"));
        for (count, mesh) in (1..).zip(&meshes) {
            let name = format!("picture_{count}_{shading}.svg");
            let path = folder.write_mesh(&name, mesh, Format::Svg, &options);
            jobs.push((path, "#f0f"));
        }
    }
    let drawn = render(&jobs);
    let mut drawn = drawn.iter();
    for shading in Shading::ALL {
        let seams = drawn.next().unwrap();
        let bright = seams.components().concat().into_iter().filter(|&sample| sample > 0).count();
        assert_eq!(bright, 0, "{shading}: samples of seams");
        for (mesh, drawn) in meshes.iter().zip(drawn.by_ref()) {
            let expected = over_magenta(&rasterize(mesh, &()).unwrap());
            let (mean, largest) = difference(drawn, &expected);
            let count = mesh.shape().component_count;
            println!("{shading}, {count} components: mean {mean:.3}, largest {largest}");
            let bound = if *shading == Shading::Flat { 8.0 } else { 1.5 };
            assert!(mean < bound, "{shading}, {count} components: {mean}");
        }
    }
}

#[test]
fn faces_with_colors_look_in_svg_and_gltf_as_they_are_measured() {
    let folder = Folder::new("flat");
    let image = waves();
    // Few faces: a GPU may give a pixel on an edge to the other face.
    let made = mesh_image(&image, &Method::Flat.parameters(Target::Percent(0.5)), &()).unwrap();
    let mut jobs = Vec::new();
    for shading in Shading::ALL {
        let options = EncodeOptions { shading: *shading, ..EncodeOptions::default() };
        let name = format!("flat_{shading}.svg");
        jobs.push((folder.write_mesh(&name, &made.mesh, Format::Svg, &options), "#fff"));
    }
    for compression in Compression::ALL {
        let options = EncodeOptions { compression: *compression, ..EncodeOptions::default() };
        let name = format!("flat_{compression}.glb");
        jobs.push((folder.write_mesh(&name, &made.mesh, Format::Glb, &options), "#fff"));
    }
    let measured = psnr_db(&rasterize(&made.mesh, &()).unwrap(), &image);
    for (drawn, (path, _)) in render(&jobs).iter().zip(&jobs) {
        let shown = psnr_db(drawn, &image);
        println!("{path:?}: {shown:.3} dB, measured {measured:.3} dB");
        assert!(shown > measured - 0.1, "{path:?}: {shown} dB, measured {measured} dB");
    }
}

/// The PSNR of a picture in colour, without the outermost pixels, whose middles lie on the mesh's
/// border.
fn psnr_db(drawn: &Image, expected: &Image) -> f64 {
    let mut squared_error = 0.0;
    for c in 0..3 {
        for y in 1..HEIGHT - 1 {
            for x in 1..WIDTH - 1 {
                let off = shown(drawn, c, x, y) - i32::from(expected.sample(c, x, y));
                squared_error += f64::from(off * off);
            }
        }
    }
    let count = (3 * (WIDTH - 2) * (HEIGHT - 2)) as f64;
    10.0 * (255.0 * 255.0 * count / squared_error).log10()
}

/// The picture as it is seen on the background that the pages have.
fn over_magenta(image: &Image) -> Image {
    let mut png = Vec::new();
    write_png(image, &mut png).unwrap();
    let options = pixmesh_codec::DecodeOptions {
        alpha: pixmesh_codec::Alpha::Over([255, 0, 255]),
        ..pixmesh_codec::DecodeOptions::default()
    };
    options.decode(&png).unwrap()
}
