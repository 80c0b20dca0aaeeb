//! The table of problems: slug, status, title, cause and remedy of each kind of refusal.

use axum::http::StatusCode;

/// Declares the table of problems.
macro_rules! problems {
    ($(
        $kind:ident = $status:ident $slug:literal $title:literal
            $cause:literal $remedy:literal;
    )+) => {
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

            /// Why a request gets it.
            #[must_use]
            pub fn cause(self) -> &'static str {
                match self { $(Self::$kind => $cause),+ }
            }

            /// What the client can do about it.
            #[must_use]
            pub fn remedy(self) -> &'static str {
                match self { $(Self::$kind => $remedy),+ }
            }
        }
    };
}

problems! {
    BadRequest = BAD_REQUEST "bad-request" "The request cannot be read"
        "The request breaks a rule of HTTP, its body is incomplete, or its body is no file."
        "Read the detail, and send the whole file as the body, as curl --data-binary @file \
         does.";
    QueryMalformed = BAD_REQUEST "query-malformed" "The query is not correctly encoded"
        "The query has a percent sign without two hexadecimal digits, or bytes that are not \
         UTF-8."
        "Encode names and values of the query in percent notation, with UTF-8.";
    UnknownParameter = BAD_REQUEST "unknown-parameter" "Unknown parameter"
        "No parameter of this resource has that name."
        "Use the name in 'nearest' if it is the one you mean. GET /v1/methods lists all \
         parameters.";
    DuplicateParameter = BAD_REQUEST "duplicate-parameter" "Repeated parameter"
        "A parameter occurs twice, in the query, the form or the JSON object together."
        "Give each parameter once.";
    ParameterMalformed = BAD_REQUEST "parameter-malformed" "Malformed parameter value"
        "The value is not of the type of its parameter."
        "Write numbers with the digits 0 to 9 and a decimal point. GET /v1/methods lists the \
         types.";
    JsonMalformed = BAD_REQUEST "json-malformed" "The parameters are not a flat JSON object"
        "The JSON text breaks the syntax, or a parameter in it is a list or an object."
        "Send one JSON object whose values are numbers, strings and booleans.";
    MultipartMalformed = BAD_REQUEST "multipart-malformed" "The form cannot be read"
        "The form breaks the syntax of multipart/form-data, or a field is too long."
        "Let the HTTP client write the form and its boundary, as curl --form image=@photo.png \
         does.";
    TooManyParts = BAD_REQUEST "too-many-parts" "The form has too many parts"
        "The form has more parts than the service reads."
        "Put the parameters into one part 'params', as a JSON object.";
    DuplicatePart = BAD_REQUEST "duplicate-part" "Repeated part of the form"
        "Two parts of the form have the same name."
        "Send one file per part name, and one part 'params'.";
    ImageMissing = BAD_REQUEST "image-missing" "The form has no part 'image'"
        "No part of the form is named 'image'."
        "Name the part with the picture 'image', as curl --form image=@photo.png does.";
    PartMissing = BAD_REQUEST "part-missing" "Missing part of the form"
        "The form lacks a file that this resource needs."
        "Add a part of the name that 'param' gives.";
    EmptyFile = BAD_REQUEST "empty-file" "The file is empty"
        "The body or the part with the file has no bytes."
        "Check that the file is not empty and that the client sends its content.";
    Unauthorized = UNAUTHORIZED "unauthorized" "The request needs a key"
        "The request has no key, or one that the service does not know."
        "Send the header Authorization: Bearer KEY with a key of the operator.";
    ForeignOrigin = FORBIDDEN "foreign-origin" "Cross-origin request not allowed"
        "A browser sent the request for a page of another origin, which the operator does not \
         allow."
        "Open the service's own page, or ask the operator to name the page's origin with \
         --cors-origin.";
    OperatorOnly = FORBIDDEN "operator-only" "The request needs an operator's key"
        "The call is for operators of the service, and the request has no key of one."
        "Send the key of an operator, which `pixmesh key new NAME --operator` makes.";
    NotFound = NOT_FOUND "not-found" "Not found"
        "Nothing is at this path, or the job belongs to another key."
        "Compare the path with GET /openapi.json, and send the key that submitted the job.";
    MethodNotAllowed = METHOD_NOT_ALLOWED "method-not-allowed" "Method not allowed"
        "The path exists, but not for this method."
        "Send one of the methods in 'allowed' and in the header Allow.";
    NotAcceptable = NOT_ACCEPTABLE "not-acceptable" "No acceptable format"
        "The header Accept allows none of the media types that the service can send."
        "Allow one of the types in 'allowed', or ask for a format with the parameter \
         'format'.";
    JobUnfinished = CONFLICT "job-unfinished" "The job has not finished"
        "The job waits or runs, so there is no mesh yet."
        "Ask again after the seconds in Retry-After, or follow the job's events.";
    JobWithoutMesh = CONFLICT "job-without-mesh" "The job ended without a mesh"
        "The job failed, or its client cancelled it."
        "Read 'error' in the job's document, and submit the picture again.";
    JobWithoutOrder = CONFLICT "job-without-order" "The job's mesh cannot be resized"
        "The job kept no order of its vertices, from which the service makes other sizes."
        "Submit the picture again with format=progression or with a method that ends with \
         removal.";
    JobWithoutTexture = CONFLICT "job-without-texture" "The job keeps no picture to show"
        "The service does not keep the picture of a job that did not ask for its texture."
        "Submit the job with texture=embed, or send its mesh and the picture to \
         /v1/conversions.";
    JobWithoutImage = CONFLICT "job-without-image" "The job keeps no image"
        "The service does not keep the image of a job that did not ask for that."
        "Submit the job with keep_image=true, or send the image again.";
    Gone = GONE "gone" "The resource has expired"
        "The job expired or its client deleted it, or that of an Idempotency-Key."
        "Submit the picture again. The operator sets the time with --result-ttl.";
    PreconditionFailed = PRECONDITION_FAILED "precondition-failed" "The mesh is another one"
        "The header If-Match names entity tags, and the mesh has another one."
        "Ask for the mesh without If-Match, and take its new ETag.";
    RangeNotSatisfiable = RANGE_NOT_SATISFIABLE "range-not-satisfiable" "The range starts beyond the end"
        "The header Range asks for bytes behind the end of the file."
        "Ask for bytes before the length in 'limit', or for the whole file without Range.";
    RequestTimeout = REQUEST_TIMEOUT "request-timeout" "The request took too long to arrive"
        "The body did not arrive within the time that the service waits."
        "Send a smaller file or use a faster connection. The operator sets the time with \
         --body-timeout.";
    BodyTooLarge = PAYLOAD_TOO_LARGE "body-too-large" "The request's body is too large"
        "The body has more bytes than the service takes."
        "Compress the picture, as PNG or JPEG, or scale it down. The operator sets the limit \
         with --max-body.";
    UriTooLong = URI_TOO_LONG "uri-too-long" "The address is too long"
        "The path and the query have more bytes than the service reads."
        "Send the parameters as fields of a form or as one JSON part 'params'.";
    UnsupportedMediaType = UNSUPPORTED_MEDIA_TYPE "unsupported-media-type" "Unsupported media type"
        "The header Content-Type names a type that the resource does not take."
        "Send one of the types in 'allowed', or application/octet-stream.";
    UnsupportedEncoding = UNSUPPORTED_MEDIA_TYPE "unsupported-encoding" "Unsupported content encoding"
        "The body is compressed by a Content-Encoding."
        "Send the file as it is, without Content-Encoding.";
    UnsupportedImage = UNSUPPORTED_MEDIA_TYPE "unsupported-image" "Unsupported image format"
        "The file is of a format, or of a variant of it, that the service does not read."
        "Convert the file to PNG, for example with `magick photo.heic photo.png`.";
    UnknownHost = MISDIRECTED_REQUEST "unknown-host" "The service does not answer to this name"
        "The Host header names another host than the service answers to."
        "Use localhost or 127.0.0.1, or ask the operator to name the host with --allowed-host.";
    UnknownValue = UNPROCESSABLE_ENTITY "unknown-value" "Unknown parameter value"
        "The parameter takes one of a few words, and the value is none of them."
        "Give one of the words in 'allowed'.";
    NotFinite = UNPROCESSABLE_ENTITY "not-finite" "A number is not finite"
        "A number is infinite, too large, or not a number."
        "Give a finite number between the bounds that GET /v1/methods lists.";
    ParameterOutOfRange = UNPROCESSABLE_ENTITY "parameter-out-of-range" "Parameter out of range"
        "The number is below the least or above the largest value allowed."
        "Give a number from 'minimum' to 'maximum'. The closest to yours is in 'nearest'.";
    ConflictingParameters = UNPROCESSABLE_ENTITY "conflicting-parameters" "Parameters exclude each other"
        "Two parameters state the same choice, or contradict each other."
        "Leave out one of the parameters that the detail names.";
    ComponentCount = UNPROCESSABLE_ENTITY "component-count" "The method does not fit the number of components"
        "The method is for pictures of another number of components, such as gray or RGB."
        "Choose a value in 'allowed', or convert the picture to gray or RGB.";
    ImageTooLarge = UNPROCESSABLE_ENTITY "image-too-large" "The image is too large"
        "The picture has more pixels, or a longer side, than the service takes."
        "Scale the picture down to 'limit' first, or ask the operator to raise the flag in \
         'setting'.";
    MetadataTooLarge = UNPROCESSABLE_ENTITY "metadata-too-large" "The image's metadata is too large"
        "The profiles, comments and other data beside the pixels take too many bytes."
        "Remove the metadata, for example with `magick photo.png -strip smaller.png`.";
    DegenerateImage = UNPROCESSABLE_ENTITY "degenerate-image" "The image is too small to be meshed"
        "The picture has fewer than two columns or rows, so it contains no triangle."
        "Send a picture of at least 2 by 2 pixels.";
    ImageDecodeFailed = UNPROCESSABLE_ENTITY "image-decode-failed" "The image cannot be decoded"
        "The file breaks the rules of its format or ends early."
        "Send the whole file again, or open it in a picture editor and save it anew.";
    FormatNotPossible = UNPROCESSABLE_ENTITY "format-not-possible" "The format cannot hold this result"
        "The format asked for cannot hold a mesh of these parameters."
        "Choose another format, or change the parameters that the detail names.";
    WorkTooLarge = UNPROCESSABLE_ENTITY "work-too-large" "The task needs more memory than the service has"
        "The task needs more memory than the service may use."
        "Scale the picture down, or choose a method with less memory such as med.";
    QuotaExceeded = TOO_MANY_REQUESTS "quota-exceeded" "The key's quota is used up"
        "The key made more requests, or has more waiting tasks or event streams, than its quota \
         allows."
        "Wait for the seconds in Retry-After before the next request.";
    ShapeMismatch = UNPROCESSABLE_ENTITY "shape-mismatch" "The pictures are not of the same shape"
        "Two pictures differ in columns, rows, components or precision, or an elevation model is compared \
         with what has no heights."
        "Make both of the same shape, which the detail names; send the mesh of an elevation model as it was made.";
    MeshInvalid = UNPROCESSABLE_ENTITY "mesh-invalid" "The file is not a mesh"
        "The file breaks the rules of its format. In a MODEL, 'line' is the first such line."
        "Send a file as the service or make_model writes it.";
    MeshTooLarge = UNPROCESSABLE_ENTITY "mesh-too-large" "The mesh states more vertices or faces than it has"
        "The head of the file states more vertices or faces than can be in it."
        "Send the whole file, with the true numbers in its head.";
    IndexOutOfRange = UNPROCESSABLE_ENTITY "index-out-of-range" "A face names a vertex that does not exist"
        "A face refers to a vertex number that the file does not have."
        "Count vertices from 0, and refer only to those in the file.";
    IdempotencyKeyReused = UNPROCESSABLE_ENTITY "idempotency-key-reused" "The idempotency key belongs to another submission"
        "An earlier submission with this Idempotency-Key had another picture or parameters."
        "Make a new key for each new submission, and repeat a key only with the same request.";
    TooManyJobs = TOO_MANY_REQUESTS "too-many-jobs" "Too many queued jobs"
        "The client has as many queued jobs as its limit allows."
        "Wait until a job ends, or cancel one.";
    HeadersTooLarge = REQUEST_HEADER_FIELDS_TOO_LARGE "headers-too-large" "The request's headers are too large"
        "The header of the request has too many lines or bytes."
        "Send fewer or shorter headers, such as cookies.";
    Internal = INTERNAL_SERVER_ERROR "internal" "Internal error"
        "The service failed in a way that no request should cause."
        "Report the request's id to the operator, whose log has the reason.";
    StorageDamaged = INTERNAL_SERVER_ERROR "storage-damaged" "The stored data are damaged"
        "The stored bytes of the job differ from those that the service wrote."
        "Submit the picture again, and report the request's id to the operator.";
    AttemptsExhausted = INTERNAL_SERVER_ERROR "attempts-exhausted" "The job crashed its worker in every attempt"
        "The worker crashed in every attempt at this job."
        "Try another method or a smaller picture, and report the job's id to the operator.";
    Overloaded = SERVICE_UNAVAILABLE "overloaded" "The service is overloaded"
        "More work is queued than the service can do in time, or it is still starting."
        "Try again after the seconds in Retry-After, or submit a job, which waits longer.";
    DeadlineExceeded = SERVICE_UNAVAILABLE "deadline-exceeded" "The deadline has passed"
        "The task was not finished by its deadline."
        "Send a smaller picture, ask for fewer vertices, or submit a job.";
    ShuttingDown = SERVICE_UNAVAILABLE "shutting-down" "The service is stopping"
        "The service is stopping and takes no more work."
        "Try again in some seconds; another instance of the service may answer.";
    JobsPaused = SERVICE_UNAVAILABLE "jobs-paused" "New jobs are paused"
        "An operator has paused the intake of jobs."
        "Try again after the seconds in Retry-After. Requests to /v1/meshes are answered.";
    StorageUnavailable = SERVICE_UNAVAILABLE "storage-unavailable" "The storage of jobs is unavailable"
        "The disk or the database of the jobs does not answer."
        "Try again after some seconds. Requests to /v1/meshes need no storage.";
    StorageFull = INSUFFICIENT_STORAGE "storage-full" "The storage of jobs is full"
        "The disk of the jobs has no room, or jobs keep as many bytes as they may."
        "Delete jobs that are no longer needed, or wait until some expire; `setting` names the limit.";
}

impl Kind {
    /// The reference in the problem's `type`.
    #[must_use]
    pub fn reference(self) -> String {
        format!("/problems/{}", self.slug())
    }

    /// The kind for a refusal that the framework made with nothing but a status.
    pub(super) fn of_status(status: StatusCode) -> Self {
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
