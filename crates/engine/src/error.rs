//! The one error of the engine: why a task is refused, stopped or failed.
//!
//! The messages name the parameter or the limit, and hold the numbers; the names of settings are
//! those of the program around the engine, which adds them.

use pixmesh_codec::{
    DecodeError, EncodeError, MeshFileError, ModelDefect, PmeshError, WeightsError,
};
use pixmesh_meshing::{Cancelled, MeshingError, ParameterError, ProgressionError};
use std::fmt;
use thiserror::Error;

/// Why a task is refused, stopped or failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EngineError {
    /// The name or the text of a parameter is wrong.
    #[error(transparent)]
    Input(#[from] InputError),
    /// An image cannot be decoded.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// The weights cannot be decoded, or do not fit the image.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The file of a mesh cannot be read.
    #[error(transparent)]
    MeshFile(#[from] MeshFileError),
    /// The picture to show, or to compare, is not of the mesh's width and height.
    #[error(
        "the picture has {} by {} pixels and the mesh {} by {}: send the picture that the \
         mesh was made of",
        picture.0, picture.1, mesh.0, mesh.1
    )]
    OtherSize {
        /// Width and height of the picture.
        picture: (usize, usize),
        /// Width and height of the mesh's image.
        mesh: (usize, usize),
    },
    /// An elevation model is compared with what has no heights.
    #[error(
        "the image is an elevation model, and the approximation has no heights: send its mesh as MODEL, \
         pmesh or progression, made from the elevation model itself, or another elevation model"
    )]
    NoHeights,
    /// The order of the vertices does not give a mesh of that size.
    #[error(transparent)]
    Progression(#[from] ProgressionError),
    /// The parameters do not fit the image, or meshing fails.
    #[error(transparent)]
    Meshing(#[from] MeshingError),
    /// The format cannot hold the result.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// The task needs more memory than there is.
    #[error(
        "this image with these parameters needs about {needed_mib} MiB, and there are \
         {budget_mib} MiB for work: send a smaller image, or ask for fewer vertices or a method \
         that starts with fewer points"
    )]
    TooLarge {
        /// Memory that the task needs, in MiB.
        needed_mib: u32,
        /// Memory for all tasks, in MiB.
        budget_mib: usize,
    },
    /// The owner's share of the queue is full.
    #[error("the queue is full: {waiting_s:.3} s of work are queued, the limit is {limit_s:.3} s")]
    QueueFull {
        /// Seconds of work that wait.
        waiting_s: f64,
        /// Seconds of work that may wait.
        limit_s: f64,
        /// Seconds until the queue will have drained.
        retry_after_s: u64,
    },
    /// As many requests of one key wait as may.
    #[error("this key has {waiting} queued requests already, the limit is {limit}")]
    KeyQueueFull {
        /// Requests that wait.
        waiting: usize,
        /// Requests that may wait.
        limit: usize,
        /// Seconds until the queue will have drained.
        retry_after_s: u64,
    },
    /// The task waited much longer than the queue should take.
    #[error(
        "the request waited {waited_s} s for a worker and memory, {} times what the queue should \
         take: the work before it took longer than expected",
        waited_s / limit_s
    )]
    WaitedTooLong {
        /// Seconds that the task waited.
        waited_s: f64,
        /// Seconds of work that may wait.
        limit_s: f64,
        /// Seconds until the queue will have drained.
        retry_after_s: u64,
    },
    /// The deadline passed before the task began.
    #[error("the deadline passed while the request waited for a worker")]
    DeadlineInQueue {
        /// Seconds until the queue will have drained.
        retry_after_s: u64,
    },
    /// The deadline passed before the task was done.
    #[error(
        "the task did not finish by the deadline: send a smaller image, or ask for fewer vertices or \
         a faster method such as med"
    )]
    DeadlineExceeded,
    /// The task was stopped, because nobody waits for it or its deadline passed.
    #[error("the task was cancelled")]
    Cancelled(#[from] Cancelled),
    /// The scheduler gives out no more slots.
    #[error("the service is stopping")]
    Stopping,
    /// The task panicked.
    #[error("a task panicked")]
    Panicked,
}

impl EngineError {
    /// Whether the task was stopped, by its deadline or because nobody waits for it.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        matches!(
            self,
            Self::Cancelled(_)
                | Self::Decode(DecodeError::Cancelled(_))
                | Self::Weights(WeightsError::Picture(DecodeError::Cancelled(_)))
                | Self::MeshFile(MeshFileError::Pmesh(PmeshError::Cancelled(_)))
                | Self::Progression(ProgressionError::Cancelled(_))
                | Self::Meshing(MeshingError::Cancelled(_))
                | Self::Encode(EncodeError::Cancelled(_))
        ) || matches!(
            self,
            Self::MeshFile(MeshFileError::Model(error))
                if matches!(error.defect, ModelDefect::Cancelled(_))
        )
    }
}

impl From<ParameterError> for EngineError {
    fn from(error: ParameterError) -> Self {
        MeshingError::from(error).into()
    }
}

/// What is wrong with the name or the text of a parameter, or with a list of them.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum InputError {
    /// There is no such parameter.
    #[error("there is no parameter '{name}'")]
    Unknown {
        /// The name given, cut at 64 characters.
        name: String,
        /// The known name that is most like it.
        nearest: Option<String>,
    },
    /// A parameter is given twice.
    #[error("{0} is given more than once")]
    Repeated(String),
    /// Two parameters of which one may be given.
    #[error("{0} and {1} exclude each other: give one of them")]
    Exclusive(&'static str, &'static str),
    /// A text that is no value at all.
    #[error("{name} must be {expected}")]
    Malformed {
        /// The parameter.
        name: String,
        /// What its values look like.
        expected: &'static str,
    },
    /// A number that is not finite.
    #[error("{0} must be a finite number")]
    NotFinite(String),
    /// A number out of its bounds.
    #[error("{name} is {text}, but must lie in {least} to {most}")]
    OutOfRange {
        /// The parameter.
        name: String,
        /// The text given, cut at 32 characters.
        text: String,
        /// The least value.
        least: Bound,
        /// The greatest value.
        most: Bound,
    },
    /// A flag that is neither `true` nor `false`.
    #[error("{0} must be true or false")]
    NotAFlag(String),
    /// Stored options of a version that this program does not know.
    #[error(
        "the options are stored in version {found}, and this program knows up to version {known}: \
         update it"
    )]
    StoredVersion {
        /// The version as it is stored.
        found: String,
        /// The latest version known.
        known: u32,
    },
    /// A query whose percent-encoding is wrong.
    #[error("the query has {0}")]
    Query(&'static str),
    /// A text that is no flat JSON object.
    #[error("params: {0}")]
    Json(String),
}

/// A bound of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// Of a decimal number.
    Decimal(f64),
    /// Of a whole number.
    Whole(u64),
}

impl fmt::Display for Bound {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Decimal(value) => value.fmt(formatter),
            Self::Whole(value) => value.fmt(formatter),
        }
    }
}
