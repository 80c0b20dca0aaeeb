//! Serde: choices by the names that users write, meshes checked again when they are read.

use crate::image::{Point, Shape};
use crate::model::mesh::Mesh;
use crate::parameters::*;
use crate::triangulation::Face;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};
use std::borrow::Cow;

macro_rules! by_name {
    ($($type:ty),+) => {
        $(impl Serialize for $type {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(self.name())
            }
        }

        impl<'de> Deserialize<'de> for $type {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                Cow::<'de, str>::deserialize(deserializer)?.parse().map_err(D::Error::custom)
            }
        })+
    };
}

by_name! {
    Boundary, Connectivity, ErrorMetric, Generator, Guide, Method, Parallel, Policy, PscTie,
    Reconstruction, Scan, Smoothing, SmoothingDirection, Startup, Values
}

/// The parts of a mesh before they are checked.
#[derive(Deserialize)]
struct MeshParts {
    shape: Shape,
    points: Vec<Point>,
    samples: Vec<u16>,
    faces: Vec<Face>,
    face_samples: Option<Vec<u16>>,
}

impl<'de> Deserialize<'de> for Mesh {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let MeshParts { shape, points, samples, faces, face_samples } =
            MeshParts::deserialize(deserializer)?;
        let mesh = Self::new(shape, points, samples, faces, &()).map_err(D::Error::custom)?;
        match face_samples {
            Some(samples) => mesh.with_face_samples(samples).map_err(D::Error::custom),
            None => Ok(mesh),
        }
    }
}

/// The parts of weights, row 0 at the bottom.
#[derive(Deserialize)]
struct WeightsParts {
    width: usize,
    height: usize,
    values: Vec<u8>,
}

impl<'de> Deserialize<'de> for Weights {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let WeightsParts { width, height, values } = WeightsParts::deserialize(deserializer)?;
        Self::from_bottom_up(width, height, values).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_survive_json() {
        let weights = Weights::from_top_down(2, 2, vec![1, 2, 3, 4]).ok();
        let own = Method::Optimal.parameters(Target::Psnr(31.5)).weights(weights);
        let text = serde_json::to_string(&own).unwrap();
        assert!(text.contains(r#""policy":"psd_max_d""#), "{text}");
        assert_eq!(serde_json::from_str::<Parameters>(&text).unwrap(), own);
        let defaults = serde_json::from_str::<Parameters>("{}").unwrap();
        assert_eq!(defaults, Parameters::default());
        let error = serde_json::from_str::<Parameters>(r#"{"scan":"zigzag"}"#).unwrap_err();
        assert!(error.to_string().contains("raster, serpentine"), "{error}");
    }

    #[test]
    fn meshes_are_checked_when_read() {
        let shape = Shape { width: 2, height: 2, component_count: 1, precision: 8 };
        let points = crate::image::corner_points(2, 2).to_vec();
        let mesh = Mesh::new(shape, points, vec![7; 4], vec![[0, 1, 3], [0, 3, 2]], &()).unwrap();
        let text = serde_json::to_string(&mesh).unwrap();
        assert_eq!(serde_json::from_str::<Mesh>(&text).unwrap(), mesh);
        let broken = text.replace("[0,3,2]", "[0,2,3]");
        let error = serde_json::from_str::<Mesh>(&broken).unwrap_err().to_string();
        assert!(error.contains("face 1 is clockwise"), "{error}");
    }
}
