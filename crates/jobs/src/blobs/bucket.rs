//! Blobs in the object store of the queue's broker: each in pieces, in a stream of its own.

use crate::nats::{Broker, failure};
use async_nats::jetstream::object_store::{
    Config, DeleteErrorKind, GetErrorKind, InfoErrorKind, Object, ObjectInfo, ObjectStore as Bucket,
};
use async_nats::jetstream::stream::StorageType;
use async_trait::async_trait;
use bytes::Bytes;
use futures_util::stream::BoxStream;
use futures_util::{StreamExt, TryStreamExt, stream};
use object_store::path::Path;
use object_store::{
    Attributes, CopyOptions, Error, GetOptions, GetResult, GetResultPayload, ListResult,
    MultipartUpload, ObjectMeta, ObjectStore, PutMultipartOptions, PutOptions, PutPayload,
    PutResult, Result,
};
use std::fmt;
use std::io::{self, Cursor};
use std::ops::Range;
use std::pin::pin;
use std::time::{Duration, SystemTime};
use tokio::io::{AsyncReadExt, copy, sink};
use tokio::time::timeout;
use tokio_util::io::ReaderStream;

/// The name by which this store is known in errors.
const STORE: &str = "JetStream";
/// How long a piece is waited for before it is asked whether there is still one to come.
const LOOK_AGAIN: Duration = Duration::from_millis(500);
/// How often in a row it is asked: a piece that has not come in half a minute is lost.
const MOST_LOOKS: u32 = 60;
/// The size of the pieces that a blob is read in.
const PIECE: usize = 128 << 10;

/// A bucket of the broker.
#[derive(Clone)]
pub(super) struct BrokerBucket {
    bucket: Bucket,
    most_looks: u32,
}

impl BrokerBucket {
    /// Opens the bucket, and makes it where there is none.
    pub(super) async fn open(
        broker: &Broker,
    ) -> Result<Self, Box<dyn std::error::Error + Send + Sync>> {
        let bucket = broker.stream_name("blobs-store");
        if let Ok(bucket) = broker.context.get_object_store(&bucket).await {
            return Ok(Self { bucket, most_looks: MOST_LOOKS });
        }
        let config = Config {
            bucket: bucket.clone(),
            description: Some("pictures and meshes".into()),
            storage: StorageType::File,
            num_replicas: broker.replicas,
            ..Config::default()
        };
        let made = broker.made(|| broker.context.create_object_store(config.clone())).await;
        let what =
            format!("bucket {bucket} cannot be made with --queue-replicas {}", broker.replicas);
        let bucket = made.map_err(|error| failure(&what, &error))?;
        Ok(Self { bucket, most_looks: MOST_LOOKS })
    }

    async fn read(
        &self,
        name: String,
        range: Range<u64>,
    ) -> Result<BoxStream<'static, Result<Bytes>>> {
        let mut object = self.bucket.get(&name).await.map_err(|error| match error.kind() {
            GetErrorKind::NotFound => not_found(&name, error),
            _ => failed(error),
        })?;
        let copy_read = object.info.nuid.clone();
        self.drop_first(&mut object, range.start, &name).await?;
        let part = object.take(range.end - range.start);
        let pieces = ReaderStream::with_capacity(part, PIECE);
        let reading = (self.clone(), pieces, name, copy_read);
        Ok(stream::try_unfold(reading, |(bucket, mut pieces, name, copy_read)| async {
            let mut looks = 0;
            loop {
                match timeout(LOOK_AGAIN, pieces.next()).await {
                    Ok(None) => return Ok(None),
                    Ok(Some(piece)) => {
                        let piece = piece.map_err(failed)?;
                        return Ok(Some((piece, (bucket, pieces, name, copy_read))));
                    }
                    Err(_) => bucket.must_have(&name, &copy_read, &mut looks).await?,
                }
            }
        })
        .boxed())
    }

    /// Reads and drops what lies before a part: pieces have no addresses.
    async fn drop_first(&self, object: &mut Object, bytes: u64, name: &str) -> Result<()> {
        let (copy_read, mut nowhere) = (object.info.nuid.clone(), sink());
        let mut first = object.take(bytes);
        let mut dropping = pin!(copy(&mut first, &mut nowhere));
        let mut looks = 0;
        loop {
            if let Ok(dropped) = timeout(LOOK_AGAIN, &mut dropping).await {
                return dropped.map(|_| ()).map_err(failed);
            }
            self.must_have(name, &copy_read, &mut looks).await?;
        }
    }

    /// A blob that is put once more is another copy, and the pieces of the one before are deleted:
    /// whoever reads that one would wait for them for ever. So would whoever reads a blob whose pieces
    /// the broker has lost, and is told so after the most looks.
    async fn must_have(&self, name: &str, copy_read: &str, looks: &mut u32) -> Result<()> {
        let info = self.bucket.info(name).await.map_err(failed)?;
        *looks += 1;
        if info.nuid != copy_read || info.deleted {
            return Err(failed(io::Error::other("it was replaced while it was read")));
        }
        if *looks >= self.most_looks {
            return Err(failed(io::Error::other("a piece of it does not come: it is lost")));
        }
        Ok(())
    }
}

