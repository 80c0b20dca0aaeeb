//! The choices that writers offer: enumerations whose values have the names that users write.

use pixmesh_meshing::ParameterError;
use std::fmt;
use std::str::FromStr;

/// Declares an enumeration whose values have the names that users write.
macro_rules! named_values {
    (
        $(#[$attribute:meta])*
        $parameter:literal $type:ident {
            $($(#[$doc:meta])* $value:ident = $name:literal),+ $(,)?
        }
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub enum $type {
            $($(#[$doc])* $value),+
        }

        impl $type {
            /// Name of the parameter that takes these values.
            pub const PARAMETER: &'static str = $parameter;
            /// Every value, in the order of their documentation.
            pub const ALL: &'static [Self] = &[$(Self::$value),+];
            /// The name of every value, in the same order.
            pub const NAMES: &'static [&'static str] = &[$($name),+];

            /// The value's name, as users write it.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $name),+
                }
            }
        }

        impl fmt::Display for $type {
            fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str(self.name())
            }
        }

        impl FromStr for $type {
            type Err = ParameterError;

            fn from_str(name: &str) -> Result<Self, ParameterError> {
                match name {
                    $($name => Ok(Self::$value),)+
                    _ => Err(ParameterError::UnknownValue {
                        parameter: $parameter,
                        value: name.to_owned(),
                        allowed: Self::NAMES,
                    }),
                }
            }
        }
    };
}

named_values! {
    /// What a relief's height follows.
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
    "unit" LengthUnit {
        /// Metres, which is also what glTF means by its numbers.
        #[default]
        Metre = "m",
        /// Millimetres, which is what printers take the numbers of an STL for.
        Millimetre = "mm",
    }
}

named_values! {
    /// How a glTF file stores its vertices and indices.
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
    "png_compression" PngCompression {
        /// About as little as rebuilding the picture.
        #[default]
        Fast = "fast",
        /// Some tens of times as much, for a smaller file.
        Small = "small",
    }
}
