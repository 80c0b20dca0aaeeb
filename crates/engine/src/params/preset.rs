//! Presets: parameters for a purpose, under one name.

use pixmesh_codec::Format;
use pixmesh_meshing::ParameterError;

/// Parameters for a purpose. Each of them gives way to one that is given beside the preset, and those of the
/// method to another method.
///
/// ```
/// use pixmesh_engine::params::{PRESETS, ParameterSet};
/// let options = ParameterSet::of_query(Some("preset=logo&size=300"))?.finish()?;
/// let logo = PRESETS.iter().find(|preset| preset.name == "logo").expect("a preset");
/// assert_eq!(options.usual_format, logo.format);
/// assert_eq!(options.object()["size"], 300);
/// # Ok::<(), pixmesh_engine::EngineError>(())
/// ```
#[derive(Debug)]
pub struct Preset {
    /// Its name.
    pub name: &'static str,
    /// Its name for people.
    pub title: &'static str,
    /// What it is for, in a sentence.
    pub about: &'static str,
    /// What it is not for, with the preset that is.
    pub not_for: &'static str,
    /// The format where neither a name, a file's ending nor `Accept` says one.
    pub format: Option<Format>,
    /// Names and values of parameters.
    pub parameters: &'static [(&'static str, &'static str)],
}

/// Every preset. `docs/presets.md` has the figures by which the values were chosen.
pub static PRESETS: [Preset; 8] = [
    Preset {
        name: "photo",
        title: "Photo",
        about: "A photograph rebuilt well: vertices move to where they lower the error most.",
        not_for: "drawings of few plain colours (logo), nor for a first look (draft).",
        format: None,
        parameters: &[("method", "optimal"), ("effort", "1"), ("density", "3")],
    },
    Preset {
        name: "lowpoly",
        title: "Low-poly",
        about: "Art of few large triangles, each in one colour, as SVG.",
        not_for: "faithful pictures (photo); pictures of under 600 pixels need a size.",
        format: Some(Format::Svg),
        parameters: &[("method", "flat"), ("effort", "3"), ("size", "600")],
    },
    Preset {
        name: "print",
        title: "Lithophane",
        about: "A lithophane 100 mm wide for a 3D printer, thick where the picture is dark, as STL.",
        not_for: "elevations (terrain), nor for colours; pictures of under 20000 pixels need a size.",
        format: Some(Format::Stl),
        parameters: &[
            ("method", "optimal"),
            ("effort", "1"),
            ("size", "20000"),
            ("alpha", "over:#ffffff"),
            ("relief", "luma"),
            ("invert_relief", "true"),
            ("height", "2.2"),
            ("base", "0.8"),
            ("width", "100"),
            ("unit", "mm"),
        ],
    },
    Preset {
        name: "terrain",
        title: "Terrain",
        about: "Hills from an elevation model, bright is high, with shaded slopes, as glTF.",
        not_for: "pictures whose samples are no heights (photo); other spacings than a metre a step and \
                  30 metres a pixel need z_scale and pixel_size.",
        format: Some(Format::Glb),
        parameters: &[
            ("method", "optimal"),
            ("effort", "1"),
            ("density", "5"),
            ("relief", "luma"),
            ("z_scale", "1"),
            ("pixel_size", "30"),
            ("z_offset", "min"),
            ("center", "true"),
            ("color", "hillshade"),
            ("unit", "m"),
        ],
    },
    Preset {
        name: "sprite",
        title: "Game sprite",
        about: "The picture on a mesh that follows the outline of what is not transparent, for game engines, as glTF.",
        not_for: "pictures without alpha (photo); sprites of under 400 pixels need a size.",
        format: Some(Format::Glb),
        parameters: &[
            ("method", "mgprfs"),
            ("size", "400"),
            ("alpha", "cut"),
            ("texture", "embed"),
            ("center", "true"),
        ],
    },
    Preset {
        name: "logo",
        title: "Logo",
        about: "Plain colours with sharp outlines, each triangle in one of them, as SVG.",
        not_for: "photographs and gradients (photo, or lowpoly); icons of under 100 by 100 pixels need a size.",
        format: Some(Format::Svg),
        parameters: &[("method", "flat"), ("effort", "3"), ("density", "2"), ("alpha", "cut")],
    },
    Preset {
        name: "placeholder",
        title: "Placeholder",
        about: "An SVG of about a kilobyte, compressed, to show while a picture loads.",
        not_for: "pictures to be looked at for long (lowpoly, or photo).",
        format: Some(Format::Svg),
        parameters: &[("method", "flat"), ("effort", "6"), ("size", "30")],
    },
    Preset {
        name: "draft",
        title: "Draft",
        about: "A first look in the least time.",
        not_for: "meshes to keep: photo is 4 to 6 dB closer.",
        format: None,
        parameters: &[("method", "preview"), ("density", "1")],
    },
];

