//! Who a request comes from: whose jobs it may see.

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use std::convert::Infallible;
use std::sync::Arc;

/// The name of a key's holder, or the one name that all clients without a key share.
///
/// What checks the keys puts it among the request's extensions.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Owner(Arc<str>);

impl Owner {
    /// The holder of this name, which is not empty.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self(name.into())
    }

    /// Everybody who needs no key.
    #[must_use]
    pub fn anonymous() -> Self {
        Self("".into())
    }

    /// The name; empty for the anonymous.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl<S: Sync> FromRequestParts<S> for Owner {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(parts.extensions.get().cloned().unwrap_or_else(Self::anonymous))
    }
}
