//! 6.7: meshes that are sent to be rebuilt or compared.

use crate::client::{field, form};
use crate::pictures::disc;
use crate::table::{Expected, Request, Row, check, post, rebuild};
use std::time::Duration;

const INVALID: Expected = Expected::Refused(422, "mesh-invalid");
/// Four corners and the centre of 3x3 pixels, line by line.
const FAN: [&str; 12] = [
    "3 3 1 8", "OFF", "5 4 8", "0 0 1", "2 0 2", "2 2 3", "0 2 4", "1 1 5", "3 0 1 4", "3 1 2 4",
    "3 2 3 4", "3 3 0 4",
];

/// The mesh of [`FAN`] with some lines, counted from 1, in place of its own.
fn fan(changes: &[(usize, &str)]) -> Request {
    let mut lines = FAN;
    for &(line, text) in changes {
        lines[line - 1] = text;
    }
    rebuild(lines.join("\n") + "\n")
}

fn fans(changes: &[(usize, &str)]) -> Vec<Request> {
    changes.iter().map(|change| fan(&[*change])).collect()
}

fn of_numbers() -> Vec<Row> {
    vec![
        Row::new(
            "M01",
            "counts of 2^32-1 vertices, of more faces than the file can hold",
            Expected::Refused(422, "mesh-too-large"),
            || fans(&[(3, "4294967295 4 8"), (3, "5 4000000000 8")]),
        ),
        Row::new(
            "M01b",
            "negative counts, counts beyond 64 bits, that do not match, an edge count that cannot be",
            INVALID,
            || {
                fans(&[
                    (3, "-5 4 8"),
                    (3, "18446744073709551616 4 8"),
                    (3, "4 4 0"),
                    (3, "5 3 0"),
                    (3, "5 5 0"),
                    (3, "5 4 7"),
                ])
            },
        ),
        Row::new(
            "M02",
            "indices of n, -1, 2^31, 2^32+4",
            Expected::Refused(422, "index-out-of-range"),
            || {
                fans(&[
                    (10, "3 1 2 5"),
                    (10, "3 1 2 -1"),
                    (10, "3 1 2 2147483648"),
                    (10, "3 1 2 4294967300"),
                ])
            },
        )
        .and(|answer| assert_eq!(answer.json()["line"], 10)),
        Row::new(
            "M03",
            "coordinates and samples of NaN, inf, 1e999",
            Expected::Refused(422, "not-finite"),
            || {
                fans(&[
                    (5, "nan 0 2"),
                    (5, "2 inf 2"),
                    (5, "2 1e999 2"),
                    (5, "2 0 -inf"),
                    (1, "nan 3 1 8"),
                ])
            },
        ),
        Row::new("M03b", "coordinates and samples with a fraction or an exponent", INVALID, || {
            fans(&[(5, "2.5 0 2"), (5, "2 1e1 2"), (5, "2 0 1.5"), (5, "2 0 5e-324")])
        }),
        Row::new(
            "M04",
            "coordinates outside the picture, samples over its precision",
            INVALID,
            || fans(&[(5, "3 0 2"), (5, "2 -1 2"), (5, "2 4294967296 2"), (5, "2 0 256")]),
        ),
        Row::new(
            "M10",
            "a mesh of another size or other components than the picture it is compared with",
            Expected::Refused(422, "shape-mismatch"),
            || {
                let model = FAN.join("\n");
                let compared = |picture: Vec<u8>| {
                    let (content_type, body) = form(&[
                        (&field("image"), &picture),
                        (&field("approximation"), model.as_bytes()),
                    ]);
                    post("/v1/comparisons", &[("Content-Type", &content_type)], body)
                };
                vec![compared(disc(20, 20, 1)), compared(disc(3, 3, 3))]
            },
        ),
        Row::new(
            "M11",
            "four corners of 20000x20000, of 16384x16384, of 4000000000 components",
            Expected::Refused(422, "image-too-large"),
            || {
                ["20000 20000 1 8", "16384 16384 1 8", "3 3 4000000000 8"]
                    .map(|line| fan(&[(1, line)]))
                    .into()
            },
        ),
    ]
}

