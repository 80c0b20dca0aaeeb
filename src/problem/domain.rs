//! From the errors of the other crates to problems: one conversion each.

use super::{Kind, Problem};
use pixmesh_codec::{DecodeError, EncodeError, ModelDefect, ModelError, WeightsError};
use pixmesh_meshing::{Cancelled, ImageError, MeshingError, ParameterError};

impl From<DecodeError> for Problem {
    fn from(error: DecodeError) -> Self {
        let detail = error.to_string();
        match error {
            DecodeError::Empty => Self::new(Kind::EmptyFile, detail),
            DecodeError::UnknownFormat | DecodeError::Unsupported { .. } => {
                Self::new(Kind::UnsupportedImage, detail)
            }
            DecodeError::TooManyPixels { pixels, limit, .. } => {
                Self::new(Kind::ImageTooLarge, detail).limit(limit, pixels).setting("--max-pixels")
            }
            DecodeError::SideTooLong { width, height, limit } => {
                Self::new(Kind::ImageTooLarge, detail)
                    .limit(limit, width.max(height))
                    .setting("--max-side")
            }
            DecodeError::MetadataTooLarge { limit, .. } => {
                Self::new(Kind::MetadataTooLarge, detail).member("limit", limit)
            }
            DecodeError::Image(error) => error.into(),
            DecodeError::Cancelled(cancelled) => cancelled.into(),
            _ => Self::new(Kind::ImageDecodeFailed, detail),
        }
    }
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
            E::UnknownValue { parameter, allowed, .. } => {
                Self::new(Kind::UnknownValue, detail).param(parameter).allowed(allowed)
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
        Self::new(Kind::DeadlineExceeded, "the work was stopped before it was done")
    }
}

impl From<EncodeError> for Problem {
    fn from(error: EncodeError) -> Self {
        match error {
            EncodeError::ComponentCount { .. }
            | EncodeError::TooLarge { .. }
            | EncodeError::Connectivity { .. }
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
