//! Tiles of quantized-mesh, read by a decoder of others.

use crate::samples::node_folder;
use pixmesh_codec::{
    DecodeOptions, Encodable, EncodeError, EncodeOptions, Format, Limits, Terrain, encode,
    probe_mesh,
};
use pixmesh_meshing::{Mesh, Method, Point, Shape, Target, mesh_image, triangulate};
use serde_json::Value;
use std::collections::BTreeSet;
use std::process::Command;

const MODEL: &[u8] = include_bytes!("../samples/elevation/f32_tiled.tif");
const IN_METRES: &[u8] = include_bytes!("../samples/elevation/f64_strips.tif");

/// Metres of a degree of latitude, about.
const DEGREE: f64 = 111_200.0;

fn written(mesh: &Mesh, format: Format, terrain: Option<Terrain>) -> Result<Vec<u8>, EncodeError> {
    let options = EncodeOptions { terrain, ..EncodeOptions::default() };
    let mut bytes = Vec::new();
    encode(&Encodable::new(mesh), format, &options, &mut bytes, &|| Ok(()))?;
    Ok(bytes)
}

/// The mesh of an elevation model within 4 units.
fn meshed(file: &[u8]) -> (Mesh, Terrain) {
    let reading = DecodeOptions { bound: Some(4.0), ..DecodeOptions::default() };
    let (image, terrain) = reading.decode_terrain_while(file, &|| Ok(())).unwrap();
    let (own, terrain) = (Method::Mgprfs.parameters(Target::MaxError(4)), terrain.unwrap());
    let made = mesh_image(&image, &terrain.parameters(own, Some(4.0)).unwrap(), &()).unwrap();
    (made.mesh, terrain)
}

/// What the decoder of others reads.
struct Tile {
    file: Value,
    width: usize,
    height: usize,
}

impl Tile {
    fn read(mesh: &Mesh, terrain: Terrain) -> Self {
        let bytes = written(mesh, Format::Terrain, Some(terrain)).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tile.terrain");
        std::fs::write(&path, bytes).unwrap();
        let mut command = Command::new("node");
        command.arg("terrain.mjs").arg(path);
        command.current_dir(node_folder("@here/quantized-mesh-decoder"));
        let output = command.output().expect("Node.js is missing: install nodejs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let Shape { width, height, .. } = mesh.shape();
        Self { file: serde_json::from_slice(&output.stdout).unwrap(), width, height }
    }

    fn header(&self, name: &str) -> f64 {
        self.file["header"][name].as_f64().unwrap()
    }

    fn place(&self, name: &str) -> [f64; 3] {
        ["X", "Y", "Z"].map(|axis| self.header(&format!("{name}{axis}")))
    }

    fn numbers(&self, name: &str) -> Vec<usize> {
        let numbers = self.file[name].as_array().unwrap().iter();
        numbers.map(|number| number.as_u64().unwrap() as usize).collect()
    }

    /// Column, row and height of each vertex.
    fn vertices(&self) -> Vec<(usize, usize, f64)> {
        let data = self.numbers("vertexData");
        let count = data.len() / 3;
        let [least, most] = ["minHeight", "maxHeight"].map(|name| self.header(name));
        let lattice = |number: usize, side: usize| {
            let at = number as f64 / 32_767.0 * (side - 1) as f64;
            assert!((at - at.round()).abs() < 0.01, "{number} of {side}");
            at.round() as usize
        };
        let vertex = |v: usize| {
            let height = least + (most - least) * data[2 * count + v] as f64 / 32_767.0;
            (lattice(data[v], self.width), lattice(data[count + v], self.height), height)
        };
        (0..count).map(vertex).collect()
    }

    /// The vertices' columns and rows, of each triangle from the least on.
    fn faces(&self) -> BTreeSet<[(usize, usize); 3]> {
        let vertices = self.vertices();
        let indices = self.numbers("triangleIndices");
        let place = |&v: &usize| (vertices[v].0, vertices[v].1);
        indices.chunks(3).map(|face| rotated([0, 1, 2].map(|i| place(&face[i])))).collect()
    }

    /// Checks that the vertices at the borders are all that lie there, in order.
    fn check_borders(&self) {
        let vertices = self.vertices();
        let (right, top) = (self.width - 1, self.height - 1);
        for (name, is_at) in [
            (
                "westIndices",
                Box::new(|v: &(usize, usize, f64)| v.0 == 0) as Box<dyn Fn(&_) -> bool>,
            ),
            ("southIndices", Box::new(|v: &(usize, usize, f64)| v.1 == 0)),
            ("eastIndices", Box::new(|v: &(usize, usize, f64)| v.0 == right)),
            ("northIndices", Box::new(|v: &(usize, usize, f64)| v.1 == top)),
        ] {
            let listed = self.numbers(name);
            let places: Vec<_> = listed.iter().map(|&v| (vertices[v].0, vertices[v].1)).collect();
            assert!(listed.iter().all(|&v| is_at(&vertices[v])), "{name}");
            assert!(places.is_sorted(), "{name}");
            assert_eq!(listed.len(), vertices.iter().filter(|v| is_at(v)).count(), "{name}");
        }
    }

    /// The normals, unfolded from the octahedron.
    fn normals(&self) -> Vec<[f64; 3]> {
        let bytes = self.numbers("normals");
        let normal = |pair: &[usize]| {
            let [x, y] = [0, 1].map(|i| pair[i] as f64 / 255.0 * 2.0 - 1.0);
            let z = 1.0 - x.abs() - y.abs();
            let [x, y] = match z < 0.0 {
                true => [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)],
                false => [x, y],
            };
            scaled([x, y, z], 1.0 / length([x, y, z]))
        };
        bytes.chunks(2).map(normal).collect()
    }
}

