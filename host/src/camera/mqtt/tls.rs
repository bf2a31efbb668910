//! Encrypted connections: certificates and keys from files, and what is wrong with them.
//!
//! In: files in PEM. Out: a configuration of rustls for TLS 1.2 and 1.3, and advice for its
//! errors. Certificates of brokers and of web servers are always checked.
//!
//! Memory: the authorities, some 100 kB. Cost: a handshake a connection.

use std::io::{self, ErrorKind};
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use rumqttc::{ConnectionError, MqttOptions, TlsConfiguration, TlsError, Transport};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{AlertDescription, CertificateError, ClientConfig, Error, RootCertStore, crypto::ring};
use ureq::config::ConfigBuilder;
use ureq::tls::{Certificate, RootCerts, TlsConfig, TlsProvider};
use ureq::typestate::AgentScope;

/// How to encrypt connections.
#[derive(Clone, Debug)]
pub struct Encryption(Arc<ClientConfig>);

impl Encryption {
    /// Makes a client encrypt its connections.
    pub fn apply_to(&self, options: &mut MqttOptions) {
        options.set_transport(Transport::tls_with_config(TlsConfiguration::Rustls(Arc::clone(&self.0))));
    }
}

/// Makes the configuration of connections. `ca` has the authorities to trust, by default those
/// of the system; `own` has the certificate and the key that this program shows.
///
/// # Errors
/// When a file cannot be read or is not what it should be, or the system has no authorities.
pub fn configuration(ca: Option<&Path>, own: Option<(&Path, &Path)>) -> Result<Encryption> {
    let mut roots = RootCertStore::empty();
    match ca {
        Some(file) => {
            for certificate in certificates(file)? {
                roots.add(certificate).with_context(|| format!("{} has no authority's certificate", file.display()))?;
            }
        }
        None => {
            roots.add_parsable_certificates(of_the_system());
            ensure!(
                !roots.is_empty(),
                "this system has no certificate authorities: install ca-certificates, or give --mqtt-ca FILE"
            );
        }
    }
    let builder = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()?
        .with_root_certificates(roots);
    let Some((certificate, key)) = own else { return Ok(Encryption(Arc::new(builder.with_no_client_auth()))) };
    let chain = certificates(certificate)?;
    let secret = PrivateKeyDer::from_pem_file(key)
        .with_context(|| format!("{} has no private key in PEM that is not encrypted", key.display()))?;
    let configuration = builder
        .with_client_auth_cert(chain, secret)
        .with_context(|| format!("the key {} does not go with {}", key.display(), certificate.display()))?;
    Ok(Encryption(Arc::new(configuration)))
}

/// Makes a web client trust the authorities in the file `ca`, by default those of the system.
///
/// # Errors
/// When the file cannot be read, or has no certificate.
pub fn trust(client: ConfigBuilder<AgentScope>, ca: Option<&Path>) -> Result<ConfigBuilder<AgentScope>> {
    let trusted = ca.map_or_else(|| Ok(of_the_system()), certificates)?;
    let trusted: Vec<_> = trusted.iter().map(|c| Certificate::from_der(c).to_owned()).collect();
    let tls = TlsConfig::builder()
        .provider(TlsProvider::Rustls)
        .unversioned_rustls_crypto_provider(Arc::new(ring::default_provider()))
        .root_certs(RootCerts::new_with_certs(&trusted));
    Ok(client.tls_config(tls.build()))
}

/// The certificates of the system's authorities.
fn of_the_system() -> Vec<CertificateDer<'static>> {
    rustls_native_certs::load_native_certs().certs
}

/// The certificates in a file.
fn certificates(file: &Path) -> Result<Vec<CertificateDer<'static>>> {
    let read = CertificateDer::pem_file_iter(file).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let found = read.with_context(|| format!("cannot read certificates in PEM from {}", file.display()))?;
    ensure!(!found.is_empty(), "{} has no certificate in PEM", file.display());
    Ok(found)
}

/// What is wrong, and what to do about it. `None` when it is nothing of TLS, or the error says
/// it well enough.
#[must_use]
pub fn advice(error: &ConnectionError) -> Option<&'static str> {
    use ErrorKind::{ConnectionAborted, ConnectionReset, UnexpectedEof};
    match error {
        ConnectionError::Tls(TlsError::Io(io))
            if matches!(io.kind(), ConnectionAborted | ConnectionReset | UnexpectedEof) =>
        {
            Some("it ended the connection when TLS began: use mqtt://, or the port for TLS")
        }
        _ => advice_on(cause(error)?),
    }
}

/// The error of rustls behind an error of the client. It may be inside an error of
/// input and output, which does not name it as its source.
fn cause(error: &ConnectionError) -> Option<&Error> {
    let mut next: Option<&(dyn std::error::Error + 'static)> = Some(error);
    while let Some(error) = next {
        let inside = error.downcast_ref::<io::Error>().and_then(|io| io.get_ref()?.downcast_ref());
        if let Some(found) = inside.or_else(|| error.downcast_ref()) {
            return Some(found);
        }
        next = error.source();
    }
    None
}

fn advice_on(error: &Error) -> Option<&'static str> {
    Some(match error {
        Error::InvalidCertificate(reason) => match reason {
            CertificateError::UnknownIssuer | CertificateError::BadSignature => {
                "the broker's certificate is not signed by an authority that is trusted: give its authority with --mqtt-ca"
            }
            CertificateError::Expired | CertificateError::ExpiredContext { .. } => {
                "the broker's certificate has expired, or the clock of this machine is wrong"
            }
            CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. } => {
                "the broker's certificate is not valid yet: is the clock of this machine right?"
            }
            CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. } => {
                "the broker's certificate is for another host name: use the name that it has"
            }
            _ => return None,
        },
        Error::InvalidMessage(_) => "it does not speak TLS: use mqtt://, or the port for TLS",
        Error::AlertReceived(alert) => match alert {
            AlertDescription::CertificateRequired => {
                "the broker wants a certificate from this program: give --mqtt-cert and --mqtt-key"
            }
            AlertDescription::UnknownCA
            | AlertDescription::BadCertificate
            | AlertDescription::CertificateExpired
            | AlertDescription::CertificateRevoked
            | AlertDescription::CertificateUnknown
            | AlertDescription::AccessDenied => {
                "the broker does not take the certificate of this program: is --mqtt-cert the right one?"
            }
            AlertDescription::HandshakeFailure => {
                "the broker ended the handshake: it may want a certificate (--mqtt-cert and --mqtt-key)"
            }
            _ => return None,
        },
        _ => return None,
    })
}
