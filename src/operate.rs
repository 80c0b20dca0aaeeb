//! `pixmesh jobs`: what operators do to the jobs of a running service.

use crate::config::HealthSettings;
use bytes::Bytes;
use clap::{Args, Subcommand, ValueEnum};
use http_body_util::{BodyExt, Empty};
use hyper::client::conn::http1;
use hyper::header::{AUTHORIZATION, HOST};
use hyper::{Method, Request};
use hyper_util::rt::TokioIo;
use serde_json::Value;
use std::error::Error;
use std::fmt::Write as _;
use std::io::{self, Write};
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::time::timeout;

/// The longest time of a request.
const TIMEOUT: Duration = Duration::from_secs(60);

/// The settings of `pixmesh jobs`.
#[derive(Args, Clone, Debug)]
pub struct Order {
    /// The service.
    #[command(flatten)]
    pub service: HealthSettings,
    /// Key of an operator, where the service has keys.
    #[arg(long, env = "PIXMESH_KEY", hide_env_values = true, global = true)]
    pub key: Option<String>,
    /// What to do.
    #[command(subcommand)]
    pub action: Action,
}

/// What to do.
#[derive(Clone, Debug, Subcommand)]
pub enum Action {
    /// Prints jobs of all owners, newest first: id, state, owner, time, bytes of the picture, and problem.
    List {
        /// Which.
        #[command(flatten)]
        filter: Filter,
        /// The most jobs.
        #[arg(long, default_value_t = 100)]
        limit: usize,
        /// Print each job as a line of JSON.
        #[arg(long)]
        json: bool,
    },
    /// Queues failed jobs again, with three new attempts.
    Retry(Selection),
    /// Cancels queued and running jobs.
    Cancel(Selection),
    /// Deletes jobs that have ended.
    Delete(Selection),
    /// Accepts no new jobs, or starts no queued ones, on all nodes, until resumed.
    Pause {
        /// What.
        what: Activity,
    },
    /// Accepts or starts jobs again.
    Resume {
        /// What.
        what: Activity,
    },
    /// Prints what is paused.
    Paused,
}

/// What can be paused.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Activity {
    /// New jobs.
    Intake,
    /// The start of queued jobs.
    Work,
}

/// Which jobs: all that every filter accepts.
#[derive(Args, Clone, Debug)]
pub struct Filter {
    /// The one with this id.
    pub id: Option<String>,
    /// Those of the key's name; '' for those without a key.
    #[arg(long)]
    pub owner: Option<String>,
    /// Those in this state: queued, running, completed, failed or cancelled.
    #[arg(long)]
    pub state: Option<String>,
    /// Those that failed with this problem, such as attempts-exhausted.
    #[arg(long)]
    pub problem: Option<String>,
    /// Those submitted as long ago or longer, such as 24h.
    #[arg(long)]
    pub min_age: Option<String>,
    /// Those submitted no longer ago.
    #[arg(long)]
    pub max_age: Option<String>,
    /// Those whose picture's file is as large or larger, such as 10MiB.
    #[arg(long)]
    pub min_size: Option<String>,
}

/// Which jobs to change.
#[derive(Args, Clone, Debug)]
pub struct Selection {
    /// Which.
    #[command(flatten)]
    pub filter: Filter,
    /// All jobs, where no filter is given.
    #[arg(long)]
    pub all: bool,
}

/// Carries the order out.
///
/// # Errors
/// When nothing answers, or the service refuses.
pub fn operate(order: &Order) -> Result<(), Box<dyn Error>> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        match &order.action {
            Action::List { filter, limit, json } => list(order, filter, *limit, *json).await,
            Action::Retry(selection) => change(order, "retry", selection).await,
            Action::Cancel(selection) => change(order, "cancel", selection).await,
            Action::Delete(selection) => change(order, "delete", selection).await,
            Action::Pause { what } => show_paused(order, Method::PUT, Some(*what)).await,
            Action::Resume { what } => show_paused(order, Method::DELETE, Some(*what)).await,
            Action::Paused => show_paused(order, Method::GET, None).await,
        }
    })
}

