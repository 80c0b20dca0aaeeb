//! The owner of tasks and jobs.

use std::fmt;
use std::sync::Arc;

/// The owner of tasks and jobs. Tasks of one owner wait for each other; jobs of others are hidden.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Owner {
    /// Everybody, where the service asks for no keys. No limits of keys apply.
    Anonymous,
    /// The holder of the key with this name.
    Key(Arc<str>),
    /// The workers of durable jobs, which wait for slots beside requests. The queue of jobs keeps the
    /// owners of jobs apart itself.
    Jobs,
}

impl Owner {
    /// The holder of the key with this name.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self::Key(name.into())
    }

    /// The owner that is stored under a name, see [`as_str`](Self::as_str).
    #[must_use]
    pub fn of_stored(name: &str) -> Self {
        if name.is_empty() { Self::Anonymous } else { Self::named(name) }
    }

    /// The name of the key, as it is stored with a job; empty without a key.
    #[must_use]
    pub fn as_str(&self) -> &str {
        match self {
            Self::Anonymous | Self::Jobs => "",
            Self::Key(name) => name,
        }
    }

    /// Whether this is the holder of a key, whom the limits of keys apply to.
    #[must_use]
    pub fn is_key(&self) -> bool {
        matches!(self, Self::Key(_))
    }
}

impl fmt::Display for Owner {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Anonymous => "anonymous",
            Self::Key(name) => name,
            Self::Jobs => "jobs",
        })
    }
}
