//! Pictures with alpha: what alpha hides costs nothing and bleeds nowhere, and `alpha=cut` leaves
//! out what is transparent and nothing else.

// A panic tells a test that something is wrong, in its own functions too.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use pixmesh_engine::pipeline::{Conversion, convert, mesh_of_job};
use pixmesh_engine::{Context, Format, Limits, MeshOptions, ParameterSet, mesh};
use std::collections::HashMap;

const SIDE: usize = 64;
const COLOR: [u8; 3] = [240, 120, 30];
/// A pixel by itself, far from the disc.
const SPECK: (usize, usize) = (55, 8);
/// Pixels of an alpha that `cut` takes as transparent.
const FAINT: (usize, usize) = (8, 55);

/// The alpha of a disc with a soft edge, a speck and a faint spot; `y` down.
fn alpha(x: usize, y: usize) -> u8 {
    let distance = ((x as f64 - 24.0).powi(2) + (y as f64 - 36.0).powi(2)).sqrt();
    let disc = ((17.0 - distance) / 3.0).clamp(0.0, 1.0) * 255.0;
    match (x, y) {
        SPECK => 90,
        FAINT => 8,
        _ => disc as u8,
    }
}

/// A sprite of one colour as PAM, with other colours where alpha is 0.
fn sprite(hidden: impl Fn(usize, usize) -> [u8; 3]) -> Vec<u8> {
    let mut file = format!("P7\nWIDTH {SIDE}\nHEIGHT {SIDE}\nDEPTH 4\nMAXVAL 255\n").into_bytes();
    file.extend(b"TUPLTYPE RGB_ALPHA\nENDHDR\n");
    for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
        let alpha = alpha(x, y);
        file.extend(if alpha == 0 { hidden(x, y) } else { COLOR });
        file.push(alpha);
    }
    file
}

fn options(query: &str) -> MeshOptions {
    ParameterSet::of_query(Some(query)).unwrap().finish().unwrap()
}

fn made(file: Vec<u8>, query: &str, format: Format) -> Vec<u8> {
    let (limits, context) = (Limits::default(), Context::default());
    mesh(file.into(), &options(query), format, &limits, &context).unwrap().bytes
}

fn black(_: usize, _: usize) -> [u8; 3] {
    [0; 3]
}

/// Positions and colours of the vertices of a PLY with alpha, and its faces.
struct Ply {
    vertices: Vec<([f32; 3], [u8; 4])>,
    faces: Vec<[u32; 3]>,
}

impl Ply {
    fn read(bytes: &[u8]) -> Self {
        let end = b"end_header\n";
        let start = bytes.windows(end.len()).position(|window| window == end).unwrap() + end.len();
        let header = std::str::from_utf8(&bytes[..start]).unwrap();
        let count = |element: &str| -> usize {
            let line = header.lines().find_map(|line| line.strip_prefix(element));
            line.unwrap().trim().parse().unwrap()
        };
        let (vertices, faces) = bytes[start..].split_at(16 * count("element vertex"));
        let word = |bytes: &[u8]| <[u8; 4]>::try_from(bytes).unwrap();
        let vertex = |bytes: &[u8]| {
            let position = [0, 4, 8].map(|at| f32::from_le_bytes(word(&bytes[at..at + 4])));
            (position, word(&bytes[12..]))
        };
        let face = |bytes: &[u8]| [1, 5, 9].map(|at| u32::from_le_bytes(word(&bytes[at..at + 4])));
        let made = Self {
            vertices: vertices.chunks_exact(16).map(vertex).collect(),
            faces: faces.chunks_exact(13).map(face).collect(),
        };
        assert_eq!(made.faces.len(), count("element face"));
        made
    }

