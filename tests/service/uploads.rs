//! How an image may be sent, and what a form must be like.

use crate::client::{Answer, connect, exchange, field, form, receive, send};
use crate::in_process::Service;
use crate::pictures::{disc, flat};
use crate::server::Client;
use std::io::Write;
use std::time::Instant;

const IMAGE: &str = "Content-Disposition: form-data; name=\"image\"; filename=\"../../etc/passwd\"";

fn post_form(server: &Client, query: &str, parts: &[(&str, &[u8])]) -> Answer {
    let (content_type, body) = form(parts);
    let target = format!("/v1/meshes?{query}");
    send(server.public, "POST", &target, &[("Content-Type", &content_type)], &body)
}

#[test]
fn a_raw_body_a_form_and_json_parameters_all_mean_the_same() {
    let server = Service::start(&[]);
    let image = disc(50, 40, 3);
    let raw = server.mesh("density=3&method=med", &[("Content-Type", "image/png")], &image);
    assert_eq!(raw.status, 200, "{}", raw.text());
    let fields: [(&str, &[u8]); 3] =
        [(&field("density"), b"3"), (IMAGE, &image), (&field("method"), b"med")];
    let json: [(&str, &[u8]); 2] =
        [(IMAGE, &image), (&field("params"), br#"{"density": 3, "method": "med"}"#)];
    let mixed: [(&str, &[u8]); 2] = [(IMAGE, &image), (&field("params"), br#"{"density": 3.0}"#)];
    for answer in [
        post_form(&server, "", &fields),
        post_form(&server, "", &json),
        post_form(&server, "method=med", &mixed),
        post_form(&server, "method=med&density=3", &[(IMAGE, &image)]),
    ] {
        assert_eq!(answer.status, 200, "{}", answer.text());
        assert_eq!(answer.header("etag"), raw.header("etag"));
    }
}

#[test]
fn the_content_decides_and_not_the_label() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    for label in ["image/jpeg", "image/nonsense", "application/octet-stream; x=y", "IMAGE/PNG"] {
        let answer = server.mesh("", &[("Content-Type", label)], &image);
        assert_eq!(answer.status, 200, "{label}: {}", answer.text());
    }
    for label in ["text/html", "application/json", "", "x"] {
        let answer = server.mesh("", &[("Content-Type", label)], &image);
        answer.problem(415, "unsupported-media-type");
    }
    let labelled = format!("{IMAGE}\r\nContent-Type: text/html");
    post_form(&server, "", &[(&labelled, &image)]).problem(415, "unsupported-media-type");
    let labelled = format!("{IMAGE}\r\nContent-Type: image/gif");
    assert_eq!(post_form(&server, "", &[(&labelled, &image)]).status, 200);
}

#[test]
fn compressed_bodies_are_refused_unread() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    for encoding in ["gzip", "br", "identity, gzip", "zstd"] {
        let answer = server.mesh("", &[("Content-Encoding", encoding)], &image);
        answer.problem(415, "unsupported-encoding");
        assert_eq!(answer.header("accept-encoding"), "identity");
    }
    assert_eq!(server.mesh("", &[("Content-Encoding", "identity")], &image).status, 200);
}

#[test]
fn a_form_must_have_one_image_and_no_more_than_sixteen_parts() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    let image: (&str, &[u8]) = (IMAGE, &image);
    let density = field("density");
    let density: (&str, &[u8]) = (&density, b"5");
    let params = field("params");
    let params: (&str, &[u8]) = (&params, b"{}");
    post_form(&server, "", &[density]).problem(400, "image-missing");
    post_form(&server, "", &[]).problem(400, "image-missing");
    post_form(&server, "", &[image, image]).problem(400, "duplicate-part");
    post_form(&server, "", &[image, params, params]).problem(400, "duplicate-part");
    post_form(&server, "", &[image, density, density]).problem(400, "duplicate-parameter");
    post_form(&server, "density=5", &[image, density]).problem(400, "duplicate-parameter");
    let nameless: (&str, &[u8]) = ("Content-Disposition: form-data", b"5");
    post_form(&server, "", &[image, nameless]).problem(400, "multipart-malformed");
    let unknown = field("desnity");
    let problem =
        post_form(&server, "", &[image, (&unknown, b"5")]).problem(400, "unknown-parameter");
    assert_eq!(problem["nearest"], "density");
    let names = [
        "method",
        "density",
        "gamma",
        "initial",
        "policy",
        "startup",
        "scan",
        "leaky",
        "tolerance",
        "smoothing",
        "smoothing_order",
        "boundary",
        "bad_point_removal",
        "seed",
        "format",
    ];
    let values = [
        "mgprfs",
        "5",
        "4",
        "ed",
        "psd_max_d",
        "classic",
        "raster",
        "false",
        "10",
        "mean",
        "5",
        "zero",
        "false",
        "1",
        "model",
    ];
    let headers = names.map(field);
    let mut parts: Vec<(&str, &[u8])> = vec![image];
    parts.extend(headers.iter().zip(values).map(|(h, v)| (h.as_str(), v.as_bytes())));
    assert_eq!(parts.len(), 16);
    assert_eq!(post_form(&server, "", &parts).status, 200);
    parts.push(params);
    let problem = post_form(&server, "", &parts).problem(400, "too-many-parts");
    assert_eq!(problem["limit"], 16);
    let many = vec![density; 5000];
    post_form(&server, "", &many).problem(400, "duplicate-parameter");
}

#[test]
fn a_picture_in_a_part_of_another_name_is_refused_with_both_names() {
    let server = Service::start(&[]);
    let heic = b"\0\0\0\x18ftypheic\0\0\0\0mif1heic";
    for image in [&disc(20, 20, 1)[..], heic] {
        for name in ["file", "density"] {
            let part = format!("{}; filename=\"photo\"", field(name));
            let problem = post_form(&server, "", &[(&part, image)]).problem(400, "image-missing");
            let detail =
                format!("the part '{name}' holds a picture: name it 'image' or 'weights' instead");
            assert_eq!(problem["detail"], detail);
            assert_eq!((&problem["param"], &problem["actual"]), (&"image".into(), &name.into()));
        }
    }
}

#[test]
fn a_mesh_in_a_part_of_another_name_is_refused_with_both_names() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    for format in ["model", "pmesh"] {
        let mesh = server.mesh(&format!("size=30&format={format}"), &[], &image).body;
        let (label, body) = form(&[(&field("file"), &mesh)]);
        let headers = [("Content-Type", label.as_str())];
        let answer = send(server.public, "POST", "/v1/conversions?format=svg", &headers, &body);
        let problem = answer.problem(400, "part-missing");
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.starts_with("the part 'file' holds a mesh: name it 'mesh'"), "{detail}");
    }
}

