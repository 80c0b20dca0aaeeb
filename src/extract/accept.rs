//! Which representation of the mesh the client wants: `?format=`, or else `Accept` (RFC 9110).

use crate::problem::{Kind, Problem};
use axum::http::HeaderMap;
use axum::http::header::ACCEPT;
use pixmesh_meshing::ParameterError;
use std::str::FromStr;

/// The formats of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// MODEL, the mesh as text.
    Model,
    /// Binary glTF 2.0.
    Glb,
    /// The picture rebuilt from the mesh, as PNG.
    Png,
    /// The same as PNM.
    Pnm,
    /// glTF 2.0 as JSON, its buffer within.
    Gltf,
    /// The triangles as SVG.
    Svg,
    /// Binary PLY.
    Ply,
    /// Wavefront OBJ.
    Obj,
    /// Binary STL of a solid.
    Stl,
    /// The figures and the arrays as JSON.
    Json,
    /// Points and samples, compressed: pmesh.
    Pmesh,
    /// The same with the order of importance of the vertices: every smaller size at once.
    Progression,
}

/// A format with the media type that it is sent as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Representation {
    /// The format.
    pub format: Format,
    /// Type and subtype, as `Accept` names them.
    pub media_type: &'static str,
    /// The whole value of `Content-Type`.
    pub content_type: &'static str,
    /// Name of the file, where somebody saves the answer.
    pub file_name: &'static str,
}

/// Every representation, the first being the one for clients that do not mind.
pub const OFFERED: [Representation; 13] = [
    Representation {
        format: Format::Model,
        media_type: "text/plain",
        content_type: "text/plain; charset=utf-8",
        file_name: "mesh.model",
    },
    Representation {
        format: Format::Model,
        media_type: "application/vnd.pixmesh.model",
        content_type: "application/vnd.pixmesh.model",
        file_name: "mesh.model",
    },
    Representation {
        format: Format::Glb,
        media_type: "model/gltf-binary",
        content_type: "model/gltf-binary",
        file_name: "mesh.glb",
    },
    PNG,
    PNM,
    Representation {
        format: Format::Gltf,
        media_type: "model/gltf+json",
        content_type: "model/gltf+json",
        file_name: "mesh.gltf",
    },
    Representation {
        format: Format::Svg,
        media_type: "image/svg+xml",
        content_type: "image/svg+xml",
        file_name: "mesh.svg",
    },
    Representation {
        format: Format::Ply,
        media_type: "application/ply",
        content_type: "application/ply",
        file_name: "mesh.ply",
    },
    Representation {
        format: Format::Obj,
        media_type: "model/obj",
        content_type: "model/obj",
        file_name: "mesh.obj",
    },
    Representation {
        format: Format::Stl,
        media_type: "model/stl",
        content_type: "model/stl",
        file_name: "mesh.stl",
    },
    Representation {
        format: Format::Json,
        media_type: "application/json",
        content_type: "application/json",
        file_name: "mesh.json",
    },
    Representation {
        format: Format::Pmesh,
        media_type: "application/vnd.pixmesh.pmesh",
        content_type: "application/vnd.pixmesh.pmesh",
        file_name: "mesh.pmesh",
    },
    // Asked for by name alone: by media type it is a pmesh like any other.
    Representation {
        format: Format::Progression,
        media_type: "application/vnd.pixmesh.pmesh",
        content_type: "application/vnd.pixmesh.pmesh",
        file_name: "progression.pmesh",
    },
];

/// A picture rebuilt from a mesh, as PNG.
const PNG: Representation = Representation {
    format: Format::Png,
    media_type: "image/png",
    content_type: "image/png",
    file_name: "mesh.png",
};

/// The same as PNM.
const PNM: Representation = Representation {
    format: Format::Pnm,
    media_type: "image/x-portable-anymap",
    content_type: "image/x-portable-anymap",
    file_name: "mesh.pnm",
};

