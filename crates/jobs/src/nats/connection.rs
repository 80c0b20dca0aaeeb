//! The way to the broker: its servers, credentials and certificates. Of what stops a start it is said
//! which setting would help.

use super::broker::causes;
use super::start::Start;
use crate::nats::settings::BrokerSettings;
use async_nats::{Client, ConnectError, ConnectErrorKind, ConnectOptions, Event};
use rustls::pki_types::pem::{self, PemObject};
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::sign::CertifiedKey;
use rustls::{CertificateError, Error as TlsError, RootCertStore};
use std::error::Error;
use std::io;
use std::path::Path;
use std::time::Duration;

/// How long an answer may take before the broker is said not to answer.
const ANSWER_TIME: Duration = Duration::from_secs(5);

/// The connection to whichever server answers first, waited for as long as a start may take. What is
/// refused is not asked for again.
///
/// # Errors
/// Which setting the servers refuse, or that none of them can be reached.
pub(super) async fn connected(
    settings: &BrokerSettings,
) -> Result<Client, Box<dyn Error + Send + Sync>> {
    check_certificates(settings)?;
    let start = Start::begin();
    loop {
        let error = match options(settings)?.connect(settings.servers()?).await {
            Ok(client) => return Ok(client),
            Err(error) => error,
        };
        if let Some(refusal) = refusal(&error, settings) {
            return Err(format!("--queue {settings}: {refusal}").into());
        }
        if !start.goes_on().await {
            let error = causes(&error);
            return Err(format!("--queue {settings}: the broker cannot be reached: {error}").into());
        }
    }
}

fn options(settings: &BrokerSettings) -> Result<ConnectOptions, Box<dyn Error + Send + Sync>> {
    let mut options = ConnectOptions::new()
        .name("pixmesh")
        .connection_timeout(ANSWER_TIME)
        .request_timeout(Some(ANSWER_TIME))
        .ping_interval(Duration::from_secs(10))
        .event_callback(|event| async move {
            match event {
                Event::Connected => tracing::info!("connected to the broker"),
                Event::Disconnected => tracing::warn!("the connection to the broker is lost"),
                event => tracing::warn!(%event, "the broker's connection"),
            }
        });
    if let Some(user) = settings.user()? {
        options = match user.password {
            Some(password) => options.user_and_password(user.name, password),
            None => options.token(user.name),
        };
    }
    if let Some(path) = &settings.queue_credentials {
        let named = |error: io::Error| unusable("--queue-credentials", path, &error);
        let text = std::fs::read_to_string(path).map_err(named)?;
        options = options.credentials(&text).map_err(named)?;
    }
    if let Some(path) = &settings.queue_ca {
        options = options.add_root_certificates(path.clone()).require_tls(true);
    }
    if let (Some(certificate), Some(key)) = (&settings.queue_cert, &settings.queue_key) {
        options = options.add_client_certificate(certificate.clone(), key.clone());
    }
    Ok(options)
}

/// Reads the files with certificates and the key, so that one that is of no use is named.
fn check_certificates(settings: &BrokerSettings) -> Result<(), String> {
    if let Some(path) = &settings.queue_ca {
        let mut authorities = RootCertStore::empty();
        for certificate in certificates("--queue-ca", path)? {
            let added = authorities.add(certificate);
            added.map_err(|error| unusable("--queue-ca", path, &error))?;
        }
    }
    let (Some(certificate), Some(key)) = (&settings.queue_cert, &settings.queue_key) else {
        return Ok(());
    };
    let chain = certificates("--queue-cert", certificate)?;
    let unusable_key = |error: &dyn Error| unusable("--queue-key", key, error);
    let secret = PrivateKeyDer::from_pem_file(key).map_err(|error| unusable_key(&error))?;
    let provider = rustls::crypto::ring::default_provider();
    let pair = CertifiedKey::from_der(chain, secret, &provider);
    pair.map(|_| ()).map_err(|error| match error {
        TlsError::InvalidCertificate(_) => unusable("--queue-cert", certificate, &error),
        _ => unusable_key(&error),
    })
}

