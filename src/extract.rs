//! From a request to typed values, and the only places that read untrusted text.

pub mod accept;
pub mod auth;
pub mod fields;
pub mod idempotency;
pub mod owner;
pub mod params;
pub mod prefer;
pub mod request_id;
pub mod upload;

/// The known name that is most like a misspelt one, if any is like it at all.
#[must_use]
pub fn nearest_name<'a>(given: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let given: String = given.chars().take(64).collect();
    let distance = |name: &str| strsim::osa_distance(&given, name);
    let alike = |name: &&str| distance(name) <= name.len().div_ceil(2);
    known.filter(alike).min_by_key(|name| distance(name))
}
