//! What is no picture, or none that can be meshed: refused quickly, and without memory.

use crate::pictures::{disc, noise, png_claiming};
use crate::server::Server;

#[test]
fn bad_pictures_are_refused_within_a_second_and_64_mib() {
    let server = Server::start(&[]);
    let good = disc(64, 64, 3);
    assert_eq!(server.mesh("", &[], &good).status, 200);
    let before_kib = server.memory_kib("VmRSS");
    server.forget_peak();
    let bad: [(&[u8], u16, &str); 15] = [
        (b"", 400, "empty-file"),
        (b"x", 415, "unsupported-image"),
        (b"Dear sir or madam,\n", 415, "unsupported-image"),
        (b"%PDF-1.7\n", 415, "unsupported-image"),
        (b"<svg onload=\"alert(1)\"/>", 415, "unsupported-image"),
        (b"\x89PNG\r\n\x1a\n", 422, "image-decode-failed"),
        (&good[..good.len() / 2], 422, "image-decode-failed"),
        (&good[..40], 422, "image-decode-failed"),
        (&png_claiming(100_000, 100_000), 422, "image-too-large"),
        (&png_claiming(0x7FFF_FFFF, 0x7FFF_FFFF), 422, "image-too-large"),
        (&png_claiming(1, 2_000_000_000), 422, "image-too-large"),
        (&png_claiming(20_000, 2_000), 422, "image-too-large"),
        (b"P5\n100000 100000\n255\nx", 422, "image-too-large"),
        (b"P2\n1 1\n255\n7\n", 422, "degenerate-image"),
        (&[b"P5\n1 50\n255\n".as_slice(), &[7; 50]].concat(), 422, "degenerate-image"),
    ];
    for (bytes, status, slug) in bad {
        let answer = server.mesh("", &[], bytes);
        let problem = answer.problem(status, slug);
        assert!(answer.took.as_millis() < 1000, "{slug}: {:?}", answer.took);
        assert!(!answer.text().contains("alert"), "nothing is echoed");
        if slug == "image-too-large" {
            assert!(problem["limit"].is_u64() && problem["actual"].is_u64(), "{problem}");
            let setting = problem["setting"].as_str().unwrap();
            assert!(setting.starts_with("--max-"), "{problem}");
            let detail = problem["detail"].as_str().unwrap();
            assert!(detail.contains("scale it down first") && detail.contains(setting), "{detail}");
            assert!(detail.contains(&problem["limit"].to_string()), "{detail}");
        }
    }
    let grown_kib = server.memory_kib("VmHWM").saturating_sub(before_kib);
    assert!(grown_kib < 64 * 1024, "{grown_kib} KiB more");
    assert_eq!(server.mesh("", &[], &good).status, 200);
    server.wait_until_idle();
}

#[test]
fn a_format_that_is_not_read_is_named_with_the_command_that_converts_it() {
    let server = Server::start(&[]);
    let known: [(&[u8], &str, &str); 5] = [
        (b"\0\0\0\x18ftypheic\0\0\0\0mif1heic", "HEIC", "magick photo.heic photo.png"),
        (b"\xFF\x0A\xFA\x1F", "JPEG XL", "djxl photo.jxl photo.png"),
        (b"<?xml version=\"1.0\"?>\n<svg/>", "SVG", "rsvg-convert"),
        (b"%PDF-1.7\n", "PDF", "pdftoppm -png"),
        (b"FUJIFILMCCD-RAW 0201FF", "RAF", "darktable-cli photo.raf photo.png"),
    ];
    for (bytes, name, command) in known {
        let problem = server.mesh("", &[], bytes).problem(415, "unsupported-image");
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.starts_with(name) && detail.contains(command), "{detail}");
    }
}

#[test]
fn a_picture_cut_anywhere_is_never_a_failure_of_the_service() {
    let server = Server::start(&[]);
    let png = disc(30, 20, 3);
    for length in (1..png.len()).step_by(13) {
        let answer = server.mesh("", &[], &png[..length]);
        assert!([200, 415, 422].contains(&answer.status), "{length}: {}", answer.text());
    }
    for byte in (8..png.len()).step_by(7) {
        let mut broken = png.clone();
        broken[byte] ^= 0x10;
        let answer = server.mesh("", &[], &broken);
        assert!([200, 415, 422].contains(&answer.status), "{byte}: {}", answer.text());
    }
}

#[test]
fn the_limits_of_pictures_are_settings_and_met_exactly() {
    let server = Server::start(&["--max-pixels", "400", "--max-side", "40"]);
    assert_eq!(server.mesh("density=5", &[], &disc(20, 20, 1)).status, 200);
    assert_eq!(server.mesh("density=5", &[], &disc(40, 10, 1)).status, 200);
    let problem = server.mesh("density=5", &[], &disc(21, 20, 1)).problem(422, "image-too-large");
    assert_eq!((&problem["limit"], &problem["actual"]), (&400.into(), &420.into()));
    let problem = server.mesh("density=5", &[], &disc(41, 9, 1)).problem(422, "image-too-large");
    assert_eq!((&problem["limit"], &problem["actual"]), (&40.into(), &41.into()));
    assert_eq!(problem["setting"], "--max-side");
}

#[test]
fn work_that_could_never_get_its_memory_is_refused_and_not_queued() {
    let server = Server::start(&["--memory-budget", "8MiB"]);
    assert_eq!(server.mesh("method=med", &[], &disc(64, 64, 1)).status, 200);
    let problem = server.mesh("method=mgpr", &[], &noise(300)).problem(422, "work-too-large");
    assert_eq!(problem["setting"], "--memory-budget");
    assert_eq!(problem["limit"], 6);
    assert!(problem["actual"].as_u64().unwrap() > 6, "{problem}");
}

#[test]
fn flat_and_tiny_pictures_are_meshed() {
    let server = Server::start(&[]);
    let flat = [b"P5\n30 30\n255\n".as_slice(), &[9; 900]].concat();
    let answer = server.mesh("size=4", &[], &flat);
    assert_eq!((answer.status, answer.header("mesh-faces")), (200, "2"), "{}", answer.text());
    assert_eq!(answer.header("mesh-psnr"), "inf");
    // Fewer vertices than the four corners means the corners.
    for density in ["density=100", "density=2", ""] {
        let tiny = server.mesh(density, &[], b"P2\n2 2\n255\n0 1 2 3\n");
        assert_eq!((tiny.status, tiny.header("mesh-vertices")), (200, "4"), "{}", tiny.text());
    }
}
