//! The log on standard error, and where it is asked for, traces.

#[cfg(feature = "otlp")]
use super::otlp::{self, Layer, Traces};
use crate::config::{LogFormat, TraceSettings};
use axum::http::HeaderMap;
use std::error::Error;
use std::io;
use tracing::Span;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{Registry, fmt};

/// What is sent to a collector; nothing where the program was built without.
#[cfg(not(feature = "otlp"))]
type Traces = ();

/// What goes on while it is kept: the sending of traces.
#[derive(Debug, Default)]
pub struct Log {
    _traces: Option<Traces>,
}

/// Sends the log to standard error, and traces to the collector that the settings name.
///
/// # Errors
/// When the collector's address is none, or the program was built without traces.
pub fn start_log(format: LogFormat, traces: &TraceSettings) -> Result<Log, Box<dyn Error>> {
    let (spans, log) = spans(traces)?;
    let registry = Registry::default().with(LevelFilter::INFO).with(spans);
    let lines = fmt::layer().with_writer(io::stderr);
    match format {
        LogFormat::Human => registry.with(lines).init(),
        LogFormat::Json => registry.with(lines.json().flatten_event(true)).init(),
    }
    super::log_panics();
    Ok(log)
}

/// The subscriber below the layer of spans.
#[cfg(feature = "otlp")]
type Filtered = tracing_subscriber::layer::Layered<LevelFilter, Registry>;

#[cfg(feature = "otlp")]
type Spans = Option<Layer<Filtered>>;

#[cfg(not(feature = "otlp"))]
type Spans = Option<tracing_subscriber::layer::Identity>;

#[cfg(feature = "otlp")]
fn spans(settings: &TraceSettings) -> Result<(Spans, Log), Box<dyn Error>> {
    Ok(match otlp::tracer(settings)? {
        Some((tracer, traces)) => {
            let layer = tracing_opentelemetry::layer().with_tracer(tracer);
            (Some(layer), Log { _traces: Some(traces) })
        }
        None => (None, Log::default()),
    })
}

#[cfg(not(feature = "otlp"))]
fn spans(settings: &TraceSettings) -> Result<(Spans, Log), Box<dyn Error>> {
    match settings.otlp_endpoint {
        Some(_) => Err("--otlp-endpoint: this program was built without the feature otlp".into()),
        None => Ok((None, Log::default())),
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