fn rotated<T: Ord + Copy>(mut corners: [T; 3]) -> [T; 3] {
    let least = (0..3).min_by_key(|&i| corners[i]).unwrap();
    corners.rotate_left(least);
    corners
}

fn scaled(vector: [f64; 3], factor: f64) -> [f64; 3] {
    vector.map(|part| part * factor)
}

fn length(vector: [f64; 3]) -> f64 {
    vector.iter().map(|part| part * part).sum::<f64>().sqrt()
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[test]
fn tile_has_the_vertices_triangles_and_borders_of_the_mesh() {
    let (mesh, terrain) = meshed(MODEL);
    assert!(terrain.has_holes);
    let tile = Tile::read(&mesh, terrain);
    let json = written(&mesh, Format::Json, Some(terrain)).unwrap();
    let json: Value = serde_json::from_slice(&json).unwrap();
    let numbers = |name: &str| -> Vec<f64> {
        json[name].as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    };
    let (positions, samples) = (numbers("positions"), numbers("samples"));
    let places = positions.chunks(3).map(|p| (p[0] as usize, p[1] as usize));
    let places: Vec<(usize, usize)> = places.collect();
    let vertices = tile.vertices();
    assert_eq!(vertices.len(), places.len());
    let rounding = (tile.header("maxHeight") - tile.header("minHeight")) / 65_534.0 + 1e-4;
    for (x, y, height) in vertices {
        let at = places.iter().position(|&place| place == (x, y)).unwrap();
        let expected = terrain.steps.height(samples[2 * at]) * terrain.unit;
        assert!((height - expected).abs() <= rounding, "({x}, {y}): {height} for {expected}");
    }
    let faces = numbers("triangles");
    let faces = faces.chunks(3).map(|face| rotated([0, 1, 2].map(|i| places[face[i] as usize])));
    assert_eq!(tile.faces(), faces.collect());
    tile.check_borders();
    assert_eq!(tile.file["names"], serde_json::json!(["vertexNormals"]));
}

#[test]
fn header_and_normals_fit_the_earth() {
    let (mesh, terrain) = meshed(MODEL);
    let tile = Tile::read(&mesh, terrain);
    let [west, south, east, north] = terrain.degrees().unwrap();
    let vertices = tile.vertices();
    // East, north and up at a vertex, and its place on a sphere: near enough for small rectangles.
    let frame = |&(x, y, _): &(usize, usize, f64)| {
        let across = x as f64 / (tile.width - 1) as f64;
        let along = y as f64 / (tile.height - 1) as f64;
        let (sin_east, cos_east) = (west + (east - west) * across).to_radians().sin_cos();
        let (sin_north, cos_north) = (south + (north - south) * along).to_radians().sin_cos();
        [
            [-sin_east, cos_east, 0.0],
            [-sin_north * cos_east, -sin_north * sin_east, cos_north],
            [cos_north * cos_east, cos_north * sin_east, sin_north],
        ]
    };
    let middle = frame(&(tile.width / 2, tile.height / 2, 0.0))[2];
    for name in ["center", "boundingSphereCenter"] {
        let place = tile.place(name);
        assert!((6.35e6..6.38e6).contains(&length(place)), "{name}: {place:?}");
        assert!(dot(place, middle) / length(place) > 0.9999, "{name}: {place:?}");
    }
    let half = (east - west).hypot(north - south) * DEGREE / 2.0;
    let radius = tile.header("boundingSphereRadius");
    assert!(radius > 0.5 * half && radius < 1.01 * half, "{radius} of {half}");
    let occluded = tile.place("horizonOcclusionPoint");
    assert!((1.0..1.1).contains(&length(occluded)), "{occluded:?}");

    let metres = |(x, y, height): (usize, usize, f64)| {
        let [column, row] =
            [(east - west) / (tile.width - 1) as f64, (north - south) / (tile.height - 1) as f64];
        let narrow = f64::midpoint(south, north).to_radians().cos();
        [x as f64 * column * DEGREE * narrow, y as f64 * row * DEGREE, height]
    };
    let mut sums = vec![[0.0; 3]; vertices.len()];
    for face in tile.numbers("triangleIndices").chunks(3) {
        let [a, b, c] = [0, 1, 2].map(|i| metres(vertices[face[i]]));
        let (u, v): ([f64; 3], [f64; 3]) =
            (std::array::from_fn(|i| b[i] - a[i]), std::array::from_fn(|i| c[i] - a[i]));
        let product =
            [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        for &vertex in face {
            sums[vertex].iter_mut().zip(product).for_each(|(sum, part)| *sum += part);
        }
    }
    let normals = tile.normals();
    assert_eq!(normals.len(), vertices.len());
    for ((vertex, sum), normal) in vertices.iter().zip(sums).zip(normals) {
        let axes = frame(vertex);
        let local = axes.map(|axis| dot(axis, normal));
        let cosine = dot(local, scaled(sum, 1.0 / length(sum)));
        assert!(cosine > 0.999 && local[2] > 0.0, "{vertex:?}: {local:?} for {sum:?}");
    }
}

#[test]
fn tiles_of_many_vertices_have_indices_of_32_bits() {
    // An even and an odd number of vertices over 65,536.
    for (width, height) in [(300, 220), (301, 219)] {
        let model = format!(
            "{width} {height} 1 16\nOFF\n# elevation model: base -7 step 0.5 rounding 0 unit 1 \
             transform 10 0.001 0 50 0 -0.001 degrees epsg 4326\n0 0 0\n"
        );
        let terrain = probe_mesh(model.as_bytes(), &Limits::default()).unwrap().terrain.unwrap();
        let shape = Shape { width, height, component_count: 1, precision: 16 };
        let points =
            (0..height as i32).flat_map(|y| (0..width as i32).map(move |x| Point::new(x, y)));
        let points: Vec<Point> = points.collect();
        let samples = points.iter().map(|p| (p.x * 31 % 97 + p.y) as u16).collect();
        let faces = triangulate(&points);
        let mesh = Mesh::new(shape, points, samples, faces, &()).unwrap();
        let tile = Tile::read(&mesh, terrain);
        assert_eq!(tile.vertices().len(), width * height);
        assert_eq!(tile.faces().len(), mesh.faces().len());
        tile.check_borders();
    }
}

#[test]
fn meshes_that_are_not_in_degrees_are_refused() {
    let (mesh, terrain) = meshed(IN_METRES);
    assert!(terrain.degrees().is_none());
    for terrain in [Some(terrain), None] {
        let refused = written(&mesh, Format::Terrain, terrain).unwrap_err();
        assert!(matches!(refused, EncodeError::NotInDegrees), "{refused}");
        assert!(refused.to_string().contains("gdalwarp -t_srs EPSG:4326"), "{refused}");
    }
}
