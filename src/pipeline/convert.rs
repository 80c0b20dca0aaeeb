//! From MODEL to any other format: of a job's mesh, or of one that a client sends.

use super::encode::encode;
use crate::extract::params::Output;
use crate::pool::Watch;
use crate::problem::Problem;
use pixmesh_codec::{Encodable, Format, Limits, read_model_while};

/// Reads a MODEL, and writes the mesh, or the picture rebuilt from it, in a format.
///
/// # Errors
/// When the bytes are no MODEL, the format cannot hold the result, or the watch stops the work.
pub fn convert(
    model: impl AsRef<[u8]>,
    format: Format,
    output: &Output,
    limits: &Limits,
    watch: &Watch,
) -> Result<Vec<u8>, Problem> {
    watch.check()?;
    watch.begin("decode");
    let mesh = read_model_while(model.as_ref(), limits, &|| watch.check())?;
    drop(model);
    watch.check()?;
    encode(&Encodable::new(&mesh), format, &output.writing(None), watch)
}
