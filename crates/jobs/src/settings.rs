//! The settings of the queue's engine.

use crate::Secret;
use crate::postgres::PostgresSettings;
use clap::Args;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// The engine of the queue and its connection.
#[derive(Args, Clone, Debug)]
pub struct QueueSettings {
    /// Engine of the queue: `embedded`, a database in the data folder of one process; or a
    /// PostgreSQL database that many nodes share, as
    /// postgres://NAME@HOST:PORT/DATABASE?sslmode=verify-full.
    #[arg(long, env = "PIXMESH_QUEUE", default_value = "embedded", hide_env_values = true)]
    pub queue: QueueEngine,
    /// The connection to the PostgreSQL database.
    #[command(flatten)]
    pub postgres: PostgresSettings,
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

    /// One line `flag value` per setting in force, without names and passwords.
    #[must_use]
    pub fn shown(&self) -> String {
        let PostgresSettings { queue_connections, queue_schema, .. } = &self.postgres;
        let path = |path: &Option<PathBuf>| {
            path.as_ref().map_or_else(String::new, |path| path.display().to_string())
        };
        let direct = self.postgres.queue_direct.as_ref();
        format!(
            "--queue {self}\n--queue-direct {}\n--queue-connections {queue_connections}\n\
             --queue-schema {queue_schema}\n--queue-password-file {}\n--queue-ca {}\n\
             --queue-cert {}\n--queue-key {}\n",
            direct.map_or_else(String::new, |url| public_part(url.reveal())),
            path(&self.postgres.queue_password_file),
            path(&self.postgres.queue_ca),
            path(&self.postgres.queue_cert),
            path(&self.postgres.queue_key),
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
}
