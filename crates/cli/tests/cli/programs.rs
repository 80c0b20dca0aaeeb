//! The programs as a user runs them: real processes, standard input and output.

#![allow(clippy::unwrap_used, clippy::panic)] // A failing test may stop anywhere.

use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

const MAKE_MODEL: &str = env!("CARGO_BIN_EXE_make_model");
const RASTERIZE_MODEL: &str = env!("CARGO_BIN_EXE_rasterize_model");

/// The thesis's command lines, as printed there.
const MED: &str = "--density 2 --initial-density 2 --initial-generator ed \
    --ed-strategy max_comp_mmsodd_ed --ed-initial-error-mode mirror --bad-point-removal 0";
const MGPRFS: &str = "--density 2 --relative-initial-density 400 --initial-generator ed \
    --ed-strategy max_comp_mmsodd_ed --ed-initial-error-mode mirror --bad-point-removal 0";
const MGPR: &str =
    "--density 2 --initial-density 100 --initial-generator all --bad-point-removal 0";

/// Runs a program with words split at blanks.
fn run(program: &str, words: &str, input: &[u8]) -> Output {
    let mut child = Command::new(program)
        .args(words.split_whitespace())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let input = input.to_vec();
    // A program that refuses its options does not read.
    let writer = std::thread::spawn(move || drop(stdin.write_all(&input)));
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap();
    output
}

