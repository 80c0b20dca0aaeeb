//! Measures a PostgreSQL database as the queue of two nodes, in a schema that is created and
//! dropped. One million jobs take about 1.5 GB.
//!
//! `cargo run --release -p pixmesh-jobs --example database_figures -- --url
//! postgres://NAME@HOST/DB`
//!
//! With `--program target/release/pixmesh` the program also measures the CPU time of a service
//! without requests, and of a database on the same machine, on Linux.
#![allow(clippy::print_stdout, reason = "the program prints figures")]

use clap::Parser;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use pixmesh_jobs::Caps;
use pixmesh_jobs::postgres::{Postgres, PostgresSettings};
use pixmesh_jobs::queue::{Outcome, PageRequest, Queue, Submitted, Terms};
use pixmesh_jobs::record::{JobId, MeshFigures, NewJob, Picture, PictureShape, State};
use sqlx::{AssertSqlSafe, PgPool};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use tokio::process::Command;

/// How long each rate is measured.
const TIME: Duration = Duration::from_secs(5);
/// Concurrent callers, on both nodes together.
const CALLERS: usize = 128;
/// Tasks that follow one job.
const FOLLOWERS: usize = 1000;
/// How long a service without requests is measured.
const IDLE_TIME: Duration = Duration::from_secs(60);
/// The schema of the tables.
const SCHEMA: &str = "pixmesh_figures";

#[derive(Parser)]
struct Flags {
    /// Address of the database.
    #[arg(long)]
    url: String,
    #[command(flatten)]
    database: PostgresSettings,
    /// The number of stored jobs while lists are measured.
    #[arg(long, default_value = "1000000")]
    jobs: usize,
    /// The program to measure without requests.
    #[arg(long)]
    program: Option<PathBuf>,
}

type Done<T> = Result<T, Box<dyn Error + Send + Sync>>;

#[tokio::main]
async fn main() -> Done<()> {
    let mut flags = Flags::parse();
    flags.database.queue_schema = SCHEMA.into();
    let pool = PgPool::connect(&flags.url).await?;
    println!("{:<52}{:>12}", "what", "figure");
    let nodes = fresh(&pool, &flags).await?;
    submissions(&nodes, "anonymous", |_| Owner::Anonymous).await;
    submissions(&nodes, "of 100 owners", |n| Owner::named(&format!("owner-{}", n % 100))).await;
    claims(&nodes, "claims with completions/s").await;
    for owners in [10, 10_000] {
        let nodes = fresh(&pool, &flags).await?;
        fill(&pool, 50_000, owners, "0", "NULL").await?;
        claims(&nodes, &format!("the same, {owners} owners with queued jobs")).await;
        let nodes = fresh(&pool, &flags).await?;
        fill(&pool, 20_000, owners, "0", "NULL").await?;
        let began = Instant::now();
        for _ in 0..500 {
            nodes[0].claim().await?;
        }
        row(
            &format!("ms a single claim, {owners} owners with queued jobs"),
            began.elapsed().as_secs_f64() * 2.0,
        );
    }
    let nodes = fresh(&pool, &flags).await?;
    followers(&nodes).await?;
    let nodes = fresh(&pool, &flags).await?;
    fill(
        &pool,
        flags.jobs,
        100,
        "n / 100 % 5",
        "CASE WHEN n / 100 % 5 >= 2 THEN now() + interval '1 day' END",
    )
    .await?;
    lists(&nodes[0]).await?;
    let bytes: i64 = sqlx::query_scalar(AssertSqlSafe(format!(
        "SELECT pg_total_relation_size('{SCHEMA}.jobs')"
    )))
    .fetch_one(&pool)
    .await?;
    row("bytes a job, indexes included", bytes as f64 / flags.jobs as f64);
    let began = Instant::now();
    for _ in 0..100 {
        nodes[0].stats().await?;
    }
    row("ms the numbers of queued and running jobs", began.elapsed().as_secs_f64() * 10.0);
    drop(nodes);
    if let Some(program) = &flags.program {
        idle(program, &flags.url).await?;
    }
    let nodes = fresh(&pool, &flags).await?;
    fill(&pool, 100_000, 100, "2", "now() - interval '1 second'").await?;
    let (began, mut expired) = (Instant::now(), 0);
    while expired < 100_000 {
        expired += nodes[0].sweep().await?.expired;
    }
    row("expired jobs/s", expired as f64 / began.elapsed().as_secs_f64());
    sqlx::raw_sql(AssertSqlSafe(format!("DROP SCHEMA {SCHEMA} CASCADE"))).execute(&pool).await?;
    Ok(())
}

