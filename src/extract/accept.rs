//! Which representation of the mesh the client wants: `?format=`, or else `Accept` (RFC 9110).

use crate::problem::{Kind, Problem};
use axum::http::HeaderMap;
use axum::http::header::ACCEPT;
use pixmesh_codec::Format;

/// A format with the media type that it is sent as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Representation {
    /// The format.
    pub format: Format,
    /// Type and subtype, as `Accept` names them.
    pub media_type: &'static str,
}

impl Representation {
    /// The whole value of `Content-Type`.
    #[must_use]
    pub fn content_type(self) -> &'static str {
        if self.media_type == "text/plain" { "text/plain; charset=utf-8" } else { self.media_type }
    }
}

/// Every representation, the default one first.
pub fn offered() -> impl Iterator<Item = Representation> {
    Format::ALL.iter().flat_map(|&format| {
        format.media_types().iter().map(move |media_type| Representation { format, media_type })
    })
}

/// The representations that are pictures.
pub fn pictures() -> impl Iterator<Item = Representation> {
    offered().filter(|offer| offer.format.is_picture())
}

/// Chooses the representation: the `format` asked for wins, then the best match of `Accept`, and
/// MODEL when there is neither.
///
/// # Errors
/// `not-acceptable` when `Accept` allows nothing that is offered.
pub fn choose(format: Option<Format>, headers: &HeaderMap) -> Result<Representation, Problem> {
    choose_among(offered(), format, headers)
}

/// The same, where a client that does not mind gets the format that was asked for before.
///
/// # Errors
/// As [`choose`].
pub fn choose_rather(
    rather: Option<Format>,
    format: Option<Format>,
    headers: &HeaderMap,
) -> Result<Representation, Problem> {
    let mut offered: Vec<_> = offered().collect();
    offered.sort_by_key(|offer| rather.is_some_and(|rather| offer.format != rather));
    choose_among(offered, format, headers)
}

/// Chooses as [`choose`] does among some representations.
///
/// # Errors
/// As [`choose`].
pub fn choose_among(
    offered: impl IntoIterator<Item = Representation>,
    format: Option<Format>,
    headers: &HeaderMap,
) -> Result<Representation, Problem> {
    if let Some(format) = format {
        return Ok(Representation { format, media_type: format.media_types()[0] });
    }
    let offered: Vec<_> = offered.into_iter().collect();
    if !headers.contains_key(ACCEPT) {
        return offered.first().copied().ok_or_else(|| not_acceptable(&offered));
    }
    let values = headers.get_all(ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let ranges: Vec<MediaRange> = values.flat_map(|v| v.split(',')).filter_map(range).collect();
    best(&offered, &ranges).ok_or_else(|| not_acceptable(&offered))
}

/// Whether `Accept` gives the first media type a higher quality than the second.
#[must_use]
pub fn prefers(headers: &HeaderMap, first: &str, second: &str) -> bool {
    let values = headers.get_all(ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let ranges: Vec<MediaRange> = values.flat_map(|v| v.split(',')).filter_map(range).collect();
    quality(first, &ranges) > quality(second, &ranges)
}

fn not_acceptable(offered: &[Representation]) -> Problem {
    let offered: Vec<_> = offered.iter().map(|offer| offer.media_type).collect();
    let detail = format!("the Accept header allows none of {}", offered.join(", "));
    Problem::new(Kind::NotAcceptable, detail).allowed(&offered)
}

/// One element of `Accept`: a type, a subtype, either of which may be `*`, and a quality.
struct MediaRange<'a> {
    kind: &'a str,
    subtype: &'a str,
    quality: f32,
}

impl MediaRange<'_> {
    /// How exactly the range names a media type: 0 by `*/*` to 2 by its full name.
    fn specificity(&self, media_type: &str) -> Option<u8> {
        let (kind, subtype) = media_type.split_once('/')?;
        match (self.kind, self.subtype) {
            ("*", "*") => Some(0),
            (range, "*") if range.eq_ignore_ascii_case(kind) => Some(1),
            (range, sub)
                if range.eq_ignore_ascii_case(kind) && sub.eq_ignore_ascii_case(subtype) =>
            {
                Some(2)
            }
            _ => None,
        }
    }
}