/// What a run that must succeed wrote.
fn succeed(program: &str, words: &str, input: &[u8]) -> Vec<u8> {
    let output = run(program, words, input);
    assert!(output.status.success(), "{words}: {}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

/// What a run that must fail said.
fn fail(program: &str, words: &str, input: &[u8]) -> String {
    let output = run(program, words, input);
    assert!(!output.status.success(), "{words} did not fail");
    assert!(output.stdout.is_empty(), "{words} wrote something");
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(!message.contains("panicked"), "{message}");
    message
}

/// The README's picture, 384 by 256 in colour.
fn landscape_png() -> Vec<u8> {
    std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/images/picture.png")).unwrap()
}

/// A gray PGM of 48 by 32 with an edge and a slope.
fn gray_pgm() -> Vec<u8> {
    let mut picture = b"P5\n# a comment\n48 32\n255\n".to_vec();
    let sample = |x: u32, y: u32| if x * x + y * y < 700 { 200 - 2 * x } else { 40 + y };
    picture.extend((0..32).flat_map(|y| (0..48).map(move |x| sample(x, y) as u8)));
    picture
}

/// The number of vertices that a MODEL declares.
fn vertex_count(model: &[u8]) -> usize {
    let text = std::str::from_utf8(model).unwrap();
    text.split_whitespace().nth(5).unwrap().parse().unwrap()
}

/// A checksum of bytes: Glenn Fowler, Landon Curt Noll and Phong Vo's FNV-1a.
fn checksum(bytes: &[u8]) -> u64 {
    let step = |hash: u64, &byte: &u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, step)
}

#[test]
fn the_examples_of_the_thesis_run_as_printed() {
    let picture = landscape_png();
    let points = 384 * 256 * 2 / 100;
    let med = vertex_count(&succeed(MAKE_MODEL, MED, &picture));
    assert!((points - 10..=points + 14).contains(&med), "{med}");
    assert_eq!(vertex_count(&succeed(MAKE_MODEL, MGPRFS, &picture)), points);
    assert_eq!(vertex_count(&succeed(MAKE_MODEL, MGPR, &gray_pgm())), 30);
}

#[test]
fn a_method_by_name_is_what_its_options_say() {
    let picture = gray_pgm();
    let named = |name: &str| succeed(MAKE_MODEL, &format!("--method {name} --density 2"), &picture);
    assert_eq!(named("med"), succeed(MAKE_MODEL, MED, &picture));
    assert_eq!(named("mgprfs"), succeed(MAKE_MODEL, MGPRFS, &picture));
    assert_eq!(named("mgpr"), succeed(MAKE_MODEL, MGPR, &picture));
}

#[test]
fn the_models_of_a_known_picture_do_not_change() {
    let picture = landscape_png();
    let sum = |words: &str| format!("{:016x}", checksum(&succeed(MAKE_MODEL, words, &picture)));
    assert_eq!(sum(MED), "c5c0eba6b4614fc3");
    assert_eq!(sum(MGPRFS), "428e6e2fe8c1d7e9");
}

#[test]
fn a_model_becomes_a_picture_again() {
    let model = succeed(MAKE_MODEL, MGPRFS, &landscape_png());
    let picture = succeed(RASTERIZE_MODEL, "", &model);
    assert!(picture.starts_with(b"P6\n384 256\n255\n"));
    assert_eq!(picture.len(), 15 + 3 * 384 * 256);
    let rebuilt = pixmesh_codec::decode(&picture, &pixmesh_cli::files::LIMITS).unwrap();
    let png = succeed(RASTERIZE_MODEL, "--format png", &model);
    assert_eq!(pixmesh_codec::decode(&png, &pixmesh_cli::files::LIMITS).unwrap(), rebuilt);
}

#[test]
fn a_mesh_file_becomes_every_other_format() {
    let folder = Folder::new("conversions");
    let picture = folder.file("picture.png");
    std::fs::write(&picture, landscape_png()).unwrap();
    let order = "--method mgprfs --size 300";
    let formats = ["glb", "svg", "ply", "obj", "stl", "png", "pnm", "pmesh", "gltf"];
    let model = succeed(MAKE_MODEL, order, &landscape_png());
    for format in formats {
        let words = format!("--format {format} --relief luma --compression meshopt");
        let direct = succeed(MAKE_MODEL, &format!("{order} {words}"), &landscape_png());
        assert!(succeed(RASTERIZE_MODEL, &words, &model) == direct, "{format}");
        let file = folder.file(&format!("mesh.{format}"));
        succeed(RASTERIZE_MODEL, &format!("{words} --output {file}"), &model);
        assert!(std::fs::read(&file).unwrap() == direct, "{file}");
    }
    let textured = "--format glb --texture embed";
    let direct = succeed(MAKE_MODEL, &format!("{order} {textured}"), &landscape_png());
    let words = format!("{textured} --image {picture}");
    assert!(succeed(RASTERIZE_MODEL, &words, &model) == direct);
    let progression = succeed(MAKE_MODEL, "--size 300 --format progression", &landscape_png());
    let smaller = succeed(RASTERIZE_MODEL, "--size 100 --format progression", &progression);
    assert!(
        succeed(RASTERIZE_MODEL, "", &smaller)
            == succeed(RASTERIZE_MODEL, "--size 100", &progression)
    );
    for (words, said) in [
        (textured.to_owned(), "--image"),
        (format!("{textured} --image {}", folder.file("mesh.svg")), "SVG is not read"),
        ("--output mesh.dae".to_owned(), "no format has the ending .dae"),
        ("--format progression".to_owned(), "keeps no order"),
        ("--relief c3 --format stl".to_owned(), "component"),
    ] {
        let message = fail(RASTERIZE_MODEL, &words, &model);
        assert!(message.contains(said), "{words}: {message}");
    }
}

#[test]
fn every_point_kept_gives_the_picture_back() {
    let model = succeed(MAKE_MODEL, "--method med --density 100", &gray_pgm());
    let rebuilt = succeed(RASTERIZE_MODEL, "", &model);
    assert_eq!(rebuilt[rebuilt.len() - 48 * 32..], gray_pgm()[gray_pgm().len() - 48 * 32..]);
}

#[test]
fn statistics_go_to_standard_error_and_agree_with_the_model() {
    let output = run(MAKE_MODEL, "--method mgprfs --size 40 --stats", &gray_pgm());
    let statistics = String::from_utf8(output.stderr).unwrap();
    let names: Vec<&str> =
        statistics.lines().map(|l| l.split_whitespace().next().unwrap()).collect();
    let stages = ["decode", "density", "diffuse", "triangulate", "simplify", "encode"];
    assert_eq!(names[..5], ["vertices", "faces", "mse", "psnr_db", "ssim"]);
    assert_eq!(names[5..], stages);
    assert!(statistics.starts_with("vertices     40\n"), "{statistics}");
    assert_eq!(vertex_count(&output.stdout), 40);
    let picture = |bytes: &[u8]| pixmesh_codec::decode(bytes, &pixmesh_cli::files::LIMITS).unwrap();
    let rebuilt = picture(&succeed(RASTERIZE_MODEL, "", &output.stdout));
    let ssim = pixmesh_meshing::structural_similarity(&picture(&gray_pgm()), &rebuilt, &());
    let ssim = format!("ssim         {:.4}\n", ssim.unwrap().unwrap());
    assert!(statistics.contains(&ssim), "{statistics} without {ssim}");
}

/// The number of vertices and the PSNR that a run's statistics name.
fn size_and_psnr(words: &str) -> (usize, f64) {
    let output = run(MAKE_MODEL, &format!("{words} --stats"), &gray_pgm());
    let statistics = String::from_utf8(output.stderr).unwrap();
    let value = |name: &str| {
        let line = statistics.lines().find_map(|line| line.strip_prefix(name));
        line.unwrap().trim().to_owned()
    };
    (value("vertices").parse().unwrap(), value("psnr_db").parse().unwrap())
}

#[test]
fn a_psnr_asked_for_is_reached_by_as_few_points_as_removal_can() {
    let (size, psnr_db) = size_and_psnr("--method mgprfs --psnr 30");
    assert!(psnr_db >= 30.0, "{psnr_db}");
    let one_less = format!("--method mgprfs --initial-density 100 --size {}", size - 1);
    assert!(size_and_psnr(&one_less).1 < 30.0);
}

#[test]
fn files_are_read_and_written_by_name() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let (picture, model) = (folder.join("named.pgm"), folder.join("named.model"));
    std::fs::write(&picture, gray_pgm()).unwrap();
    let words = format!(
        "--method med --size 50 --input {} --output {}",
        picture.display(),
        model.display()
    );
    assert!(succeed(MAKE_MODEL, &words, b"").is_empty());
    assert_eq!(
        std::fs::read(&model).unwrap(),
        succeed(MAKE_MODEL, "--method med --size 50", &gray_pgm())
    );
    let missing = fail(RASTERIZE_MODEL, "--input no-such.model", b"");
    assert!(missing.contains("no-such.model"), "{missing}");
}

