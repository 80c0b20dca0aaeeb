//! From the errors of the other crates to problems: one conversion each.

use super::{Kind, Problem};
use pixmesh_codec::{
    DecodeError, EncodeError, MeshFileError, ModelDefect, ModelError, PmeshError, WeightsError,
};
use pixmesh_engine::error::Bound;
use pixmesh_engine::params::nearest_name;
use pixmesh_engine::{EngineError, InputError};
use pixmesh_jobs::QueueError;
use pixmesh_jobs::worker::AttemptError;
use pixmesh_meshing::{Cancelled, ImageError, MeshingError, ParameterError, ProgressionError};
use serde_json::Value;

impl From<EngineError> for Problem {
    fn from(error: EngineError) -> Self {
        use EngineError as E;
        let detail = error.to_string();
        match error {
            E::Input(error) => error.into(),
            E::Decode(error) => error.into(),
            E::Weights(error) => error.into(),
            E::MeshFile(error) => error.into(),
            E::NoHeights => Self::new(Kind::ShapeMismatch, detail).param("approximation"),
            E::OtherSize { .. } => Self::new(Kind::ShapeMismatch, detail).param("image"),
            E::Meshing(error) => error.into(),
            E::Encode(error) => error.into(),
            E::TooLarge { needed_mib, budget_mib } => Self::new(Kind::WorkTooLarge, detail)
                .setting("--memory-budget")
                .limit(budget_mib, needed_mib),
            E::QueueFull { waiting_s: actual_s, limit_s, retry_after_s }
            | E::WaitedTooLong { waited_s: actual_s, limit_s, retry_after_s } => {
                Self::new(Kind::Overloaded, detail)
                    .setting("--queue-seconds")
                    .limit(limit_s, actual_s)
                    .retry_after_s(retry_after_s)
            }
            E::KeyQueueFull { waiting, limit, retry_after_s } => {
                Self::new(Kind::QuotaExceeded, detail)
                    .setting("--key-queued")
                    .limit(limit, waiting)
                    .retry_after_s(retry_after_s)
            }
            E::DeadlineInQueue { retry_after_s } => Self::new(Kind::DeadlineExceeded, detail)
                .setting("--sync-deadline")
                .retry_after_s(retry_after_s),
            E::DeadlineExceeded => {
                Self::new(Kind::DeadlineExceeded, detail).setting("--sync-deadline")
            }
            E::Cancelled(cancelled) => cancelled.into(),
            E::Stopping => Self::new(Kind::ShuttingDown, detail),
            E::Progression(error) => error.into(),
            _ => internal("task failed", &error),
        }
    }
}

impl From<QueueError> for Problem {
    fn from(error: QueueError) -> Self {
        let problem = match &error {
            QueueError::StorageFull(_) => Self::new(
                Kind::StorageFull,
                "the disk with the jobs is full: delete jobs, or give the disk more room",
            )
            .setting("--data-dir"),
            QueueError::SpaceLow { free, least } => Self::new(
                Kind::StorageFull,
                format!(
                    "the disk with the jobs has {} MiB left, and {} MiB stay free: delete jobs, wait \
                     until some expire, or give the disk more room",
                    free >> 20,
                    least >> 20
                ),
            )
            .setting("--min-free-space")
            .limit(*least, *free),
            QueueError::Paused => {
                Self::new(Kind::JobsPaused, "an operator has paused the intake of jobs")
            }
            QueueError::Storage(_) => {
                Self::new(Kind::StorageUnavailable, "the data folder can be neither written nor read: try again")
                    .setting("--data-dir")
            }
            QueueError::Damaged(_) => {
                Self::new(Kind::StorageDamaged, "the stored data of this job are damaged: submit the picture again")
            }
            QueueError::Blobs(_) => Self::new(
                Kind::StorageUnavailable,
                "the store of pictures and meshes does not answer: try again",
            )
            .setting("--blobs"),
            QueueError::DatabaseFull(_) => Self::new(
                Kind::StorageFull,
                "the disk of the database is full: delete jobs, or give the database more room",
            )
            .setting("--queue"),
            QueueError::Database(_) => Self::new(
                Kind::StorageUnavailable,
                "the database of the jobs refuses to work: try again",
            )
            .setting("--queue"),
            QueueError::Unreachable(_) => {
                Self::new(Kind::StorageUnavailable, "the database of the jobs does not answer: try again")
                    .setting("--queue")
            }
        };
        problem.caused_by(&error)
    }
}

