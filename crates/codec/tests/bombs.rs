//! Small files that would like to become large: neither time nor memory is given to them.

// A test is told that something is wrong by a panic, helpers of tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

mod samples;

use pixmesh_codec::{DecodeError, DecodeOptions, Limits, decode, probe, read_model};
use samples::bombs::{contradictions, huge_headers, many_frames};
use samples::memory::rise_kib;
use samples::{deflated, ihdr, png_file};
use std::time::Duration;

/// The most that a bomb may make the process grow.
const MOST_KIB: u64 = 20 << 10;

/// The processor time of this thread: what else the machine does takes none of it.
fn processor_time() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::try_from(time).unwrap()
}

/// Checks that an action takes less than so many milliseconds of processor time and makes the process grow by less
/// than [`MOST_KIB`], from now to its peak.
fn within<T>(milliseconds: u64, what: &str, action: impl FnOnce() -> T) -> T {
    let start = processor_time();
    let (result, rise) = rise_kib(action);
    let elapsed = processor_time() - start;
    assert!(elapsed < Duration::from_millis(milliseconds), "{what} took {elapsed:?}");
    println!("{what}: {elapsed:?}, {rise} KiB");
    assert!(rise < MOST_KIB, "{what} took {rise} KiB more");
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
    let contradictions = contradictions();
    let frames = many_frames();

    for (name, bytes) in &headers {
        let probed = within(100, name, || probe(bytes, &limits));
        let error = probed.unwrap_err();
        let refused =
            matches!(error, DecodeError::TooManyPixels { .. } | DecodeError::SideTooLong { .. });
        assert!(refused, "{name}: {error}");
        assert_eq!(within(100, name, || decode(bytes, &limits)), Err(error), "{name}");
    }
    for (name, bytes) in &contradictions {
        let _ = within(500, name, || probe(bytes, &limits));
        let lenient = DecodeOptions { lenient: true, ..DecodeOptions::default() };
        assert!(within(500, name, || decode(bytes, &limits)).is_err(), "{name}");
        assert!(within(500, name, || lenient.decode(bytes)).is_err(), "{name}");
        if name.contains("65536 groups") || name.contains("a frame of such codes") {
            let error = decode(bytes, &limits).unwrap_err();
            assert!(matches!(error, DecodeError::MetadataTooLarge { .. }), "{error}");
        }
    }
    assert_eq!(within(500, "frames", || decode(&frames, &limits)).unwrap().width(), 2);
    for (name, bytes) in [("iCCP", &profile), ("zTXt", &text), ("200000 texts", &many)] {
        within(1000, name, || probe(bytes, &limits)).unwrap();
        let image = within(1000, name, || decode(bytes, &limits)).unwrap();
        assert_eq!(image.components(), [[3, 4, 1, 2]]);
    }
    let image = within(1000, "surplus pixels", || decode(&surplus, &limits));
    assert!(image.is_ok_and(|image| image.width() == 64));
    let error = within(1000, "eXIf", || probe(&exif, &limits)).unwrap_err();
    assert!(matches!(error, DecodeError::MetadataTooLarge { limit: 8_388_608, .. }), "{error}");
    let error = within(20, "MODEL", || read_model(&vertices, &limits)).unwrap_err();
    assert!(error.to_string().contains("4294967295 vertices"), "{error}");
}
