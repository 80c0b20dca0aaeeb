//! The parameters that change how the image is read and how the mesh is written.

use crate::in_process::Service;
use crate::pictures::{disc, disc_image, png, sprite};
use crate::server::Server;
use pixmesh_codec::{
    DecodeOptions, Encodable, EncodeOptions, Format, Geometry, Limits, Relief, ReliefHeight,
    encode, read_model, write_png,
};
use pixmesh_meshing::{Image, Method, Target, mesh_image, rasterize};
use serde_json::Value;

fn number(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

/// The document within a GLB.
fn document(glb: &[u8]) -> Value {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&glb[20..20 + length]).unwrap()
}

#[test]
fn a_relief_has_the_height_asked_for_and_says_so() {
    let server = Service::start(&[]);
    let image = disc(40, 30, 1);
    let answer = server.mesh("format=ply&height=7.5&pixel_size=0.5&base=2&density=4", &[], &image);
    assert_eq!(answer.status, 200, "{}", answer.text());
    let ran = answer.header("mesh-parameters").to_owned();
    assert!(ran.contains("relief=luma&height=7.5&base=2&pixel_size=0.5"), "{ran}");
    let parameters = Method::Mgprfs.parameters(Target::Percent(4.0));
    let model = mesh_image(&disc_image(40, 30, 1), &parameters, &()).unwrap();
    let relief = Relief { height: ReliefHeight::Total(7.5), ..Relief::default() };
    let geometry =
        Geometry { relief: Some(relief), pixel_size: 0.5, base: 2.0, ..Geometry::default() };
    let mut expected = Vec::new();
    let options = EncodeOptions { geometry, ..EncodeOptions::default() };
    let source = Encodable::new(&model.mesh);
    encode(&source, Format::Ply, &options, &mut expected, &|| Ok(())).unwrap();
    assert_eq!(answer.body, expected);
    // What was run gives the same again.
    assert_eq!(server.mesh(&ran, &[], &image).body, expected);
}

#[test]
fn an_elevation_model_becomes_metres() {
    let samples = (0..20_u16 * 10).map(|i| 1000 * (i % 20)).collect();
    let mut png = Vec::new();
    write_png(&Image::from_bottom_up(20, 10, 16, vec![samples]).unwrap(), &mut png).unwrap();
    let server = Service::start(&[]);
    let stl = server.mesh("format=stl&z_scale=0.1&pixel_size=30&base=5&density=50", &[], &png);
    let triangles = stl.body[84..].chunks_exact(50);
    let lengths: Vec<[f32; 3]> = triangles
        .flat_map(|t| (0..3).map(|i| [0, 4, 8].map(|axis| number(t, 12 + 12 * i + axis))))
        .collect();
    let most = |axis: usize| lengths.iter().map(|l| l[axis]).fold(f32::MIN, f32::max);
    let least = lengths.iter().map(|l| l[2]).fold(f32::MAX, f32::min);
    assert_eq!([most(0), most(1), most(2), least], [570.0, 270.0, 1900.0, -5.0]);
    let glb = server.mesh("format=glb&z_scale=100&pixel_size=30&unit=mm", &[], &png);
    assert_eq!(document(&glb.body)["nodes"][0]["scale"], serde_json::json!([0.001, 0.001, 0.001]));
}

#[test]
fn an_elevation_model_lies_and_has_colors() {
    // Heights of 1200 to 1390 of 65535, which are black as a picture.
    let samples = (0..20_u16 * 10).map(|i| 1200 + 10 * (i % 20)).collect();
    let png = png(&Image::from_bottom_up(20, 10, 16, vec![samples]).unwrap());
    let server = Service::start(&[]);
    let glb = server.mesh("format=glb&z_scale=1", &[], &png).body;
    let node = document(&glb)["nodes"][0].clone();
    let half = std::f64::consts::FRAC_1_SQRT_2;
    assert_eq!(node["rotation"], serde_json::json!([-half, 0.0, 0.0, half]));
    let upright = server.mesh("format=glb&z_scale=1&up=z", &[], &png).body;
    assert!(document(&upright)["nodes"][0]["rotation"].is_null());
    assert!(document(&server.mesh("format=glb", &[], &png).body)["nodes"][0]["rotation"].is_null());
    let vertices = |query: &str| {
        let query = format!("format=obj&z_scale=1&density=50&{query}");
        let answer = server.mesh(&query, &[], &png);
        let ran = answer.header("mesh-parameters").to_owned();
        assert!(server.mesh(&ran, &[], &png).body == answer.body, "{ran}");
        let text = answer.text();
        let lines = text.lines().filter_map(|line| line.strip_prefix("v "));
        lines
            .map(|line| line.split(' ').map(|n| n.parse().unwrap()).collect())
            .collect::<Vec<Vec<f64>>>()
    };
    let range = |vertices: &[Vec<f64>], axis: usize| {
        let of = |vertex: &Vec<f64>| vertex[axis];
        [f64::min, f64::max].map(|best| vertices.iter().map(of).reduce(best).unwrap())
    };
    let plain = vertices("");
    assert_eq!(range(&plain, 2), [1200.0, 1390.0]);
    assert_eq!(range(&plain, 3), [0.0, 1.0], "gray from black to white");
    let placed = vertices("z_offset=min&center=true&width=190&color=none&up=y");
    assert_eq!(
        [0, 1, 2].map(|axis| range(&placed, axis)),
        [[-95.0, 95.0], [0.0, 190.0], [-45.0, 45.0]]
    );
    assert_eq!(placed[0].len(), 3, "no colours");
    assert_eq!(range(&vertices("z_offset=1195.5"), 2), [4.5, 194.5]);
    assert!(vertices("color=ramp")[0][4] > vertices("color=ramp")[0][3], "green where it is low");
    let shaded = vertices("color=hillshade");
    assert_eq!(range(&shaded, 3), range(&shaded, 5), "gray");
    let stl = server.mesh("format=stl", &[], &png).body;
    assert!(stl.starts_with(b"binary STL, lengths in mm"));
}

