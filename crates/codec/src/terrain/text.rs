//! An elevation model as a line of text, which MODEL keeps as a comment and pmesh behind its header.
//!
//! Words and their numbers, separated by blanks:
//!
//! | word | numbers |
//! |---|---|
//! | `base`, `step` | the height of the sample 0, and from a sample to the next |
//! | `rounding` | the largest difference of a height from that of its sample |
//! | `unit` | metres of a unit of heights |
//! | `bound` | the largest error of the mesh's heights, where it was asked for |
//! | `transform` | six, as in [`Georeference::transform`], where the place is known |
//! | `linear_unit`, `degrees` | metres of a unit of projected coordinates, or that they are degrees |
//! | `epsg` | the code of the coordinate system, where it has one |
//! | `holes` | where samples of alpha 0 are missing |

use super::Terrain;
use pixmesh_meshing::Shape;
use pixmesh_meshing::alpha::has_alpha;
use pixmesh_terrain::{Georeference, Steps};
use std::fmt;
use std::str::SplitAsciiWhitespace;

/// The words before the line.
const TITLE: &str = "elevation model:";

impl fmt::Display for Terrain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Steps { base, step, rounding } = self.steps;
        // The shortest digits that read back as the same number.
        write!(
            f,
            "{TITLE} base {base:?} step {step:?} rounding {rounding:?} unit {:?}",
            self.unit
        )?;
        if let Some(bound) = self.bound {
            write!(f, " bound {bound:?}")?;
        }
        if let Some(place) = self.georeference {
            f.write_str(" transform")?;
            place.transform.iter().try_for_each(|number| write!(f, " {number:?}"))?;
            match place.is_geographic {
                true => f.write_str(" degrees")?,
                false => write!(f, " linear_unit {:?}", place.linear_unit)?,
            }
            if let Some(epsg) = place.epsg {
                write!(f, " epsg {epsg}")?;
            }
        }
        f.write_str(if self.has_holes { " holes" } else { "" })
    }
}

impl Terrain {
    /// Reads the line of a mesh of this shape; `None` where it is of something else, and what is wrong
    /// with it where it is damaged.
    pub(crate) fn of_text(text: &[u8], shape: Shape) -> Option<Result<Self, String>> {
        let line = text.trim_ascii().strip_prefix(TITLE.as_bytes())?;
        Some(read(&String::from_utf8_lossy(line), shape))
    }
}

fn read(line: &str, shape: Shape) -> Result<Terrain, String> {
    let (mut words, mut steps) = (line.split_ascii_whitespace(), [None; 3]);
    let (mut unit, mut bound, mut has_holes) = (None, None, false);
    let (mut transform, mut epsg, mut linear_unit, mut is_geographic) = (None, None, 1.0, false);
    while let Some(word) = words.next() {
        match word {
            "base" => steps[0] = Some(number(word, &mut words)?),
            "step" => steps[1] = Some(positive(word, &mut words)?),
            "rounding" => steps[2] = Some(number(word, &mut words)?),
            "unit" => unit = Some(positive(word, &mut words)?),
            "bound" => bound = Some(number(word, &mut words)?),
            "transform" => {
                let mut numbers = [0.0; 6];
                for place in &mut numbers {
                    *place = number(word, &mut words)?;
                }
                transform = Some(numbers);
            }
            "linear_unit" => linear_unit = positive(word, &mut words)?,
            "degrees" => is_geographic = true,
            "epsg" => epsg = words.next().and_then(|code| code.parse().ok()),
            "holes" => has_holes = true,
            _ => return Err(format!("the elevation model has no '{}'", word.escape_default())),
        }
    }
    let ([Some(base), Some(step), Some(rounding)], Some(unit)) = (steps, unit) else {
        return Err("the elevation model needs base, step, rounding and unit".to_owned());
    };
    if has_holes && !has_alpha(shape.component_count) {
        return Err("the elevation model has holes, and the mesh no alpha".to_owned());
    }
    let georeference = match transform {
        None => None,
        Some(numbers) => {
            let place = Georeference::new(numbers, epsg, is_geographic, linear_unit);
            Some(place.ok_or("the transform of the elevation model gives no places")?)
        }
    };
    let most = (base.abs() + f64::from(u16::MAX) * step) * unit;
    if most > f32::MAX.into() {
        return Err("the heights of the elevation model are too large".to_owned());
    }
    let steps = Steps { base, step, rounding };
    let Shape { width, height, .. } = shape;
    Ok(Terrain { width, height, steps, unit, bound, georeference, has_holes })
}

