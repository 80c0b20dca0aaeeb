//! What a parameter may be: one table, the same for the query, a field and JSON.

use crate::client::{field, form, send};
use crate::in_process::Service;
use crate::pictures::disc;
use crate::server::Server;
use pixmesh_engine::params::TABLE;
use serde_json::Value;

/// A query, and the refusal it gets.
const REFUSALS: [(&str, u16, &str); 67] = [
    ("density=0", 422, "parameter-out-of-range"),
    ("density=-0.0", 422, "parameter-out-of-range"),
    ("density=-1", 422, "parameter-out-of-range"),
    ("density=101", 422, "parameter-out-of-range"),
    ("density=100.0000001", 422, "parameter-out-of-range"),
    ("density=1e308", 422, "parameter-out-of-range"),
    ("density=1e-320", 422, "parameter-out-of-range"),
    ("density=0.0000009", 422, "parameter-out-of-range"),
    ("density=NaN", 422, "not-finite"),
    ("density=inf", 422, "not-finite"),
    ("density=-inf", 422, "not-finite"),
    ("density=%2BInfinity", 422, "not-finite"),
    ("density=1e309", 422, "not-finite"),
    ("density=", 400, "parameter-malformed"),
    ("density", 400, "parameter-malformed"),
    ("density=%205%20", 400, "parameter-malformed"),
    ("density=+5", 400, "parameter-malformed"),
    ("density=5%25", 400, "parameter-malformed"),
    ("density=5,0", 400, "parameter-malformed"),
    ("density=0x10", 400, "parameter-malformed"),
    ("density=%D9%A5", 400, "parameter-malformed"),
    ("density=1_000", 400, "parameter-malformed"),
    ("size=0", 422, "parameter-out-of-range"),
    ("size=3", 422, "parameter-out-of-range"),
    ("size=-1", 422, "parameter-out-of-range"),
    ("size=4294967296", 422, "parameter-out-of-range"),
    ("size=401", 422, "parameter-out-of-range"),
    ("size=1e2", 400, "parameter-malformed"),
    ("size=3.5", 400, "parameter-malformed"),
    ("density=5&size=50", 422, "conflicting-parameters"),
    ("target_psnr=30&size=50", 422, "conflicting-parameters"),
    ("gamma=4&initial_size=50", 422, "conflicting-parameters"),
    ("target_psnr=-1", 422, "parameter-out-of-range"),
    ("target_psnr=1000", 422, "parameter-out-of-range"),
    ("density=1&density=99", 400, "duplicate-parameter"),
    ("density=1&%64ensity=1", 400, "duplicate-parameter"),
    ("desnity=5", 400, "unknown-parameter"),
    ("zzzzzzzzzzzzzzzzzz=5", 400, "unknown-parameter"),
    ("Density=5", 400, "unknown-parameter"),
    ("=5", 400, "unknown-parameter"),
    ("method=MED", 422, "unknown-value"),
    ("method=", 422, "unknown-value"),
    ("format=gif", 422, "unknown-value"),
    ("format=PNG", 422, "unknown-value"),
    ("policy=psa", 422, "unknown-value"),
    ("leaky=yes", 422, "unknown-value"),
    ("seed=18446744073709551616", 422, "parameter-out-of-range"),
    ("tolerance=99999999999", 422, "parameter-out-of-range"),
    ("smoothing_order=2", 422, "parameter-out-of-range"),
    ("smoothing_order=23", 422, "parameter-out-of-range"),
    ("gamma=0.5", 422, "parameter-out-of-range"),
    ("gamma=1001", 422, "parameter-out-of-range"),
    ("density=%zz", 400, "query-malformed"),
    ("density=%00", 400, "query-malformed"),
    ("density=%C0%AF", 400, "query-malformed"),
    ("target_error=1&density=2", 422, "conflicting-parameters"),
    ("initial_density=5&gamma=4", 422, "conflicting-parameters"),
    ("target_error=-1", 422, "parameter-out-of-range"),
    ("initial_density=101", 422, "parameter-out-of-range"),
    ("target_psnr=30&error_metric=mean_comp_ae", 422, "conflicting-parameters"),
    ("double_convolution=1", 422, "unknown-value"),
    ("smoothing_direction=up", 422, "unknown-value"),
    ("error_metric=mse", 422, "unknown-value"),
    ("error_metric=luma_se", 422, "component-count"),
    ("meshed=luma", 422, "component-count"),
    ("method=ced", 422, "component-count"),
    ("policy=psc", 422, "component-count"),
];

