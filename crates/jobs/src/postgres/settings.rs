//! How the database is reached.

use sqlx::ConnectOptions;
use sqlx::postgres::{PgConnectOptions, PgSslMode};
use std::error::Error;
use std::fmt;
use std::num::NonZeroU32;
use std::path::PathBuf;

/// How the database is reached, and what of it is used.
#[derive(Clone)]
pub struct PostgresSettings {
    /// The address, as `postgres://NAME:PASSWORD@HOST:PORT/DATABASE?sslmode=verify-full`.
    pub url: String,
    /// The address past a pooler, where `url` is that of one that lends connections for a transaction
    /// each: calls between nodes are heard there. Without it nodes look again and again.
    pub direct_url: Option<String>,
    /// File with the certificates that the server's is checked by; asks for TLS.
    pub ca: Option<PathBuf>,
    /// File with the certificate that the server knows this node by.
    pub certificate: Option<PathBuf>,
    /// File with that certificate's key.
    pub key: Option<PathBuf>,
    /// File with the password.
    pub password_file: Option<PathBuf>,
    /// The most connections of this node, beside the one on which calls are heard.
    pub max_connections: NonZeroU32,
    /// The schema of the tables, made where there is none: 1 to 32 letters, digits, hyphens or
    /// underscores.
    pub schema: String,
}

impl PostgresSettings {
    /// How connections are made to the address, or past the pooler.
    ///
    /// # Errors
    /// When the address cannot be read, or a file.
    pub(super) fn options(
        &self,
        url: &str,
    ) -> Result<PgConnectOptions, Box<dyn Error + Send + Sync>> {
        let mut options: PgConnectOptions =
            url.parse().map_err(|_| "the address is none of a PostgreSQL database")?;
        // Poolers know no such parameter; numbers travel in binary.
        options = options.application_name("pixmesh").extra_float_digits(None);
        if let Some(path) = &self.ca {
            options = options.ssl_root_cert(path);
            if !matches!(options.get_ssl_mode(), PgSslMode::VerifyCa) {
                options = options.ssl_mode(PgSslMode::VerifyFull);
            }
        }
        if let (Some(certificate), Some(key)) = (&self.certificate, &self.key) {
            options = options.ssl_client_cert(certificate).ssl_client_key(key);
        }
        if let Some(path) = &self.password_file {
            let text = std::fs::read_to_string(path)
                .map_err(|error| format!("--queue-credentials {}: {error}", path.display()))?;
            options = options.password(text.lines().next().unwrap_or_default());
        }
        Ok(options.disable_statement_logging())
    }
}

impl fmt::Debug for PostgresSettings {
    /// Without addresses, which may have passwords in them.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("PostgresSettings")
            .field("schema", &self.schema)
            .finish_non_exhaustive()
    }
}
