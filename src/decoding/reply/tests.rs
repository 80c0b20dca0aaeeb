//! What comes in is what was written, in pieces of any length, and nothing else is believed.

use super::*;
use pixmesh_codec::DecodeOptions;

const PROGRESSIVE: &[u8] = include_bytes!("../../../crates/codec/tests/samples/progressive.jpg");
const LOSSY_ALPHA: &[u8] = include_bytes!("../../../crates/codec/tests/samples/lossy_alpha.webp");

fn reply(file: &[u8]) -> Reply<impl Fn() -> Result<Assembly, DecodeError>> {
    let assemble = || DecodeOptions::default().assemble(file, &|| Ok(()));
    Reply::new(PictureFormat::sniff(file).unwrap(), assemble)
}

fn written(decoded: &Result<Vec<u8>, DecodeError>) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(decoded, &mut bytes).unwrap();
    bytes
}

fn received(file: &[u8], bytes: &[u8], piece: usize) -> Result<Image, DecodeError> {
    let mut reply = reply(file);
    for piece in bytes.chunks(piece) {
        assert!(!reply.is_whole());
        reply.take(piece).unwrap();
    }
    assert!(reply.is_whole());
    reply.into_image(&|| Ok(()))
}

#[test]
fn samples_in_pieces_of_any_length_become_the_image() {
    for file in [PROGRESSIVE, LOSSY_ALPHA] {
        let options = DecodeOptions::default();
        let expected = options.decode(file);
        let bytes = written(&options.decode_stored(file));
        for piece in [1, 2, 7, 100, 1000, 65_536, usize::MAX] {
            assert_eq!(received(file, &bytes, piece), expected, "{piece}");
        }
    }
}

#[test]
fn refusals_come_through_as_they_were_made() {
    let format = PictureFormat::Jpeg;
    let reason = "Spaß".to_owned();
    for error in [
        DecodeError::Malformed { format, reason: reason.clone() },
        DecodeError::Malformed { format, reason: String::new() },
        DecodeError::Unsupported { format, reason },
        DecodeError::MetadataTooLarge { format, limit: 8_388_608 },
    ] {
        let bytes = written(&Err(error.clone()));
        for piece in [1, 9, 10, 1000] {
            assert_eq!(received(PROGRESSIVE, &bytes, piece), Err(error.clone()));
        }
    }
    let other = written(&Err(DecodeError::Empty));
    let told = received(PROGRESSIVE, &other, 4).unwrap_err().to_string();
    assert!(told.contains("the file is empty"), "{told}");
}

#[test]
fn what_is_no_answer_to_this_file_is_garbled() {
    let whole = written(&DecodeOptions::default().decode_stored(PROGRESSIVE));
    let more = [&whole[..], b"x"].concat();
    let mut fewer = whole.clone();
    fewer[1] ^= 1;
    let mut other = whole;
    other[0] = b'X';
    let long = [&b"M"[..], &(MAX_TEXT_BYTES + 1).to_le_bytes()].concat();
    for bytes in [&more[..], &fewer, &other, &long, b"pixmesh: no such command"] {
        assert_eq!(reply(PROGRESSIVE).take(bytes), Err(Broken::Garbled));
    }
    let mut cut = reply(PROGRESSIVE);
    cut.take(&more[..100]).unwrap();
    assert!(!cut.is_whole());
    assert!(matches!(cut.into_image(&|| Ok(())), Err(DecodeError::Malformed { .. })));
}
