//! MODEL to picture, and how close two pictures are.

use crate::client::{Answer, field, form, send};
use crate::pictures::{disc, flat};
use crate::server::{Client, Server};

fn reconstruct(server: &Client, query: &str, headers: &[(&str, &str)], model: &[u8]) -> Answer {
    send(server.public, "POST", &format!("/v1/reconstructions?{query}"), headers, model)
}

fn compare(server: &Client, parts: &[(&str, &[u8])]) -> Answer {
    let fields: Vec<_> = parts.iter().map(|(name, content)| (field(name), *content)).collect();
    let parts: Vec<_> = fields.iter().map(|(name, content)| (name.as_str(), *content)).collect();
    let (label, body) = form(&parts);
    send(server.public, "POST", "/v1/comparisons", &[("Content-Type", &label)], &body)
}

#[test]
fn a_model_is_rebuilt_to_the_picture_that_its_mesh_was_made_with() {
    let server = Server::start(&[]);
    let image = disc(60, 50, 3);
    let model = server.mesh("size=100", &[], &image).body;
    for (format, label) in [("png", "image/png"), ("pnm", "image/x-portable-anymap")] {
        let direct = server.mesh(&format!("size=100&format={format}"), &[], &image);
        let by_query = reconstruct(&server, &format!("format={format}"), &[], &model);
        assert!(by_query.status == 200 && by_query.body == direct.body, "{}", by_query.text());
        assert_eq!(by_query.header("content-type"), label);
        assert_eq!(by_query.header("etag"), direct.header("etag"));
        let by_accept = reconstruct(&server, "", &[("Accept", label)], &model);
        assert!(by_accept.body == direct.body);
        let (boundary, body) =
            form(&[(&field("model"), &model), (&field("format"), format.as_bytes())]);
        let by_form = reconstruct(&server, "", &[("Content-Type", &boundary)], &body);
        assert!(by_form.body == direct.body, "{}", by_form.text());
    }
    assert_eq!(reconstruct(&server, "", &[], &model).header("content-type"), "image/png");
    reconstruct(&server, "format=glb", &[], &model).problem(422, "unknown-value");
    reconstruct(&server, "density=2", &[], &model).problem(400, "unknown-parameter");
    reconstruct(&server, "", &[("Accept", "text/plain")], &model).problem(406, "not-acceptable");
    let label = [("Content-Type", "image/png")];
    reconstruct(&server, "", &label, &model).problem(415, "unsupported-media-type");
    server.wait_until_idle();
}

#[test]
fn what_is_no_model_is_refused_with_its_line() {
    let server = Server::start(&[]);
    for (model, status, slug, line) in [
        (&b""[..], 400, "empty-file", None),
        (b"nonsense", 422, "mesh-invalid", Some(1)),
        (b"\x89PNG\r\n\x1a\n", 422, "mesh-invalid", Some(1)),
        (b"3 2 1 8\nOFF\n4294967295 2 0\n", 422, "mesh-too-large", Some(3)),
        (b"20000 20000 1 8\nOFF\n4 2 5\n", 422, "image-too-large", Some(1)),
        (b"nan 2 1 8\nOFF\n", 422, "not-finite", Some(1)),
        (
            b"2 2 1 8\nOFF\n4 2 5\n0 0 1\n1 0 2\n1 1 3\n0 1 4\n3 0 1 9\n3 0 2 3\n",
            422,
            "index-out-of-range",
            Some(8),
        ),
        (
            b"2 2 1 8\nOFF\n4 2 5\n0 0 1\n1 0 2\n1 1 3\n0 1 4\n3 0 2 1\n3 0 2 3\n",
            422,
            "mesh-invalid",
            Some(8),
        ),
    ] {
        let problem = reconstruct(&server, "", &[], model).problem(status, slug);
        assert_eq!(problem["line"].as_u64(), line, "{problem}");
    }
    server.wait_until_idle();
}

#[test]
fn pictures_and_models_are_compared() {
    let server = Server::start(&[]);
    let image = disc(60, 50, 3);
    let mesh = server.mesh("size=100", &[], &image);
    let picture = server.mesh("size=100&format=png", &[], &image).body;
    let by_model = compare(&server, &[("image", &image), ("approximation", &mesh.body)]);
    assert_eq!(by_model.status, 200, "{}", by_model.text());
    let by_picture = compare(&server, &[("approximation", &picture), ("image", &image)]);
    assert_eq!(by_model.json(), by_picture.json());
    let figures = by_model.json();
    let header = |name: &str| mesh.header(name).parse::<f64>().unwrap();
    assert_eq!(figures["mse"].as_f64().unwrap(), header("mesh-mse"));
    assert_eq!(figures["psnr_db"].as_f64().unwrap(), header("mesh-psnr"));
    let ssim = figures["ssim"].as_f64().unwrap();
    assert!(ssim > 0.5 && ssim < 1.0, "{ssim}");
    let same = compare(&server, &[("image", &image), ("approximation", &image)]).json();
    assert_eq!((&same["mse"], &same["identical"]), (&0.0.into(), &true.into()));
    assert_eq!((&same["ssim"], &same["psnr_db"]), (&1.0.into(), &().into()));
    let small = disc(10, 10, 1);
    let small = compare(&server, &[("image", &small), ("approximation", &small)]).json();
    assert!(small["ssim"].is_null(), "no window fits");
    server.wait_until_idle();
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let server = Server::start(&[]);
    let image = disc(20, 20, 1);
    let other = [("image", &image[..]), ("approximation", &disc(21, 20, 1)[..])];
    compare(&server, &other).problem(422, "shape-mismatch");
    let other = [("image", &image[..]), ("approximation", &disc(20, 20, 3)[..])];
    let problem = compare(&server, &other).problem(422, "shape-mismatch");
    assert!(problem["detail"].as_str().unwrap().contains("3 components"));
    compare(&server, &[("image", &image)]).problem(400, "part-missing");
    compare(&server, &[("approximation", &image)]).problem(400, "image-missing");
    let twice = [("image", &image[..]), ("image", &image[..])];
    compare(&server, &twice).problem(400, "duplicate-part");
    let garbage = [("image", &image[..]), ("approximation", &b"garbage"[..])];
    let problem = compare(&server, &garbage).problem(415, "unsupported-image");
    assert_eq!(problem["param"], "approximation");
    let broken = [
        ("image", &image[..]),
        (
            "approximation",
            &b"20 20 1 8 OFF 4 2 5 0 0 1 junk junk 3 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0"[..],
        ),
    ];
    compare(&server, &broken).problem(422, "mesh-invalid");
    send(server.public, "POST", "/v1/comparisons", &[], &image)
        .problem(415, "unsupported-media-type");
    let surplus = [("image", &image[..]), ("approximation", &image[..]), ("size", b"5")];
    compare(&server, &surplus).problem(400, "unknown-parameter");
    server.wait_until_idle();
}

#[test]
fn large_pictures_are_compared_within_the_budget() {
    let server = Server::start(&["--memory-budget", "256MiB"]);
    let image = flat(2000, 2000);
    let answer = compare(&server, &[("image", &image), ("approximation", &image)]);
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert!(server.memory_kib("VmHWM") >> 10 < 256 + 80);
    let small = Server::start(&["--memory-budget", "40MiB"]);
    let image = disc(2000, 2000, 3);
    compare(&small, &[("image", &image), ("approximation", &image)]).problem(422, "work-too-large");
}