/// The problem document of a job's attempt that failed. The deadline of a job is set by another
/// flag than that of a request.
pub(crate) fn of_attempt(error: AttemptError) -> Value {
    let problem = match error {
        AttemptError::Engine(
            EngineError::DeadlineExceeded | EngineError::DeadlineInQueue { .. },
        ) => Problem::new(
            Kind::DeadlineExceeded,
            "the job did not finish by its deadline: send a smaller image, or ask for fewer vertices \
             or a faster method such as med",
        )
        .setting("--job-deadline"),
        AttemptError::Engine(error) => error.into(),
        AttemptError::Storage(error) => error.into(),
        AttemptError::PictureChanged => Problem::new(
            Kind::StorageUnavailable,
            "the stored image is not the submitted one: submit it again",
        ),
    };
    problem.value()
}

impl From<InputError> for Problem {
    fn from(error: InputError) -> Self {
        use InputError as E;
        let detail = error.to_string();
        match error {
            // A picture is no text: it comes as a part of a form.
            E::Unknown { name, .. } if name == "weights" => {
                let detail =
                    "weights are a picture: send them as a part of a form, beside the part 'image'";
                Self::new(Kind::UnknownParameter, detail).param(name)
            }
            E::Unknown { name, nearest } => {
                let problem = Self::new(Kind::UnknownParameter, detail).param(name);
                nearest.into_iter().fold(problem, Self::nearest)
            }
            E::Repeated(name) => Self::new(Kind::DuplicateParameter, detail).param(name),
            E::Exclusive(_, second) => Self::new(Kind::ConflictingParameters, detail).param(second),
            E::Malformed { name, .. } => Self::new(Kind::ParameterMalformed, detail).param(name),
            E::NotFinite(name) => Self::new(Kind::NotFinite, detail).param(name),
            E::OutOfRange { name, text, least, most } => Self::new(
                Kind::ParameterOutOfRange,
                detail,
            )
            .param(name)
            .range(number(least), number(most), text),
            E::NotAFlag(name) => {
                Self::new(Kind::UnknownValue, detail).param(name).allowed(&["true", "false"])
            }
            E::StoredVersion { .. } => Self::new(Kind::StorageDamaged, detail),
            E::Query(_) => Self::new(Kind::QueryMalformed, detail),
            E::Json(_) => Self::new(Kind::JsonMalformed, detail).param("params"),
        }
    }
}

/// A bound as a number of JSON.
fn number(bound: Bound) -> Value {
    match bound {
        Bound::Decimal(value) => value.into(),
        Bound::Whole(value) => value.into(),
    }
}

impl From<DecodeError> for Problem {
    fn from(error: DecodeError) -> Self {
        let detail = error.to_string();
        match error {
            DecodeError::Empty => Self::new(Kind::EmptyFile, detail),
            DecodeError::UnknownFormat
            | DecodeError::Unread { .. }
            | DecodeError::Unsupported { .. } => Self::new(Kind::UnsupportedImage, detail),
            DecodeError::TooManyPixels { pixels, limit, .. } => {
                beyond("--max-pixels", &detail).limit(limit, pixels)
            }
            DecodeError::SideTooLong { width, height, limit } => {
                beyond("--max-side", &detail).limit(limit, width.max(height))
            }
            DecodeError::MetadataTooLarge { limit, .. } => {
                Self::new(Kind::MetadataTooLarge, detail).member("limit", limit)
            }
            DecodeError::TooMuchMemory { needed, allowed } => {
                Self::new(Kind::WorkTooLarge, detail).limit(allowed, needed)
            }
            DecodeError::Image(error) => error.into(),
            DecodeError::Cancelled(cancelled) => cancelled.into(),
            _ => Self::new(Kind::ImageDecodeFailed, detail),
        }
    }
}

