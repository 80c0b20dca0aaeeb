//! `pixmesh compare` and `pixmesh info`: figures of files.

use super::work::{Telling, print};
use crate::{CliError, files};
use clap::Args;
use pixmesh_codec::{probe, probe_mesh};
use pixmesh_engine::pipeline::{self, Comparison, HeightErrors, Pair};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Two files to compare.
#[derive(Args, Debug)]
pub struct CompareOrder {
    /// Picture; - for standard input
    picture: PathBuf,
    /// Picture of the same shape, or mesh as MODEL or pmesh; - for standard input
    approximation: PathBuf,
    #[command(flatten)]
    telling: Telling,
}

/// A file to describe.
#[derive(Args, Debug)]
pub struct InfoOrder {
    /// Picture, or mesh as MODEL or pmesh; - for standard input
    input: PathBuf,
    /// Tell it as one line of JSON
    #[arg(long)]
    json: bool,
}

impl CompareOrder {
    /// Prints PSNR, mean squared error and structural similarity; of elevation models the errors of
    /// heights.
    ///
    /// # Errors
    /// When a file cannot be read, or the shapes differ.
    pub fn run(&self) -> Result<(), CliError> {
        let inputs = [&self.picture, &self.approximation].map(|path| files::named(path));
        if inputs == [None, None] {
            return Err(CliError::InputTwice);
        }
        let picture = files::read(inputs[0])?;
        let approximation = files::read(inputs[1])?;
        let is_mesh = probe_mesh(&approximation, &files::LIMITS).is_ok();
        let pair = Pair { picture, approximation, is_mesh };
        let made = self.telling.work(|context| pipeline::compare(pair, &files::LIMITS, context));
        let Comparison { mse, psnr_db, ssim, heights } = made?;
        if self.telling.json {
            let mut facts = json!({ "psnr_db": psnr_db, "mse": mse, "ssim": ssim });
            if let Some(HeightErrors { max_error, rmse, steps, compared, unmatched }) = heights {
                let (step, rounding) = steps.unzip();
                facts["elevation"] = json!({
                    "max_error": max_error, "rmse": rmse, "step": step, "rounding": rounding,
                    "compared": compared, "unmatched": unmatched,
                });
            }
            return print(&facts.to_string());
        }
        if let Some(HeightErrors { max_error, rmse, steps, compared, unmatched }) = heights {
            let step = steps.map_or(String::new(), |(step, _)| format!(", step {step}"));
            return print(&format!(
                "largest error {max_error:.4}, RMSE {rmse:.4}, PSNR {psnr_db:.4} dB{step}, {compared} \
                 heights compared, {unmatched} in one file only"
            ));
        }
        let ssim = ssim.map_or("none".to_owned(), |ssim| format!("{ssim:.4}"));
        print(&format!("PSNR {psnr_db:.4} dB, MSE {mse:.4}, SSIM {ssim}"))
    }
}

impl InfoOrder {
    /// Prints what the file's header says.
    ///
    /// # Errors
    /// When it is neither a picture nor a mesh that can be read.
    pub fn run(&self) -> Result<(), CliError> {
        let input = files::named(&self.input);
        let bytes = files::read(input)?;
        let (kind, format, shape, vertices) = match probe(&bytes, &files::LIMITS) {
            Ok(header) => ("picture", header.format.name(), header.shape(), None),
            Err(source) => {
                let header = probe_mesh(&bytes, &files::LIMITS);
                let header = header.map_err(|_| CliError::of_file(input, source.into()))?;
                ("mesh", header.format.name(), header.shape, Some(header.vertices))
            }
        };
        let (width, height) = (shape.width, shape.height);
        let (components, bits) = (shape.component_count, shape.precision);
        if self.json {
            let mut facts = json!({
                "kind": kind, "format": format, "bytes": bytes.len(), "width": width,
                "height": height, "components": components, "bits": bits,
            });
            if let Some(vertices) = vertices {
                facts["vertices"] = Value::from(vertices);
            }
            return print(&facts.to_string());
        }
        let vertices = vertices.map_or(String::new(), |count| format!(", {count} vertices"));
        print(&format!(
            "{kind}, {format}, {width} by {height} pixels, {components} components of {bits} bits\
             {vertices}, {} bytes",
            bytes.len()
        ))
    }
}