#[test]
fn gltf_is_compressed_and_textured_on_request() {
    let server = Service::start(&[]);
    let image = disc(60, 40, 3);
    let plain = server.mesh("format=glb&density=20", &[], &image).body;
    let packed = server.mesh("format=glb&density=20&compression=meshopt", &[], &image).body;
    assert!(2 * packed.len() < plain.len(), "{} and {}", packed.len(), plain.len());
    let extensions = &document(&packed)["extensionsRequired"];
    let required = ["KHR_mesh_quantization", "EXT_meshopt_compression"];
    assert_eq!(extensions, &serde_json::json!(required));
    let textured = server.mesh("format=glb&texture=embed", &[], &image).body;
    assert_eq!(document(&textured)["images"][0]["mimeType"], "image/png");
    assert!(document(&plain)["images"].is_null());
}

#[test]
fn alpha_is_kept_cut_dropped_or_composed() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 4);
    let start = |query: &str| {
        let answer = server.mesh(query, &[], &image);
        assert_eq!(answer.status, 200, "{}", answer.text());
        (answer.text()[..8].to_owned(), answer.header("mesh-parameters").to_owned())
    };
    assert_eq!(start("").0, "20 20 4 ");
    assert_eq!(start("alpha=drop").0, "20 20 3 ");
    let (text, ran) = start("alpha=over:%23ff8000");
    assert_eq!(text, "20 20 3 ");
    assert!(ran.contains("alpha=over:%23ff8000"), "{ran}");
    assert_eq!(start(&ran).0, text);
    // A method for three components, which the image has without its alpha.
    assert_eq!(start("alpha=drop&method=ced").0, "20 20 3 ");
    assert!(start("alpha=cut:20").1.contains("alpha=cut:20"));
    for alpha in ["over:red", "cut:255", "cut:-1", "cut:"] {
        let answer = server.mesh(&format!("alpha={alpha}"), &[], &image);
        assert_eq!(answer.problem(422, "unknown-value")["param"], "alpha", "{alpha}");
    }
}

#[test]
fn a_jobs_mesh_can_be_cut_later_but_its_alpha_not_dropped() {
    let server = Service::start(&[]);
    let job = server.job("size=40", &sprite(60));
    server.wait_for(&job, "completed");
    let mesh = |query: &str| server.get(&format!("{job}/mesh?format=ply{query}"));
    let (whole, cut) = (mesh(""), mesh("&alpha=cut"));
    assert_eq!((whole.status, cut.status), (200, 200), "{}", cut.text());
    assert!(cut.body.len() < whole.body.len());
    for alpha in ["drop", "over:%23ffffff", "cut:9"] {
        let problem = mesh(&format!("&alpha={alpha}")).problem(422, "unknown-value");
        assert_eq!(problem["allowed"], serde_json::json!(["keep", "cut"]), "{alpha}");
    }
}

#[test]
fn an_image_that_ends_early_is_only_taken_when_asked_to() {
    let server = Service::start(&[]);
    let image = disc(60, 40, 1);
    let cut = &image[..image.len() - 40];
    server.mesh("", &[], cut).problem(422, "image-decode-failed");
    let answer = server.mesh("lenient=true&format=json", &[], cut);
    assert_eq!(answer.status, 200, "{}", answer.text());
    let json: Value = serde_json::from_slice(&answer.body).unwrap();
    assert_eq!((&json["width"], &json["height"]), (&60.into(), &40.into()));
    assert!(DecodeOptions::default().decode(cut).is_err());
}

