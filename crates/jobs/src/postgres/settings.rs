//! The connection to the database, and what is wrong with it when it fails.

use crate::secret::Secret;
use clap::Args;
use rustls::RootCertStore;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use serde::Serialize;
use sqlx::ConnectOptions;
use sqlx::postgres::{PgConnectOptions, PgSslMode};
use std::error::Error;
use std::fs;
use std::io;
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

/// The connection to the database, without its address.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct PostgresSettings {
    /// Address of the same PostgreSQL database without the pooler, for notifications between nodes.
    #[arg(long, env = "PIXMESH_QUEUE_DIRECT", hide_env_values = true)]
    pub queue_direct: Option<Secret>,
    /// The most connections of this node to the PostgreSQL database.
    #[arg(long, env = "PIXMESH_QUEUE_CONNECTIONS", default_value = "8")]
    pub queue_connections: NonZeroU32,
    /// The schema of the tables in the PostgreSQL database: one for each deployment that shares it.
    #[arg(long, env = "PIXMESH_QUEUE_SCHEMA", default_value = "pixmesh", value_parser = schema)]
    pub queue_schema: String,
    /// File with the password of the PostgreSQL database in its first line.
    #[arg(long, env = "PIXMESH_QUEUE_PASSWORD_FILE")]
    pub queue_password_file: Option<PathBuf>,
    /// File with the certificate authorities that may sign the database's certificate; requires
    /// TLS.
    #[arg(long, env = "PIXMESH_QUEUE_CA")]
    pub queue_ca: Option<PathBuf>,
    /// File with the certificate that this node presents to the database.
    #[arg(long, env = "PIXMESH_QUEUE_CERT", requires = "queue_key")]
    pub queue_cert: Option<PathBuf>,
    /// File with the private key of that certificate.
    #[arg(long, env = "PIXMESH_QUEUE_KEY", requires = "queue_cert")]
    pub queue_key: Option<PathBuf>,
}

type Failure = Box<dyn Error + Send + Sync>;

impl PostgresSettings {
    /// The options of connections to an address.
    ///
    /// # Errors
    /// When the address or a file is not valid.
    pub(super) fn options(&self, url: &str) -> Result<PgConnectOptions, Failure> {
        let mut options: PgConnectOptions = url.parse().map_err(|error| {
            format!("this is not the address of a PostgreSQL database: {error}")
        })?;
        // Poolers refuse the parameter extra_float_digits; the binary protocol does not need it.
        options = options.application_name("pixmesh").extra_float_digits(None);
        if let Some(path) = &self.queue_ca {
            options = options.ssl_root_cert_from_pem(authorities(path)?);
            if !matches!(options.get_ssl_mode(), PgSslMode::VerifyCa) {
                options = options.ssl_mode(PgSslMode::VerifyFull);
            }
        }
        if let (Some(certificate), Some(key)) = (&self.queue_cert, &self.queue_key) {
            let pem = read("--queue-cert", certificate)?;
            if CertificateDer::from_pem_slice(&pem).is_err() {
                return Err(no_such_pem("--queue-cert", certificate, "certificate"));
            }
            let key_pem = read("--queue-key", key)?;
            if PrivateKeyDer::from_pem_slice(&key_pem).is_err() {
                return Err(no_such_pem("--queue-key", key, "private key"));
            }
            options = options.ssl_client_cert_from_pem(pem).ssl_client_key_from_pem(key_pem);
        }
        if let Some(path) = &self.queue_password_file {
            let text = String::from_utf8(read("--queue-password-file", path)?);
            let text = text.map_err(|_| format!("{} is not text", path.display()))?;
            let password = text.lines().next().filter(|password| !password.is_empty());
            let missing =
                || format!("--queue-password-file {}: the first line is empty", path.display());
            options = options.password(password.ok_or_else(missing)?);
        }
        Ok(options.disable_statement_logging())
    }

    /// The setting that makes connections fail with this error, and what to do; `None` for an error
    /// that may pass.
    pub(super) fn explain(&self, error: &sqlx::Error) -> Option<String> {
        let file = |path: &Option<PathBuf>| {
            path.as_ref().map_or_else(String::new, |path| format!(" {}", path.display()))
        };
        let advice = match error {
            sqlx::Error::Database(refusal) => match refusal.code().as_deref() {
                Some("28P01" | "28000") => {
                    "the database refuses this node: check the name and password in --queue or \
                     --queue-password-file, and --queue-cert if it requires a certificate"
                        .to_owned()
                }
                Some("3D000") => "create the database, or name another one in --queue".to_owned(),
                Some("42501") => format!(
                    "grant CREATE on the database to the user in --queue, or create the schema {} \
                     for it",
                    self.queue_schema
                ),
                _ => return None,
            },
            sqlx::Error::Tls(reason) if reason.to_string().contains("does not support TLS") => {
                "the database does not offer TLS, which --queue-ca and sslmode require".to_owned()
            }
            sqlx::Error::Tls(_) => format!(
                "TLS cannot be set up: check that --queue-key{} is the key of --queue-cert{}",
                file(&self.queue_key),
                file(&self.queue_cert)
            ),
            sqlx::Error::Io(error) => match tls_error(error)? {
                rustls::Error::InvalidCertificate(
                    rustls::CertificateError::NotValidForName
                    | rustls::CertificateError::NotValidForNameContext { .. },
                ) => "the certificate of the database is not for the host in --queue".to_owned(),
                rustls::Error::InvalidCertificate(_) => format!(
                    "no known authority has signed the certificate of the database: name the file \
                     of its authority with --queue-ca{}",
                    file(&self.queue_ca)
                ),
                rustls::Error::AlertReceived(_) => format!(
                    "the database refuses the certificate of this node: check --queue-cert{}",
                    file(&self.queue_cert)
                ),
                _ => return None,
            },
            _ => return None,
        };
        Some(format!("{advice} ({error})"))
    }
}

/// The PEM text of a file with at least one certificate that can be read.
fn authorities(path: &Path) -> Result<Vec<u8>, Failure> {
    let pem = read("--queue-ca", path)?;
    let certificates: Vec<_> = CertificateDer::pem_slice_iter(&pem).collect();
    let mut store = RootCertStore::empty();
    let are_valid =
        certificates.into_iter().all(|found| found.is_ok_and(|der| store.add(der).is_ok()));
    if !are_valid || store.is_empty() {
        return Err(no_such_pem("--queue-ca", path, "certificate"));
    }
    Ok(pem)
}

fn read(setting: &str, path: &Path) -> Result<Vec<u8>, Failure> {
    fs::read(path).map_err(|error| format!("{setting} {}: {error}", path.display()).into())
}

fn no_such_pem(setting: &str, path: &Path, kind: &str) -> Failure {
    format!("{setting} {}: there is no valid {kind} in PEM format", path.display()).into()
}

fn tls_error(error: &io::Error) -> Option<&rustls::Error> {
    error.get_ref()?.downcast_ref()
}

/// The name of a schema that needs no escapes in SQL.
fn schema(text: &str) -> Result<String, String> {
    let is_allowed = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
    if (1..=32).contains(&text.len()) && text.bytes().all(is_allowed) {
        return Ok(text.to_owned());
    }
    Err("must be 1 to 32 letters, digits, hyphens or underscores".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schemas_are_short_and_plain() {
        assert!(schema("pixmesh-2").is_ok() && schema("a.b").is_err() && schema("").is_err());
        assert!(schema(&"a".repeat(33)).is_err());
    }
}
