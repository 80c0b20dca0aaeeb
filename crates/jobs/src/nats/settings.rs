//! Settings of the engine of the queue.

use crate::Secret;
use crate::postgres::PostgresSettings;
use clap::Args;
use percent_encoding::percent_decode_str;
use std::error::Error;
use std::fmt;
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;
use std::str::FromStr;

/// The schemes of addresses of brokers.
const SCHEMES: [&str; 2] = ["nats://", "tls://"];
/// Those of addresses of PostgreSQL databases.
const DATABASE_SCHEMES: [&str; 2] = ["postgres://", "postgresql://"];
/// Copies of what a broker keeps, in a cluster.
const COPIES_IN_CLUSTER: usize = 3;

/// What keeps the queue, and how it is reached.
#[derive(Args, Clone, Debug)]
pub struct BrokerSettings {
    /// Engine of the queue: `embedded`, a database in the data folder; a PostgreSQL database, shared
    /// by many nodes, as postgres://NAME@HOST:PORT/DATABASE; or the servers of a NATS broker with
    /// JetStream, as nats://HOST:PORT or tls://HOST:PORT, several with commas between.
    #[arg(long, env = "PIXMESH_QUEUE", default_value = "embedded", hide_env_values = true)]
    pub queue: QueueEngine,
    /// Address of the PostgreSQL database past the pooler in --queue, for calls between nodes.
    #[arg(long, env = "PIXMESH_QUEUE_DIRECT", hide_env_values = true)]
    pub queue_direct: Option<Secret>,
    /// The most connections of this node to a PostgreSQL database.
    #[arg(long, env = "PIXMESH_QUEUE_CONNECTIONS", default_value = "8")]
    pub queue_connections: NonZeroU32,
    /// The schema of a PostgreSQL database's tables; or what the names of the broker's streams and
    /// subjects begin with.
    #[arg(long, env = "PIXMESH_QUEUE_PREFIX", default_value = "pixmesh", value_parser = prefix)]
    pub queue_prefix: String,
    /// Copies of each of the broker's streams [default: 3 in a cluster, otherwise 1].
    #[arg(long, env = "PIXMESH_QUEUE_REPLICAS")]
    pub queue_replicas: Option<NonZeroUsize>,
    /// File with the password of a PostgreSQL database, or the broker's credentials (JWT and seed).
    #[arg(long, env = "PIXMESH_QUEUE_CREDENTIALS")]
    pub queue_credentials: Option<PathBuf>,
    /// File with the certificates that the broker's is checked by; asks for TLS.
    #[arg(long, env = "PIXMESH_QUEUE_CA")]
    pub queue_ca: Option<PathBuf>,
    /// File with the certificate that the broker knows this node by.
    #[arg(long, env = "PIXMESH_QUEUE_CERT", requires = "queue_key")]
    pub queue_cert: Option<PathBuf>,
    /// File with that certificate's key.
    #[arg(long, env = "PIXMESH_QUEUE_KEY", requires = "queue_cert")]
    pub queue_key: Option<PathBuf>,
}

/// What keeps the queue.
#[derive(Clone, Debug)]
pub enum QueueEngine {
    /// A database in the data folder.
    Embedded,
    /// A PostgreSQL database at this address, with or without a name and password in it.
    Postgres(Secret),
    /// A broker with these servers; names and passwords may be in their addresses.
    Nats(Secret),
}

/// By whom a broker is used.
#[derive(Clone)]
pub struct BrokerUser {
    /// The name, or the token where there is no password.
    pub name: String,
    /// The password.
    pub password: Option<String>,
}

impl BrokerSettings {
    /// Whether other nodes have the same queue.
    #[must_use]
    pub fn is_shared(&self) -> bool {
        !matches!(self.queue, QueueEngine::Embedded)
    }

    /// How the database is reached; `None` where the queue is in none.
    #[must_use]
    pub fn postgres(&self) -> Option<PostgresSettings> {
        let QueueEngine::Postgres(url) = &self.queue else { return None };
        Some(PostgresSettings {
            url: url.reveal().to_owned(),
            direct_url: self.queue_direct.as_ref().map(|url| url.reveal().to_owned()),
            ca: self.queue_ca.clone(),
            certificate: self.queue_cert.clone(),
            key: self.queue_key.clone(),
            password_file: self.queue_credentials.clone(),
            max_connections: self.queue_connections,
            schema: self.queue_prefix.clone(),
        })
    }

    /// The addresses of the broker's servers.
    ///
    /// # Errors
    /// When one of them is none, or the queue has no broker.
    pub fn servers(&self) -> Result<Vec<async_nats::ServerAddr>, Box<dyn Error + Send + Sync>> {
        let QueueEngine::Nats(addresses) = &self.queue else {
            return Err("--queue embedded has no broker".into());
        };
        addresses.reveal().split(',').map(|address| Ok(address.trim().parse()?)).collect()
    }