impl fmt::Debug for BrokerBucket {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(STORE)
    }
}

impl fmt::Display for BrokerBucket {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(STORE)
    }
}

#[async_trait]
impl ObjectStore for BrokerBucket {
    async fn put_opts(
        &self,
        place: &Path,
        payload: PutPayload,
        _: PutOptions,
    ) -> Result<PutResult> {
        let mut bytes = Cursor::new(Bytes::from(payload));
        let info = self.bucket.put(place.as_ref(), &mut bytes).await.map_err(failed)?;
        Ok(PutResult { e_tag: info.digest, version: None, extensions: Default::default() })
    }

    async fn get_opts(&self, place: &Path, options: GetOptions) -> Result<GetResult> {
        let name = place.to_string();
        let info = self.bucket.info(&name).await.map_err(|error| match error.kind() {
            InfoErrorKind::NotFound => not_found(&name, error),
            _ => failed(error),
        })?;
        // What was deleted leaves a mark under its name.
        if info.deleted {
            return Err(Error::NotFound { path: name, source: "it was deleted".into() });
        }
        let meta = meta_of(place.clone(), &info);
        options.check_preconditions(&meta)?;
        let range = match &options.range {
            Some(range) => range.as_range(meta.size).map_err(failed)?,
            None => 0..meta.size,
        };
        let pieces = match options.head {
            true => stream::empty().boxed(),
            false => self.read(name, range.clone()).await?,
        };
        Ok(GetResult {
            payload: GetResultPayload::Stream(pieces),
            meta,
            range,
            attributes: Attributes::default(),
            extensions: Default::default(),
        })
    }

    fn delete_stream(
        &self,
        places: BoxStream<'static, Result<Path>>,
    ) -> BoxStream<'static, Result<Path>> {
        let bucket = self.bucket.clone();
        places
            .and_then(move |place| {
                let bucket = bucket.clone();
                async move {
                    match bucket.delete(place.as_ref()).await {
                        Ok(()) => Ok(place),
                        Err(error) if error.kind() == DeleteErrorKind::NotFound => {
                            Err(not_found(place.as_ref(), error))
                        }
                        Err(error) => Err(failed(error)),
                    }
                }
            })
            .boxed()
    }

    fn list(&self, _: Option<&Path>) -> BoxStream<'static, Result<ObjectMeta>> {
        stream::once(std::future::ready(Err(not_done("list")))).boxed()
    }

    async fn put_multipart_opts(
        &self,
        _: &Path,
        _: PutMultipartOptions,
    ) -> Result<Box<dyn MultipartUpload>> {
        Err(not_done("put_multipart"))
    }

    async fn list_with_delimiter(&self, _: Option<&Path>) -> Result<ListResult> {
        Err(not_done("list_with_delimiter"))
    }

    async fn copy_opts(&self, _: &Path, _: &Path, _: CopyOptions) -> Result<()> {
        Err(not_done("copy"))
    }
}

fn meta_of(location: Path, info: &ObjectInfo) -> ObjectMeta {
    let nanoseconds = info.modified.map_or(0, |moment| moment.unix_timestamp_nanos());
    let since_1970 = Duration::from_millis((nanoseconds / 1_000_000).max(0) as u64);
    ObjectMeta {
        location,
        last_modified: (SystemTime::UNIX_EPOCH + since_1970).into(),
        size: info.size as u64,
        e_tag: info.digest.clone(),
        version: None,
    }
}

fn not_found(name: &str, error: impl std::error::Error + Send + Sync + 'static) -> Error {
    Error::NotFound { path: name.to_owned(), source: Box::new(error) }
}

fn failed(error: impl std::error::Error + Send + Sync + 'static) -> Error {
    Error::Generic { store: STORE, source: Box::new(error) }
}

/// Blobs are written whole, under names that say nothing of their order.
fn not_done(operation: &str) -> Error {
    Error::NotImplemented { operation: operation.to_owned(), implementer: STORE.to_owned() }
}

#[cfg(test)]
mod tests;
