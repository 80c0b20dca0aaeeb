//! The setting of the store of blobs.

use serde::{Serialize, Serializer};
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
    /// A store on the network, with or without a prefix: `s3://BUCKET` (S3 and compatible),
    /// `gs://BUCKET` (Google Cloud Storage) or `az://CONTAINER` (Azure Blob Storage).
    Bucket(String),
}

impl FromStr for BlobEngine {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once("://") {
            None if text == "file" => Ok(Self::File),
            Some(("file", path)) if path.starts_with('/') => Ok(Self::Folder(path.into())),
            Some(("s3" | "gs" | "az", bucket))
                if !bucket.is_empty() && !bucket.starts_with('/') =>
            {
                Ok(Self::Bucket(text.to_owned()))
            }
            _ => {
                Err("must be file, file:///FOLDER, s3://BUCKET, gs://BUCKET or az://CONTAINER"
                    .into())
            }
        }
    }
}

impl fmt::Display for BlobEngine {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => formatter.write_str("file"),
            Self::Folder(path) => write!(formatter, "file://{}", path.display()),
            Self::Bucket(address) => formatter.write_str(address),
        }
    }
}

impl Serialize for BlobEngine {
    /// As it is shown.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stores_round_trip_through_text() {
        for text in
            ["file", "file:///srv/blobs", "s3://bucket", "gs://bucket/prefix", "az://container"]
        {
            assert_eq!(
                text.parse::<BlobEngine>().map(|engine| engine.to_string()),
                Ok(text.into())
            );
        }
        for wrong in ["", "files", "file://relative", "s3://", "gs:///a", "http://a"] {
            assert!(wrong.parse::<BlobEngine>().is_err(), "{wrong}");
        }
    }
}
