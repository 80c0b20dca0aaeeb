//! MODEL there and back, and each defect with its line.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

use crate::samples::{crossings, meshes};
use pixmesh_codec::{Limits, ModelDefect, ModelError, read_model, write_model};
use pixmesh_meshing::alpha::premultiply_vectors;
use pixmesh_meshing::{Mesh, MeshError};
use proptest::prelude::*;

fn model(mesh: &Mesh) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_model(mesh, &mut bytes).unwrap();
    bytes
}

fn read(text: impl AsRef<[u8]>) -> Result<Mesh, ModelError> {
    read_model(text.as_ref(), &Limits::default())
}

/// Four corners and the centre of 3x3 pixels, line by line.
const FAN: [&str; 12] = [
    "3 3 1 8", "OFF", "5 4 8", "0 0 1", "2 0 2", "2 2 3", "0 2 4", "1 1 5", "3 0 1 4", "3 1 2 4",
    "3 2 3 4", "3 3 0 4",
];

/// The model of [`FAN`] with some lines, counted from 1, replaced.
fn fan_with(changes: &[(usize, &str)]) -> String {
    let mut lines = FAN;
    for &(line, text) in changes {
        lines[line - 1] = text;
    }
    lines.join("\n") + "\n"
}

/// The defect of such a model, with its line.
fn defect_of(changes: &[(usize, &str)]) -> ModelError {
    let text = fan_with(changes);
    read(&text).expect_err(&text)
}

proptest! {
    #[test]
    fn what_is_written_reads_back_as_the_same_mesh(mesh in meshes()) {
        prop_assert_eq!(read(model(&mesh)).unwrap(), mesh);
    }

    #[test]
    fn colors_of_faces_read_back_and_are_comments_to_others(mesh in meshes(), seed in any::<u16>()) {
        let shape = mesh.shape();
        let largest = u32::from(u16::MAX >> (16 - shape.precision)) + 1;
        let count = mesh.faces().len() * shape.component_count;
        let color = |i: usize| ((i as u32 * 40_503 + u32::from(seed)) % largest) as u16;
        let mut colors: Vec<u16> = (0..count).map(color).collect();
        premultiply_vectors(&mut colors, shape.component_count, (largest - 1) as u16);
        let flat = mesh.clone().with_face_samples(colors).unwrap();
        let text = model(&flat);
        prop_assert_eq!(read(&text).unwrap(), flat);
        let text = String::from_utf8(text).unwrap();
        let without: String =
            text.lines().filter(|line| !line.starts_with('#')).map(|line| line.to_owned() + "\n").collect();
        prop_assert_eq!(without.into_bytes(), model(&mesh));
    }

    #[test]
    fn no_bytes_make_the_reader_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        let _ = read(bytes);
    }

    #[test]
    fn no_change_of_one_token_makes_the_reader_panic(
        mesh in meshes(),
        place in any::<prop::sample::Index>(),
        token in "-?[0-9]{1,20}|[a-z#.]{1,3}|1e9|nan",
    ) {
        let text = String::from_utf8(model(&mesh)).unwrap();
        let mut tokens: Vec<&str> = text.split_whitespace().collect();
        let place = place.index(tokens.len());
        tokens[place] = &token;
        if let Err(error) = read(tokens.join("\n")) {
            prop_assert!(error.line >= 1 && error.line <= tokens.len());
        }
    }

    #[test]
    fn no_cut_makes_a_model_that_passes_or_panics(mesh in meshes()) {
        let text = model(&mesh);
        // The last line feed may be missing, and digits of the last index.
        let whole = text.trim_ascii_end().iter().rposition(|&byte| byte == b' ').unwrap() + 2;
        for end in (0..whole - 1).step_by(37) {
            prop_assert!(read(&text[..end]).is_err(), "cut at {}", end);
        }
    }
}

#[test]
fn the_written_text_is_laid_out_in_lines() {
    let mesh = crossings(&[0, 2], &[0, 1], 3, 8, |i| i as u16 * 10);
    let text = String::from_utf8(model(&mesh)).unwrap();
    assert_eq!(
        text,
        "3 2 3 8\nOFF\n4 2 5\n0 0 0 10 20\n2 0 30 40 50\n0 1 60 70 80\n2 1 90 100 110\n3 0 1 3\n3 0 3 2\n"
    );
}

#[test]
fn white_space_and_comments_do_not_matter() {
    let plain = read(fan_with(&[])).unwrap();
    let text = fan_with(&[]);
    for variant in [
        text.replace('\n', "\r\n"),
        text.replace('\n', "\r"),
        text.replace('\n', " "),
        text.replace('\n', "# to the end of the line\n"),
        text.trim_end().to_owned(),
        format!("# first\n\t{text}\n\n# last"),
        text.replace("5 4 8", "5 4 0"),
    ] {
        assert_eq!(read(&variant).as_ref(), Ok(&plain), "{variant:?}");
    }
}

