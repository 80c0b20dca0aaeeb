//! A mesh to make, checked against its image's header: the one place that says what a mesh costs.

mod cost;
mod effort;
mod footprint;

pub use cost::Cost;
pub(crate) use effort::{Effort, WorkKind};
pub use footprint::Compared;
pub(crate) use footprint::image_bytes;

use crate::error::EngineError;
use crate::params::MeshOptions;
use pixmesh_codec::{Format, Header, Limits, Texturing, probe_weights};

/// An image, and a picture of the same size that says how much its pixels matter.
#[derive(Clone, Copy, Debug)]
pub struct Weighed<T> {
    /// The image.
    pub image: T,
    /// The weights, if there are any.
    pub weights: Option<T>,
}

impl<T> From<T> for Weighed<T> {
    /// An image without weights.
    fn from(image: T) -> Self {
        Self { image, weights: None }
    }
}

impl<T: AsRef<[u8]>> Weighed<T> {
    /// The bytes of both files.
    #[must_use]
    pub fn as_bytes(&self) -> Weighed<&[u8]> {
        let weights = self.weights.as_ref().map(AsRef::as_ref);
        Weighed { image: self.image.as_ref(), weights }
    }
}

/// A mesh to make, before its pixels are decoded.
#[derive(Clone, Copy, Debug)]
pub struct MeshTask {
    /// The image's header.
    pub header: Header,
    /// The format that the mesh is written in.
    pub format: Format,
    /// What it takes.
    pub cost: Cost,
}

impl MeshTask {
    /// A mesh for a response. The memory for bodies is charged for the files themselves.
    ///
    /// # Errors
    /// When a header cannot be read, is over a limit, or does not fit the options.
    pub fn for_response(
        source: Weighed<&[u8]>,
        options: &MeshOptions,
        format: Format,
        limits: &Limits,
    ) -> Result<Self, EngineError> {
        let header = options.output.reading(limits).probe(source.image)?;
        let plan = options.plan(&header)?;
        let mut cost = Cost::of_mesh(&header, &plan, &options.parameters, format);
        if options.output.shows_image(format) {
            cost = cost.showing(&header);
        }
        Self { header, format, cost }.with_weights(source.weights, limits)
    }

    /// A job's mesh, stored as MODEL or, where the order of its vertices is kept, with that. The cost
    /// includes the files, which the job's attempt reads into memory.
    ///
    /// # Errors
    /// As [`for_response`](Self::for_response).
    pub fn for_job(
        source: Weighed<&[u8]>,
        options: &MeshOptions,
        limits: &Limits,
    ) -> Result<Self, EngineError> {
        let header = options.output.reading(limits).probe(source.image)?;
        let plan = options.plan(&header)?;
        let format =
            if options.keeps_progression(&plan) { Format::Progression } else { Format::Model };
        let files = source.image.len() + source.weights.map_or(0, <[u8]>::len);
        let mut cost =
            Cost::of_mesh(&header, &plan, &options.parameters, format).with_file(files as u64);
        if options.output.texture == Texturing::Embed {
            cost = cost.showing(&header);
        }
        if options.output.keep_image {
            cost = cost.with_file(source.image.len() as u64);
        }
        Self { header, format, cost }.with_weights(source.weights, limits)
    }

    /// The task with its weights, which must fit the image.
    fn with_weights(self, weights: Option<&[u8]>, limits: &Limits) -> Result<Self, EngineError> {
        let Some(weights) = weights else { return Ok(self) };
        let size = (self.header.width, self.header.height);
        let header = probe_weights(weights, size, limits)?;
        Ok(Self { cost: self.cost.with_weights(&header), ..self })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::ParameterSet;

    #[test]
    fn a_job_costs_the_bytes_of_its_weights_too() {
        let options = ParameterSet::of_query(Some("density=50")).unwrap().finish().unwrap();
        let image = &b"P5 4 4 255\n0123456789abcdef"[..];
        // Bytes behind a picture's end are ignored, and held in memory all the same.
        let weights = [image, &vec![0; 8 << 20]].concat();
        let mib = |weights| {
            let source = Weighed { image, weights };
            MeshTask::for_job(source, &options, &Limits::default()).unwrap().cost.mib()
        };
        assert!(mib(Some(&weights[..])) >= mib(Some(image)) + 8);
        assert!(mib(Some(image)) >= mib(None));
    }
}