#[test]
fn slips_with_curl_are_answered_with_the_option_to_use() {
    let server = Service::start(&[]);
    let urlencoded = [("Content-Type", "application/x-www-form-urlencoded")];
    let detail = |body: &[u8]| {
        let problem = server.mesh("", &urlencoded, body).problem(400, "bad-request");
        problem["detail"].as_str().unwrap().to_owned()
    };
    let image = disc(20, 20, 3);
    assert_eq!(server.mesh("", &urlencoded, &image).status, 200);
    let stripped: Vec<u8> = image.into_iter().filter(|byte| !b"\0\r\n".contains(byte)).collect();
    assert!(detail(&stripped).contains("`curl --data-binary @file`"));
    assert!(detail(b"photos/My Photo.PNG").contains("--data-binary @photos/My Photo.PNG"));
}

#[test]
fn a_form_that_cannot_be_read_is_refused() {
    let server = Service::start(&[]);
    let malformed = |content_type: &str, body: &[u8]| {
        let headers = [("Content-Type", content_type)];
        let answer = send(server.public, "POST", "/v1/meshes", &headers, body);
        answer.problem(400, "multipart-malformed");
    };
    malformed("multipart/form-data", b"--limit\r\n");
    malformed("multipart/form-data; boundary=limit", b"--limit\r\nContent-Dis");
    malformed("multipart/form-data; boundary=other", b"--limit\r\n\r\nabc\r\n--limit--\r\n");
    let headers = "X: y\r\n".repeat(10_000);
    let (content_type, body) = form(&[(&format!("{headers}{IMAGE}"), b"abc")]);
    malformed(&content_type, &body);
    let mixed = format!("{IMAGE}\r\nContent-Type: multipart/mixed; boundary=inner");
    let answer = post_form(&server, "", &[(&mixed, b"--inner--")]);
    answer.problem(415, "unsupported-media-type");
}