#[test]
fn the_default_is_mgprfs_at_2_percent_unless_the_thesis_chooses_initial_points() {
    let model = |words: &str| succeed(MAKE_MODEL, words, &gray_pgm());
    assert_eq!(model(""), model("--method mgprfs --density 2"));
    assert_eq!(model("--size 50"), model("--method mgprfs --size 50"));
    assert_eq!(model("--target-psnr 30"), model("--method mgprfs --psnr 30"));
    assert_eq!(model("--target-error 20"), model("--method mgprfs --error 20"));
    let of_thesis = "--size 50 --initial-density 100 --bad-point-removal 1 --initial-generator ed \
                     --ed-initial-error-mode mirror --ed-scan-order serpentine";
    for option in [
        "--initial-generator ed",
        "--initial-density 100",
        "--ed-strategy max_comp_mmsodd_ed",
        "--ed-initial-error-mode mirror",
        "--ed-scan-order serpentine",
        "--ed-leaky-mode no_leaky",
    ] {
        assert_eq!(model(&format!("--size 50 {option}")), model(of_thesis), "{option}");
    }
}

#[test]
fn an_ending_that_no_format_has_is_refused_before_any_work() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    for ending in ["jpg", "webp", "dae", "svgz"] {
        let path = folder.join(format!("refused.{ending}"));
        let message = fail(MAKE_MODEL, &format!("--output {}", path.display()), b"no picture");
        assert!(message.contains(&format!("ending .{ending}")), "{message}");
        assert!(message.contains("--format") && !path.exists(), "{message}");
    }
    let path = folder.join("named.data");
    let words = format!("--size 50 --format svg --output {}", path.display());
    succeed(MAKE_MODEL, &words, &gray_pgm());
    assert!(std::fs::read(path).unwrap().starts_with(b"<svg"));
}

