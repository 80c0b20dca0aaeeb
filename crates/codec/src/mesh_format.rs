//! The formats that meshes are written in.

use pixmesh_meshing::named_values;

named_values! {
    /// A format that [`encode`](crate::encode()) writes.
    ///
    /// ```
    /// use pixmesh_codec::Format;
    ///
    /// assert_eq!(Format::of_file_ending("GLB"), Some(Format::Glb));
    /// assert_eq!(Format::Glb.media_types(), ["model/gltf-binary"]);
    /// assert_eq!("svg".parse(), Ok(Format::Svg));
    /// ```
    #[derive(Default)]
    "format" Format {
        /// MODEL text.
        #[default]
        Model = "model",
        /// glTF 2.0, binary.
        Glb = "glb",
        /// The picture rebuilt from the mesh, as PNG.
        Png = "png",
        /// The picture rebuilt from the mesh, as PGM, PPM or PAM.
        Pnm = "pnm",
        /// glTF 2.0 as JSON with an embedded buffer.
        Gltf = "gltf",
        /// The triangles as SVG.
        Svg = "svg",
        /// PLY, binary.
        Ply = "ply",
        /// Wavefront OBJ.
        Obj = "obj",
        /// STL of a solid, binary.
        Stl = "stl",
        /// Counts, errors and arrays as JSON.
        Json = "json",
        /// Points and samples, compressed: pmesh.
        Pmesh = "pmesh",
        /// A pmesh whose vertices are in the order of their importance: every smaller mesh at once.
        Progression = "progression",
        /// Quantized-mesh 1.0: a tile of terrain, of elevation models in degrees.
        Terrain = "terrain",
    }
}

impl Format {
    /// The media types that name the format, the preferred one first.
    #[must_use]
    pub fn media_types(self) -> &'static [&'static str] {
        match self {
            Self::Model => &["text/plain", "application/vnd.pixmesh.model"],
            Self::Glb => &["model/gltf-binary"],
            Self::Png => &["image/png"],
            Self::Pnm => &["image/x-portable-anymap"],
            Self::Gltf => &["model/gltf+json"],
            Self::Svg => &["image/svg+xml"],
            Self::Ply => &["application/ply"],
            Self::Obj => &["model/obj"],
            Self::Stl => &["model/stl"],
            Self::Json => &["application/json"],
            Self::Terrain => &["application/vnd.quantized-mesh"],
            Self::Pmesh | Self::Progression => &["application/vnd.pixmesh.pmesh"],
        }
    }

    /// The name of a file in this format.
    #[must_use]
    pub fn file_name(self) -> String {
        match self {
            Self::Progression => "progression.pmesh".into(),
            _ => format!("mesh.{self}"),
        }
    }

    /// The format that a file's ending names, in any case; `pmesh` is [`Format::Pmesh`].
    #[must_use]
    pub fn of_file_ending(ending: &str) -> Option<Self> {
        match ending.to_ascii_lowercase().as_str() {
            "pgm" | "ppm" | "pam" => Some(Self::Pnm),
            "progression" => None,
            name => name.parse().ok(),
        }
    }

    /// Whether the format is a picture rebuilt from the mesh.
    #[must_use]
    pub fn is_picture(self) -> bool {
        matches!(self, Self::Png | Self::Pnm)
    }

    /// Whether the format can embed the picture as a texture.
    #[must_use]
    pub fn holds_texture(self) -> bool {
        matches!(self, Self::Glb | Self::Gltf)
    }
}