    /// Whether a point, `y` up, lies in a face or on its border.
    fn covers(&self, x: f32, y: f32) -> bool {
        self.faces.iter().any(|face| {
            let [a, b, c] = face.map(|v| self.vertices[v as usize].0);
            let side =
                |p: [f32; 3], q: [f32; 3]| (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
            side(a, b) >= 0.0 && side(b, c) >= 0.0 && side(c, a) >= 0.0
        })
    }
}

#[test]
fn hidden_colors_change_no_format() {
    let noise = |x: usize, y: usize| [x * 37 + y, y * 91, x * y].map(|sample| sample as u8);
    for method in ["mgprfs", "med", "flat", "optimal", "preview"] {
        let query = format!("method={method}&size=80");
        for &format in Format::ALL {
            let is_flat = method == "flat";
            if format == Format::Terrain || format == Format::Progression && is_flat {
                continue;
            }
            let [first, second] =
                [sprite(black), sprite(noise)].map(|file| made(file, &query, format));
            assert!(first == second, "{method}, {format}");
        }
    }
}

#[test]
fn a_sprite_of_one_color_has_no_fringe() {
    for query in ["size=60", "method=flat&size=60", "size=60&values=fitted&effort=3"] {
        let ply = Ply::read(&made(sprite(black), &format!("{query}&alpha=cut"), Format::Ply));
        for (_, [red, green, blue, alpha]) in &ply.vertices {
            let straight = [red, green, blue];
            // A step of a premultiplied colour is 255 / alpha of a straight one, and a face's colour
            // is rounded once more.
            let steps = if query.contains("flat") { 2 } else { 1 };
            let fitted = if query.contains("fitted") { 3 } else { 0 };
            let most = 1 + fitted + steps * 128 / i32::from(*alpha).max(1);
            let is_near = |(&of, own): (&u8, u8)| (i32::from(of) - i32::from(own)).abs() <= most;
            let is_near = straight.into_iter().zip(COLOR).all(is_near);
            assert!(is_near, "{query}: {straight:?} of alpha {alpha}");
        }
    }
}

#[test]
fn cut_leaves_out_what_is_transparent_and_covers_what_is_not() {
    for query in ["size=60", "size=40&method=med", "method=flat&size=60", "target_psnr=40"] {
        let [kept, cut] = ["keep", "cut"].map(|alpha| {
            let query = format!("{query}&alpha={alpha}");
            Ply::read(&made(sprite(black), &query, Format::Ply))
        });
        assert!(cut.faces.len() < kept.faces.len(), "{query}");
        for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
            let is_covered = |ply: &Ply| ply.covers(x as f32, (SIDE - 1 - y) as f32);
            assert!(is_covered(&kept), "{query}: ({x}, {y})");
            assert!(alpha(x, y) <= 8 || is_covered(&cut), "{query}: ({x}, {y})");
        }
        let used: Vec<u32> = cut.faces.iter().flatten().copied().collect();
        assert!((0..cut.vertices.len() as u32).all(|v| used.contains(&v)), "{query}");
    }
}

#[test]
fn a_jobs_mesh_is_cut_as_the_one_made_at_once() {
    let (limits, context) = (Limits::default(), Context::default());
    for (query, is_cut_later) in [("size=80&alpha=cut", false), ("size=80", true)] {
        for format in [Format::Glb, Format::Svg, Format::Obj, Format::Stl] {
            let own = options(query);
            let job = mesh_of_job(sprite(black).into(), &own, false, &limits, &context).unwrap();
            let cut = own.written_by([("alpha", "cut")].into_iter()).unwrap();
            let output = if is_cut_later { cut.output } else { own.output };
            let file = job.answer.bytes;
            let conversion =
                Conversion { file, shown: None, size: None, format, output, mse: None };
            let later = convert(conversion, &limits, &context).unwrap().bytes;
            let at_once = made(sprite(black), query, format);
            assert_eq!(later == at_once, !is_cut_later, "{query}, {format}");
        }
    }
    let over = options("size=80").written_by([("alpha", "over:#ffffff")].into_iter());
    let error = over.unwrap_err().to_string();
    assert!(error.contains("alpha") && error.contains("keep, cut"), "{error}");
}

#[test]
fn a_solid_of_a_cut_sprite_is_closed() {
    for query in ["size=60", "method=flat&size=60"] {
        let stl = made(sprite(black), &format!("{query}&alpha=cut"), Format::Stl);
        let corner = |bytes: &[u8]| <[u8; 12]>::try_from(bytes).unwrap();
        let mut balance: HashMap<_, i32> = HashMap::new();
        for triangle in stl[84..].chunks_exact(50) {
            let [a, b, c] = [12, 24, 36].map(|at| corner(&triangle[at..at + 12]));
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *balance.entry((from.min(to), from.max(to))).or_default() +=
                    if from < to { 1 } else { -1 };
            }
        }
        assert!(!balance.is_empty() && balance.values().all(|&sum| sum == 0), "{query}");
    }
}