/// An image beyond a limit that the operator sets.
fn beyond(setting: &'static str, detail: &str) -> Problem {
    let detail = format!("{detail}, or have the service started with a larger {setting}");
    Problem::new(Kind::ImageTooLarge, detail).setting(setting)
}

impl From<WeightsError> for Problem {
    fn from(error: WeightsError) -> Self {
        let detail = error.to_string();
        let problem = match error {
            WeightsError::Picture(DecodeError::Cancelled(cancelled)) => return cancelled.into(),
            WeightsError::Picture(error) => Self { detail, ..error.into() },
            WeightsError::ComponentCount(_) => Self::new(Kind::ComponentCount, detail),
            _ => Self::new(Kind::ShapeMismatch, detail),
        };
        problem.param("weights")
    }
}

impl From<ModelError> for Problem {
    fn from(error: ModelError) -> Self {
        use ModelDefect as D;
        let (detail, line) = (error.to_string(), error.line);
        let problem = match error.defect {
            D::Cancelled(cancelled) => return cancelled.into(),
            D::Size(error) => error.into(),
            D::TooManySamples { samples, limit, .. } => {
                Self::new(Kind::ImageTooLarge, detail).limit(limit, samples).setting("--max-pixels")
            }
            D::TooMany { count, maximum, .. } => {
                Self::new(Kind::MeshTooLarge, detail).limit(maximum, count)
            }
            D::NotFinite { .. } => Self::new(Kind::NotFinite, detail),
            D::IndexOutOfRange { .. } => Self::new(Kind::IndexOutOfRange, detail),
            _ => Self::new(Kind::MeshInvalid, detail),
        };
        problem.member("line", line)
    }
}

impl From<MeshFileError> for Problem {
    fn from(error: MeshFileError) -> Self {
        match error {
            MeshFileError::Model(error) => error.into(),
            MeshFileError::Pmesh(error) => error.into(),
        }
    }
}

impl From<PmeshError> for Problem {
    fn from(error: PmeshError) -> Self {
        let detail = error.to_string();
        match error {
            PmeshError::Size(error) => error.into(),
            PmeshError::Cancelled(cancelled) => cancelled.into(),
            PmeshError::Progression(error) => error.into(),
            PmeshError::NoOrder => Self::new(Kind::FormatNotPossible, detail),
            PmeshError::VertexCount { count, most } => {
                Self::new(Kind::MeshTooLarge, detail).limit(most, count)
            }
            _ => Self::new(Kind::MeshInvalid, detail),
        }
    }
}

impl From<ProgressionError> for Problem {
    fn from(error: ProgressionError) -> Self {
        match error {
            ProgressionError::Cancelled(cancelled) => cancelled.into(),
            error => Self::new(Kind::MeshInvalid, error.to_string()),
        }
    }
}

impl From<ImageError> for Problem {
    fn from(error: ImageError) -> Self {
        let detail = error.to_string();
        match error {
            ImageError::TooSmall { width, height } => {
                Self::new(Kind::DegenerateImage, detail).limit(2, width.min(height))
            }
            ImageError::TooLarge { width, height } => Self::new(Kind::ImageTooLarge, detail)
                .limit(pixmesh_meshing::MAX_SIDE, width.max(height)),
            _ => Self::new(Kind::ImageDecodeFailed, detail),
        }
    }
}

