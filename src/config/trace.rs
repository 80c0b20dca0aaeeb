//! The settings of traces.

use clap::Args;
use pixmesh_jobs::Secret;
use std::fmt;

/// The collector of traces.
#[derive(Args, Clone, Debug)]
pub struct TraceSettings {
    /// Collector of traces, by OTLP over HTTP, such as http://127.0.0.1:4318; none by default.
    #[arg(long, env = "PIXMESH_OTLP_ENDPOINT", value_parser = endpoint)]
    pub otlp_endpoint: Option<String>,
    /// Headers for the collector, as NAME=VALUE,NAME=VALUE; never shown.
    #[arg(long, env = "PIXMESH_OTLP_HEADERS", hide_env_values = true)]
    pub otlp_headers: Option<Secret>,
}

impl fmt::Display for TraceSettings {
    /// One line `flag value` per setting in force.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let headers = self.otlp_headers.as_ref().map(Secret::to_string);
        writeln!(formatter, "--otlp-endpoint {}", self.otlp_endpoint.as_deref().unwrap_or(""))?;
        writeln!(formatter, "--otlp-headers {}", headers.unwrap_or_default())
    }
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