#[test]
fn every_wrong_value_gets_its_refusal_at_once() {
    let server = Server::start(&[]);
    let image = disc(20, 20, 1);
    for (query, status, slug) in REFUSALS {
        let answer = server.mesh(query, &[], &image);
        let problem = answer.problem(status, slug);
        assert!(answer.took.as_millis() < 1000, "{query}: {:?}", answer.took);
        let names = ["param", "detail"].map(|member| problem[member].as_str().unwrap_or_default());
        let given = query.split(['=', '&']).next().unwrap();
        let named = names.iter().any(|name| name.contains(given) || slug == "query-malformed");
        let other = ["conflicting-parameters", "duplicate-parameter"].contains(&slug);
        assert!(named || other, "{query} is not named: {problem}");
    }
    assert_eq!(server.mesh("density=5", &[], &image).status, 200);
    server.wait_until_idle();
}

#[test]
fn a_number_out_of_bounds_is_answered_with_the_nearest_that_is_not() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    for (query, nearest) in [
        ("target_psnr=-1", 0.0),
        ("target_psnr=1000", 200.0),
        ("size=3", 4.0),
        ("size=-1", 4.0),
        ("size=401", 400.0),
        ("max_error=65536", 65535.0),
        ("max_error=-1", 0.0),
        ("target_error=-1", 0.0),
        ("density=101", 100.0),
    ] {
        let problem = server.mesh(query, &[], &image).problem(422, "parameter-out-of-range");
        assert_eq!(problem["nearest"].as_f64(), Some(nearest), "{query}: {problem}");
        let (name, _) = query.split_once('=').unwrap();
        let allowed = format!("{name}={}", problem["nearest"]);
        assert_eq!(server.mesh(&allowed, &[], &image).status, 200, "{allowed}");
    }
}

#[test]
fn fields_are_refused_like_the_query() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    for (query, status, slug) in REFUSALS {
        let simple =
            !query.contains(['%', '&']) && query.contains('=') && slug != "query-malformed";
        let Some((name, value)) = query.split_once('=').filter(|_| simple) else { continue };
        let (content_type, body) =
            form(&[(&field(name), value.as_bytes()), (&field("image"), &image)]);
        let headers = [("Content-Type", content_type.as_str())];
        send(server.public, "POST", "/v1/meshes", &headers, &body).problem(status, slug);
    }
}

#[test]
fn json_is_refused_like_the_query() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    let mut tried = 0;
    for (query, status, slug) in REFUSALS {
        if query.contains('%') {
            continue;
        }
        let pairs = query.split('&').map(|pair| pair.split_once('=').unwrap_or((pair, "")));
        let members: Vec<String> =
            pairs.map(|(name, value)| format!("{name:?}:{value:?}")).collect();
        let json = format!("{{{}}}", members.join(","));
        let params = field("params");
        let (content_type, body) = form(&[(&params, json.as_bytes()), (&field("image"), &image)]);
        let headers = [("Content-Type", content_type.as_str())];
        send(server.public, "POST", "/v1/meshes", &headers, &body).problem(status, slug);
        tried += 1;
    }
    assert!(tried > 50, "{tried}");
}

#[test]
fn the_list_of_methods_has_every_parameter_of_the_parser() {
    let server = Service::start(&[]);
    let list = server.get("/v1/methods").json();
    let image = disc(20, 20, 3);
    let parameters = list["parameters"].as_array().unwrap();
    let table: Vec<_> = TABLE.iter().map(|row| row.name).collect();
    let listed: Vec<_> = parameters.iter().map(|row| row["name"].as_str().unwrap()).collect();
    assert_eq!(listed, table);
    for row in parameters {
        let name = row["name"].as_str().unwrap();
        // A value beyond each bound is refused with that bound; so is a word that is not listed.
        let (value, slug) = match (&row["maximum"], &row["type"]) {
            (Value::Number(most), _) if most.as_u64() == Some(u64::MAX) => {
                ("18446744073709551616".to_owned(), "parameter-out-of-range")
            }
            (Value::Number(most), _) => {
                (format!("{}", most.as_f64().unwrap() + 1.0), "parameter-out-of-range")
            }
            _ => ("nonsense".to_owned(), "unknown-value"),
        };
        let problem = server.mesh(&format!("{name}={value}"), &[], &image).problem(422, slug);
        assert_eq!(problem["param"], name);
        if let Value::Array(allowed) = &row["allowed"] {
            assert_eq!(problem["allowed"].as_array().unwrap(), allowed);
        }
    }
}

