//! The part of the document about jobs, reconstructions and comparisons.
//!
//! Names and bounds come from the tables that the routes work by.

use super::parts::{
    bytes, content, form, header, mesh, query_parameter, refusal, text, values, with_or_without_key,
};
use crate::extract::accept::pictures;
use crate::routes::jobs::list;
use pixmesh_engine::params::TABLE;
use pixmesh_jobs::record::State;
use pixmesh_meshing::parameters::MIN_SIZE;
use serde_json::{Value, json};
use utoipa::openapi::path::{HttpMethod, OperationBuilder, PathItem, PathsBuilder};
use utoipa::openapi::request_body::{RequestBody, RequestBodyBuilder};
use utoipa::openapi::schema::{ObjectBuilder, Type};
use utoipa::openapi::{ContentBuilder, Ref, RefOr, Required, Response, ResponseBuilder};

/// Adds the paths.
pub(super) fn paths(paths: PathsBuilder) -> PathsBuilder {
    let with = |method, operation: OperationBuilder| PathItem::new(method, operation.build());
    let mut jobs = with(HttpMethod::Post, create());
    jobs.get = Some(list_jobs().build());
    let mut job = with(HttpMethod::Get, show());
    job.delete = Some(cancel().build());
    paths
        .path("/v1/jobs", jobs)
        .path("/v1/jobs/{id}", job)
        .path("/v1/jobs/{id}/events", with(HttpMethod::Get, events()))
        .path("/v1/jobs/{id}/mesh", with(HttpMethod::Get, job_mesh()))
        .path("/v1/reconstructions", with(HttpMethod::Post, reconstruct()))
        .path("/v1/comparisons", with(HttpMethod::Post, compare()))
}

/// What `POST /v1/meshes` and `POST /v1/jobs` answer with when there is a job.
pub(super) fn accepted() -> Response {
    ResponseBuilder::new()
        .description("A job, on stable storage")
        .header("Location", header(Type::String, "Where the job is"))
        .header("Retry-After", header(Type::Integer, "Seconds after which to look again"))
        .content("application/json", referred("Job"))
        .build()
}

/// The header `Prefer` of `POST /v1/meshes`.
pub(super) fn prefer() -> Value {
    json!({
        "name": "Prefer", "in": "header", "required": false, "schema": { "type": "string" },
        "description": "respond-async: a job instead of a mesh. wait=S: a job, whose mesh is waited \
                        for for S seconds (RFC 7240)."
    })
}

/// The header `Idempotency-Key`.
pub(super) fn idempotency_key() -> Value {
    json!({
        "name": "Idempotency-Key", "in": "header", "required": false,
        "schema": { "type": "string", "minLength": 1, "maxLength": 255, "pattern": "^[!-~]+$" },
        "description": "A word for this submission, remembered for a day: the same word with the \
                        same image and parameters is the same job, with others it is refused."
    })
}

fn operation(id: &str, summary: &str, about: &str) -> OperationBuilder {
    OperationBuilder::new().operation_id(Some(id)).summary(Some(summary)).description(Some(about))
}

/// An operation with its refusals; one below /v1/ may also be refused for its key.
fn refusing(operation: OperationBuilder, statuses: &[u16]) -> OperationBuilder {
    let operation = operation.securities(Some(with_or_without_key()));
    statuses.iter().chain(&[401, 429]).fold(operation, |operation, &status| {
        operation.response(status.to_string(), refusal(status))
    })
}

pub(super) fn with_parameters(
    operation: OperationBuilder,
    parameters: impl IntoIterator<Item = Value>,
) -> OperationBuilder {
    let parameters = parameters.into_iter().filter_map(|value| serde_json::from_value(value).ok());
    parameters.fold(operation, |operation, parameter: utoipa::openapi::path::Parameter| {
        operation.parameter(parameter)
    })
}

fn create() -> OperationBuilder {
    let operation = operation(
        "createJob",
        "An image in, a job out",
        "As createMesh, but always as a job; the answer comes when image and job are on stable \
         storage. The job ends completed, failed or cancelled, whatever happens to the service. The \
         body may also be a JSON object with the image in base64 and the parameters as `params`.",
    );
    let operation = operation.request_body(Some(image_form_or_json())).response("202", accepted());
    let operation =
        TABLE.iter().fold(operation, |operation, row| operation.parameter(query_parameter(row)));
    let operation = with_parameters(operation, [idempotency_key()]);
    refusing(operation, &[400, 408, 413, 414, 415, 422, 429, 431, 500, 503, 507])
}

