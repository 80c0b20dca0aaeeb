//! Small files that would like to become large: neither time nor memory is given to them.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

mod samples;

use pixmesh_codec::{DecodeError, Limits, decode, probe, read_model};
use samples::{deflated, gradient, ihdr, jpeg, png_file};
use std::time::{Duration, Instant};

/// A header that claims too many pixels, in a file that holds hardly any.
fn huge_headers() -> Vec<(&'static str, Vec<u8>)> {
    let mut huge_jpeg = jpeg(&gradient(16, 16, 1), 90);
    let frame = huge_jpeg.windows(2).position(|marker| marker == [0xFF, 0xC0]).unwrap();
    huge_jpeg[frame + 5..frame + 9].copy_from_slice(&[0xFA, 0xFA, 0xFA, 0xFA]);
    let png = |width, height, interlaced| {
        let header = (b"IHDR", ihdr(width, height, 1, 0, interlaced));
        png_file(&[header, (b"IDAT", vec![0]), (b"IEND", Vec::new())])
    };
    vec![
        ("PNG 100000x100000", png(100_000, 100_000, false)),
        ("PNG 14000x14000 interlaced", png(14_000, 14_000, true)),
        ("PNG 2^31-1 square", png((1 << 31) - 1, (1 << 31) - 1, false)),
        ("PNG 1x2000000000", png(1, 2_000_000_000, false)),
        ("PGM 2^32-1 square", b"P5 4294967295 4294967295 255\n".to_vec()),
        ("PGM 10^40", format!("P5 1{:040} 3 255\n", 0).into_bytes()),
        ("PPM 100000x100000", b"P3 100000 100000 65535\n1 2 3".to_vec()),
        ("PAM 16385x2", b"P7 WIDTH 16385 HEIGHT 2 DEPTH 4 MAXVAL 1 ENDHDR\n".to_vec()),
        ("JPEG 64250x64250", huge_jpeg),
    ]
}

/// The most memory that this process has had, in KiB; `None` where the system does not tell.
fn peak_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

/// Checks that an action takes less than so many milliseconds.
fn within<T>(milliseconds: u64, what: &str, action: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = action();
    let elapsed = start.elapsed();
    assert!(elapsed < Duration::from_millis(milliseconds), "{what} took {elapsed:?}");
    result
}

/// A gray picture of 2x2 pixels with a chunk before its own.
fn with_chunk(kind: &'static [u8; 4], data: Vec<u8>) -> Vec<u8> {
    let pixels = (b"IDAT", deflated(&[0, 1, 2, 0, 3, 4]));
    png_file(&[(b"IHDR", ihdr(2, 2, 8, 0, false)), (kind, data), pixels, (b"IEND", Vec::new())])
}

// One test, so that no other raises this process's peak of memory meanwhile.
#[test]
fn bombs_cost_neither_time_nor_memory() {
    let limits = Limits::default();
    let headers = huge_headers();
    let zeros = deflated(&vec![0; 64 << 20]);
    let profile = with_chunk(b"iCCP", [&b"bomb\0\0"[..], &zeros].concat());
    let text = with_chunk(b"zTXt", [&b"bomb\0\0"[..], &zeros].concat());
    let pixels = (b"IDAT", zeros);
    let surplus = png_file(&[(b"IHDR", ihdr(64, 64, 8, 0, false)), pixels, (b"IEND", Vec::new())]);
    let exif = with_chunk(b"eXIf", vec![b'I'; 9 << 20]);
    let many_texts: Vec<_> = (0..200_000).map(|_| (b"tEXt", b"Comment\0text".to_vec())).collect();
    let mut many = vec![(b"IHDR", ihdr(2, 2, 8, 0, false))];
    many.extend(many_texts);
    many.extend([(b"IDAT", deflated(&[0, 1, 2, 0, 3, 4])), (b"IEND", Vec::new())]);
    let many = png_file(&many);
    let vertices = b"4000 4000 3 8 OFF 4294967295 8589934590 0\n0 0 1 2 3".to_vec();
    let before = peak_kib();

    for (name, bytes) in &headers {
        let probed = within(20, name, || probe(bytes, &limits));
        let error = probed.unwrap_err();
        let refused =
            matches!(error, DecodeError::TooManyPixels { .. } | DecodeError::SideTooLong { .. });
        assert!(refused, "{name}: {error}");
        assert_eq!(decode(bytes, &limits), Err(error), "{name}");
    }
    for (name, bytes) in [("iCCP", &profile), ("zTXt", &text), ("200000 texts", &many)] {
        within(1000, name, || probe(bytes, &limits)).unwrap();
        let image = within(1000, name, || decode(bytes, &limits)).unwrap();
        assert_eq!(image.components(), [[3, 4, 1, 2]]);
    }
    let image = within(1000, "surplus pixels", || decode(&surplus, &limits));
    assert!(image.is_ok_and(|image| image.width() == 64));
    let error = probe(&exif, &limits).unwrap_err();
    assert!(matches!(error, DecodeError::MetadataTooLarge { limit: 8_388_608, .. }), "{error}");
    let error = within(20, "MODEL", || read_model(&vertices, &limits)).unwrap_err();
    assert!(error.to_string().contains("4294967295 vertices"), "{error}");

    let (Some(before), Some(after)) = (before, peak_kib()) else {
        println!("skipped: the system does not tell this process's peak of memory");
        return;
    };
    assert!(after - before < 20 << 10, "{} KiB more", after - before);
}
