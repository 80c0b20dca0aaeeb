//! The choices that writers offer: enumerations whose values have the names that users write.

use pixmesh_meshing::named_values;

named_values! {
    /// What a relief's height follows.
    #[derive(Default)]
    "relief" ReliefSource {
        /// The luma `0.299 R + 0.587 G + 0.114 B` of three or four components, else the first.
        #[default]
        Luma = "luma",
        /// The first component.
        First = "c0",
        /// The second component.
        Second = "c1",
        /// The third component.
        Third = "c2",
        /// The fourth component.
        Fourth = "c3",
    }
}

named_values! {
    /// What lengths are measured in.
    #[derive(Default)]
    "unit" LengthUnit {
        /// Metres, which is also what glTF means by its numbers.
        #[default]
        Metre = "m",
        /// Millimetres, which is what printers take the numbers of an STL for.
        Millimetre = "mm",
    }
}

named_values! {
    /// Which axis heights follow.
    "up" UpAxis {
        /// `y`: the picture lies on the ground, as glTF's viewers expect of a relief.
        Y = "y",
        /// `z`: the picture stands on the axes `x` and `y`.
        Z = "z",
    }
}

named_values! {
    /// What the vertices' colours show.
    #[derive(Default)]
    "color" Coloring {
        /// The picture. A gray relief of more than 8 bits takes black and white from the least and
        /// the largest sample of its vertices.
        #[default]
        Image = "image",
        /// Nothing: the file has no colours.
        None = "none",
        /// The relief in the light from the upper left.
        Hillshade = "hillshade",
        /// The height, from green over brown to white between the lowest and the highest vertex.
        Ramp = "ramp",
    }
}

named_values! {
    /// How a glTF file stores its vertices and indices.
    #[derive(Default)]
    "compression" Compression {
        /// As 32-bit floating-point positions: every reader understands it.
        #[default]
        None = "none",
        /// As 16-bit integers (`KHR_mesh_quantization`), exact in the plane.
        Quantized = "quantized",
        /// As such integers, compressed (`EXT_meshopt_compression`).
        Meshopt = "meshopt",
    }
}

named_values! {
    /// What a glTF file shows on its triangles.
    #[derive(Default)]
    "texture" Texturing {
        /// The vertices' colours.
        #[default]
        None = "none",
        /// The picture that the mesh was made of, which the file carries.
        Embed = "embed",
    }
}

named_values! {
    /// How the triangles of an SVG are filled.
    #[derive(Default)]
    "shading" Shading {
        /// Each with the mean of its corners' colours.
        #[default]
        Flat = "flat",
        /// With its corners' colours, interpolated linearly.
        Gradient = "gradient",
    }
}

named_values! {
    /// How much time a PNG's compression may take.
    #[derive(Default)]
    "png_compression" PngCompression {
        /// About as little as rebuilding the picture.
        #[default]
        Fast = "fast",
        /// Some tens of times as much, for a smaller file.
        Small = "small",
    }
}
