//! Every refusal, as a problem document (RFC 9457).
//!
//! The table below is the one place where a refusal gets its slug, status and title. The `type` of
//! a document is the reference `/problems/<slug>`, which the service answers with the row itself;
//! `detail` names the parameter or limit and the numbers; nothing internal is ever in it.
//! A handler returns a [`Problem`]; the outermost layer writes it out with the request's id.

mod domain;
mod render;

pub(crate) use domain::{internal, of_attempt};
pub use render::render;

use axum::http::StatusCode;
use serde_json::Value;

/// Declares the table of problems.
macro_rules! problems {
    ($($kind:ident = $status:ident $slug:literal $title:literal;)+) => {
        /// What kind of refusal it is.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Kind {
            $(#[doc = $title] $kind),+
        }

        impl Kind {
            /// Every kind, by status.
            pub const ALL: &'static [Self] = &[$(Self::$kind),+];

            /// The stable name at the end of the problem's `type`.
            #[must_use]
            pub fn slug(self) -> &'static str {
                match self { $(Self::$kind => $slug),+ }
            }

            /// The status it is answered with.
            #[must_use]
            pub fn status(self) -> StatusCode {
                match self { $(Self::$kind => StatusCode::$status),+ }
            }

            /// The fixed title.
            #[must_use]
            pub fn title(self) -> &'static str {
                match self { $(Self::$kind => $title),+ }
            }
        }
    };
}

