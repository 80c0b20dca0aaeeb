//! The log on standard error, and where it is asked for, traces.
//!
//! A thread of its own writes the lines. While nobody reads them, up to [`WAITING_LINES`] wait, and
//! more are dropped and counted: a log that stalls must not stall the service.

#[cfg(feature = "otlp")]
use super::otlp::{self, Layer, Traces};
use crate::config::{LogFormat, LogLevel, TraceSettings};
use axum::http::HeaderMap;
use std::error::Error;
use std::io;
use std::sync::OnceLock;
use tracing::Span;
use tracing::level_filters::LevelFilter;
use tracing_appender::non_blocking::{ErrorCounter, NonBlockingBuilder, WorkerGuard};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{Registry, fmt, reload};

/// The most lines that wait to be written.
const WAITING_LINES: usize = 8192;

/// The log of this process, once it is started.
static IN_FORCE: OnceLock<InForce> = OnceLock::new();

struct InForce {
    level: reload::Handle<LevelFilter, Registry>,
    dropped: ErrorCounter,
}

/// What is sent to a collector; nothing where the program was built without.
#[cfg(not(feature = "otlp"))]
type Traces = ();

/// Writes log lines and sends traces until it is dropped.
#[derive(Debug)]
pub struct Log {
    _lines: WorkerGuard,
    _traces: Option<Traces>,
}

/// Sends the log from a level on to standard error, and traces to the collector that the settings name.
///
/// # Errors
/// When the collector's address is none, or the program was built without traces.
pub fn start_log(
    format: LogFormat,
    level: LogLevel,
    traces: &TraceSettings,
) -> Result<Log, Box<dyn Error>> {
    let (spans, traces) = spans(traces)?;
    let (level, handle) = reload::Layer::new(level.filter());
    let writing = NonBlockingBuilder::default().lossy(true).buffered_lines_limit(WAITING_LINES);
    let (writer, guard) = writing.finish(io::stderr());
    let _ = IN_FORCE.set(InForce { level: handle, dropped: writer.error_counter() });
    let registry = Registry::default().with(level).with(spans);
    let lines = fmt::layer().with_writer(writer);
    match format {
        LogFormat::Human => registry.with(lines).init(),
        LogFormat::Json => registry.with(lines.json().flatten_event(true)).init(),
    }
    super::log_panics();
    Ok(Log { _lines: guard, _traces: traces })
}

/// Logs from another level on.
pub fn set_level(level: LogLevel) {
    if let Some(log) = IN_FORCE.get() {
        let _ = log.level.reload(level.filter());
    }
}

/// Lines that were dropped because nobody read the log.
pub(super) fn dropped_lines() -> usize {
    IN_FORCE.get().map_or(0, |log| log.dropped.dropped_lines())
}

impl LogLevel {
    fn filter(self) -> LevelFilter {
        match self {
            Self::Error => LevelFilter::ERROR,
            Self::Warn => LevelFilter::WARN,
            Self::Info => LevelFilter::INFO,
            Self::Debug => LevelFilter::DEBUG,
        }
    }
}

/// The subscriber below the layer of spans.
#[cfg(feature = "otlp")]
type Filtered = tracing_subscriber::layer::Layered<reload::Layer<LevelFilter, Registry>, Registry>;

#[cfg(feature = "otlp")]
type Spans = Option<Layer<Filtered>>;

#[cfg(not(feature = "otlp"))]
type Spans = Option<tracing_subscriber::layer::Identity>;

#[cfg(feature = "otlp")]
fn spans(settings: &TraceSettings) -> Result<(Spans, Option<Traces>), Box<dyn Error>> {
    Ok(match otlp::tracer(settings)? {
        Some((tracer, traces)) => {
            let layer = tracing_opentelemetry::layer().with_tracer(tracer);
            (Some(layer), Some(traces))
        }
        None => (None, None),
    })
}

#[cfg(not(feature = "otlp"))]
fn spans(settings: &TraceSettings) -> Result<(Spans, Option<Traces>), Box<dyn Error>> {
    match settings.otlp_endpoint {
        Some(_) => Err("--otlp-endpoint: this program was built without the feature otlp".into()),
        None => Ok((None, None)),
    }
}

/// Makes the caller's span, named in a request's header, the parent of the request's, and says what
/// is asked for.
#[cfg(feature = "otlp")]
pub fn adopt(span: &Span, method: &'static str, route: &str, headers: &HeaderMap) {
    otlp::adopt(span, method, route, headers);
}

/// Makes nothing the parent of the request's span: there are no traces.
#[cfg(not(feature = "otlp"))]
pub fn adopt(_: &Span, _: &'static str, _: &str, _: &HeaderMap) {}