impl From<ParameterError> for Problem {
    fn from(error: ParameterError) -> Self {
        use ParameterError as E;
        let detail = error.to_string();
        match error {
            E::UnknownValue { parameter, value, allowed } => {
                let problem =
                    Self::new(Kind::UnknownValue, detail).param(parameter).allowed(allowed);
                let nearest = nearest_name(&value, allowed.iter().copied());
                nearest.into_iter().fold(problem, Self::nearest)
            }
            E::NotFinite { parameter } => Self::new(Kind::NotFinite, detail).param(parameter),
            E::OutOfRange { parameter, value, minimum, maximum } => {
                Self::new(Kind::ParameterOutOfRange, detail)
                    .param(parameter)
                    .range(minimum, maximum, value)
            }
            E::Even { parameter, value } => Self::new(Kind::ParameterOutOfRange, detail)
                .param(parameter)
                .member("actual", value),
            E::ComponentCount { parameter, allowed, actual, .. } => {
                Self::new(Kind::ComponentCount, detail)
                    .param(parameter)
                    .allowed(&allowed)
                    .member("actual", actual)
            }
            E::TargetNeedsSquaredError(_) => {
                Self::new(Kind::ConflictingParameters, detail).param("target_psnr")
            }
            E::HolesNeedBound => Self::new(Kind::ConflictingParameters, detail).param("max_error"),
            E::Shape(error) => error.into(),
            _ => Self::new(Kind::ParameterOutOfRange, detail),
        }
    }
}

impl From<MeshingError> for Problem {
    fn from(error: MeshingError) -> Self {
        match error {
            MeshingError::Parameter(error) => error.into(),
            MeshingError::Cancelled(cancelled) => cancelled.into(),
            MeshingError::TargetMissed { parameter, .. } => {
                Self::new(Kind::ConflictingParameters, error.to_string()).param(parameter)
            }
            MeshingError::Shape(error) => {
                Self::new(Kind::ShapeMismatch, error.to_string()).param("approximation")
            }
            _ => internal("mesh generation failed", &error),
        }
    }
}

impl From<Cancelled> for Problem {
    /// Work is cancelled at its deadline, or when nobody is left to hear of it.
    fn from(_: Cancelled) -> Self {
        Self::new(Kind::DeadlineExceeded, "the task was cancelled before it finished")
    }
}

impl From<EncodeError> for Problem {
    fn from(error: EncodeError) -> Self {
        match error {
            EncodeError::ComponentCount { .. }
            | EncodeError::TooLarge { .. }
            | EncodeError::Connectivity { .. }
            | EncodeError::NotInDegrees
            | EncodeError::NotOfPointsAlone { .. } => {
                Self::new(Kind::FormatNotPossible, error.to_string()).param("format")
            }
            EncodeError::NoSuchComponent { .. } => {
                Self::new(Kind::FormatNotPossible, error.to_string()).param("relief")
            }
            EncodeError::Cancelled(cancelled) => cancelled.into(),
            _ => internal("encoding failed", &error),
        }
    }
}

/// A failure of ours: the log has the reason, the client only the request's id to ask with.
pub(crate) fn internal(what: &str, error: &dyn std::error::Error) -> Problem {
    tracing::error!(error = %error, "{what}");
    Problem::new(Kind::Internal, "the log has the reason under this request's id")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_job_names_the_deadline_of_jobs() {
        let late = of_attempt(AttemptError::Engine(EngineError::DeadlineExceeded));
        assert_eq!(late["type"], "/problems/deadline-exceeded");
        assert_eq!(late["setting"], "--job-deadline");
        assert_eq!(late["detail"].as_str().map(|detail| detail.starts_with("the job")), Some(true));
    }

    #[test]
    fn a_panic_tells_clients_nothing() {
        let problem = Problem::from(EngineError::Panicked);
        assert_eq!(problem.kind(), Kind::Internal);
        assert!(!problem.document(None).contains("panic"));
    }
}