/// The certificates in a file, at least one.
fn certificates(flag: &str, path: &Path) -> Result<Vec<CertificateDer<'static>>, String> {
    let read = CertificateDer::pem_file_iter(path).and_then(Iterator::collect);
    let found: Vec<_> = read.map_err(|error| unusable(flag, path, &error))?;
    if found.is_empty() {
        return Err(unusable(flag, path, &pem::Error::NoItemsFound));
    }
    Ok(found)
}

fn unusable(flag: &str, path: &Path, error: &dyn Error) -> String {
    format!("{flag} {}: {error}", path.display())
}

/// What is refused and would be so again; `None` for what may pass.
fn refusal(error: &ConnectError, settings: &BrokerSettings) -> Option<String> {
    if let Some(error) = tls_error(error) {
        return Some(about_tls(error, settings));
    }
    match error.kind() {
        ConnectErrorKind::AuthorizationViolation | ConnectErrorKind::Authentication => {
            Some(format!("{}: {}", about_credentials(settings), causes(error)))
        }
        ConnectErrorKind::Tls => Some(format!("TLS cannot be set up: {}", causes(error))),
        _ => None,
    }
}

fn about_credentials(settings: &BrokerSettings) -> String {
    let user = settings.user().ok().flatten();
    let given = match (&settings.queue_credentials, user.map(|user| user.password)) {
        (Some(path), _) => format!("refuses those of --queue-credentials {}", path.display()),
        (None, Some(Some(_))) => "refuses the name and password in --queue".into(),
        (None, Some(None)) => "refuses the token in --queue".into(),
        (None, None) => "wants credentials, by --queue nats://NAME:PASSWORD@HOST, \
                         nats://TOKEN@HOST, or --queue-credentials"
            .into(),
    };
    format!("the broker {given}")
}

fn about_tls(error: &TlsError, settings: &BrokerSettings) -> String {
    let what = match error {
        TlsError::InvalidCertificate(error) => about_certificate(error, settings),
        TlsError::AlertReceived(_) if settings.queue_cert.is_some() => {
            "the broker refuses the certificate of --queue-cert".into()
        }
        TlsError::AlertReceived(_) => {
            "the broker wants a certificate of this node, by --queue-cert and --queue-key".into()
        }
        TlsError::InvalidMessage(_) => {
            "the broker does not speak TLS, which tls:// in --queue and --queue-ca ask for".into()
        }
        _ => String::from("no TLS connection to the broker comes about"),
    };
    format!("{what}: {error}")
}

fn about_certificate(error: &CertificateError, settings: &BrokerSettings) -> String {
    use CertificateError::{BadSignature, NotValidForName, NotValidForNameContext, UnknownIssuer};
    match (error, &settings.queue_ca) {
        (NotValidForName | NotValidForNameContext { .. }, _) => {
            "the broker's certificate is not for the host in --queue".into()
        }
        // The signature is bad where another authority has the same name.
        (UnknownIssuer | BadSignature, Some(path)) => {
            let path = path.display();
            format!("the broker's certificate is not by the authority in --queue-ca {path}")
        }
        (UnknownIssuer | BadSignature, None) => {
            "the broker's certificate is by an authority that this machine does not know: name its \
             file with --queue-ca"
                .into()
        }
        _ => "the broker's certificate is not valid".into(),
    }
}

/// The error of TLS among the causes of one.
fn tls_error(error: &ConnectError) -> Option<&TlsError> {
    let mut causes = std::iter::successors(Some(error as &dyn Error), |&error| error.source());
    causes.find_map(|cause| match cause.downcast_ref::<io::Error>() {
        // Its source is not what is in it, but the source of that.
        Some(error) => error.get_ref()?.downcast_ref(),
        None => cause.downcast_ref(),
    })
}
