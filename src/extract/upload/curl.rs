//! Typical mistakes with curl, where the body is not the file that was meant.

use super::essence;
use crate::problem::{Kind, Problem};
use axum::http::HeaderMap;
use axum::http::header::CONTENT_TYPE;
use pixmesh_codec::PictureFormat;

/// What curl calls any body given with `--data` or `--data-binary` unless told otherwise.
pub(super) const LABEL: &str = "application/x-www-form-urlencoded";

/// The longest name of a file.
const MAX_NAME: usize = 255;
/// The endings of files that the service takes, or that it refuses by their format.
const ENDINGS: [&str; 33] = [
    "png", "jpg", "jpeg", "pbm", "pgm", "ppm", "pnm", "pam", "webp", "gif", "tif", "tiff", "bmp",
    "jpe", "jfif", "apng", "dib", "heic", "heif", "avif", "jxl", "svg", "pdf", "cr2", "cr3", "nef",
    "arw", "dng", "raf", "orf", "rw2", "model", "pmesh",
];

/// Refuses a body that is a file's name, or a file as `curl --data @file` sends it: without its line
/// breaks and zeros. Every picture and mesh has some of them, but for text and a PNM with blanks.
pub(super) fn refuse_slips(headers: &HeaderMap, body: &[u8]) -> Result<(), Problem> {
    let refuse = |detail: String| Err(Problem::new(Kind::BadRequest, detail));
    if let Some(name) = name_of_file(body) {
        return refuse(format!(
            "the body is the name of a file and not its content: put an @ before the name, as in \
             `curl --data-binary @{name}`"
        ));
    }
    let label = headers.get(CONTENT_TYPE).and_then(|label| label.to_str().ok());
    let is_of_curl = label.is_some_and(|label| essence(label).eq_ignore_ascii_case(LABEL));
    let may_lack_them = body.is_ascii() || PictureFormat::sniff(body) == Ok(PictureFormat::Pnm);
    if is_of_curl && !may_lack_them && !body.iter().any(|byte| [0, b'\n', b'\r'].contains(byte)) {
        return refuse(
            "the body has lost its line breaks and zeros, as `curl --data @file` sends files: use \
             `curl --data-binary @file` instead"
                .to_owned(),
        );
    }
    Ok(())
}

/// The name of a file that a body consists of.
fn name_of_file(body: &[u8]) -> Option<&str> {
    let name = str::from_utf8(body).ok()?.trim_end();
    let (stem, ending) = name.rsplit_once('.')?;
    let is_known = ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known));
    let is_name = name.len() <= MAX_NAME && !stem.is_empty() && !name.contains(char::is_control);
    (is_known && is_name).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    #[test]
    fn names_of_files_and_stripped_files_are_refused_and_nothing_else() {
        let labelled = HeaderMap::from_iter([(CONTENT_TYPE, HeaderValue::from_static(LABEL))]);
        let (unlabelled, png) = (HeaderMap::new(), b"\x89PNG\x1A\rIHDR");
        let blanks = b"P5 2 1 255 \xFF\xFE";
        for slip in [&b"photo.png"[..], b"/home/a b/Photo.JPEG\n", "größe.tif".as_bytes()] {
            assert!(refuse_slips(&unlabelled, slip).is_err(), "{slip:?}");
        }
        assert!(refuse_slips(&labelled, b"\x89PNG\x1AIHDR").is_err());
        for body in
            [&b""[..], b".png", b"photo.txt", b"P2\n# a.png", b"P2 2 2 9 1 2 3 4", blanks, png]
        {
            assert!(refuse_slips(&labelled, body).is_ok(), "{body:?}");
        }
        assert!(refuse_slips(&unlabelled, b"\x89PNG\x1AIHDR").is_ok());
    }
}
