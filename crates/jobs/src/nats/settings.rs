//! Settings of the engine of the queue.

use crate::Secret;
use clap::Args;
use percent_encoding::percent_decode_str;
use std::error::Error;
use std::fmt;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::str::FromStr;

/// The schemes of addresses of brokers.
const SCHEMES: [&str; 2] = ["nats://", "tls://"];
/// Copies of what a broker keeps, in a cluster.
const COPIES_IN_CLUSTER: usize = 3;

/// What keeps the queue, and how it is reached.
#[derive(Args, Clone, Debug)]
pub struct BrokerSettings {
    /// Engine of the queue: `embedded`, a database in the data folder; or the servers of a NATS
    /// broker with JetStream, shared by many nodes, as nats://HOST:PORT or tls://HOST:PORT, several
    /// with commas between.
    #[arg(long, env = "PIXMESH_QUEUE", default_value = "embedded", hide_env_values = true)]
    pub queue: QueueEngine,
    /// What the names of the broker's streams and subjects begin with.
    #[arg(long, env = "PIXMESH_QUEUE_PREFIX", default_value = "pixmesh", value_parser = prefix)]
    pub queue_prefix: String,
    /// Copies of each of the broker's streams [default: 3 in a cluster, otherwise 1].
    #[arg(long, env = "PIXMESH_QUEUE_REPLICAS")]
    pub queue_replicas: Option<NonZeroUsize>,
    /// File with the broker's credentials (JWT and seed).
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
        matches!(self.queue, QueueEngine::Nats(_))
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
            "--queue {self}\n--queue-prefix {}\n--queue-replicas {replicas}\n\
             --queue-credentials {}\n--queue-ca {}\n--queue-cert {}\n--queue-key {}\n",
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
        for address in text.split(',') {
            let is_address = SCHEMES.iter().any(|scheme| address.trim().starts_with(scheme));
            if !is_address || address.trim().parse::<async_nats::ServerAddr>().is_err() {
                return Err(format!(
                    "must be embedded, or servers as nats://HOST:PORT or tls://HOST:PORT; {} is \
                     neither",
                    without_user(address)
                ));
            }
        }
        Secret::from_str(text).map(Self::Nats).map_err(|never| match never {})
    }
}

/// An address without the name and password before its host.
fn without_user(address: &str) -> String {
    let address = address.trim();
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
    }

    #[test]
    fn engines_are_embedded_or_addresses() {
        assert!(matches!("embedded".parse(), Ok(QueueEngine::Embedded)));
        assert!(matches!("nats://a:1,nats://b".parse(), Ok(QueueEngine::Nats(_))));
        for wrong in ["", "nats", "http://a", "nats://a,redis://b", "embedded,nats://a"] {
            let error = wrong.parse::<QueueEngine>().unwrap_err();
            assert!(error.contains("nats://HOST:PORT"), "{wrong}: {error}");
        }
        assert!(prefix("pixmesh-2").is_ok() && prefix("a.b").is_err() && prefix("").is_err());
    }
}