fn image_form_or_json() -> RequestBody {
    let params = TABLE
        .iter()
        .fold(ObjectBuilder::new(), |object, row| object.property(row.name, values(row)));
    let base64 = || ObjectBuilder::new().schema_type(Type::String).content_encoding("base64");
    let json = ObjectBuilder::new()
        .property("image", base64())
        .property("weights", base64())
        .required("image")
        .property("params", params)
        .build();
    RequestBodyBuilder::new()
        .description(Some("An image, a form with one, or a JSON object with one in base64."))
        .required(Some(Required::True))
        .content("image/*", content(bytes()))
        .content("application/octet-stream", content(bytes()))
        .content("multipart/form-data", content(form()))
        .content("application/json", content(json))
        .build()
}

fn list_jobs() -> OperationBuilder {
    let operation = operation(
        "listJobs",
        "The caller's jobs, newest first",
        "The cursor of a page, which is null on the last one, asks for the next.",
    );
    let parameter = |name: &str, about: &str, schema: Value| json!({ "name": name, "in": "query", "required": false, "description": about, "schema": schema });
    let parameters = [
        parameter(
            "state",
            "Only jobs in this state.",
            json!({ "type": "string", "enum": State::NAMES }),
        ),
        parameter(
            "limit",
            "The most jobs of the page.",
            json!({ "type": "integer", "minimum": 1, "maximum": list::MOST, "default": list::DEFAULT }),
        ),
        parameter(
            "cursor",
            "The cursor of the page before.",
            json!({ "type": "string", "format": "uuid" }),
        ),
    ];
    let operation = with_parameters(operation, parameters);
    let operation = operation.response("200", json_response("Some of the jobs", "Jobs"));
    refusing(operation, &[400, 414, 422, 431, 500, 503])
}

fn show() -> OperationBuilder {
    let operation = operation("getJob", "A job", "Its state, its progress, and what came of it.");
    let operation = with_parameters(operation, [id()]);
    let operation = operation.response("200", json_response("The job", "Job"));
    refusing(operation, &[400, 404, 410, 414, 431, 500, 503])
}

fn cancel() -> OperationBuilder {
    let operation = operation(
        "cancelJob",
        "Cancels or deletes a job",
        "A job that waits or runs is cancelled: running work stops within moments. One that has come \
         to its end is deleted, with its mesh.",
    );
    let deleted =
        ResponseBuilder::new().description("It had come to its end, and is deleted").build();
    let operation = with_parameters(operation, [id()])
        .response("202", json_response("It is cancelled, or will be in a moment", "Job"))
        .response("204", deleted);
    refusing(operation, &[400, 404, 410, 414, 431, 500, 503, 507])
}

fn events() -> OperationBuilder {
    let operation = operation(
        "followJob",
        "What happens to a job, as it happens",
        "Server-sent events named state and progress, the data of each a JobEvent, until the job \
         comes to its end. Who comes back with Last-Event-ID hears what was missed.",
    );
    let last = json!({
        "name": "Last-Event-ID", "in": "header", "required": false, "schema": { "type": "string" },
        "description": "The id of the last event heard."
    });
    let stream = ResponseBuilder::new()
        .description("The events")
        .content("text/event-stream", content(text()))
        .build();
    let operation = with_parameters(operation, [id(), last]).response("200", stream);
    refusing(operation, &[400, 404, 410, 414, 431, 500, 503])
}

fn job_mesh() -> OperationBuilder {
    let operation = operation(
        "getJobMesh",
        "The mesh of a completed job, in any format and size",
        "Kept once, and written in the format that the query or else Accept asks for, or else that \
         the job was submitted with. With a size: the mesh of that many vertices that removal passes \
         through on its way down from the job's mesh, where the job keeps the order of its vertices: \
         where removal ends its method, or its format is progression. The format progression is \
         all of these meshes at once, with their squared errors.",
    );
    let header = |name: &str| json!({ "name": name, "in": "header", "required": false, "schema": { "type": "string" } });
    let parameters = [id(), header("If-None-Match"), header("Range"), header("If-Range")];
    let mut operation = with_parameters(operation, parameters);
    if let Some(format) = TABLE.iter().find(|row| row.name == "format") {
        operation = operation.parameter(query_parameter(format));
    }
    let size = json!({
        "name": "size", "in": "query", "required": false,
        "description": "Vertices of the mesh, up to those of the job's. Default: all.",
        "schema": { "type": "integer", "minimum": MIN_SIZE }
    });
    operation = with_parameters(operation, [size]);
    let without_body = |about: &str| ResponseBuilder::new().description(about).build();
    let mut part = mesh();
    part.description = "A part of it".to_owned();
    let operation = operation
        .response("200", mesh())
        .response("206", part)
        .response("304", without_body("The client has it already"));
    refusing(operation, &[400, 404, 406, 409, 410, 414, 416, 422, 431, 500, 503])
}

