//! Who sends a request, as far as anything is kept apart by it.

use axum::extract::FromRequestParts;
use axum::http::Extensions;
use axum::http::request::Parts;
use std::convert::Infallible;
use std::fmt;
use std::sync::Arc;

/// The one whom a request's work and jobs belong to: the name of its key, or nobody in particular.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Owner(Arc<str>);

impl Owner {
    /// The owner of everything where no keys are asked for. No key has its name, which is empty.
    #[must_use]
    pub fn anonymous() -> Self {
        Self("".into())
    }

    /// Who waits for workers on behalf of all jobs, whose own queue keeps their owners apart. No key
    /// has this name.
    #[must_use]
    pub fn jobs() -> Self {
        Self("(jobs)".into())
    }

    /// The owner that a key of this name stands for.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self(name.into())
    }

    /// Whom a request is from, as what checks its key has found out.
    #[must_use]
    pub fn of(extensions: &Extensions) -> Self {
        extensions.get().cloned().unwrap_or_else(Self::anonymous)
    }

    /// The name; empty for [`Owner::anonymous`].
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Whether this is [`Owner::anonymous`].
    #[must_use]
    pub fn is_anonymous(&self) -> bool {
        self.0.is_empty()
    }
}

impl fmt::Display for Owner {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(if self.is_anonymous() { "anonymous" } else { &self.0 })
    }
}

impl<S: Sync> FromRequestParts<S> for Owner {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(Self::of(&parts.extensions))
    }
}