#[test]
fn a_refusal_carries_bounds_alternatives_and_the_nearest_name() {
    let server = Service::start(&[]);
    let image = disc(20, 20, 1);
    let refusal = |query: &str| server.mesh(query, &[], &image).json();
    let problem = refusal("density=101");
    assert_eq!((&problem["param"], &problem["maximum"]), (&"density".into(), &100.0.into()));
    assert_eq!(problem["actual"], "101");
    assert_eq!(refusal("size=3")["minimum"], 4);
    assert_eq!(refusal("size=401")["maximum"], 400.0, "no more vertices than pixels");
    assert_eq!(refusal("desnity=5")["nearest"], "density");
    assert_eq!(refusal("smooting_order=5")["nearest"], "smoothing_order");
    for (name, meant) in [("psnr", "target_psnr"), ("vertices", "size"), ("quality", "target_psnr")]
    {
        assert_eq!(refusal(&format!("{name}=40"))["nearest"], meant);
    }
    let allowed = refusal("method=MED")["allowed"].clone();
    assert!(allowed.as_array().unwrap().contains(&"med".into()), "{allowed}");
    let allowed = refusal("method=ced")["allowed"].clone();
    assert!(!allowed.as_array().unwrap().contains(&"cgpr".into()), "{allowed}");
}

#[test]
fn a_target_that_the_initial_points_cannot_reach_is_refused() {
    let server = Service::start(&[]);
    let image = disc(40, 40, 1);
    for target in ["target_psnr=60", "target_error=0.01", "max_error=1"] {
        let query = format!("{target}&initial_size=50");
        let problem = server.mesh(&query, &[], &image).problem(422, "conflicting-parameters");
        assert_eq!(problem["param"], target.split('=').next().unwrap());
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains("50 initial points"), "{detail}");
        assert_eq!(server.mesh(target, &[], &image).status, 200, "{target}");
    }
}

#[test]
fn a_plus_may_be_written_as_it_is_escaped_or_as_the_blank_of_a_form() {
    let server = Service::start(&[]);
    let image = disc(60, 40, 3);
    let plain = server.mesh("method=med&size=90", &[], &image);
    let plus = server.mesh("method=med%2B&size=90", &[], &image);
    assert_eq!(plus.status, 200, "{}", plus.text());
    assert!(plus.body != plain.body && plus.header("mesh-parameters").contains("method=med+&"));
    for query in ["method=med+&size=90", "method=med%20&size=90", plus.header("mesh-parameters")] {
        assert!(server.mesh(query, &[], &image).body == plus.body, "{query}");
    }
    let parts = |method: &[u8]| {
        let fields: [(&str, &[u8]); 3] =
            [(&field("image"), &image), (&field("method"), method), (&field("size"), b"90")];
        let (content_type, body) = form(&fields);
        let headers = [("Content-Type", content_type.as_str())];
        send(server.public, "POST", "/v1/meshes", &headers, &body)
    };
    assert!(parts(b"med+").body == plus.body);
    assert!(parts(b"med ").body == plus.body);
    for query in ["method=med%20%20", "method=mgprfs+", "method=%20med"] {
        server.mesh(query, &[], &image).problem(422, "unknown-value");
    }
}

#[test]
fn without_a_target_the_mesh_has_two_percent_of_the_pixels() {
    let server = Service::start(&[]);
    let answer = server.mesh("", &[], &disc(50, 40, 3));
    assert_eq!(answer.header("mesh-vertices"), "40");
    assert!(answer.header("mesh-parameters").starts_with("method=mgprfs&density=2&"));
}

#[test]
fn every_choice_changes_the_mesh_and_is_named_in_the_answer() {
    let server = Service::start(&[]);
    let image = disc(40, 30, 3);
    let plain = server.mesh("size=30&gamma=8", &[], &image);
    for choice in [
        "initial=random",
        "initial=insertion",
        "policy=psc",
        "policy=psb_l",
        "policy=pse_d",
        "startup=classic",
        "startup=random",
        "scan=raster",
        "leaky=true",
        "smoothing_order=5",
        "smoothing=mean",
        "smoothing_direction=orthogonal",
        "double_convolution=true",
        "boundary=constant",
        "meshed=luma",
        "error_metric=mean_comp_ae",
    ] {
        let answer = server.mesh(&format!("size=30&gamma=8&{choice}"), &[], &image);
        assert_eq!(answer.status, 200, "{choice}: {}", answer.text());
        assert!(answer.body != plain.body, "{choice} changes nothing");
        assert!(answer.header("mesh-parameters").contains(choice), "{choice}");
    }
    let answer = server.mesh("target_error=30", &[], &image);
    assert!(answer.header("mesh-mse").parse::<f64>().unwrap() <= 30.0);
    let answer = server.mesh("size=30&initial_density=20", &[], &image);
    assert!(answer.header("mesh-parameters").contains("initial_density=20"));
}