fn reconstruct() -> OperationBuilder {
    let operation = operation(
        "createReconstruction",
        "A MODEL in, the picture rebuilt from it out",
        "The body is the MODEL text, or a form with one part `model`.",
    );
    let formats: Vec<_> = pictures().map(|picture| picture.format.name()).collect();
    let format = json!({
        "name": "format", "in": "query", "required": false,
        "description": "The format of the picture; wins over the Accept header. Default: png.",
        "schema": { "type": "string", "enum": formats }
    });
    let file = ObjectBuilder::new()
        .property("model", text())
        .required("model")
        .property(
            "format",
            ObjectBuilder::new().schema_type(Type::String).enum_values(Some(formats.clone())),
        )
        .build();
    let body = RequestBodyBuilder::new()
        .description(Some("A mesh as MODEL text, or a form with one."))
        .required(Some(Required::True))
        .content("text/plain", content(text()))
        .content("application/vnd.pixmesh.model", content(text()))
        .content("application/octet-stream", content(bytes()))
        .content("multipart/form-data", content(file))
        .build();
    let mut picture = ResponseBuilder::new().description("The picture").build();
    for offer in pictures() {
        picture.content.insert(offer.media_type.to_owned(), RefOr::T(content(bytes())));
    }
    let operation =
        with_parameters(operation, [format]).request_body(Some(body)).response("200", picture);
    refusing(operation, &[400, 406, 408, 413, 414, 415, 422, 431, 500, 503])
}

fn compare() -> OperationBuilder {
    let operation = operation(
        "createComparison",
        "How close a picture, or a mesh, is to a picture",
        "A form with the parts `image` and `approximation`; the latter is a picture or a MODEL of \
         the same width, height, components and precision, as its content says.",
    );
    let files = ObjectBuilder::new()
        .property("image", bytes())
        .required("image")
        .property("approximation", bytes())
        .required("approximation")
        .build();
    let body = RequestBodyBuilder::new()
        .required(Some(Required::True))
        .content("multipart/form-data", content(files))
        .build();
    let operation = operation
        .request_body(Some(body))
        .response("200", json_response("The figures", "Comparison"));
    refusing(operation, &[400, 408, 413, 414, 415, 422, 431, 500, 503])
}

fn json_response(about: &str, schema: &str) -> Response {
    ResponseBuilder::new().description(about).content("application/json", referred(schema)).build()
}

fn referred(schema: &str) -> utoipa::openapi::Content {
    ContentBuilder::new().schema(Some(Ref::from_schema_name(schema))).build()
}

/// The job in the path.
fn id() -> Value {
    json!({
        "name": "id", "in": "path", "required": true, "description": "The job's id",
        "schema": { "type": "string", "format": "uuid" }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_as_json_is_read_as_such() {
        let document: Value = serde_json::from_str(&super::super::document_text()).unwrap();
        let schemas = &document["components"]["schemas"];
        assert_eq!(schemas["Job"]["properties"]["state"]["enum"], json!(State::NAMES));
        assert_eq!(
            schemas["Jobs"]["properties"]["jobs"]["items"]["$ref"],
            "#/components/schemas/Job"
        );
        assert_eq!(schemas["JobEvent"]["properties"]["at"]["format"], "date-time");
        assert_eq!(schemas["Comparison"]["properties"]["ssim"]["type"], json!(["number", "null"]));
        let parameters = |path: &str, method: &str| {
            let list = document["paths"][path][method]["parameters"].as_array().unwrap().iter();
            list.map(|row| row["name"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(parameters("/v1/jobs", "get"), ["state", "limit", "cursor"]);
        assert_eq!(parameters("/v1/jobs/{id}", "delete"), ["id"]);
        let mesh = parameters("/v1/jobs/{id}/mesh", "get");
        assert_eq!(mesh, ["id", "If-None-Match", "Range", "If-Range", "format", "size"]);
        assert!(parameters("/v1/jobs", "post").contains(&"Idempotency-Key".to_owned()));
        assert!(parameters("/v1/meshes", "post").contains(&"Prefer".to_owned()));
    }
}
