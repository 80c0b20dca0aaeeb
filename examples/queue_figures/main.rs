//! Measures what a broker does as the queue: submissions and jobs per second, and bytes per job.
//!
//! `cargo run --release --example queue_figures -- --queue nats://127.0.0.1:4222 --jobs 2000`
#![allow(clippy::print_stdout, reason = "the figures are what it is for")]

use clap::Parser;
use futures_util::StreamExt;
use futures_util::stream;
use pixmesh::config::BrokerSettings;
use pixmesh::digest::Digest;
use pixmesh::extract::owner::Owner;
use pixmesh::jobs::fairness::Caps;
use pixmesh::jobs::nats::{Broker, Nats};
use pixmesh::jobs::queue::{Outcome, Queue, Submitted, Terms};
use pixmesh::jobs::record::{JobId, MeshFigures, NewJob, Picture, PictureShape};
use std::error::Error;
use std::time::{Duration, Instant};

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
    println!("{:>12} {:>14} {:>14} {:>14}", "at a time", "submits/s", "p99 ms", "jobs done/s");
    for at_a_time in [1, 8, 64] {
        let count = if at_a_time == 1 { flags.jobs / 4 } else { flags.jobs };
        measure(&flags.broker, count, at_a_time).await?;
    }
    Ok(())
}

async fn measure(
    settings: &BrokerSettings,
    count: usize,
    at_a_time: usize,
) -> Result<(), Box<dyn Error + Send + Sync>> {
    let queue = Nats::open(Broker::connect(settings).await?, terms()).await?;
    let began = Instant::now();
    let mut took: Vec<Duration> = stream::iter(0..count)
        .map(|_| async {
            let began = Instant::now();
            let submitted = queue.submit(job()).await;
            assert!(matches!(submitted, Ok(Submitted::Created(_))), "{submitted:?}");
            began.elapsed()
        })
        .buffer_unordered(at_a_time)
        .collect()
        .await;
    let submits = count as f64 / began.elapsed().as_secs_f64();
    took.sort_unstable();
    let p99 = took[(count * 99 / 100).min(count - 1)];
    let began = Instant::now();
    stream::iter(0..count)
        .map(|_| async {
            let claim = loop {
                match queue.claim().await {
                    Ok(Some(claim)) => break claim,
                    other => println!("nothing to claim: {other:?}"),
                }
            };
            let outcome = Outcome::Completed(figures(claim.lease.job));
            let finished = queue.finish(claim.lease, outcome).await;
            assert!(finished.is_ok(), "{finished:?}");
        })
        .buffer_unordered(at_a_time)
        .collect::<Vec<()>>()
        .await;
    let done = count as f64 / began.elapsed().as_secs_f64();
    println!("{at_a_time:>12} {submits:>14.0} {:>14.1} {done:>14.0}", p99.as_secs_f64() * 1e3);
    Ok(())
}

fn terms() -> Terms {
    let day = Duration::from_hours(24);
    let most = 1_000_000;
    Terms {
        caps: Caps { queued: most, queued_per_owner: most, running_per_owner: most },
        lease: Duration::from_secs(30),
        result_ttl: day,
        idempotency_ttl: day,
        gone_ttl: day,
    }
}

fn job() -> NewJob {
    let id = JobId::new();
    let shape =
        PictureShape { width: 512, height: 512, components: 1, precision: 8, weights: None };
    let digest = Digest::of(id.as_bytes());
    NewJob {
        id,
        owner: Owner::anonymous(),
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
        timings_ms: stages.map(|stage| (stage.to_owned(), 12.345)).to_vec(),
        progression: None,
    }
}
