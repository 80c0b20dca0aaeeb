//! An operator of a broker that knows its users by signed tokens: who signs accounts, which sign
//! users. Tokens and files of credentials are made here as NATS describes them.

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use nkeys::KeyPair;
use serde_json::{Value, json};
use std::time::{SystemTime, UNIX_EPOCH};

/// An operator with an account for nodes and one for the server itself.
pub(crate) struct Operator {
    operator: KeyPair,
    system: KeyPair,
    account: KeyPair,
}

impl Operator {
    pub(crate) fn new() -> Self {
        let account = KeyPair::new_account;
        Self { operator: KeyPair::new_operator(), system: account(), account: account() }
    }

    /// The lines of a server's configuration that trust this operator.
    pub(crate) fn configuration(&self) -> String {
        let own = json!({ "type": "operator", "version": 2 });
        let operator = token(&self.operator, &self.operator, &own, None);
        // The server's own account may have no streams.
        let accounts = [(&self.system, 0), (&self.account, -1)];
        let [system, account] = accounts.map(|(account, bytes)| {
            let claims = account_claims(bytes);
            (account.public_key(), token(&self.operator, account, &claims, None))
        });
        format!(
            "operator: \"{operator}\"\nsystem_account: {0}\nresolver: MEMORY\n\
             resolver_preload: {{ {0}: \"{1}\", {2}: \"{3}\" }}\n",
            system.0, system.1, account.0, account.1
        )
    }

    /// The text of a file of credentials, of a user whom the account has signed.
    pub(crate) fn credentials(&self) -> String {
        credentials(&self.account, None)
    }

    /// The same of one whose time is over.
    pub(crate) fn expired_credentials(&self) -> String {
        credentials(&self.account, Some(seconds_since_1970() - 60))
    }
}

/// The text of a file of credentials, of a user whom an account signs that no operator knows.
pub(crate) fn strange_credentials() -> String {
    credentials(&KeyPair::new_account(), None)
}

fn credentials(account: &KeyPair, until: Option<u64>) -> String {
    let user = KeyPair::new_user();
    let claims = json!({
        "pub": {}, "sub": {}, "subs": -1, "data": -1, "payload": -1, "type": "user", "version": 2
    });
    let token = token(account, &user, &claims, until);
    let seed = user.seed().unwrap();
    format!(
        "-----BEGIN NATS USER JWT-----\n{token}\n------END NATS USER JWT------\n\n\
         -----BEGIN USER NKEY SEED-----\n{seed}\n------END USER NKEY SEED------\n"
    )
}

/// An account without limits but that of the bytes in its streams; -1 is none.
fn account_claims(bytes: i64) -> Value {
    json!({
        "limits": {
            "subs": -1, "data": -1, "payload": -1, "imports": -1, "exports": -1, "wildcards": true,
            "conn": -1, "leaf": -1, "mem_storage": bytes, "disk_storage": bytes, "streams": -1,
            "consumer": -1
        },
        "type": "account",
        "version": 2
    })
}

/// What an issuer says of a subject, signed.
fn token(issuer: &KeyPair, subject: &KeyPair, claims: &Value, until: Option<u64>) -> String {
    let mut body = json!({
        "jti": subject.public_key(),
        "iat": seconds_since_1970(),
        "iss": issuer.public_key(),
        "sub": subject.public_key(),
        "name": "test",
        "nats": claims
    });
    if let Some(until) = until {
        body["exp"] = until.into();
    }
    let header = json!({ "typ": "JWT", "alg": "ed25519-nkey" });
    let [header, body] = [header, body].map(|part| URL_SAFE_NO_PAD.encode(part.to_string()));
    let signed = format!("{header}.{body}");
    let signature = URL_SAFE_NO_PAD.encode(issuer.sign(signed.as_bytes()).unwrap());
    format!("{signed}.{signature}")
}

fn seconds_since_1970() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs()
}