#[test]
fn a_form_over_the_limit_of_bodies_is_refused_like_any_body() {
    let server = Service::start(&["--max-body", "64KiB"]);
    let answer = post_form(&server, "", &[(IMAGE, &[0; 100_000])]);
    assert_eq!(answer.problem(413, "body-too-large")["setting"], "--max-body");
    let mut chunked =
        b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\
        Content-Type: multipart/form-data; boundary=limit\r\n\r\n18700\r\n"
            .to_vec();
    let (_, body) = form(&[(IMAGE, &[0; 100_000])]);
    chunked.extend_from_slice(&body[..0x18700]);
    exchange(server.public, &chunked).problem(413, "body-too-large");
    let field = field("params");
    let answer = post_form(&server, "", &[(&field, &[b' '; 50_000]), (IMAGE, b"")]);
    answer.problem(400, "json-malformed");
}

#[test]
fn a_form_may_be_as_long_as_any_body() {
    let image = flat(1000, 1000);
    let server = Service::start(&[]);
    let answer = post_form(&server, "size=4&method=med", &[(IMAGE, &image)]);
    assert_eq!(answer.status, 200, "{}", answer.text());
    let server = Service::start(&["--max-body", "3000100"]);
    let (content_type, body) = form(&[(IMAGE, &image)]);
    assert!(body.len() > 3_000_100);
    let mut chunked = format!(
        "POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\
         Content-Type: {content_type}\r\n\r\n{:x}\r\n",
        body.len()
    )
    .into_bytes();
    chunked.extend_from_slice(&body);
    chunked.extend_from_slice(b"\r\n0\r\n\r\n");
    exchange(server.public, &chunked).problem(413, "body-too-large");
}

#[test]
fn a_form_may_come_in_the_smallest_pieces() {
    let server = Service::start(&[]);
    let long_name = "n".repeat(10_000);
    let headers = format!("{IMAGE}\r\nX-Long: {long_name}");
    // A picture whose bytes look like the beginning of a boundary again and again.
    let mut image = b"P5\n40 40\n255\n".to_vec();
    image.extend(b"\r\n--limi".iter().cycle().take(1600));
    let (content_type, body) = form(&[(&field("density"), b"5"), (&headers, &image)]);
    let whole = post_form(&server, "density=5", &[(IMAGE, &image)]);
    let mut stream = connect(server.public);
    let head = format!(
        "POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: {}\r\n\
         Content-Type: {content_type}\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes()).unwrap();
    for piece in body.chunks(7) {
        stream.write_all(piece).unwrap();
    }
    let answer = receive(&mut stream, Instant::now());
    assert_eq!((answer.status, whole.status), (200, 200), "{}", answer.text());
    assert_eq!(answer.header("etag"), whole.header("etag"));
}

#[test]
fn json_parameters_are_a_flat_object() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    let params = field("params");
    let post = |json: &[u8]| post_form(&server, "", &[(IMAGE, &image), (&params, json)]);
    let deep = [b"{\"density\":".as_slice(), &[b'['; 10_000], &[b']'; 10_000], b"}"].concat();
    for json in [
        deep.as_slice(),
        b"{\"density\": 1e400}",
        b"\xEF\xBB\xBF{}",
        b"{\"density\": 5,}",
        b"[]",
        b"{\"method\": \"\xFF\"}",
        b"{\"method\": \"\\ud800\"}",
        b"{} {}",
        b"{\"leaky\": null}",
    ] {
        post(json).problem(400, "json-malformed");
    }
    post(br#"{"density": 5, "density": 6}"#).problem(400, "duplicate-parameter");
    post(br#"{"density": -1}"#).problem(422, "parameter-out-of-range");
    post(br#"{"density": "NaN"}"#).problem(422, "not-finite");
    assert_eq!(post(br#"{"density": 5, "leaky": false}"#).status, 200);
    assert_eq!(post(br#"{"density": 1e+1}"#).status, 200);
    post(br#"{"size": 10.0}"#).problem(400, "parameter-malformed");
}
