//! The parameters of operations: query, path and headers.

use super::examples;
use crate::extract::accept::pictures;
use crate::extract::fields::RECONSTRUCTION;
use pixmesh_engine::params::{Parameter as Row, TABLE, Takes, WRITING, WRITTEN_ALPHAS};
use pixmesh_jobs::record::State;
use pixmesh_meshing::parameters::MIN_SIZE;
use utoipa::IntoParams;
use utoipa::openapi::path::{Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::{KnownFormat, Object, ObjectBuilder, SchemaFormat, Type};
use utoipa::openapi::{RefOr, Required, Schema};

/// The most jobs of a page, and the number without `limit`.
pub(in crate::routes) const MOST_JOBS: u64 = 100;
pub(in crate::routes) const DEFAULT_JOBS: u64 = 20;

/// Declares a type with the parameters that operations name it for.
macro_rules! parameters {
    ($($(#[$doc:meta])* $name:ident => $parameters:expr;)*) => {$(
        $(#[$doc])*
        pub(in crate::routes) struct $name;

        impl IntoParams for $name {
            fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Parameter> {
                Vec::from($parameters)
            }
        }
    )*};
}

parameters! {
    /// The parameters of meshes, from the table that the parser works by.
    MeshParameters => TABLE.iter().map(mesh_parameter).collect::<Vec<_>>();
    /// The parameter that names an image which the service keeps.
    ImageOf => [query(
        "image_of",
        "The id of a job whose image is taken, so that it need not be sent again: the body is empty, \
         or a form without the part image. The job must still wait or run, or keep its image \
         (keep_image).",
        uuid(),
    )];
    /// The header that asks for a job.
    Prefer => [header(
        "Prefer",
        "respond-async: a job instead of a mesh. wait=S: a job, whose mesh the service waits for up \
         to S seconds (RFC 7240).",
        string(),
    )];
    /// The header by which a repeated submission is the same job.
    IdempotencyKey => [header(
        "Idempotency-Key",
        "A key for this submission, valid for a day: the same key with the same image and parameters \
         is the same job, and with others an error.",
        string().min_length(Some(1)).max_length(Some(255)).pattern(Some("^[!-~]+$")),
    )];
    /// The header with which a client continues a stream of events.
    LastEventId => [header("Last-Event-ID", "The id of the last event received.", string())];
    /// The id in the path.
    JobPath => [parameter("id", ParameterIn::Path, "The job's id", uuid())];
    /// The slug in the path.
    ProblemPath => [parameter("slug", ParameterIn::Path, "The end of the problem's type", string()
        .enum_values(Some(crate::problem::Kind::ALL.iter().map(|kind| kind.slug()))))];
    /// The parameters of a page of jobs.
    PageParameters => [
        query("state", "Only jobs in this state.", string().enum_values(Some(State::NAMES.iter().copied()))),
        query(
            "limit",
            "The most jobs of the page.",
            ObjectBuilder::new()
                .schema_type(Type::Integer)
                .minimum(Some(1))
                .maximum(Some(MOST_JOBS as usize))
                .default(Some(DEFAULT_JOBS.into())),
        ),
        query("cursor", "The cursor of the page before.", uuid()),
    ];
    /// The parameters of a completed job's mesh.
    KeptMeshParameters => [
        header("If-None-Match", "Entity tags of meshes that the client has.", string()),
        header("If-Match", "Entity tags of which the mesh must have one.", string()),
        header("Range", "A part of the mesh, in bytes.", string()),
        header("If-Range", "The entity tag of the mesh that the part must belong to.", string()),
    ]
    .into_iter()
    .chain(writing_parameters(
        "How a picture is rebuilt: by linear interpolation, or with one colour for each face. \
         Another way than that of the job has no figures of its error. Default: that of the job.",
        "Vertices of the mesh, up to those of the job's. Default: all.",
    ))
    .collect::<Vec<_>>();
    /// The parameters of a conversion.
    ConversionParameters => writing_parameters(OF_FILE, SIZE_OF_FILE);
    /// The parameters of a reconstruction.
    PictureParameters => [query(
        "format",
        "The format of the picture; takes precedence over Accept. Default: png.",
        string().enum_values(Some(pictures().map(|picture| picture.format.name()))),
    )]
    .into_iter()
    .chain(writing_parameters(OF_FILE, SIZE_OF_FILE).into_iter().filter(|parameter| {
        parameter.name != "format" && RECONSTRUCTION.contains(&parameter.name.as_str())
    }))
    .collect::<Vec<_>>();
}

const OF_FILE: &str = "How a picture is rebuilt: by linear interpolation, or with one colour for \
                       each face. Default: as the file says.";
const SIZE_OF_FILE: &str =
    "Vertices of the mesh; fewer than the file has need a progression. Default: all.";

const ALPHA_OF_FILE: &str = "Whether triangles that show nothing, because their alpha is 0, are \
                             kept or cut. MODEL, pmesh and pictures keep them.";

/// The parameters of writing a mesh that was made before.
fn writing_parameters(reconstruction: &'static str, size: &'static str) -> Vec<Parameter> {
    let written = |row: &&Row| row.name == "format" || WRITING.contains(&row.name);
    let rebuilt = TABLE.iter().filter(|row| row.name == "reconstruction").map(|row| {
        let mut parameter = mesh_parameter(row);
        parameter.description = Some(reconstruction.into());
        parameter
    });
    let vertices = ObjectBuilder::new().schema_type(Type::Integer).minimum(Some(MIN_SIZE));
    let sized = [query("size", size, vertices)];
    let mut parameters: Vec<_> =
        TABLE.iter().filter(written).map(mesh_parameter).chain(rebuilt).chain(sized).collect();
    if let Some(alpha) = parameters.iter_mut().find(|parameter| parameter.name == "alpha") {
        let names = WRITTEN_ALPHAS.iter().copied();
        let names = ObjectBuilder::new().schema_type(Type::String).enum_values(Some(names));
        *alpha = query("alpha", ALPHA_OF_FILE, names);
    }
    parameters
}

fn mesh_parameter(row: &Row) -> Parameter {
    let schema = RefOr::T(Schema::Object(values(row)));
    let parameter = ParameterBuilder::new()
        .name(row.name)
        .parameter_in(ParameterIn::Query)
        .required(Required::False)
        .description(Some(row.about))
        .schema(Some(schema));
    parameter.example(examples::value(row)).build()
}

/// The schema of a parameter's values.
pub(super) fn values(row: &Row) -> Object {
    let object = ObjectBuilder::new();
    match row.takes {
        Takes::Decimal { least, most } => {
            object.schema_type(Type::Number).minimum(Some(least)).maximum(Some(most))
        }
        Takes::Whole { least, most } => object
            .schema_type(Type::Integer)
            .minimum(usize::try_from(least).ok())
            .maximum(usize::try_from(most).ok()),
        Takes::Flag => object.schema_type(Type::Boolean),
        Takes::Word(allowed) => {
            object.schema_type(Type::String).enum_values(Some(allowed.iter().copied()))
        }
        Takes::Pattern(pattern) => object.schema_type(Type::String).pattern(Some(pattern)),
    }
    .build()
}

fn query(name: &str, about: &str, schema: ObjectBuilder) -> Parameter {
    parameter(name, ParameterIn::Query, about, schema)
}

fn header(name: &str, about: &str, schema: ObjectBuilder) -> Parameter {
    parameter(name, ParameterIn::Header, about, schema)
}

fn parameter(name: &str, place: ParameterIn, about: &str, schema: ObjectBuilder) -> Parameter {
    let is_path = matches!(place, ParameterIn::Path);
    ParameterBuilder::new()
        .name(name)
        .parameter_in(place)
        .required(if is_path { Required::True } else { Required::False })
        .description(Some(about))
        .schema(Some(schema))
        .build()
}

fn string() -> ObjectBuilder {
    ObjectBuilder::new().schema_type(Type::String)
}

fn uuid() -> ObjectBuilder {
    string().format(Some(SchemaFormat::KnownFormat(KnownFormat::Uuid)))
}
