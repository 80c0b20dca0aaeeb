//! Every refusal, as a problem document (RFC 9457).
//!
//! The table of [`Kind`] is the one place where a refusal gets its slug, status, title, cause and
//! remedy. The `type` of a document is the reference `/problems/<slug>`, which the service answers
//! with the row and an example. `detail` names the parameter or limit and the numbers; nothing
//! internal is ever in it.
//! A handler returns a [`Problem`]; the outermost layer writes it out with the request's id.

mod domain;
mod kind;
mod render;

pub(crate) use domain::{internal, of_attempt};
pub use kind::Kind;
pub use render::render;

use serde_json::Value;

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

    /// The parameter or part that is wrong, if the problem names one.
    #[must_use]
    pub fn named_param(&self) -> Option<&str> {
        let param = self.members.iter().find(|(name, _)| *name == "param");
        param.and_then(|(_, value)| value.as_str())
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

    /// When to try again, in seconds; also sent as `Retry-After`.
    #[must_use]
    pub fn retry_after_s(self, seconds: u64) -> Self {
        self.member("retry_after_s", seconds)
    }

    /// Adds a member that programs can read.
    pub(crate) fn member(mut self, name: &'static str, value: impl Into<Value>) -> Self {
        self.members.push((name, value.into()));
        self
    }
}
