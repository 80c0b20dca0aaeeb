//! Traces to a collector, by OTLP over HTTP.
//!
//! A request is a span, with one below it for each stage of its work; the caller's span, in
//! `traceparent`, is the parent of both. A thread of its own sends spans in batches.

use crate::config::TraceSettings;
use axum::http::HeaderMap;
use opentelemetry::propagation::{Extractor, TextMapPropagator};
use opentelemetry::trace::TracerProvider;
use opentelemetry::{Context, KeyValue};
use opentelemetry_otlp::{SpanExporter, WithExportConfig, WithHttpConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::propagation::TraceContextPropagator;
use opentelemetry_sdk::trace::{SdkTracer, SdkTracerProvider};
use pixmesh_jobs::Secret;
use std::collections::HashMap;
use std::error::Error;
use std::time::Duration;
use tracing::Span;
use tracing_opentelemetry::{OpenTelemetryLayer, OpenTelemetrySpanExt};

/// The path of traces below a collector's address.
const PATH: &str = "/v1/traces";
/// Longest time for the collector to take a batch.
const TIMEOUT: Duration = Duration::from_secs(5);

/// Sends the remaining spans when dropped.
#[derive(Debug)]
pub(super) struct Traces(SdkTracerProvider);

impl Drop for Traces {
    fn drop(&mut self) {
        let _ = self.0.shutdown_with_timeout(TIMEOUT);
    }
}

/// The layer that turns spans of the log into traces.
pub(super) type Layer<S> = OpenTelemetryLayer<S, SdkTracer>;

/// The tracer of the settings, if they name a collector.
///
/// # Errors
/// When the address is not valid.
pub(super) fn tracer(
    settings: &TraceSettings,
) -> Result<Option<(SdkTracer, Traces)>, Box<dyn Error>> {
    let Some(address) = &settings.otlp_endpoint else { return Ok(None) };
    // The one provider of cryptography of this program, for collectors at https addresses; a second
    // call changes nothing.
    let _ = rustls::crypto::ring::default_provider().install_default();
    let exporter = SpanExporter::builder()
        .with_http()
        .with_endpoint(format!("{}{PATH}", address.trim_end_matches('/')))
        .with_headers(headers(settings.otlp_headers.as_ref()))
        .with_timeout(TIMEOUT)
        .build()?;
    let version = KeyValue::new("service.version", env!("CARGO_PKG_VERSION"));
    let resource = Resource::builder().with_service_name("pixmesh").with_attribute(version).build();
    let provider =
        SdkTracerProvider::builder().with_batch_exporter(exporter).with_resource(resource).build();
    Ok(Some((provider.tracer("pixmesh"), Traces(provider))))
}

fn headers(given: Option<&Secret>) -> HashMap<String, String> {
    let pairs = given.map_or("", Secret::reveal).split(',');
    let pairs = pairs.filter_map(|pair| pair.split_once('='));
    pairs.map(|(name, value)| (name.trim().to_owned(), value.trim().to_owned())).collect()
}

/// Makes the caller's span the parent of a request's, and records method and route.
pub(super) fn adopt(span: &Span, method: &'static str, route: &str, headers: &HeaderMap) {
    let propagator = TraceContextPropagator::new();
    let caller = propagator.extract_with_context(&Context::new(), &Headers(headers));
    let _ = span.set_parent(caller);
    span.set_attribute("http.request.method", method);
    span.set_attribute("http.route", route.to_owned());
}

struct Headers<'a>(&'a HeaderMap);

impl Extractor for Headers<'_> {
    fn get(&self, name: &str) -> Option<&str> {
        self.0.get(name)?.to_str().ok()
    }

    fn keys(&self) -> Vec<&str> {
        self.0.keys().map(axum::http::HeaderName::as_str).collect()
    }
}
