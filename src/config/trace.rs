//! The settings of traces.

use clap::Args;
use pixmesh_jobs::Secret;
use serde::Serialize;

/// The collector of traces.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct TraceSettings {
    /// Collector of traces, by OTLP over HTTP, such as http://127.0.0.1:4318; none by default.
    #[arg(long, env = "PIXMESH_OTLP_ENDPOINT", value_parser = endpoint)]
    pub otlp_endpoint: Option<String>,
    /// Headers for the collector, as NAME=VALUE,NAME=VALUE; never shown.
    #[arg(long, env = "PIXMESH_OTLP_HEADERS", hide_env_values = true)]
    pub otlp_headers: Option<Secret>,
}

/// The address of a collector, without a name or password, because the address is printed.
fn endpoint(text: &str) -> Result<String, String> {
    let host = text.strip_prefix("http://").or_else(|| text.strip_prefix("https://"));
    match host {
        Some(host) if !host.is_empty() && !host.contains(['@', ' ']) => Ok(text.to_owned()),
        _ => Err("must be http://HOST:PORT or https://HOST:PORT, without a name or password; \
                  pass credentials with --otlp-headers"
            .into()),
    }
}