#[test]
fn what_is_wrong_is_said_by_name() {
    let picture = gray_pgm();
    for (words, expected) in [
        ("--density 2 --size 50", "cannot be used with"),
        ("--density 0", "density is 0"),
        ("--density 101", "density is 101, but must lie in 0.000001 to 100"),
        ("--density nan", "density must be a finite number"),
        ("--density two", "invalid value 'two' for '--density"),
        ("--size 3", "size is 3, but must lie in 4 to 1536"),
        ("--size 1537", "4 to 1536"),
        ("--size 50 --initial-size 2000", "initial_size is 2000"),
        ("--size 50 --relative-initial-density 50", "gamma is 0.5"),
        ("--size 50 --initial-size 60 --initial-density 7", "cannot be used with"),
        ("--size 50 --smooth-order 4", "smoothing_order is 4, but must be odd"),
        ("--size 50 --smooth-order 23", "smoothing_order is 23"),
        ("--size 50 --ed-strategy best", "possible values: gray_comp_mmsodd_ed"),
        ("--size 50 --derivative-bound-policy none", "possible values: zero_ext"),
        ("--size 50 --bad-point-removal 2", "possible values: 0, 1"),
        ("--size 50 --method ced", "method 'ced' is for images of 3 component(s), this one has 1"),
        ("--size 50 --method best", "possible values: ed, med"),
        ("--sise 50", "--size"),
    ] {
        let message = fail(MAKE_MODEL, words, &picture);
        assert!(message.contains(expected), "{words}: {message}");
    }
}

#[test]
fn what_is_no_picture_and_what_is_no_model_is_refused() {
    let truncated = &landscape_png()[..2000];
    for input in [&b""[..], b"hello", truncated, b"P5 1 9 255\n123456789"] {
        let message = fail(MAKE_MODEL, "--density 2", input);
        assert!(message.starts_with("make_model: standard input: "), "{message}");
    }
    for input in [&b""[..], b"hello", b"2 2 1 8\nOFF\n4 2 5\n0 0 1\n"] {
        let message = fail(RASTERIZE_MODEL, "", input);
        assert!(message.starts_with("rasterize_model: standard input: "), "{message}");
    }
}

#[test]
fn strategies_mean_their_gray_policy_for_a_gray_picture() {
    let picture = gray_pgm();
    let of = |strategy: &str| {
        let words = format!("--density 3 --relative-initial-density 300 --ed-strategy {strategy}");
        succeed(MAKE_MODEL, &words, &picture)
    };
    let (mmsodd, laplacian) = (of("max_comp_mmsodd_ed"), of("max_comp_laplacian_ed"));
    assert_ne!(mmsodd, laplacian);
    for strategy in [
        "gray_comp_mmsodd_ed",
        "vector_space_comb",
        "mean_comp_mmsodd_ed",
        "three_comps_union_mmsodd",
        "three_comps_union_laplacian",
    ] {
        assert_eq!(of(strategy), mmsodd, "{strategy}");
    }
    for strategy in ["gray_comp_laplacian_ed", "mean_comp_laplacian_ed"] {
        assert_eq!(of(strategy), laplacian, "{strategy}");
    }
}

/// A PPM of 40 by 30 whose components differ.
fn colour_ppm() -> Vec<u8> {
    let mut picture = b"P6\n40 30\n255\n".to_vec();
    for i in 0..40 * 30 {
        let (x, y) = (i % 40, i / 40);
        let inside = (x - 20) * (x - 20) + (y - 15) * (y - 15) < 90;
        let noise = (x * 7919 + y * 104_729) % 23;
        let colour = if inside { [200 - x, 40 + y, 30 + noise] } else { [3 * x, 90, 120 + 2 * y] };
        picture.extend(colour.map(|sample| sample as u8));
    }
    picture
}

#[test]
fn every_option_has_an_effect() {
    let picture = colour_ppm();
    let base = "--size 40 --initial-size 400";
    let plain = succeed(MAKE_MODEL, base, &picture);
    for option in [
        "--initial-generator all",
        "--initial-generator random",
        "--initial-generator uniform",
        "--ed-strategy vector_space_comb",
        "--ed-strategy three_comps_union_laplacian",
        "--ed-size-tolerance 0",
        "--ed-scan-order raster",
        "--ed-leaky-mode leaky",
        "--ed-initial-error-mode zero",
        "--ed-initial-error-mode random",
        "--smooth-order 5",
        "--smooth-operator mean",
        "--smooth-direction orthogonal",
        "--derivative-bound-policy const_ext",
        "--derivative-bound-policy sym_ext",
        "--use-double-convolution 1",
        "--use-double-convolution 1 --smooth-bound-policy sym_ext",
        "--mesh-generation-policy lsmg",
        "--error-metric mean_comp_ae",
        "--error-metric luma_se",
        "--error-metric luma_ae",
        "--error-metric ycbcr_vec_se",
        "--error-metric ycbcr_vec_ae",
    ] {
        let changed = succeed(MAKE_MODEL, &format!("{base} {option}"), &picture);
        assert!(changed != plain, "{option}");
        assert_eq!(changed, succeed(MAKE_MODEL, &format!("{base} {option}"), &picture), "{option}");
    }
    // The length of the difference vector orders removals as the mean over components does.
    assert_eq!(succeed(MAKE_MODEL, &format!("{base} --error-metric vec_se"), &picture), plain);
}

