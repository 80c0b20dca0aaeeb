//! The bodies of requests and answers that no struct of the program describes.

use super::parameters::values;
use crate::extract::fields::{CONVERSION, RECONSTRUCTION};
use crate::problem::Kind;
use pixmesh_engine::params::TABLE;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{
    ArrayBuilder, KnownFormat, Object, ObjectBuilder, Schema, SchemaFormat, SchemaType, Type,
};
use utoipa::{PartialSchema, ToSchema};

/// Declares types of which only the schemas are used.
macro_rules! schemas {
    ($($(#[$doc:meta])* $name:ident => $schema:expr;)*) => {$(
        $(#[$doc])*
        pub(in crate::routes) struct $name;

        impl PartialSchema for $name {
            fn schema() -> RefOr<Schema> {
                Object::into($schema)
            }
        }

        impl ToSchema for $name {}
    )*};
}

schemas! {
    /// A file.
    Binary => binary().build();
    /// Text that is not JSON.
    Text => text().build();
    /// Any JSON object.
    AnyObject => ObjectBuilder::new().schema_type(Type::Object).build();
    /// A form with an image and the parameters of its mesh.
    MeshForm => TABLE
        .iter()
        .fold(
            ObjectBuilder::new()
                .property("image", binary())
                .required("image")
                .property(
                    "weights",
                    binary().description(Some(
                        "A picture of the image's size: the weight of each pixel, black is zero",
                    )),
                )
                .property("params", params()),
            |fields, row| fields.property(row.name, values(row)),
        )
        .build();
    /// A JSON object with an image in base64 and the parameters of its mesh.
    MeshObject => ObjectBuilder::new()
        .property("image", text().content_encoding("base64"))
        .property("weights", text().content_encoding("base64"))
        .required("image")
        .property("params", params())
        .build();
    /// A form with a mesh whose picture is rebuilt.
    ModelForm => form_of("model", &RECONSTRUCTION)
        .property("format", text().enum_values(Some(
            crate::extract::accept::pictures().map(|picture| picture.format.name()),
        )))
        .build();
    /// A form with a mesh to convert.
    MeshFileForm => form_of("mesh", &CONVERSION)
        .property("image", binary().description(Some("The picture that texture=embed shows")))
        .build();
    /// A problem document (RFC 9457).
    Problem => [
        ("param", text().description(Some("The parameter or part at fault"))),
        ("limit", any("What is allowed")),
        ("actual", any("What was found")),
        ("minimum", any("The least value allowed")),
        ("maximum", any("The largest value allowed")),
        ("nearest", any("The most similar known name, or the nearest number allowed")),
        ("setting", text().description(Some("The operator's flag for the limit"))),
        ("retry_after_s", ObjectBuilder::new().schema_type(Type::Integer)),
        ("request_id", text()),
    ]
    .into_iter()
    .fold(
        ObjectBuilder::new()
            .property("type", text().enum_values(Some(Kind::ALL.iter().map(|kind| kind.reference()))))
            .property("title", text())
            .property("status", ObjectBuilder::new().schema_type(Type::Integer))
            .property("detail", text())
            .property("allowed", ArrayBuilder::new().items(text())),
        |problem, (name, member)| problem.property(name, member),
    )
    .required("type")
    .required("title")
    .required("status")
    .required("detail")
    .build();
    /// A form with a picture and its approximation.
    ComparisonForm => ObjectBuilder::new()
        .property("image", binary())
        .required("image")
        .property("approximation", binary())
        .required("approximation")
        .build();
}

/// A form with a file and parameters of these names.
fn form_of(file: &str, names: &[&str]) -> ObjectBuilder {
    let rows = TABLE.iter().filter(|row| names.contains(&row.name));
    let form = ObjectBuilder::new().property(file, binary()).required(file);
    rows.fold(form, |form, row| form.property(row.name, values(row)))
}

fn params() -> ObjectBuilder {
    let object = ObjectBuilder::new().schema_type(Type::Object);
    TABLE.iter().fold(object, |object, row| object.property(row.name, values(row)))
}

pub(super) fn text() -> ObjectBuilder {
    ObjectBuilder::new().schema_type(Type::String)
}

pub(super) fn binary() -> ObjectBuilder {
    text().format(Some(SchemaFormat::KnownFormat(KnownFormat::Binary)))
}

fn any(about: &str) -> ObjectBuilder {
    ObjectBuilder::new().schema_type(SchemaType::AnyValue).description(Some(about))
}