    /// The name and password in the first address that has one; a name alone is a token.
    ///
    /// # Errors
    /// Like [`Self::servers`].
    pub fn user(&self) -> Result<Option<BrokerUser>, Box<dyn Error + Send + Sync>> {
        let decoded = |text: &str| percent_decode_str(text).decode_utf8_lossy().into_owned();
        let servers = self.servers()?;
        let mut users = servers.iter().filter_map(|server| {
            let name = decoded(server.username()?);
            Some(BrokerUser { name, password: server.password().map(decoded) })
        });
        Ok(users.next())
    }

    /// Copies of each stream.
    #[must_use]
    pub fn replicas(&self, is_cluster: bool) -> usize {
        let default = if is_cluster { COPIES_IN_CLUSTER } else { 1 };
        self.queue_replicas.map_or(default, NonZeroUsize::get)
    }

    /// One line `flag value` per setting in force.
    #[must_use]
    pub fn shown(&self) -> String {
        let path = |path: &Option<PathBuf>| {
            path.as_ref().map_or_else(String::new, |path| path.display().to_string())
        };
        let replicas = self.queue_replicas.map_or_else(|| "auto".to_owned(), |n| n.to_string());
        format!(
            "--queue {self}\n--queue-direct {}\n--queue-connections {}\n--queue-prefix {}\n\
             --queue-replicas {replicas}\n--queue-credentials {}\n--queue-ca {}\n--queue-cert {}\n--queue-key {}\n",
            self.queue_direct.as_ref().map_or_else(String::new, |url| without_user(url.reveal())),
            self.queue_connections,
            self.queue_prefix,
            path(&self.queue_credentials),
            path(&self.queue_ca),
            path(&self.queue_cert),
            path(&self.queue_key),
        )
    }
}

impl fmt::Display for BrokerSettings {
    /// The engine, without names and passwords.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.queue {
            QueueEngine::Embedded => formatter.write_str("embedded"),
            QueueEngine::Postgres(url) => formatter.write_str(&without_user(url.reveal())),
            QueueEngine::Nats(addresses) => {
                let shown: Vec<String> = addresses.reveal().split(',').map(without_user).collect();
                formatter.write_str(&shown.join(","))
            }
        }
    }
}

impl FromStr for QueueEngine {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "embedded" {
            return Ok(Self::Embedded);
        }
        let secret = || Secret::from_str(text).map_err(|never| match never {});
        if DATABASE_SCHEMES.iter().any(|scheme| text.starts_with(scheme)) {
            return secret().map(Self::Postgres);
        }
        for address in text.split(',') {
            let is_address = SCHEMES.iter().any(|scheme| address.trim().starts_with(scheme));
            if !is_address || address.trim().parse::<async_nats::ServerAddr>().is_err() {
                return Err(format!(
                    "must be embedded, a database as postgres://HOST:PORT/DATABASE, or servers as \
                     nats://HOST:PORT or tls://HOST:PORT; {} is none of them",
                    without_user(address)
                ));
            }
        }
        secret().map(Self::Nats)
    }
}

/// An address without the name and password before its host.
fn without_user(address: &str) -> String {
    let address = address.trim();
    // What follows a question mark may be a password, too.
    let address = address.split_once('?').map_or(address, |(address, _)| address);
    match (address.split_once("://"), address.rsplit_once('@')) {
        (Some((scheme, _)), Some((_, host))) => format!("{scheme}://{host}"),
        _ => address.to_owned(),
    }
}

/// A prefix that is one word of a subject, and part of a stream's name.
fn prefix(text: &str) -> Result<String, String> {
    let is_word = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
    if (1..=32).contains(&text.len()) && text.bytes().all(is_word) {
        return Ok(text.to_owned());
    }
    Err("must be 1 to 32 letters, digits, hyphens or underscores".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_shown_without_names_and_passwords() {
        let shown = "nats://user:pass@a:4222, tls://token@b".split(',').map(without_user);
        assert_eq!(shown.collect::<Vec<_>>(), ["nats://a:4222", "tls://b"]);
        assert_eq!(without_user("nats://a:1"), "nats://a:1");
        assert_eq!(without_user("postgres://u:p@h:5/d?password=p"), "postgres://h:5/d");
    }

    #[test]
    fn engines_are_embedded_or_addresses() {
        assert!(matches!("embedded".parse(), Ok(QueueEngine::Embedded)));
        assert!(matches!("nats://a:1,nats://b".parse(), Ok(QueueEngine::Nats(_))));
        assert!(matches!("postgresql://a/b".parse(), Ok(QueueEngine::Postgres(_))));
        for wrong in ["", "nats", "http://a", "nats://a,redis://b", "embedded,nats://a"] {
            let error = wrong.parse::<QueueEngine>().unwrap_err();
            assert!(error.contains("nats://HOST:PORT"), "{wrong}: {error}");
        }
        assert!(prefix("pixmesh-2").is_ok() && prefix("a.b").is_err() && prefix("").is_err());
    }
}