#[test]
fn bad_points_are_removed_unless_told_not_to() {
    let size = |words: &str| {
        let words = format!("--size 200 --initial-generator random --initial-size 200 {words}");
        vertex_count(&succeed(MAKE_MODEL, &words, &colour_ppm()))
    };
    assert_eq!(size("--bad-point-removal 0"), 200);
    assert!(size("") < 200);
    assert_eq!(size(""), size("--bad-point-removal 1"));
}

#[test]
fn a_mesh_of_the_luma_carries_the_colours_and_a_gray_picture_is_its_own_luma() {
    let model = succeed(MAKE_MODEL, "--method cgprfsed --size 50", &colour_ppm());
    let named = "--size 50 --relative-initial-density 400 --ed-strategy gray_comp_mmsodd_ed \
        --ed-initial-error-mode zero --mesh-generation-policy lsmg --bad-point-removal 0";
    assert_eq!(succeed(MAKE_MODEL, named, &colour_ppm()), model);
    assert!(model.starts_with(b"40 30 3 8\n"));
    let gray = |words: &str| succeed(MAKE_MODEL, &format!("--size 50 {words}"), &gray_pgm());
    assert_eq!(gray("--mesh-generation-policy lsmg"), gray(""));
}

#[test]
fn the_history_has_a_line_for_each_removed_point() {
    let history = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("history.txt");
    let words = format!(
        "--size 50 --initial-size 150 --bad-point-removal 0 --history-file {}",
        history.display()
    );
    let model = succeed(MAKE_MODEL, &words, &colour_ppm());
    let initial = "--method med --size 150";
    let before = vertex_count(&succeed(MAKE_MODEL, initial, &colour_ppm()));
    let lines = std::fs::read_to_string(history).unwrap();
    assert_eq!(lines.lines().count(), before - vertex_count(&model));
    let vertices: Vec<&str> =
        std::str::from_utf8(&model).unwrap().lines().skip(3).take(50).collect();
    for line in lines.lines() {
        let fields: Vec<i64> = line.split(' ').map(|field| field.parse().unwrap()).collect();
        assert!((0..40).contains(&fields[0]) && (0..30).contains(&fields[1]), "{line}");
        let point = format!("{} {} ", fields[0], fields[1]);
        assert!(!vertices.iter().any(|vertex| vertex.starts_with(&point)), "{line} is still there");
    }
}

#[test]
fn a_mean_error_asked_for_is_not_exceeded() {
    // Removal stops at the bound; a method without removal is tried at several sizes.
    for method in ["mgprfs", "med"] {
        let words = format!("--method {method} --error 20 --stats");
        let output = run(MAKE_MODEL, &words, &colour_ppm());
        let statistics = String::from_utf8(output.stderr).unwrap();
        let mse = statistics.lines().find_map(|line| line.strip_prefix("mse")).unwrap();
        let mse: f64 = mse.trim().parse().unwrap();
        assert!((10.0..=20.0).contains(&mse), "{method}: {mse}");
    }
    let words = "--method mgprfs --psnr 30 --error-metric luma_ae";
    let message = fail(MAKE_MODEL, words, &colour_ppm());
    assert!(message.contains("target_psnr needs the error_metric mean_comp_se"), "{message}");
    let message = fail(MAKE_MODEL, "--size 50 --error-metric luma_se", &gray_pgm());
    assert!(message.contains("allowed are mean_comp_se, mean_comp_ae, vec_se"), "{message}");
}