async fn list(
    order: &Order,
    filter: &Filter,
    limit: usize,
    is_json: bool,
) -> Result<(), Box<dyn Error>> {
    let (mut left, mut cursor) = (limit, String::new());
    while left > 0 {
        let query = format!("{}&limit={}{cursor}", filter.query(), left.min(100));
        let page = ask(order, Method::GET, &format!("/v1/jobs?{query}")).await?;
        for job in page["jobs"].as_array().into_iter().flatten() {
            left -= 1;
            if is_json {
                writeln!(io::stdout(), "{job}")?;
                continue;
            }
            let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
            let owner = Some(text(&job["owner"])).filter(|owner| !owner.is_empty());
            let columns = [
                text(&job["id"]),
                text(&job["state"]),
                owner.unwrap_or_else(|| "-".into()),
                text(&job["created_at"]),
                job["image"]["bytes"].to_string(),
                text(&job["error"]["type"]).replace("/problems/", ""),
            ];
            writeln!(io::stdout(), "{}", columns.join("  ").trim_end())?;
        }
        for id in page["damaged"].as_array().into_iter().flatten() {
            writeln!(io::stderr(), "the record of job {id} cannot be read")?;
        }
        let Some(next) = page["cursor"].as_str() else { return Ok(()) };
        cursor = format!("&cursor={next}");
    }
    writeln!(io::stderr(), "there may be more: --limit")?;
    Ok(())
}

async fn change(order: &Order, name: &str, selection: &Selection) -> Result<(), Box<dyn Error>> {
    let (mut changed, mut without_picture, mut cursor) = (0, 0, String::new());
    loop {
        let query = format!(
            "{}{}{cursor}",
            selection.filter.query(),
            if selection.all { "&all=true" } else { "" }
        );
        let answer = ask(order, Method::POST, &format!("/v1/jobs/{name}?{query}")).await?;
        changed += answer["changed"].as_u64().unwrap_or_default();
        without_picture += answer["without_picture"].as_u64().unwrap_or_default();
        let Some(next) = answer["cursor"].as_str() else { break };
        cursor = format!("&cursor={next}");
    }
    writeln!(io::stdout(), "{name}: {changed} jobs")?;
    if without_picture > 0 {
        writeln!(io::stderr(), "not retried, because their pictures are gone: {without_picture}")?;
    }
    Ok(())
}

async fn show_paused(
    order: &Order,
    method: Method,
    what: Option<Activity>,
) -> Result<(), Box<dyn Error>> {
    let path = match what {
        Some(Activity::Intake) => "/v1/paused/intake",
        Some(Activity::Work) => "/v1/paused/work",
        None => "/v1/paused",
    };
    let answer = ask(order, method, path).await?;
    for what in ["intake", "work"] {
        let is_paused = answer[what].as_bool().unwrap_or_default();
        writeln!(io::stdout(), "{what}: {}", if is_paused { "paused" } else { "running" })?;
    }
    Ok(())
}

/// Sends a request and returns the JSON of the answer.
async fn ask(order: &Order, method: Method, target: &str) -> Result<Value, Box<dyn Error>> {
    let address = order.service.ops_listen;
    let mut request =
        Request::builder().method(method).uri(target).header(HOST, address.to_string());
    if let Some(key) = &order.key {
        request = request.header(AUTHORIZATION, format!("Bearer {key}"));
    }
    let request = request.body(Empty::<Bytes>::new())?;
    let exchange = async {
        let stream = TcpStream::connect(address).await?;
        let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await?;
        tokio::spawn(connection);
        let response = sender.send_request(request).await?;
        let is_success = response.status().is_success();
        let body = response.into_body().collect().await?.to_bytes();
        Ok::<_, Box<dyn Error>>((is_success, body))
    };
    let (is_success, body) = timeout(TIMEOUT, exchange)
        .await
        .map_err(|error| format!("no answer from {address}: {error}"))?
        .map_err(|error| format!("no answer from {address}: {error}"))?;
    let answer: Value = serde_json::from_slice(&body)?;
    match is_success {
        true => Ok(answer),
        false => Err(answer["detail"].as_str().unwrap_or("the service refuses").into()),
    }
}

impl Filter {
    fn query(&self) -> String {
        let Self { id, owner, state, problem, min_age, max_age, min_size } = self;
        let pairs = [
            ("id", id),
            ("owner", owner),
            ("state", state),
            ("problem", problem),
            ("min_age", min_age),
            ("max_age", max_age),
            ("min_size", min_size),
        ];
        let given = pairs.iter().filter_map(|(name, value)| Some((*name, value.as_ref()?)));
        given
            .map(|(name, value)| format!("{name}={}", encoded(value)))
            .collect::<Vec<_>>()
            .join("&")
    }
}

/// A value of a query in percent notation.
fn encoded(value: &str) -> String {
    value.bytes().fold(String::new(), |mut text, byte| {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            text.push(char::from(byte));
        } else {
            let _ = write!(text, "%{byte:02X}");
        }
        text
    })
}