/// Reads one element of `Accept`; one that cannot be read names nothing.
fn range(element: &str) -> Option<MediaRange<'_>> {
    let mut pieces = element.split(';').map(str::trim);
    let (kind, subtype) = pieces.next()?.split_once('/')?;
    let weight = pieces.find_map(|piece| piece.strip_prefix("q=").or(piece.strip_prefix("Q=")));
    let quality = weight.map_or(Some(1.0), |weight| weight.parse().ok())?;
    (0.0..=1.0).contains(&quality).then_some(MediaRange { kind, subtype, quality })
}

/// The offer of the highest quality; among equals the one that is offered first.
fn best(offered: &[Representation], ranges: &[MediaRange]) -> Option<Representation> {
    let mut best = None;
    let mut best_quality = 0.0;
    for offer in offered {
        let quality = quality(offer.media_type, ranges);
        if quality > best_quality {
            (best, best_quality) = (Some(*offer), quality);
        }
    }
    best
}

/// The quality that the most specific range gives a media type; 0 without any.
fn quality(media_type: &str, ranges: &[MediaRange]) -> f32 {
    let matching =
        ranges.iter().filter_map(|range| Some((range.specificity(media_type)?, range.quality)));
    matching.max_by_key(|(specificity, _)| *specificity).map_or(0.0, |(_, quality)| quality)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(accept: &str) -> Option<&'static str> {
        let mut headers = HeaderMap::new();
        headers.insert(ACCEPT, accept.parse().unwrap());
        choose(None, &headers).ok().map(|representation| representation.media_type)
    }

    #[test]
    fn the_best_quality_wins_and_the_most_specific_range_decides_it() {
        assert_eq!(chosen("*/*"), Some("text/plain"));
        assert_eq!(chosen("image/*"), Some("image/png"));
        assert_eq!(chosen("image/*, image/png;q=0"), Some("image/x-portable-anymap"));
        assert_eq!(
            chosen("text/plain;q=0.3, MODEL/gltf-binary ; q=0.5"),
            Some("model/gltf-binary")
        );
        assert_eq!(chosen("application/vnd.pixmesh.model"), Some("application/vnd.pixmesh.model"));
        assert_eq!(chosen("text/html, */*;q=0.1"), Some("text/plain"));
    }

    #[test]
    fn who_does_not_mind_gets_what_was_asked_for_before() {
        let chosen = |rather, accept: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(ACCEPT, accept.parse().unwrap());
            choose_rather(rather, None, &headers).unwrap().media_type
        };
        assert_eq!(chosen(Some(Format::Glb), "*/*"), "model/gltf-binary");
        assert_eq!(chosen(Some(Format::Glb), "image/*"), "image/png");
        assert_eq!(chosen(None, "*/*"), "text/plain");
    }

    #[test]
    fn programs_that_ask_for_json_are_told_from_browsers() {
        let wants_json = |accept: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(ACCEPT, accept.parse().unwrap());
            prefers(&headers, "application/json", "text/html")
        };
        assert!(wants_json("application/json") && wants_json("text/html;q=0.5, application/*"));
        assert!(!wants_json("*/*") && !wants_json("text/html,application/xhtml+xml,*/*;q=0.8"));
        assert!(!wants_json("") && !prefers(&HeaderMap::new(), "application/json", "text/html"));
    }

    #[test]
    fn nothing_acceptable_is_refused() {
        for accept in ["text/html", "*/*;q=0", "", "nonsense", "image/png;q=x", "image/webp"] {
            assert_eq!(chosen(accept), None, "{accept}");
        }
    }
}