#[test]
fn each_defect_is_reported_with_its_line() {
    type Change = (usize, &'static str);
    // What is changed, the line of the error, and what its message holds.
    let table: &[(&[Change], usize, &str)] = &[
        (&[(1, "0 3 1 8")], 1, "the width is 0, outside of 1"),
        (&[(1, "1 3 1 8")], 1, "1x3 cannot be meshed"),
        (&[(1, "3 -3 1 8")], 1, "the height is -3"),
        (&[(1, "100000 100000 1 8")], 1, "10000000000 pixels"),
        (&[(1, "20000 3 1 8")], 1, "side over the limit of 16384"),
        (&[(1, "3 3 0 8")], 1, "the number of components is 0"),
        (&[(1, "3 3 99999999999 8")], 1, "99999999999 components make 899999999991 samples"),
        (&[(1, "3 3 1 0")], 1, "the precision is 0, outside of 1 to 16"),
        (&[(1, "3 3 1 17")], 1, "the precision is 17"),
        (&[(2, "NOFF")], 2, "the word OFF is expected, not 'NOFF'"),
        (&[(2, "")], 3, "the word OFF is expected, not '5'"),
        (&[(3, "4294967295 4 8")], 3, "4294967295 vertices are announced"),
        (&[(3, "18446744073709551616 4 8")], 3, "the number of vertices is 18446744073709551616"),
        (&[(3, "-5 4 8")], 3, "the number of vertices is -5"),
        (&[(3, "5 4000000000 8")], 3, "4000000000 faces are announced"),
        (&[(3, "5 4 7")], 3, "7 edges are announced, but 5 vertices and 4 faces have 8"),
        (&[(3, "5 3 0")], 12, "'3' follows the last face"),
        (&[(3, "5 5 0")], 13, "the file ends where the face's number of corners"),
        (&[(3, "4 4 0")], 8, "the face has 1 corners"),
        (&[(5, "3 0 2")], 5, "the vertex's x is 3, outside of 0 to 2"),
        (&[(5, "2 -1 2")], 5, "the vertex's y is -1"),
        (&[(5, "2 0 256")], 5, "the vertex's sample is 256, outside of 0 to 255"),
        (&[(5, "2 0 1.5")], 5, "the vertex's sample must be a whole number, not '1.5'"),
        (&[(5, "2 0 1e2")], 5, "a whole number, not '1e2'"),
        (&[(5, "nan 0 2")], 5, "'nan' is not finite"),
        (&[(5, "2 1e999 2")], 5, "'1e999' is not finite"),
        (&[(5, "two 0 2")], 5, "the vertex's x is expected, not 'two'"),
        (&[(8, "2 2 5")], 8, "vertex 4 repeats the point (2, 2) of vertex 2"),
        (&[(7, "0 1 4")], 3, "corner (0, 2) is not a vertex"),
        (&[(10, "4 1 2 3 4")], 10, "the face has 4 corners"),
        (&[(10, "3 1 2 5")], 10, "the face names vertex 5, but the 5 vertices"),
        (&[(10, "3 1 2 -1")], 10, "the face names vertex -1"),
        (&[(10, "3 1 2 4294967300")], 10, "the face names vertex 4294967300"),
        (&[(10, "3 1 2 x")], 10, "the index of a vertex is expected, not 'x'"),
        (&[(10, "3 1 1 4")], 10, "face 1 is degenerate"),
        (&[(10, "3 0 2 4")], 10, "face 1 is degenerate"),
        (&[(10, "3 2 1 4")], 10, "face 1 is clockwise"),
        (&[(11, "3 1 2 4")], 11, "face 2 overlaps another"),
        (&[(3, "5 3 7"), (11, "")], 10, "face 1 has no neighbour"),
        (&[(12, "3 3 0 4 7")], 12, "'7' follows the last face"),
        (&[(12, "3 3 0")], 13, "the file ends where the index of a vertex"),
    ];
    for &(changes, line, message) in table {
        let error = defect_of(changes);
        assert_eq!(error.line, line, "{changes:?}: {error}");
        assert!(error.to_string().contains(message), "{changes:?}: {error}");
    }
}

#[test]
fn damaged_colors_of_faces_are_reported_with_their_line() {
    let with = |comments: &str| read(fan_with(&[]) + comments);
    let colors = "# any other comment\n# face samples: 4\n# 9\n# 8\n# 7\n# 255\n";
    assert_eq!(with(colors).unwrap().face_samples(), Some(&[9, 8, 7, 255][..]));
    assert_eq!(with("# face samples:\n").unwrap_err().line, 13);
    for (comments, line, defect) in [
        ("# face samples: 5\n", 13, "the number of faces with samples is 5, outside of 4 to 4"),
        ("# face samples: 4\n# 9\n", 15, "the comment with the samples of face 1 is missing"),
        (&colors.replace("255", "256"), 18, "the face's sample is 256, outside of 0 to 255"),
        (&colors.replace('7', "7 7"), 17, "the face has more samples than the image components"),
        (&colors.replace("# 8", "#"), 16, "the file ends where the face's sample is expected"),
    ] {
        let error = with(comments).expect_err(comments);
        assert_eq!((error.line, &*error.defect.to_string()), (line, defect));
    }
}

#[test]
fn faces_that_leave_a_corner_open_or_a_vertex_unused_are_refused() {
    let square = "3 3 1 8 OFF 5 2 0\n0 0 0\n2 0 0\n2 2 0\n0 2 0\n1 1 0\n3 0 1 2\n3 0 2 3\n";
    let error = read(square).unwrap_err();
    assert_eq!(error.line, 6);
    assert!(matches!(error.defect, ModelDefect::Mesh(MeshError::VertexUnused { vertex: 4 })));
    let no_faces = "3 3 1 8 OFF\n4 0 0\n0 0 0\n2 0 0\n2 2 0\n0 2 0\n";
    let error = read(no_faces).unwrap_err();
    assert_eq!(error.line, 2);
    assert!(matches!(error.defect, ModelDefect::Mesh(MeshError::Area { actual: 0, .. })));
    assert_eq!(read("2 2 1 8 OFF 0 0 0").unwrap_err().line, 1);
}

#[test]
fn lines_are_right_for_several_components_and_crlf() {
    let mesh = crossings(&[0, 3, 5], &[0, 4], 3, 8, |i| i as u16);
    let text = String::from_utf8(model(&mesh)).unwrap().replace('\n', "\r\n");
    let lines: Vec<&str> = text.lines().collect();
    let (third_face, swapped) = (lines[11], lines[11].replacen("3 1 2 4", "3 2 1 4", 1));
    assert_ne!(third_face, swapped);
    let error = read(text.replacen(third_face, &swapped, 1)).unwrap_err();
    assert_eq!(error.to_string(), "line 12: face 2 is clockwise");
}

#[test]
fn the_limits_apply_to_the_image_that_the_mesh_models() {
    let text = fan_with(&[]);
    let limits = |max_pixels, max_side| Limits { max_pixels, max_side };
    assert!(read_model(text.as_bytes(), &limits(9, 3)).is_ok());
    assert!(read_model(text.as_bytes(), &limits(8, 3)).is_err());
    assert!(read_model(text.as_bytes(), &limits(9, 2)).is_err());
    let five = "3 3 5 8 OFF 0 0 0";
    assert_eq!(
        read_model(five.as_bytes(), &limits(9, 3)).unwrap_err().to_string(),
        "line 1: 5 components make 45 samples, more than the limit of 36"
    );
}

#[test]
fn floods_of_comments_and_garbage_are_refused_at_once() {
    assert!(matches!(read("").unwrap_err().defect, ModelDefect::Malformed(_)));
    assert_eq!(read("#".repeat(1 << 20)).unwrap_err().line, 1);
    assert_eq!(read("#\n".repeat(1 << 20)).unwrap_err().line, (1 << 20) + 1);
    let flood = [vec![b'x'; 1 << 24], b" 1".to_vec()].concat();
    assert!(read(flood).unwrap_err().to_string().len() < 100);
    assert!(read(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR").is_err());
}

#[test]
fn comments_are_lines_of_their_own_and_change_nothing() {
    let shape = pixmesh_meshing::Shape { width: 2, height: 2, component_count: 1, precision: 8 };
    let points = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| pixmesh_meshing::Point::new(x, y));
    let mesh = Mesh::new(shape, points.to_vec(), vec![1, 2, 3, 4], vec![[0, 1, 2], [1, 3, 2]], &())
        .unwrap();
    let mut text = Vec::new();
    let comments = ["connectivity free: of another kind", "two\nlines"];
    pixmesh_codec::write_model_with_comments(&mesh, &comments, &mut text).unwrap();
    let lines: Vec<&[u8]> = text.split(|&byte| byte == b'\n').collect();
    assert_eq!(lines[2], b"# connectivity free: of another kind");
    assert_eq!(lines[3..5], [&b"# two"[..], b"# lines"]);
    let read = read_model(&text, &Limits::default()).unwrap();
    assert_eq!(read, mesh);
    // The other diagonal of the square is the preferred one.
    assert_eq!(read.is_preferred_delaunay(&()), Ok(false));
}
