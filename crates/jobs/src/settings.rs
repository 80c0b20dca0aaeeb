//! The settings that name the engine of the queue and say how it is reached.

use crate::Secret;
use crate::postgres::PostgresSettings;
use clap::Args;
use std::fmt;
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::str::FromStr;

/// The engine of the queue and its connection.
#[derive(Args, Clone, Debug)]
pub struct QueueSettings {
    /// Engine of the queue: `embedded`, a database in the data folder of one process; or a PostgreSQL
    /// database that many nodes share, as postgres://NAME@HOST:PORT/DATABASE?sslmode=verify-full.
    #[arg(long, env = "PIXMESH_QUEUE", default_value = "embedded", hide_env_values = true)]
    pub queue: QueueEngine,
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
    /// File with the certificate authorities that may sign the database's certificate; requires TLS.
    #[arg(long, env = "PIXMESH_QUEUE_CA")]
    pub queue_ca: Option<PathBuf>,
    /// File with the certificate that this node presents to the database.
    #[arg(long, env = "PIXMESH_QUEUE_CERT", requires = "queue_key")]
    pub queue_cert: Option<PathBuf>,
    /// File with the private key of that certificate.
    #[arg(long, env = "PIXMESH_QUEUE_KEY", requires = "queue_cert")]
    pub queue_key: Option<PathBuf>,
}

/// The engine of the queue.
#[derive(Clone, Debug)]
pub enum QueueEngine {
    /// An SQLite database in the data folder.
    Embedded,
    /// A PostgreSQL database at this address, which may include a name and a password.
    Postgres(Secret),
}

impl QueueSettings {
    /// Whether other nodes use the same queue.
    #[must_use]
    pub fn is_shared(&self) -> bool {
        matches!(self.queue, QueueEngine::Postgres(_))
    }

    /// The connection to the PostgreSQL database; `None` for the embedded engine.
    #[must_use]
    pub fn postgres(&self) -> Option<PostgresSettings> {
        let QueueEngine::Postgres(url) = &self.queue else { return None };
        Some(PostgresSettings {
            url: url.reveal().to_owned(),
            direct_url: self.queue_direct.as_ref().map(|url| url.reveal().to_owned()),
            ca: self.queue_ca.clone(),
            certificate: self.queue_cert.clone(),
            key: self.queue_key.clone(),
            password_file: self.queue_password_file.clone(),
            max_connections: self.queue_connections,
            schema: self.queue_schema.clone(),
        })
    }

    /// One line `flag value` per setting in force, without names and passwords.
    #[must_use]
    pub fn shown(&self) -> String {
        let path = |path: &Option<PathBuf>| {
            path.as_ref().map_or_else(String::new, |path| path.display().to_string())
        };
        format!(
            "--queue {self}\n--queue-direct {}\n--queue-connections {}\n--queue-schema {}\n\
             --queue-password-file {}\n--queue-ca {}\n--queue-cert {}\n--queue-key {}\n",
            self.queue_direct.as_ref().map_or_else(String::new, |url| public_part(url.reveal())),
            self.queue_connections,
            self.queue_schema,
            path(&self.queue_password_file),
            path(&self.queue_ca),
            path(&self.queue_cert),
            path(&self.queue_key),
        )
    }
}

impl fmt::Display for QueueSettings {
    /// The engine, without names and passwords.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.queue {
            QueueEngine::Embedded => formatter.write_str("embedded"),
            QueueEngine::Postgres(url) => formatter.write_str(&public_part(url.reveal())),
        }
    }
}

impl FromStr for QueueEngine {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "embedded" {
            return Ok(Self::Embedded);
        }
        if ["postgres://", "postgresql://"].iter().any(|scheme| text.starts_with(scheme)) {
            let url = Secret::from_str(text).map_err(|never| match never {});
            return url.map(Self::Postgres);
        }
        Err(format!(
            "must be embedded, or a PostgreSQL database as postgres://HOST:PORT/DATABASE; {} is \
             neither",
            public_part(text)
        ))
    }
}

/// An address without its name, password and parameters: a parameter may be a password, too.
fn public_part(address: &str) -> String {
    let address = address.split_once('?').map_or(address, |(address, _)| address);
    match (address.split_once("://"), address.rsplit_once('@')) {
        (Some((scheme, _)), Some((_, host))) => format!("{scheme}://{host}"),
        _ => address.to_owned(),
    }
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
    fn addresses_are_shown_without_names_and_passwords() {
        assert_eq!(public_part("postgres://a:1/d"), "postgres://a:1/d");
        assert_eq!(public_part("postgres://u:p@h:5/d?password=p"), "postgres://h:5/d");
    }

    #[test]
    fn engines_are_embedded_or_a_postgresql_address() {
        assert!(matches!("embedded".parse(), Ok(QueueEngine::Embedded)));
        assert!(matches!("postgresql://a/b".parse(), Ok(QueueEngine::Postgres(_))));
        for wrong in ["", "postgres", "http://a", "nats://user:secret@a:4222"] {
            let error = wrong.parse::<QueueEngine>().unwrap_err();
            assert!(error.contains("postgres://HOST:PORT"), "{wrong}: {error}");
            assert!(!error.contains("secret"), "{error}");
        }
    }

    #[test]
    fn schemas_are_short_and_plain() {
        assert!(schema("pixmesh-2").is_ok() && schema("a.b").is_err() && schema("").is_err());
        assert!(schema(&"a".repeat(33)).is_err());
    }
}