#[test]
fn manual_pages_and_completions_name_every_option() {
    for program in [MAKE_MODEL, RASTERIZE_MODEL] {
        let help = String::from_utf8(succeed(program, "--help", b"")).unwrap();
        let options: Vec<&str> = help
            .lines()
            .filter_map(|line| line.trim_start().strip_prefix("--"))
            .map(|option| option.split(' ').next().unwrap())
            .filter(|option| !option.ends_with(','))
            .collect();
        assert!(options.len() > 3, "{help}");
        let page = String::from_utf8(succeed(program, "--man-page", b"")).unwrap();
        assert!(page.contains(".SH NAME"));
        let page = page.replace('\\', "");
        for option in options {
            assert!(page.contains(&format!("--{option}")), "--{option}");
            for shell in ["bash", "fish", "zsh"] {
                let script = succeed(program, &format!("--completions {shell}"), b"");
                assert!(String::from_utf8(script).unwrap().contains(option), "{shell}: {option}");
            }
        }
    }
}

#[test]
fn the_ending_of_the_output_and_the_option_choose_the_format() {
    let folder = std::env::temp_dir().join(format!("pixmesh-formats-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let starts: [(&str, &[u8]); 11] = [
        ("model", b"48 32 1 8\nOFF\n"),
        ("glb", b"glTF"),
        ("gltf", b"{\"asset\""),
        ("svg", b"<svg "),
        ("ply", b"ply\n"),
        ("obj", b"# lengths"),
        ("stl", b"binary STL"),
        ("json", b"{\"width\":48"),
        ("pmesh", b"PMSH\x03\0\x08\x01"),
        ("png", b"\x89PNG"),
        ("pgm", b"P5\n48 32"),
    ];
    for (ending, start) in starts {
        let path = folder.join(format!("mesh.{ending}"));
        let words = format!("--method med --density 4 --output {}", path.display());
        succeed(MAKE_MODEL, &words, &gray_pgm());
        assert!(std::fs::read(&path).unwrap().starts_with(start), "{ending}");
        if ending != "pgm" {
            let words = format!("--method med --density 4 --format {ending}");
            assert!(succeed(MAKE_MODEL, &words, &gray_pgm()).starts_with(start), "{ending}");
        }
    }
    let words = "--method med --density 4 --format progression";
    assert!(succeed(MAKE_MODEL, words, &gray_pgm()).starts_with(b"PMSH\x01\x01"));
    let model = succeed(MAKE_MODEL, "--method med --density 4", &gray_pgm());
    let picture = folder.join("rebuilt.PNG");
    succeed(RASTERIZE_MODEL, &format!("--output {}", picture.display()), &model);
    assert!(std::fs::read(&picture).unwrap().starts_with(b"\x89PNG"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_lithophane_has_the_lengths_asked_for() {
    let words = "--method med --density 10 --format stl --invert-relief --height 2.2 --base 0.8 \
        --pixel-size 0.25 --unit mm";
    let stl = succeed(MAKE_MODEL, words, &gray_pgm());
    let z = stl[84..].chunks_exact(50).flat_map(|triangle| {
        (0..3).map(|i| f32::from_le_bytes(triangle[20 + 12 * i..24 + 12 * i].try_into().unwrap()))
    });
    let (least, most) = z.fold((f32::MAX, f32::MIN), |(a, b), z| (a.min(z), b.max(z)));
    assert_eq!(least, -0.8);
    // The darkest sample is 40 or more.
    assert!(most > 1.0 && most < 2.2 * 215.5 / 255.0, "{most}");
    assert!(fail(MAKE_MODEL, "--density 4 --relief c2", &gray_pgm()).contains("component 2"));
    assert!(fail(MAKE_MODEL, "--density 4 --height=-1", &gray_pgm()).contains("length"));
}

#[test]
fn alpha_is_dropped_and_files_that_end_early_are_read_on_request() {
    let pam = [&b"P7\nWIDTH 9\nHEIGHT 9\nDEPTH 2\nMAXVAL 255\nENDHDR\n"[..], &[7; 162]].concat();
    let start = |words: &str, input: &[u8]| succeed(MAKE_MODEL, words, input)[..7].to_vec();
    assert_eq!(start("--density 9", &pam), b"9 9 2 8");
    assert_eq!(start("--density 9 --alpha drop", &pam), b"9 9 1 8");
    assert_eq!(start("--density 9 --alpha over:#f00000", &pam), b"9 9 3 8");
    let cut = &pam[..pam.len() - 50];
    assert!(fail(MAKE_MODEL, "--density 9", cut).contains("ends early"));
    assert_eq!(start("--density 9 --lenient", cut), b"9 9 2 8");
}

/// A folder of its own for a test's files, removed when dropped.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("pixmesh-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn file(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn one_run_keeps_every_size_and_the_compact_mesh() {
    let folder = Folder::new("progressive");
    let (pmesh, order) = (folder.file("mesh.pmesh"), folder.file("order.pmesh"));
    let start = "--initial-generator all --bad-point-removal 0";
    let words = format!("--size 120 {start} --pmesh {pmesh} --progressive {order}");
    let model = succeed(MAKE_MODEL, &words, &gray_pgm());
    let rebuilt = succeed(RASTERIZE_MODEL, "", &model);
    for file in [&pmesh, &order] {
        let picture = succeed(RASTERIZE_MODEL, &format!("--input {file}"), b"");
        assert!(picture == rebuilt, "{file}");
    }
    let is_larger = |a: &str, b: &str| {
        std::fs::metadata(a).unwrap().len() > std::fs::metadata(b).unwrap().len()
    };
    assert!(is_larger(&order, &pmesh));
    for size in [4, 17, 119, 120] {
        let smaller = succeed(MAKE_MODEL, &format!("--size {size} {start}"), &gray_pgm());
        let expected = succeed(RASTERIZE_MODEL, "", &smaller);
        let words = format!("--input {order} --size {size}");
        assert!(succeed(RASTERIZE_MODEL, &words, b"") == expected, "{size}");
    }
    for (words, said) in [
        (format!("--input {order} --size 3"), "size is 3, but must lie in 4 to 120"),
        (format!("--input {order} --size 121"), "size is 121"),
        (format!("--input {pmesh} --size 50"), "keeps no order"),
    ] {
        let message = fail(RASTERIZE_MODEL, &words, b"");
        assert!(message.contains(said), "{message}");
    }
    assert!(fail(RASTERIZE_MODEL, "--size 50", &model).contains("keeps no order"));
    for (words, said) in [
        ("--method mgprfs --connectivity free --pmesh", "holds no faces"),
        ("--method mgprfs --connectivity free --progressive", "keeps no order"),
        ("--method mgprfs --values fitted --progressive", "keeps no order"),
        ("--method flat --progressive", "keeps no order"),
    ] {
        let file = folder.file("refused");
        let output = run(MAKE_MODEL, &format!("--size 300 {words} {file}"), &landscape_png());
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && message.contains(said), "{words}: {message}");
    }
}

#[test]
fn weights_draw_vertices_to_where_they_are_large() {
    let folder = Folder::new("weights");
    let noisy = {
        let mut picture = b"P5\n48 32\n255\n".to_vec();
        picture.extend((0..48 * 32_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8));
        picture
    };
    let mask = |header: &str, of: &dyn Fn(usize) -> Vec<u8>| {
        [header.as_bytes().to_vec(), (0..48 * 32).flat_map(of).collect()].concat()
    };
    let side = |i: usize| if i % 48 < 24 { 255 } else { 9 };
    std::fs::write(folder.file("gray"), mask("P5\n48 32\n255\n", &|i| vec![side(i)])).unwrap();
    std::fs::write(folder.file("colour"), mask("P6\n48 32\n255\n", &|i| vec![side(i); 3])).unwrap();
    std::fs::write(folder.file("small"), b"P5\n2 2\n255\nabcd").unwrap();
    std::fs::write(folder.file("none"), b"nothing").unwrap();
    let with =
        |words: &str| succeed(MAKE_MODEL, &format!("--method mgprfs --size 150 {words}"), &noisy);
    let on_the_left = |model: &[u8]| {
        let text = std::str::from_utf8(model).unwrap();
        let vertices = text.lines().skip(3).take(150);
        let columns = vertices.map(|line| line.split(' ').next().unwrap().parse::<u32>().unwrap());
        columns.filter(|&x| x < 24).count()
    };
    let (plain, gray) = (with(""), with(&format!("--weights {}", folder.file("gray"))));
    assert!(on_the_left(&gray) > on_the_left(&plain) + 25);
    assert!(with(&format!("--weights {}", folder.file("colour"))) == gray);
    for (file, said) in [("small", "2x2"), ("none", "the weights"), ("missing", "No such file")] {
        let words = format!("--size 150 --weights {}", folder.file(file));
        let message = fail(MAKE_MODEL, &words, &noisy);
        assert!(message.contains(said), "{message}");
    }
}
