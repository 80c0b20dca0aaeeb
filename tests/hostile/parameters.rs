//! 6.6: parameters, each value by every way there is: the query, a field, JSON, a job.

use crate::client::{field, form};
use crate::pictures::disc;
use crate::table::{Expected, Request, Row, check, mesh, post};
use serde_json::json;
use std::time::Duration;

const OUT_OF_RANGE: Expected = Expected::Refused(422, "parameter-out-of-range");
const MALFORMED: Expected = Expected::Refused(400, "parameter-malformed");
const NOT_FINITE: Expected = Expected::Refused(422, "not-finite");
const JSON_MALFORMED: Expected = Expected::Refused(400, "json-malformed");

fn picture() -> Vec<u8> {
    disc(20, 20, 1)
}

fn escaped(text: &str) -> String {
    let escape = |byte: u8| match byte {
        b'0'..=b'9' | b'a'..=b'z' | b'A'..=b'Z' | b'-' | b'.' | b'_' => {
            char::from(byte).to_string()
        }
        _ => format!("%{byte:02X}"),
    };
    text.bytes().map(escape).collect()
}

fn form_of(parts: &[(&str, &[u8])]) -> Request {
    let (content_type, body) = form(parts);
    post("/v1/meshes", &[("Content-Type", &content_type)], body)
}

fn params(text: &[u8]) -> Request {
    form_of(&[(&field("params"), text), (&field("image"), &picture())])
}

/// The same pairs by every way.
fn every_way(pairs: &[(&str, &str)]) -> Vec<Request> {
    let query = pairs.iter().map(|(name, value)| format!("{name}={}", escaped(value)));
    let query = query.collect::<Vec<_>>().join("&");
    let members: Vec<String> =
        pairs.iter().map(|(name, value)| format!("{}:{}", json!(name), json!(value))).collect();
    let object = format!("{{{}}}", members.join(","));
    let mut parts: Vec<(String, &[u8])> =
        pairs.iter().map(|(name, value)| (field(name), value.as_bytes())).collect();
    let image = picture();
    parts.push((field("image"), &image));
    let parts: Vec<_> =
        parts.iter().map(|(headers, content)| (headers.as_str(), *content)).collect();
    vec![
        mesh(&query, picture()),
        post(&format!("/v1/jobs?{query}"), &[], picture()),
        form_of(&parts),
        params(object.as_bytes()),
    ]
}