fn of_shapes() -> Vec<Row> {
    vec![
        Row::new(
            "M05",
            "faces of no area, clockwise, twice, that overlap, that leave a hole, a T-junction; vertices twice",
            INVALID,
            || {
                let mut requests = fans(&[
                    (10, "3 1 1 4"),
                    (10, "3 0 2 4"),
                    (10, "3 2 1 4"),
                    (10, "3 0 1 4"),
                    (11, "3 1 2 4"),
                    (8, "2 2 5"),
                ]);
                // The upper triangle is missing, and the number of faces says so.
                requests.push(rebuild("3 3 1 8\nOFF\n5 3 0\n0 0 1\n2 0 2\n2 2 3\n0 2 4\n1 1 5\n3 0 1 4\n3 1 2 4\n3 3 0 4\n"));
                // The middle of the lower side is a corner of two faces and lies on a side of none.
                requests.push(rebuild("3 3 1 8\nOFF\n5 4 0\n0 0 1\n2 0 2\n2 2 3\n0 2 4\n1 0 5\n3 0 1 2\n3 0 2 3\n3 0 4 3\n3 4 1 2\n"));
                requests
            },
        ),
        Row::new(
            "M06",
            "sides that cross each other, a side from a vertex to itself",
            INVALID,
            || {
                vec![
                    rebuild("3 3 1 8\nOFF\n4 2 5\n0 0 1\n2 0 2\n2 2 3\n0 2 4\n3 0 1 2\n3 0 1 3\n"),
                    rebuild("3 3 1 8\nOFF\n4 2 5\n0 0 1\n2 0 2\n2 2 3\n0 2 4\n3 0 0 2\n3 0 2 3\n"),
                ]
            },
        ),
        Row::new(
            "M07",
            "vertices of no face, no faces, no vertices, one triangle",
            INVALID,
            || {
                vec![
                    rebuild(
                        "3 3 1 8\nOFF\n5 2 0\n0 0 1\n2 0 2\n2 2 3\n0 2 4\n1 1 5\n3 0 1 2\n3 0 2 3\n",
                    ),
                    rebuild("3 3 1 8\nOFF\n4 0 0\n0 0 1\n2 0 2\n2 2 3\n0 2 4\n"),
                    rebuild("3 3 1 8\nOFF\n0 0 0\n"),
                    rebuild("3 3 1 8\nOFF\n3 1 3\n0 0 1\n2 0 2\n2 2 3\n3 0 1 2\n"),
                ]
            },
        ),
        Row::new(
            "M12",
            "a face with a side of three vertices in a line, on the rim",
            INVALID,
            || {
                vec![rebuild(
                    "3 3 1 8\nOFF\n5 3 0\n0 0 1\n2 0 2\n2 2 3\n0 2 4\n1 0 5\n3 0 4 3\n3 4 1 3\n3 1 2 0\n",
                )]
            },
        ),
    ]
}

fn of_text() -> Vec<Row> {
    vec![
        Row::new("M08", "garbage, the word OFF missing, another version, something after the end", INVALID, || {
            let mut requests = fans(&[(2, "NOFF"), (2, "COFF"), (2, ""), (12, "3 3 0 4 9")]);
            requests.push(rebuild("nonsense"));
            requests.push(rebuild(vec![0xFF; 100_000]));
            requests.push(rebuild(vec![0; 100_000]));
            requests
        }),
        Row::new("M08b", "lines that end in CR LF, in CR, not at all; comments", Expected::Served, || {
            let text = FAN.join("\n");
            [
                text.replace('\n', "\r\n"),
                text.replace('\n', "\r"),
                text.replace('\n', " "),
                text.replace('\n', "# and a comment\n"),
            ]
            .map(rebuild)
            .into()
        }),
        Row::new("M08c", "one line of 16 MiB; 16 MiB of comments, of blanks, of digits", INVALID, || {
            let flood = |start: &str, with| rebuild([start.as_bytes(), &vec![with; 16 << 20]].concat());
            vec![flood("", b'x'), flood("#", b'x'), flood("", b' '), flood("3 3 1 8\nOFF\n", b'7'), flood("", b'\n')]
        })
        .and(|answer| assert!(answer.body.len() < 1000, "{}", answer.body.len()))
        .within(Duration::from_secs(2))
        .taking(128),
        Row::new("M09", "GLB, glTF with buffers on the disk or the network, pmesh, STL, PLY: only MODEL is read", INVALID, || {
            let gltf = br#"{"asset":{"version":"2.0"},"buffers":[{"uri":"file:///etc/passwd","byteLength":9},{"uri":"http://127.0.0.1:1/x","byteLength":9}]}"#;
            let starts: [&[u8]; 6] = [
                b"glTF\x02\0\0\0\xFF\xFF\xFF\xFF\0\0\0\0JSON",
                gltf,
                b"PDDT\0\0\0\0",
                b"solid x\nfacet normal 0 0 0\n",
                b"ply\nformat ascii 1.0\n",
                b"\x89PNG\r\n\x1a\n",
            ];
            starts.map(|start| rebuild(start.to_vec())).into()
        })
        .and(|answer| assert!(!answer.text().contains("root:"))),
        Row::new("M13", "an empty mesh file", Expected::Refused(400, "empty-file"), || vec![rebuild("")]),
        Row::new("M14", "a mesh that claims to be a picture", Expected::Refused(415, "unsupported-media-type"), || {
            vec![post("/v1/reconstructions", &[("Content-Type", "image/png")], FAN.join("\n").into_bytes())]
        }),
    ]
}

/// The rows of this chapter.
pub(crate) fn rows() -> Vec<Row> {
    [of_numbers(), of_shapes(), of_text()].into_iter().flatten().collect()
}

#[test]
fn what_is_no_mesh_is_refused_and_says_why() {
    check(&[], &rows());
}