/// The representations that are pictures.
pub const PICTURES: [Representation; 2] = [PNG, PNM];

impl Format {
    /// Every format, in the order of [`Self::NAMES`].
    const ALL: [Self; 12] = [
        Self::Model,
        Self::Glb,
        Self::Png,
        Self::Pnm,
        Self::Gltf,
        Self::Svg,
        Self::Ply,
        Self::Obj,
        Self::Stl,
        Self::Json,
        Self::Pmesh,
        Self::Progression,
    ];
    /// The name of every format, as the parameter `format` takes it.
    pub const NAMES: &'static [&'static str] = &[
        "model",
        "glb",
        "png",
        "pnm",
        "gltf",
        "svg",
        "ply",
        "obj",
        "stl",
        "json",
        "pmesh",
        "progression",
    ];

    /// The format's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        let index = Self::ALL.iter().position(|format| *format == self);
        index.map_or("model", |index| Self::NAMES[index])
    }

    /// The representation of a client that asks for the format by name.
    fn representation(self) -> Representation {
        OFFERED.into_iter().find(|offer| offer.format == self).unwrap_or(OFFERED[0])
    }
}

impl FromStr for Format {
    type Err = ParameterError;

    fn from_str(name: &str) -> Result<Self, ParameterError> {
        let index = Self::NAMES.iter().position(|known| *known == name);
        index.map(|index| Self::ALL[index]).ok_or_else(|| ParameterError::UnknownValue {
            parameter: "format",
            value: name.chars().take(64).collect(),
            allowed: Self::NAMES,
        })
    }
}

/// Chooses the representation: the `format` asked for wins, then the best match of `Accept`, and
/// MODEL when there is neither.
///
/// # Errors
/// `not-acceptable` when `Accept` allows nothing that is offered.
pub fn choose(format: Option<Format>, headers: &HeaderMap) -> Result<Representation, Problem> {
    choose_among(&OFFERED, format, headers)
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
    let mut offered = OFFERED;
    offered.sort_by_key(|offer| rather.is_some_and(|rather| offer.format != rather));
    choose_among(&offered, format, headers)
}

/// The same among some representations, which hold the format asked for.
///
/// # Errors
/// As [`choose`].
pub fn choose_among(
    offered: &[Representation],
    format: Option<Format>,
    headers: &HeaderMap,
) -> Result<Representation, Problem> {
    if let Some(format) = format {
        return Ok(format.representation());
    }
    if !headers.contains_key(ACCEPT) {
        return offered.first().copied().ok_or_else(|| not_acceptable(offered));
    }
    let values = headers.get_all(ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let ranges: Vec<MediaRange> = values.flat_map(|v| v.split(',')).filter_map(range).collect();
    best(offered, &ranges).ok_or_else(|| not_acceptable(offered))
}

/// Whether a client that may have a page or JSON would rather have JSON: one that asks for it, and
/// not as much for a page.
#[must_use]
pub fn prefers_json_to_html(headers: &HeaderMap) -> bool {
    let values = headers.get_all(ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let ranges: Vec<MediaRange> = values.flat_map(|v| v.split(',')).filter_map(range).collect();
    quality("application/json", &ranges) > quality("text/html", &ranges)
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
        let prefers = |accept: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(ACCEPT, accept.parse().unwrap());
            prefers_json_to_html(&headers)
        };
        assert!(prefers("application/json") && prefers("text/html;q=0.5, application/*"));
        assert!(!prefers("*/*") && !prefers("text/html,application/xhtml+xml,*/*;q=0.8"));
        assert!(!prefers("") && !prefers_json_to_html(&HeaderMap::new()));
    }

    #[test]
    fn nothing_acceptable_is_refused() {
        for accept in ["text/html", "*/*;q=0", "", "nonsense", "image/png;q=x", "image/webp"] {
            assert_eq!(chosen(accept), None, "{accept}");
        }
    }
}
