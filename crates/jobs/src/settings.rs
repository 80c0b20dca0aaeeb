//! The settings of the queue's engine.

use crate::Secret;
use crate::postgres::PostgresSettings;
use clap::Args;
use serde::{Serialize, Serializer};
use std::fmt;
use std::str::FromStr;

/// The engine of the queue and its connection.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct QueueSettings {
    /// Engine of the queue: `embedded`, a database in the data folder of one process; or a
    /// PostgreSQL database that many nodes share, as
    /// postgres://NAME@HOST:PORT/DATABASE?sslmode=verify-full.
    #[arg(long, env = "PIXMESH_QUEUE", default_value = "embedded", hide_env_values = true)]
    pub queue: QueueEngine,
    /// The connection to the PostgreSQL database.
    #[command(flatten)]
    #[serde(flatten)]
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
}

impl fmt::Display for QueueEngine {
    /// The engine, without names and passwords.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Embedded => formatter.write_str("embedded"),
            Self::Postgres(url) => formatter.write_str(&public_part(url.reveal())),
        }
    }
}

impl Serialize for QueueEngine {
    /// As it is shown.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
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