/// Two nodes with new tables.
async fn fresh(pool: &PgPool, flags: &Flags) -> Done<[Arc<Postgres>; 2]> {
    let dropped = format!("DROP SCHEMA IF EXISTS {SCHEMA} CASCADE");
    sqlx::raw_sql(AssertSqlSafe(dropped)).execute(pool).await?;
    let caps = Caps {
        queued: 1 << 30,
        queued_per_owner: 1 << 30,
        running_per_owner: 1 << 30,
        stored_bytes: u64::MAX,
        stored_bytes_per_owner: u64::MAX,
    };
    let terms = Terms::new(caps, Duration::from_hours(1), Duration::from_hours(1));
    let url = flags.url.parse()?;
    let [one, other] = [
        Postgres::open(&url, &flags.database, terms).await?,
        Postgres::open(&url, &flags.database, terms).await?,
    ];
    Ok([Arc::new(one), Arc::new(other)])
}

/// Inserts jobs as if they had been submitted.
async fn fill(pool: &PgPool, jobs: usize, owners: usize, state: &str, expires: &str) -> Done<()> {
    sqlx::raw_sql(AssertSqlSafe(format!(
        "INSERT INTO {SCHEMA}.jobs (id, owner, state, attempt, fence, cancel_requested, options,
                                    image_digest, image_bytes, image_shape, created_at, revision,
                                    history, mesh, mesh_digest, finished_at, expires_at)
         SELECT (lpad(to_hex(n), 12, '0') || '7000' || substr(md5(n::text), 1, 16))::uuid,
                'owner-' || n % {owners}, {state}, 0, 0, false, 'density=2', sha256(n::text::bytea),
                1000, '{{\"width\":2,\"height\":2,\"components\":1,\"precision\":8}}', now(), 1,
                ARRAY[1, 1700000000000, 0, 0], NULL,
                CASE WHEN {state} = 2 THEN sha256((-n)::text::bytea) END,
                CASE WHEN {state} >= 2 THEN now() END, {expires}
         FROM generate_series(1, {jobs}) AS n;
         INSERT INTO {SCHEMA}.owner_locks SELECT 'owner-' || n, purpose
         FROM generate_series(0, {owners} - 1) AS n, (VALUES (0), (1)) AS purposes (purpose);
         UPDATE {SCHEMA}.job_counts SET queued = {jobs} WHERE slot = 0"
    )))
    .execute(pool)
    .await?;
    sqlx::raw_sql(AssertSqlSafe(format!("VACUUM ANALYZE {SCHEMA}.jobs"))).execute(pool).await?;
    Ok(())
}

async fn submissions(nodes: &[Arc<Postgres>; 2], of: &str, owner: fn(usize) -> Owner) {
    let mut took = at_once(nodes, move |node, n| async move {
        let submitted = node.submit(job(owner(n))).await;
        matches!(submitted, Ok(Submitted::Created(_)))
    })
    .await;
    row(&format!("submissions/s, {of}"), took.len() as f64 / TIME.as_secs_f64());
    took.sort();
    row("  p99 ms", ms(took[took.len() * 99 / 100]));
}

async fn claims(nodes: &[Arc<Postgres>; 2], what: &str) {
    let took = at_once(nodes, |node, n| async move {
        let Ok(Some(claim)) = node.claim().await else { return false };
        node.finish(claim.lease, Outcome::Completed(figures(n))).await.is_ok()
    })
    .await;
    row(what, took.len() as f64 / TIME.as_secs_f64());
}

/// The durations of an operation that concurrent callers repeat on both nodes.
async fn at_once<F>(
    nodes: &[Arc<Postgres>; 2],
    act: impl Fn(Arc<Postgres>, usize) -> F + Clone + Send + 'static,
) -> Vec<Duration>
where
    F: Future<Output = bool> + Send,
{
    let (until, count) = (Instant::now() + TIME, Arc::new(AtomicUsize::new(0)));
    let caller = |n: usize| {
        let (node, count, act) = (Arc::clone(&nodes[n % 2]), Arc::clone(&count), act.clone());
        tokio::spawn(async move {
            let mut took = Vec::new();
            while Instant::now() < until {
                let began = Instant::now();
                if act(Arc::clone(&node), count.fetch_add(1, Ordering::Relaxed)).await {
                    took.push(began.elapsed());
                }
            }
            took
        })
    };
    let mut took = Vec::new();
    for caller in (0..CALLERS).map(caller).collect::<Vec<_>>() {
        took.extend(caller.await.unwrap_or_default());
    }
    took
}

