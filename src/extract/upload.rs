//! Receives the upload: the image's bytes, and with a form the parameters beside them.
//!
//! A body is the image itself, or `multipart/form-data` with one part `image`, and the parameters
//! as fields or as one JSON part `params`. Every byte is counted against the body limit and charged
//! to the memory for bodies as it arrives, and all of them must arrive in time. The label of the
//! body only tells a form from an image: what the image is, its content decides.

mod form;
mod meter;
mod pace;

pub use meter::{BodyLimit, BodyMemory, Charge};

use super::owner::Owner;
use super::params::ParameterSet;
use crate::problem::{Kind, Problem};
use axum::body::Body;
use axum::http::HeaderMap;
use axum::http::header::{CONTENT_ENCODING, CONTENT_LENGTH, CONTENT_TYPE};
use http_body_util::BodyExt;
use meter::Metered;
use std::error::Error;
use std::sync::Arc;
use std::time::Duration;

/// What bodies may be like, and the memory that they share.
#[derive(Clone, Debug)]
pub struct Intake {
    /// Longest body.
    pub max_body: BodyLimit,
    /// Longest time for a body to arrive.
    pub timeout: Duration,
    /// Memory for all bodies at a time.
    pub memory: BodyMemory,
}

/// An image as it was received, with the memory it is charged for.
#[derive(Debug)]
pub struct Upload {
    /// The image's bytes, of any format.
    pub image: Vec<u8>,
    /// Freed with the bytes.
    pub charge: Arc<Charge>,
}

impl Intake {
    /// Receives a body, and adds the parameters of a form to `parameters`.
    ///
    /// # Errors
    /// `unsupported-encoding`, `unsupported-media-type`, `body-too-large`, `request-timeout`,
    /// `overloaded` when bodies take all of their memory, and whatever is wrong with a form.
    pub async fn receive(
        &self,
        owner: &Owner,
        headers: &HeaderMap,
        body: Body,
        parameters: &mut ParameterSet,
    ) -> Result<Upload, Problem> {
        refuse_encoded(headers)?;
        let label = Label::of(headers)?;
        self.refuse_announced(headers)?;
        let charge = Arc::new(self.memory.charge(owner));
        let body = Metered::new(body, self.max_body, Arc::clone(&charge));
        let receiving = receive_labelled(&label, headers, body, parameters);
        let received = tokio::time::timeout(self.timeout, receiving).await;
        let image = received.map_err(|_| self.too_slow())??;
        Ok(Upload { image, charge })
    }

    /// Refuses a body that is too long before any of it is read.
    fn refuse_announced(&self, headers: &HeaderMap) -> Result<(), Problem> {
        let text = headers.get(CONTENT_LENGTH).and_then(|length| length.to_str().ok());
        match text.and_then(|length| length.parse::<u64>().ok()) {
            Some(length) => self.max_body.check(length),
            None => Ok(()),
        }
    }

    fn too_slow(&self) -> Problem {
        let detail = format!("the body did not arrive within {} s", self.timeout.as_secs_f64());
        Problem::new(Kind::RequestTimeout, detail).setting("--body-timeout")
    }
}

/// The bytes of the image in a body.
async fn receive_labelled(
    label: &Label,
    headers: &HeaderMap,
    body: Metered,
    parameters: &mut ParameterSet,
) -> Result<Vec<u8>, Problem> {
    match label {
        Label::Image => collect(body).await,
        Label::Form => form::receive(headers, body, parameters).await,
    }
}

/// What a body says it is.
enum Label {
    Image,
    Form,
}

impl Label {
    fn of(headers: &HeaderMap) -> Result<Self, Problem> {
        let Some(value) = headers.get(CONTENT_TYPE) else { return Ok(Self::Image) };
        let label = value.to_str().unwrap_or("(unreadable)");
        if essence(label).eq_ignore_ascii_case("multipart/form-data") {
            return Ok(Self::Form);
        }
        // What curl calls any body given with --data-binary unless told otherwise: no statement.
        if essence(label).eq_ignore_ascii_case("application/x-www-form-urlencoded") {
            return Ok(Self::Image);
        }
        accept_image_label(label)?;
        Ok(Self::Image)
    }
}

/// Type and subtype of a media type, without its parameters.
fn essence(label: &str) -> &str {
    label.split(';').next().unwrap_or_default().trim()
}

/// Accepts the labels that an image may have, right or wrong.
fn accept_image_label(label: &str) -> Result<(), Problem> {
    let essence = essence(label).to_ascii_lowercase();
    if essence.starts_with("image/") || essence == "application/octet-stream" {
        return Ok(());
    }
    let essence: String = essence.chars().take(64).collect();
    let detail = format!(
        "a body of type '{essence}' is not accepted: send the image as image/*, as \
         application/octet-stream or without a type, or send multipart/form-data"
    );
    let allowed = ["image/*", "application/octet-stream", "multipart/form-data"];
    Err(Problem::new(Kind::UnsupportedMediaType, detail).allowed(&allowed))
}

/// Refuses compressed bodies: they could be of any size.
fn refuse_encoded(headers: &HeaderMap) -> Result<(), Problem> {
    let identity = |value: &[u8]| value.trim_ascii().eq_ignore_ascii_case(b"identity");
    if headers.get_all(CONTENT_ENCODING).iter().all(|value| identity(value.as_bytes())) {
        return Ok(());
    }
    let detail = "the body must come without a Content-Encoding";
    Err(Problem::new(Kind::UnsupportedEncoding, detail).allowed(&["identity"]))
}

/// The whole of a body.
async fn collect(mut body: Metered) -> Result<Vec<u8>, Problem> {
    let mut bytes = Vec::new();
    while let Some(frame) = body.frame().await {
        let frame = frame.map_err(|error| refusal_in(&*error).unwrap_or_else(broken_off))?;
        bytes.extend_from_slice(frame.data_ref().map_or(&[], |data| data));
    }
    Ok(bytes)
}

/// The problem that the meter ended a body with, wherever it is among an error's causes.
fn refusal_in(error: &(dyn Error + 'static)) -> Option<Problem> {
    let mut causes = std::iter::successors(Some(error), |&error| error.source());
    causes.find_map(|cause| cause.downcast_ref::<meter::Refused>()).map(|refused| refused.0.clone())
}

fn broken_off() -> Problem {
    Problem::new(Kind::BadRequest, "the body broke off before its end")
}
