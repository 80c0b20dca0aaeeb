//! The setting of the store of blobs.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// The store of blobs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BlobEngine {
    /// Files in the data folder.
    File,
    /// Files in a folder that all nodes share.
    Folder(PathBuf),
    /// An S3-compatible store, by `s3://BUCKET` with or without a prefix.
    S3(String),
}

impl FromStr for BlobEngine {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once("://") {
            None if text == "file" => Ok(Self::File),
            Some(("file", path)) if path.starts_with('/') => Ok(Self::Folder(path.into())),
            Some(("s3", bucket)) if !bucket.is_empty() && !bucket.starts_with('/') => {
                Ok(Self::S3(text.to_owned()))
            }
            _ => Err("must be file, file:///FOLDER or s3://BUCKET".into()),
        }
    }
}

impl fmt::Display for BlobEngine {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => formatter.write_str("file"),
            Self::Folder(path) => write!(formatter, "file://{}", path.display()),
            Self::S3(address) => formatter.write_str(address),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stores_round_trip_through_text() {
        for text in ["file", "file:///srv/blobs", "s3://bucket", "s3://bucket/prefix"] {
            assert_eq!(
                text.parse::<BlobEngine>().map(|engine| engine.to_string()),
                Ok(text.into())
            );
        }
        for wrong in ["", "files", "file://relative", "s3://", "http://a", "nats"] {
            assert!(wrong.parse::<BlobEngine>().is_err(), "{wrong}");
        }
    }
}