/// The names of the presets, in their order.
pub(super) static NAMES: [&str; PRESETS.len()] = {
    let mut names = [""; PRESETS.len()];
    let mut index = 0;
    while index < names.len() {
        names[index] = PRESETS[index].name;
        index += 1;
    }
    names
};

impl Preset {
    /// The preset of a name.
    pub(super) fn named(name: &str) -> Result<&'static Self, ParameterError> {
        PRESETS.iter().find(|preset| preset.name == name).ok_or_else(|| {
            let value = name.chars().take(64).collect();
            ParameterError::UnknownValue { parameter: "preset", value, allowed: &NAMES }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::{MeshOptions, ParameterSet};

    fn options(query: &str) -> MeshOptions {
        ParameterSet::of_query(Some(query)).unwrap().finish().unwrap()
    }

    #[test]
    fn every_preset_sets_what_it_says() {
        for preset in &PRESETS {
            let options = options(&format!("preset={}", preset.name));
            assert_eq!(options.usual_format, preset.format, "{}", preset.name);
            assert_eq!(preset.object().len(), preset.parameters.len(), "{}", preset.name);
            let made = options.object();
            for (name, value) in preset.object() {
                assert_eq!(made[&name], value, "{}: {name}", preset.name);
            }
        }
    }

    #[test]
    fn parameters_given_beside_a_preset_win() {
        let given = options("height=3&preset=print&size=500&unit=m&format=obj").object();
        for (name, value) in
            [("height", "3"), ("size", "500"), ("unit", "\"m\""), ("format", "\"obj\"")]
        {
            assert_eq!(given[name].to_string(), value);
        }
        assert_eq!(given["base"], 0.8);
        let given = options("preset=print&density=3").object();
        assert!(!given.contains_key("size"));
        let given = options("preset=terrain&width=5&texture=embed").object();
        assert!(!given.contains_key("pixel_size") && !given.contains_key("color"));
    }

    #[test]
    fn another_method_takes_its_own_parameters() {
        let given = options("preset=logo&method=med").object();
        assert_eq!((&given["effort"], &given["reconstruction"]), (&0.into(), &"linear".into()));
        assert_eq!((&given["density"], &given["alpha"]), (&2.into(), &"cut".into()));
    }

    #[test]
    fn a_stored_preset_keeps_its_format_and_no_name() {
        let options = options("preset=placeholder");
        assert_eq!((options.format, options.usual_format), (None, Some(Format::Svg)));
        let stored = MeshOptions::of_stored(&options.stored()).unwrap();
        assert_eq!((stored.format, stored.usual_format), (Some(Format::Svg), None));
        assert!(!options.stored().contains("preset"));
        assert_eq!(MeshOptions { format: None, ..stored }.query(), options.query());
    }

    #[test]
    fn an_unknown_preset_is_refused_with_the_list() {
        let error = ParameterSet::of_query(Some("preset=phto")).unwrap_err().to_string();
        assert!(error.contains("photo, lowpoly, print, terrain, sprite, logo"), "{error}");
    }
}
