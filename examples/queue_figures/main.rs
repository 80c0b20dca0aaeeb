//! Measures what a broker does as the queue: submissions, claims and ends of jobs per second, bytes
//! in the streams, and the processor time of a node.
//!
//! `cargo run --release --example queue_figures -- --queue nats://127.0.0.1:4222 --jobs 2000`
#![allow(clippy::print_stdout, reason = "the figures are what it is for")]

use clap::Parser;
use futures_util::StreamExt;
use futures_util::stream;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use pixmesh_jobs::fairness::Caps;
use pixmesh_jobs::nats::settings::BrokerSettings;
use pixmesh_jobs::nats::{Broker, Nats};
use pixmesh_jobs::queue::{Claim, Finish, Outcome, Queue, Submitted, Terms};
use pixmesh_jobs::record::{JobId, MeshFigures, NewJob, Picture, PictureShape, State};
use rustix::time::{ClockId, clock_gettime};
use std::error::Error;
use std::time::{Duration, Instant};

/// The streams whose bytes are counted.
const STREAMS: [&str; 5] = ["work", "jobs", "words", "gone", "blobs"];

#[derive(Parser)]
struct Flags {
    #[command(flatten)]
    broker: BrokerSettings,
    /// Jobs of each measurement.
    #[arg(long, default_value = "2000")]
    jobs: usize,
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let flags = Flags::parse();
    println!(
        "at a time  submits/s  median ms  p99 ms  claims/s  ends/s  bytes waiting  bytes ended  \
         node ms/job"
    );
    for at_a_time in [1, 8, 64] {
        let count = if at_a_time == 1 { flags.jobs / 4 } else { flags.jobs };
        measure(&flags.broker, count.max(1), at_a_time).await?;
    }
    Ok(())
}

async fn measure(
    settings: &BrokerSettings,
    count: usize,
    at_a_time: usize,
) -> Result<(), Box<dyn Error + Send + Sync>> {
    let queue = Nats::open(Broker::connect(settings).await?, terms()).await?;
    let (kept, used_s) = (kept_bytes(settings).await?, processor_s());
    let began = Instant::now();
    let mut took = at_once(count, at_a_time, || submit(&queue)).await;
    let submits = per_second(count, began);
    took.sort_unstable();
    let percentile_ms = |percent: usize| took[(count - 1) * percent / 100].as_secs_f64() * 1e3;
    let waiting = kept_bytes(settings).await?;
    let began = Instant::now();
    let claims = at_once(count, at_a_time, || claim(&queue)).await;
    let claimed = per_second(count, began);
    let began = Instant::now();
    let ends: Vec<_> = stream::iter(claims)
        .map(|claim| end(&queue, claim))
        .buffer_unordered(at_a_time)
        .collect()
        .await;
    let ended = per_second(ends.len(), began);
    let left = kept_bytes(settings).await?;
    let each = |bytes: u64| bytes.saturating_sub(kept) / count as u64;
    println!(
        "{at_a_time:>9}  {submits:>9.0}  {:>9.1}  {:>6.1}  {claimed:>8.0}  {ended:>6.0}  {:>13}  \
         {:>11}  {:>11.2}",
        percentile_ms(50),
        percentile_ms(99),
        each(waiting),
        each(left),
        (processor_s() - used_s) * 1e3 / count as f64
    );
    Ok(())
}

/// Does something many times, so many at a time.
async fn at_once<T, F: Future<Output = T>>(
    count: usize,
    at_a_time: usize,
    task: impl Fn() -> F,
) -> Vec<T> {
    stream::iter(0..count).map(|_| task()).buffer_unordered(at_a_time).collect().await
}

fn per_second(count: usize, began: Instant) -> f64 {
    count as f64 / began.elapsed().as_secs_f64()
}

/// Submits a job, and says how long that took.
async fn submit(queue: &Nats) -> Duration {
    let began = Instant::now();
    let submitted = queue.submit(job()).await;
    assert!(matches!(submitted, Ok(Submitted::Created(_))), "{submitted:?}");
    began.elapsed()
}

async fn claim(queue: &Nats) -> Claim {
    loop {
        match queue.claim().await {
            Ok(Some(claim)) => return claim,
            other => println!("nothing to claim: {other:?}"),
        }
    }
}

async fn end(queue: &Nats, claim: Claim) {
    let outcome = Outcome::Completed(figures(claim.lease.job));
    let finish = queue.finish(claim.lease, outcome).await;
    assert!(matches!(finish, Ok(Finish::Committed(State::Completed))), "{finish:?}");
}

/// The bytes in all streams.
async fn kept_bytes(settings: &BrokerSettings) -> Result<u64, Box<dyn Error + Send + Sync>> {
    let client = async_nats::connect(settings.servers()?).await?;
    let context = async_nats::jetstream::new(client);
    let mut bytes = 0;
    for kind in STREAMS {
        let stream = context.get_stream(format!("{}-{kind}", settings.queue_prefix)).await?;
        bytes += stream.cached_info().state.bytes;
    }
    Ok(bytes)
}

/// The processor time of this process.
fn processor_s() -> f64 {
    let used = clock_gettime(ClockId::ProcessCPUTime);
    used.tv_sec as f64 + used.tv_nsec as f64 / 1e9
}

fn terms() -> Terms {
    let day = Duration::from_hours(24);
    let most = 1_000_000;
    Terms {
        caps: Caps { queued: most, queued_per_owner: most, running_per_owner: most },
        // Longer than a measurement: what is claimed is not given to anybody again.
        lease: Duration::from_hours(1),
        result_ttl: day,
        idempotency_ttl: day,
        gone_ttl: day,
        look_again: Duration::from_secs(1),
    }
}

fn job() -> NewJob {
    let id = JobId::new();
    let shape =
        PictureShape { width: 512, height: 512, components: 1, precision: 8, weights: None };
    let digest = Digest::of(id.as_bytes());
    NewJob {
        id,
        owner: Owner::Anonymous,
        order: "method=mgprfs&density=2".into(),
        picture: Picture { digest, bytes: 262_144, shape },
        idempotency_key: None,
    }
}

fn figures(id: JobId) -> MeshFigures {
    let stages = ["queue", "decode", "density", "diffuse", "triangulate", "simplify", "encode"];
    MeshFigures {
        digest: Digest::of(id.to_string().as_bytes()).to_string(),
        bytes: 100_000,
        vertices: 5242,
        faces: 10_000,
        mse: 12.5,
        psnr_db: Some(37.16),
        chunks: Vec::new(),
        timings_ms: stages.map(|stage| (stage.to_owned(), 12.345)).to_vec(),
        progression: None,
    }
}