fn number(word: &str, words: &mut SplitAsciiWhitespace<'_>) -> Result<f64, String> {
    let number = words.next().and_then(|text| text.parse().ok()).filter(|n: &f64| n.is_finite());
    number.ok_or_else(|| format!("'{word}' of the elevation model is no finite number"))
}

fn positive(word: &str, words: &mut SplitAsciiWhitespace<'_>) -> Result<f64, String> {
    Some(number(word, words)?)
        .filter(|&number| number > 0.0)
        .ok_or_else(|| format!("'{word}' of the elevation model must be over 0"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SHAPE: Shape = Shape { width: 9, height: 7, component_count: 2, precision: 16 };

    prop_compose! {
        fn terrain()(
            base in -1e5..1e5,
            step in 1e-9..1e9,
            [rounding, unit, linear_unit] in prop::array::uniform3(1e-3..1e3),
            bound in prop::option::of(0.0..100.0),
            [x, y, shear] in prop::array::uniform3(-1e7..1e7),
            epsg in prop::option::of(1u32..99_999),
            (is_placed, is_geographic, has_holes) in any::<(bool, bool, bool)>(),
        ) -> Terrain {
            let place = || {
                let transform = [x, 0.1, shear, y, 0.0, -30.5];
                let linear_unit = if is_geographic { 1.0 } else { linear_unit };
                Georeference::new(transform, epsg, is_geographic, linear_unit).unwrap()
            };
            Terrain {
                width: 9,
                height: 7,
                steps: Steps { base, step, rounding },
                unit,
                bound,
                georeference: is_placed.then(place),
                has_holes,
            }
        }
    }

    proptest! {
        #[test]
        fn text_reads_back_as_the_same_model(terrain in terrain()) {
            let text = terrain.to_string();
            let read = Terrain::of_text(text.as_bytes(), SHAPE);
            prop_assert_eq!(read, Some(Ok(terrain)));
        }

        #[test]
        fn any_text_is_read_or_refused(words in prop::collection::vec(
            prop::sample::select(vec![
                "base", "step", "transform", "epsg", "holes", "unit", "rounding", "1", "0", "-1",
                "1e308", "nan", "inf", "x",
            ]),
            0..24,
        )) {
            let text = format!("{TITLE} {}", words.join(" "));
            if let Some(Ok(terrain)) = Terrain::of_text(text.as_bytes(), SHAPE) {
                prop_assert!(terrain.extras().to_string().contains("step"));
            }
        }
    }

    #[test]
    fn damaged_text_is_refused_with_its_word() {
        let of = |text: &str| Terrain::of_text(text.as_bytes(), SHAPE);
        assert_eq!(of("elevation: 5 m"), None);
        let refusal = |text: &str| of(&format!("{TITLE} {text}")).unwrap().unwrap_err();
        assert!(refusal("base 1 step 0 rounding 0 unit 1").contains("'step'"));
        assert!(refusal("base 1 step 1 rounding nan unit 1").contains("'rounding'"));
        assert!(refusal("base 1 step 1 rounding 0").contains("needs"));
        assert!(refusal("base 1 step 1 rounding 0 unit 1 up 2").contains("'up'"));
        let flat = refusal("base 1 step 1 rounding 0 unit 1 transform 0 1 1 0 1 1");
        assert!(flat.contains("no places"), "{flat}");
        let gray = Shape { component_count: 1, ..SHAPE };
        let text = format!("{TITLE} base 1 step 1 rounding 0 unit 1 holes");
        assert!(Terrain::of_text(text.as_bytes(), gray).unwrap().is_err());
    }
}