problems! {
    BadRequest = BAD_REQUEST "bad-request" "The request cannot be read";
    QueryMalformed = BAD_REQUEST "query-malformed" "The query is not correctly encoded";
    UnknownParameter = BAD_REQUEST "unknown-parameter" "Unknown parameter";
    DuplicateParameter = BAD_REQUEST "duplicate-parameter" "Repeated parameter";
    ParameterMalformed = BAD_REQUEST "parameter-malformed" "Malformed parameter value";
    JsonMalformed = BAD_REQUEST "json-malformed" "The parameters are not a flat JSON object";
    MultipartMalformed = BAD_REQUEST "multipart-malformed" "The form cannot be read";
    TooManyParts = BAD_REQUEST "too-many-parts" "The form has too many parts";
    DuplicatePart = BAD_REQUEST "duplicate-part" "Repeated part of the form";
    ImageMissing = BAD_REQUEST "image-missing" "The form has no part 'image'";
    PartMissing = BAD_REQUEST "part-missing" "Missing part of the form";
    EmptyFile = BAD_REQUEST "empty-file" "The file is empty";
    Unauthorized = UNAUTHORIZED "unauthorized" "The request needs a key";
    NotFound = NOT_FOUND "not-found" "Not found";
    MethodNotAllowed = METHOD_NOT_ALLOWED "method-not-allowed" "Method not allowed";
    NotAcceptable = NOT_ACCEPTABLE "not-acceptable" "No acceptable format";
    JobUnfinished = CONFLICT "job-unfinished" "The job has not finished";
    JobWithoutMesh = CONFLICT "job-without-mesh" "The job ended without a mesh";
    JobWithoutOrder = CONFLICT "job-without-order" "The job's mesh cannot be resized";
    JobWithoutTexture = CONFLICT "job-without-texture" "The job keeps no picture to show";
    Gone = GONE "gone" "The resource has expired";
    RangeNotSatisfiable = RANGE_NOT_SATISFIABLE "range-not-satisfiable" "The range starts beyond the end";
    RequestTimeout = REQUEST_TIMEOUT "request-timeout" "The request took too long to arrive";
    BodyTooLarge = PAYLOAD_TOO_LARGE "body-too-large" "The request's body is too large";
    UriTooLong = URI_TOO_LONG "uri-too-long" "The address is too long";
    UnsupportedMediaType = UNSUPPORTED_MEDIA_TYPE "unsupported-media-type" "Unsupported media type";
    UnsupportedEncoding = UNSUPPORTED_MEDIA_TYPE "unsupported-encoding" "Unsupported content encoding";
    UnsupportedImage = UNSUPPORTED_MEDIA_TYPE "unsupported-image" "Unsupported image format";
    UnknownValue = UNPROCESSABLE_ENTITY "unknown-value" "Unknown parameter value";
    NotFinite = UNPROCESSABLE_ENTITY "not-finite" "A number is not finite";
    ParameterOutOfRange = UNPROCESSABLE_ENTITY "parameter-out-of-range" "Parameter out of range";
    ConflictingParameters = UNPROCESSABLE_ENTITY "conflicting-parameters" "Parameters exclude each other";
    ComponentCount = UNPROCESSABLE_ENTITY "component-count" "The method does not fit the number of components";
    ImageTooLarge = UNPROCESSABLE_ENTITY "image-too-large" "The image is too large";
    MetadataTooLarge = UNPROCESSABLE_ENTITY "metadata-too-large" "The image's metadata is too large";
    DegenerateImage = UNPROCESSABLE_ENTITY "degenerate-image" "The image is too small to be meshed";
    ImageDecodeFailed = UNPROCESSABLE_ENTITY "image-decode-failed" "The image cannot be decoded";
    FormatNotPossible = UNPROCESSABLE_ENTITY "format-not-possible" "The format cannot hold this result";
    WorkTooLarge = UNPROCESSABLE_ENTITY "work-too-large" "The task needs more memory than the service has";
    QuotaExceeded = TOO_MANY_REQUESTS "quota-exceeded" "The key's quota is used up";
    ShapeMismatch = UNPROCESSABLE_ENTITY "shape-mismatch" "The pictures are not of the same shape";
    MeshInvalid = UNPROCESSABLE_ENTITY "mesh-invalid" "The file is not a mesh";
    MeshTooLarge = UNPROCESSABLE_ENTITY "mesh-too-large" "The mesh states more vertices or faces than it has";
    IndexOutOfRange = UNPROCESSABLE_ENTITY "index-out-of-range" "A face names a vertex that does not exist";
    IdempotencyKeyReused = UNPROCESSABLE_ENTITY "idempotency-key-reused" "The idempotency key belongs to another submission";
    TooManyJobs = TOO_MANY_REQUESTS "too-many-jobs" "Too many queued jobs";
    HeadersTooLarge = REQUEST_HEADER_FIELDS_TOO_LARGE "headers-too-large" "The request's headers are too large";
    Internal = INTERNAL_SERVER_ERROR "internal" "Internal error";
    StorageDamaged = INTERNAL_SERVER_ERROR "storage-damaged" "The stored data are damaged";
    AttemptsExhausted = INTERNAL_SERVER_ERROR "attempts-exhausted" "The job crashed its worker in every attempt";
    Overloaded = SERVICE_UNAVAILABLE "overloaded" "The service is overloaded";
    DeadlineExceeded = SERVICE_UNAVAILABLE "deadline-exceeded" "The deadline has passed";
    ShuttingDown = SERVICE_UNAVAILABLE "shutting-down" "The service is stopping";
    StorageUnavailable = SERVICE_UNAVAILABLE "storage-unavailable" "The storage of jobs is unavailable";
    StorageFull = INSUFFICIENT_STORAGE "storage-full" "The storage of jobs is full";
}

impl Kind {
    /// The reference in the problem's `type`.
    #[must_use]
    pub fn reference(self) -> String {
        format!("/problems/{}", self.slug())
    }

    /// The kind for a refusal that the framework made with nothing but a status.
    fn of_status(status: StatusCode) -> Self {
        let named = [
            Self::NotFound,
            Self::MethodNotAllowed,
            Self::NotAcceptable,
            Self::RequestTimeout,
            Self::BodyTooLarge,
            Self::UriTooLong,
            Self::UnsupportedMediaType,
            Self::HeadersTooLarge,
            Self::Overloaded,
        ];
        let fallback = if status.is_client_error() { Self::BadRequest } else { Self::Internal };
        named.into_iter().find(|kind| kind.status() == status).unwrap_or(fallback)
    }
}

/// One refusal: its kind, what exactly is wrong, and members that programs can read.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    kind: Kind,
    detail: String,
    members: Vec<(&'static str, Value)>,
    /// What failed inside the service: for the log alone.
    cause: Option<String>,
}