#[test]
fn what_cannot_be_is_refused_before_any_work() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    let refused = |query: &str, status: u16, kind: &str| {
        server.mesh(query, &[], &image).problem(status, kind)["param"].clone()
    };
    assert_eq!(refused("relief=c1&format=stl", 422, "format-not-possible"), "relief");
    assert_eq!(refused("height=1&z_scale=1", 422, "conflicting-parameters"), "z_scale");
    assert_eq!(refused("height=-1", 422, "parameter-out-of-range"), "height");
    assert_eq!(refused("pixel_size=0", 422, "parameter-out-of-range"), "pixel_size");
    assert_eq!(refused("unit=inch", 422, "unknown-value"), "unit");
    assert_eq!(refused("compression=draco", 422, "unknown-value"), "compression");
    assert_eq!(refused("up=x", 422, "unknown-value"), "up");
    assert_eq!(refused("color=blue", 422, "unknown-value"), "color");
    assert_eq!(refused("center=middle", 422, "unknown-value"), "center");
    assert_eq!(refused("width=0", 422, "parameter-out-of-range"), "width");
    assert_eq!(refused("width=9&pixel_size=1", 422, "conflicting-parameters"), "width");
    for offset in ["lowest", "1e10", "nan", ""] {
        assert_eq!(refused(&format!("z_offset={offset}"), 422, "unknown-value"), "z_offset");
    }
    assert_eq!(refused("texture=embed&color=ramp", 422, "conflicting-parameters"), "color");
}

#[test]
fn a_jobs_mesh_is_written_by_the_parameters_of_the_request() {
    let server = Server::start(&[]);
    let image = disc(60, 50, 3);
    let job = server.job("size=60&height=2&shading=gradient", &image);
    server.wait_for(&job, "completed");
    let mesh = |query: &str| server.get(&format!("{job}/mesh?{query}"));
    for query in [
        "format=stl&height=3&base=2",
        "format=svg&shading=flat",
        "format=glb&height=2&compression=meshopt",
        "format=png&png_compression=small",
        "format=ply&relief=c1&height=9&pixel_size=0.5",
        "format=obj&z_scale=0.1&unit=mm&invert_relief=true",
        "format=model&z_scale=1",
        "format=glb&z_scale=2&z_offset=min&width=90&center=true&up=z&color=ramp",
        "format=ply&height=3&color=hillshade",
    ] {
        let (stored, direct) = (mesh(query), server.mesh(&format!("size=60&{query}"), &[], &image));
        assert_eq!(stored.status, 200, "{query}: {}", stored.text());
        assert!(stored.body == direct.body, "{query}");
        assert_eq!(stored.header("mesh-psnr"), direct.header("mesh-psnr"));
    }
    let tags = ["", "&shading=flat", "&shading=gradient", "&unit=mm", "&reconstruction=flat"]
        .map(|query| mesh(&format!("format=svg{query}")).header("etag").to_owned());
    for (i, tag) in tags.iter().enumerate() {
        assert!(!tags[..i].contains(tag), "{tags:?}");
    }
    for (query, status, slug, name) in [
        ("relief=c3", 422, "format-not-possible", "relief"),
        ("height=-1", 422, "parameter-out-of-range", "height"),
        ("height=1&z_scale=1", 422, "conflicting-parameters", "z_scale"),
        ("reconstruction=smooth", 422, "unknown-value", "reconstruction"),
        ("texture=embed", 409, "job-without-texture", "texture"),
    ] {
        let problem = mesh(&format!("format=glb&{query}")).problem(status, slug);
        assert!(problem.to_string().contains(name), "{problem}");
    }
    server.wait_until_idle();
}

#[test]
fn a_jobs_mesh_of_any_method_can_be_shown_flat_or_smooth() {
    let server = Server::start(&[]);
    let image = disc(60, 50, 3);
    let server = &server;
    let mesh = |query: &str| {
        let job = server.job(query, &image);
        server.wait_for(&job, "completed");
        move |query: &str| server.get(&format!("{job}/mesh?{query}"))
    };
    let read = |bytes: &[u8]| read_model(bytes, &Limits::default()).unwrap();
    let (smooth, flat) = (mesh("size=60&initial_size=240"), mesh("method=flat&size=60"));
    let made_flat = smooth("format=model&reconstruction=flat");
    assert_eq!(made_flat.header("mesh-psnr"), "", "the error of this picture is not known");
    let picture = rasterize(&read(&smooth("format=model").body), &()).unwrap();
    let expected = read(&smooth("format=model").body).with_flat_colors(&picture, &()).unwrap().0;
    assert_eq!(read(&made_flat.body), expected);
    let json = smooth("format=json&reconstruction=flat").json();
    assert!(json["psnr_db"].is_null() && json["face_colors"].is_array(), "{json}");
    let small = smooth("format=model&size=30&reconstruction=flat");
    assert!(read(&small.body).face_samples().is_some() && small.header("mesh-psnr").is_empty());
    let made_smooth = flat("format=model&reconstruction=linear");
    let expected = read(&flat("format=model").body).without_face_samples();
    assert_eq!(read(&made_smooth.body), expected);
    for (of_job, own) in [(&smooth, "linear"), (&flat, "flat")] {
        let same = of_job(&format!("format=png&reconstruction={own}"));
        assert!(same.body == of_job("format=png").body && !same.header("mesh-psnr").is_empty());
    }
    server.wait_until_idle();
}