/// How late followers on one node receive the end of a job that the other node ran.
async fn followers(nodes: &[Arc<Postgres>; 2]) -> Done<()> {
    let mut took = Vec::new();
    for n in 0..10 {
        let owner = Owner::Anonymous;
        let new = job(owner.clone());
        let id = new.id;
        nodes[0].submit(new).await?;
        let claim = nodes[0].claim().await?.ok_or("no job to claim")?;
        let (events, _) = nodes[1].events_now(&owner, id, 0).await?;
        let after = events.last().map_or(0, |event| event.revision);
        let follow = |_| {
            let (node, owner) = (Arc::clone(&nodes[1]), owner.clone());
            tokio::spawn(async move {
                let received = node.events(&owner, id, after).await;
                received.map(|events| (events.len(), Instant::now()))
            })
        };
        let following: Vec<_> = (0..FOLLOWERS).map(follow).collect();
        // Each has read the job once before the job ends.
        tokio::time::sleep(Duration::from_secs(1)).await;
        let began = Instant::now();
        nodes[0].finish(claim.lease, Outcome::Completed(figures(n))).await?;
        for follower in following {
            let (events, at) = follower.await??;
            assert_eq!(events, 1, "the end of the job");
            took.push(at.duration_since(began));
        }
    }
    took.sort();
    row("ms p99 an event to 1,000 followers", ms(took[took.len() * 99 / 100]));
    Ok(())
}

/// The CPU time of a service and of the database while nobody sends requests.
async fn idle(program: &Path, url: &str) -> Done<()> {
    let folder = tempfile::tempdir()?;
    let blobs = format!("file://{}", folder.path().display());
    let mut service = Command::new(program)
        .args(["serve", "--listen", "127.0.0.1:0", "--blobs", &blobs])
        .args(["--queue", url, "--queue-schema", SCHEMA])
        .stdout(Stdio::null())
        .kill_on_drop(true)
        .spawn()?;
    // It expires and deletes what the measurements before have left.
    tokio::time::sleep(Duration::from_secs(60)).await;
    let before = cpu_seconds()?;
    tokio::time::sleep(IDLE_TIME).await;
    let after = cpu_seconds()?;
    for (name, before, after) in [("service", before.0, after.0), ("database", before.1, after.1)] {
        let share = (after - before) / IDLE_TIME.as_secs_f64();
        row(&format!("% of a core, {name} without requests"), share * 100.0);
    }
    match service.try_wait()? {
        Some(status) => Err(format!("{} has ended: {status}", program.display()).into()),
        None => Ok(service.kill().await?),
    }
}

/// The CPU time of all processes named `pixmesh`, and of those named `postgres`, in seconds.
fn cpu_seconds() -> Done<(f64, f64)> {
    let (mut service, mut database) = (0.0, 0.0);
    for process in std::fs::read_dir("/proc")? {
        // A process that has ended meanwhile has no file.
        let Ok(stat) = std::fs::read_to_string(process?.path().join("stat")) else { continue };
        let Some((name, fields)) = stat.split_once(") ") else { continue };
        // User and system time in ticks of 10 ms, the 14th and 15th value of all.
        let ticks =
            fields.split(' ').skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok());
        let seconds = ticks.sum::<f64>() / 100.0;
        match name.split_once('(') {
            Some((_, "pixmesh")) => service += seconds,
            Some((_, "postgres")) => database += seconds,
            _ => {}
        }
    }
    Ok((service, database))
}

async fn lists(node: &Postgres) -> Done<()> {
    let filters = std::iter::once(None).chain(State::ALL.map(Some));
    for state in filters {
        let (mut took, mut before) = (Vec::new(), None);
        for n in 0..300 {
            let owner = Owner::named(&format!("owner-{}", n % 100));
            let began = Instant::now();
            let page = node.list(&owner, PageRequest { state, before, limit: 100 }).await?;
            took.push(began.elapsed());
            before = page.next.filter(|_| n % 10 != 9);
        }
        took.sort();
        let name = state.map_or("any state", State::name);
        row(&format!("ms p99 a list of 100, {name}"), ms(took[took.len() * 99 / 100]));
    }
    Ok(())
}

fn job(owner: Owner) -> NewJob {
    let id = JobId::new();
    let shape =
        PictureShape { width: 512, height: 512, components: 3, precision: 8, weights: None };
    let picture = Picture { digest: Digest::of(id.as_bytes()), bytes: 1000, shape };
    NewJob { id, owner, options: "density=2".into(), picture, idempotency_key: None }
}

fn figures(n: usize) -> MeshFigures {
    MeshFigures {
        digest: Digest::of(&n.to_be_bytes()).to_string(),
        bytes: 5,
        vertices: 4,
        faces: 2,
        mse: 0.25,
        psnr_db: Some(54.15),
        timings_ms: vec![("decode".into(), 1.5)],
        progression: None,
        texture: None,
        image: None,
        chunks: Vec::new(),
    }
}

fn ms(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

fn row(what: &str, figure: f64) {
    println!("{what:<52}{figure:>12.1}");
}