impl Problem {
    /// A refusal with its detail: what is wrong, with the parameter or limit and the numbers.
    #[must_use]
    pub fn new(kind: Kind, detail: impl Into<String>) -> Self {
        Self { kind, detail: detail.into(), members: Vec::new(), cause: None }
    }

    /// Adds what failed inside the service. The log gets it with the response; the client does not.
    #[must_use]
    pub fn caused_by(self, error: &dyn std::error::Error) -> Self {
        Self { cause: Some(error.to_string()), ..self }
    }

    /// What failed inside the service.
    #[must_use]
    pub fn cause(&self) -> Option<&str> {
        self.cause.as_deref()
    }

    /// What kind it is.
    #[must_use]
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Names the parameter or part that is wrong.
    #[must_use]
    pub fn param(self, name: impl Into<String>) -> Self {
        self.member("param", name.into())
    }

    /// The limit and what was found instead.
    #[must_use]
    pub fn limit(self, limit: impl Into<Value>, actual: impl Into<Value>) -> Self {
        self.member("limit", limit).member("actual", actual)
    }

    /// The least and the most a number may be, what it is, and the nearest that it may be.
    #[must_use]
    pub fn range(
        self,
        minimum: impl Into<Value>,
        maximum: impl Into<Value>,
        actual: impl Into<Value>,
    ) -> Self {
        let (minimum, maximum, actual) = (minimum.into(), maximum.into(), actual.into());
        let number = |value: &Value| match value {
            Value::String(text) => text.parse().ok(),
            other => other.as_f64(),
        };
        let is_below = number(&actual) < number(&minimum);
        let nearest = if is_below { &minimum } else { &maximum };
        // Parameters that are whole numbers take no decimal point.
        let whole = nearest.as_f64().filter(|value| value.fract() == 0.0);
        let nearest = whole.map_or(nearest.clone(), |value| (value as i64).into());
        self.member("minimum", minimum)
            .member("maximum", maximum)
            .member("actual", actual)
            .nearest(nearest)
    }

    /// Every value allowed.
    #[must_use]
    pub fn allowed(self, values: &[&str]) -> Self {
        self.member("allowed", values)
    }

    /// The known name that is most like the one given, or the nearest number that is allowed.
    #[must_use]
    pub fn nearest(self, value: impl Into<Value>) -> Self {
        self.member("nearest", value)
    }

    /// Says in other words what exactly is wrong.
    #[must_use]
    pub fn detail(self, detail: impl Into<String>) -> Self {
        Self { detail: detail.into(), ..self }
    }

    /// The setting that the operator can change the limit with.
    #[must_use]
    pub fn setting(self, flag: &'static str) -> Self {
        self.member("setting", flag)
    }

    /// Anything else that a program can read.
    pub(crate) fn with(self, name: &'static str, value: impl Into<Value>) -> Self {
        self.member(name, value)
    }

    /// When to try again, in seconds; also sent as `Retry-After`.
    #[must_use]
    pub fn retry_after_s(self, seconds: u64) -> Self {
        self.member("retry_after_s", seconds)
    }

    /// Adds a member of its own.
    pub(crate) fn member(mut self, name: &'static str, value: impl Into<Value>) -> Self {
        self.members.push((name, value.into()));
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slugs_are_distinct_and_statuses_are_errors() {
        let slugs: std::collections::HashSet<_> =
            Kind::ALL.iter().map(|kind| kind.slug()).collect();
        assert_eq!(slugs.len(), Kind::ALL.len());
        for kind in Kind::ALL {
            assert!(kind.status().is_client_error() || kind.status().is_server_error());
        }
    }

    #[test]
    fn a_bare_status_gets_the_kind_that_has_it() {
        assert_eq!(Kind::of_status(StatusCode::NOT_FOUND), Kind::NotFound);
        assert_eq!(Kind::of_status(StatusCode::IM_A_TEAPOT), Kind::BadRequest);
        assert_eq!(Kind::of_status(StatusCode::BAD_GATEWAY), Kind::Internal);
    }
}