fn values(name: &'static str, values: &'static [&'static str]) -> impl Fn() -> Vec<Request> {
    move || values.iter().flat_map(|value| every_way(&[(name, value)])).collect()
}

fn of_numbers() -> Vec<Row> {
    vec![
        Row::new("P01", "`density=0`", OUT_OF_RANGE, values("density", &["0"])).and(|answer| {
            let problem = answer.json();
            assert!(problem["minimum"].is_number() && problem["maximum"].is_number(), "{problem}");
        }),
        Row::new(
            "P02",
            "`density` of -1, 101, 100.0000001, 1e308, -0.0, 1e-320",
            OUT_OF_RANGE,
            values("density", &["-1", "101", "100.0000001", "1e308", "-0.0", "1e-320"]),
        ),
        Row::new(
            "P03",
            "`density` of NaN, inf, +Infinity, 1e309",
            NOT_FINITE,
            values("density", &["NaN", "nan", "inf", "-inf", "+Infinity", "1e309", "-1e309"]),
        ),
        Row::new(
            "P04",
            "`density` of nothing, ` 5 `, 5%, 5,0, 0x10, an Arabic digit, 1_000",
            MALFORMED,
            values(
                "density",
                &["", " 5 ", "5%", "5,0", "0x10", "\u{665}", "1_000", "5\u{0301}", "\u{FF15}"],
            ),
        ),
        Row::new("P05", "`density=100`: every pixel a vertex", Expected::Served, || {
            vec![mesh("density=100&method=mgpr", picture())]
        })
        .and(|answer| assert_eq!(answer.header("mesh-vertices"), "400"))
        .within(Duration::from_secs(5)),
        Row::new("P06", "`size=3`: fewer than the corners", OUT_OF_RANGE, values("size", &["3"])),
        Row::new(
            "P07",
            "`size` of 0, -1, 2^32, more than pixels, 2^64",
            OUT_OF_RANGE,
            values("size", &["0", "-1", "4294967296", "401", "18446744073709551616"]),
        ),
        Row::new(
            "P07b",
            "`size` of 1e6, 3.5, 10.0",
            MALFORMED,
            values("size", &["1e6", "3.5", "10.0"]),
        ),
        Row::new(
            "P12",
            "`seed` of 2^64, `tolerance` of 10^11, `gamma` of 1001 and of 0.5",
            OUT_OF_RANGE,
            || {
                let pairs = [
                    ("seed", "18446744073709551616"),
                    ("tolerance", "99999999999"),
                    ("gamma", "1001"),
                    ("gamma", "0.5"),
                ];
                pairs.iter().flat_map(|pair| every_way(&[*pair])).collect()
            },
        ),
        Row::new(
            "P15",
            "a number of 8000 digits, of 8000 zeros before it",
            Expected::OneOf(&[(422, "parameter-out-of-range"), (422, "not-finite")]),
            || {
                let digits = "9".repeat(7000);
                let mut requests = vec![
                    mesh(&format!("size={digits}"), picture()),
                    mesh(&format!("density={digits}"), picture()),
                ];
                requests.push(mesh(&format!("density=1e-{digits}"), picture()));
                requests
            },
        )
        .and(|answer| assert!(answer.body.len() < 1000, "{}", answer.body.len())),
        Row::new(
            "P16",
            "lengths at the ends of what is allowed, in every format that has lengths",
            Expected::ServedOr(&[(422, "parameter-out-of-range")]),
            || {
                let formats = ["glb", "gltf", "ply", "obj", "stl", "svg", "json"];
                let extremes = [
                    "height=1e300",
                    "z_scale=1e300",
                    "pixel_size=1e300",
                    "pixel_size=1e-300&height=1e300",
                    "base=1e300&height=1",
                ];
                let of = |format: &&str| {
                    extremes.map(|query| mesh(&format!("format={format}&{query}"), picture()))
                };
                formats.iter().flat_map(of).collect()
            },
        )
        .and(|answer| {
            let text = answer.text().to_lowercase();
            assert!(!text.contains("nan") && !text.contains("inf\n") && !text.contains("infinity"));
        }),
    ]
}

fn of_names() -> Vec<Row> {
    vec![
        Row::new(
            "P08",
            "`density` and `size`; `target_psnr` and `size`; `gamma` and `initial_size`",
            Expected::Refused(422, "conflicting-parameters"),
            || {
                let pairs = [
                    [("density", "5"), ("size", "50")],
                    [("target_psnr", "30"), ("size", "50")],
                    [("gamma", "4"), ("initial_size", "50")],
                ];
                pairs.iter().flat_map(|pairs| every_way(pairs)).collect()
            },
        ),
        Row::new(
            "P09",
            "`density=1` and `density=99`, one of them escaped, one a field",
            Expected::Refused(400, "duplicate-parameter"),
            || {
                let mut requests = every_way(&[("density", "1"), ("density", "99")]);
                requests.push(mesh("density=1&%64ensity=1", picture()));
                let (content_type, body) =
                    form(&[(&field("density"), b"1"), (&field("image"), &picture())]);
                requests.push(post(
                    "/v1/meshes?density=1",
                    &[("Content-Type", &content_type)],
                    body,
                ));
                requests
            },
        ),
        Row::new(
            "P10",
            "`desnity=5`, `Density=5`, a name of 4000 letters, no name",
            Expected::Refused(400, "unknown-parameter"),
            || {
                let long = "n".repeat(4000);
                [("desnity", "5"), ("Density", "5"), (&long, "5"), ("\u{0434}ensity", "5")]
                    .iter()
                    .flat_map(|pair| every_way(&[*pair]))
                    .chain([mesh("=5", picture())])
                    .collect()
            },
        )
        .and(|answer| assert!(answer.body.len() < 1000, "{}", answer.text())),
        Row::new(
            "P11",
            "unknown method, format, policy, in another case, empty",
            Expected::Refused(422, "unknown-value"),
            || {
                let pairs = [
                    ("method", "MED"),
                    ("method", ""),
                    ("format", "gif"),
                    ("format", "PNG"),
                    ("policy", "psa"),
                    ("leaky", "yes"),
                ];
                let sent = pairs.iter();
                sent.flat_map(|pair| every_way(&[*pair])).collect()
            },
        )
        .and(|answer| assert!(answer.json()["allowed"].is_array(), "{}", answer.text())),
        Row::new(
            "P14",
            "`%zz`, `%00`, overlong UTF-8, a lone percent, controls",
            Expected::Refused(400, "query-malformed"),
            || {
                ["%zz", "%00", "%C0%AF", "%", "%4", "%ED%A0%80", "%0d%0aX:1", "%7f"]
                    .map(|value| mesh(&format!("density={value}"), picture()))
                    .into()
            },
        ),
        Row::new("P14b", "`density=+5`: a plus is a plus", MALFORMED, || {
            vec![mesh("density=+5", picture())]
        }),
        Row::new("P17", "4000 parameters", Expected::Refused(400, "duplicate-parameter"), || {
            vec![mesh(&"seed=1&".repeat(1100), picture())]
        }),
    ]
}

fn of_json() -> Vec<Row> {
    vec![
        Row::new(
            "P13",
            "JSON of depth 10000, of 1e400, with a byte-order mark, a comma at the end, bad UTF-8, a lone surrogate, null, two objects",
            JSON_MALFORMED,
            || {
                let deep =
                    [b"{\"density\":".as_slice(), &[b'['; 10_000], &[b']'; 10_000], b"}"].concat();
                let objects = b"{\"a\":".repeat(10_000);
                [
                    deep.as_slice(),
                    &objects,
                    b"{\"density\": 1e400}",
                    b"\xEF\xBB\xBF{}",
                    b"{\"density\": 5,}",
                    b"[]",
                    b"",
                    b"{\"method\": \"\xFF\"}",
                    b"{\"method\": \"\\ud800\"}",
                    b"{} {}",
                    b"{\"leaky\": null}",
                    b"{'density': 5}",
                    b"{\"density\": NaN}",
                    b"{\"density\": 05}",
                ]
                .map(params)
                .into()
            },
        ),
        Row::new(
            "P13b",
            "JSON with a key twice, as itself and escaped",
            Expected::Refused(400, "duplicate-parameter"),
            || {
                vec![
                    params(br#"{"density": 5, "density": 6}"#),
                    params(br#"{"density": 5, "\u0064ensity": 5}"#),
                ]
            },
        ),
        Row::new(
            "P13c",
            "a job in JSON whose picture is no base64, a number, there twice; of depth 100000",
            Expected::OneOf(&[
                (400, "json-malformed"),
                (400, "parameter-malformed"),
                (400, "duplicate-parameter"),
            ]),
            || {
                let deep = [b"{\"params\":".repeat(100_000), b"}".repeat(100_000)].concat();
                let bodies: [&[u8]; 5] = [
                    b"{\"image\": \"A\"}",
                    b"{\"image\": 5}",
                    b"{\"image\": \"AQID\", \"image\": \"AQID\"}",
                    b"{\"image\": \"AQ\\u0000ID\"}",
                    &deep,
                ];
                bodies
                    .map(|body| {
                        post("/v1/jobs", &[("Content-Type", "application/json")], body.to_vec())
                    })
                    .into()
            },
        ),
        Row::new(
            "P13d",
            "a job in JSON of 2 million tiny members, its own or those of its parameters",
            Expected::Refused(400, "unknown-parameter"),
            || {
                let members: Vec<_> = (0..2_000_000).map(|n| format!("\"{n:x}\":1")).collect();
                let members = members.join(",");
                [format!("{{{members}}}"), format!("{{\"params\":{{{members}}}}}")]
                    .map(|body| {
                        post("/v1/jobs", &[("Content-Type", "application/json")], body.into())
                    })
                    .into()
            },
        )
        .within(Duration::from_secs(2)),
    ]
}

/// The rows of this chapter.
pub(crate) fn rows() -> Vec<Row> {
    [of_numbers(), of_names(), of_json()].into_iter().flatten().collect()
}

#[test]
fn wrong_values_are_refused_the_same_whichever_way_they_come() {
    check(&[], &rows());
}
