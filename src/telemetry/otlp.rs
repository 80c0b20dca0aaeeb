//! Traces to a collector, by OTLP over HTTP.
//!
//! A request is a span, with one below it for each stage of its work; the caller's span, in
//! `traceparent`, is the parent of both. Spans are sent in batches by a thread of their own. The
//! collector is reached without encryption: it is meant to stand beside the service, and to pass on
//! from there.

use crate::config::TraceSettings;
use axum::http::HeaderMap;
use bytes::Bytes;
use http_body_util::{BodyExt, Full};
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use opentelemetry::propagation::{Extractor, TextMapPropagator};
use opentelemetry::trace::TracerProvider;
use opentelemetry::{Context, KeyValue};
use opentelemetry_http::{HttpClient, HttpError};
use opentelemetry_otlp::{SpanExporter, WithExportConfig, WithHttpConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::propagation::TraceContextPropagator;
use opentelemetry_sdk::trace::{SdkTracer, SdkTracerProvider};
use pixmesh_jobs::Secret;
use std::collections::HashMap;
use std::error::Error;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::runtime::{Builder, Runtime};
use tokio::time::timeout;
use tracing::Span;
use tracing_opentelemetry::{OpenTelemetryLayer, OpenTelemetrySpanExt};

/// Where a base address has traces.
const PATH: &str = "/v1/traces";
/// Longest time for the collector to take a batch.
const TIMEOUT: Duration = Duration::from_secs(5);

/// Sends what is left when dropped.
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
/// When the address is none.
pub(super) fn tracer(
    settings: &TraceSettings,
) -> Result<Option<(SdkTracer, Traces)>, Box<dyn Error>> {
    let Some(address) = &settings.otlp_endpoint else { return Ok(None) };
    let runtime = Builder::new_current_thread().enable_all().build()?;
    let exporter = SpanExporter::builder()
        .with_http()
        .with_http_client(Client { runtime })
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

/// Makes the caller's span the parent of a request's, and says what is asked for.
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

/// Sends one request at a time, on the thread that asks for it.
#[derive(Debug)]
struct Client {
    runtime: Runtime,
}

#[async_trait::async_trait]
impl HttpClient for Client {
    async fn send_bytes(
        &self,
        request: hyper::Request<Bytes>,
    ) -> Result<hyper::Response<Bytes>, HttpError> {
        self.runtime.block_on(async { timeout(TIMEOUT, send(request)).await? })
    }
}

async fn send(mut request: hyper::Request<Bytes>) -> Result<hyper::Response<Bytes>, HttpError> {
    let authority = request.uri().authority().ok_or("the collector's address has no host")?.clone();
    let socket = TcpStream::connect((authority.host(), authority.port_u16().unwrap_or(80))).await?;
    let (mut sender, connection) = http1::handshake(TokioIo::new(socket)).await?;
    tokio::spawn(connection);
    let path = request.uri().path().parse()?;
    *request.uri_mut() = path;
    request.headers_mut().insert(hyper::header::HOST, authority.as_str().parse()?);
    let response = sender.send_request(request.map(Full::new)).await?;
    let (head, body) = response.into_parts();
    Ok(hyper::Response::from_parts(head, body.collect().await?.to_bytes()))
}
