//! From a request to typed values, and the only places that read untrusted text.

pub mod accept;
pub mod auth;
pub mod client_address;
pub mod fields;
pub mod idempotency;
pub mod prefer;
pub mod request_id;
pub mod upload;
