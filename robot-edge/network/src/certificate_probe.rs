//! Why TLS with what listens at an address fails. Zenoh reports only that it could not connect.

use std::io::{ErrorKind, Read as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use protocol::export::utc_label;
use rustls::client::WebPkiServerVerifier;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use rustls::{
    AlertDescription, CertificateError, ClientConfig, ClientConnection, DigitallySignedStruct,
    Error, RootCertStore, SignatureScheme, StreamOwned,
};
use x509_parser::prelude::{FromDer as _, X509Certificate};

use crate::credentials::Credentials;
use crate::endpoints::place;

/// A vehicle that accepts the certificate says nothing after the handshake.
const TIMEOUT: Duration = Duration::from_secs(1);

/// Whose certificate is wrong at `endpoint`, and why; `None` if TLS works, or if nothing can be said. Takes seconds.
pub fn certificate_problem_at(endpoint: &str, credentials: &Credentials) -> Option<String> {
    let (host, port) = place(endpoint)?;
    let address = (host, port).to_socket_addrs().ok()?.next()?;
    let stream = TcpStream::connect_timeout(&address, TIMEOUT).ok()?;
    certificate_problem(stream, host, credentials)
}

/// Tries TLS on `stream`, which is connected to `host`: whose certificate is wrong, and why; `None` if TLS works, or if
/// nothing can be said.
pub fn certificate_problem(
    stream: TcpStream,
    host: &str,
    credentials: &Credentials,
) -> Option<String> {
    let name = ServerName::try_from(host.to_owned()).ok()?;
    let (config, seen) = client_config(credentials)?;
    let connection = ClientConnection::new(config, name).ok()?;
    stream.set_read_timeout(Some(TIMEOUT)).ok()?;
    stream.set_write_timeout(Some(TIMEOUT)).ok()?;
    let mut stream = StreamOwned::new(connection, stream);
    // In TLS 1.3 the listener refuses a client's certificate after the client's part of the handshake.
    let failure = stream.read(&mut [0]).err()?;
    let error = match failure.kind() {
        ErrorKind::InvalidData => failure.downcast::<Error>().ok()?,
        _ => return None,
    };
    let whose = lock(&seen).take();
    let whose = whose.unwrap_or_else(|| "an unnamed owner".to_owned());
    explain(&error, &whose, host, &credentials.identity().to_string())
}

/// `whose`: owner of the listener's certificate. `own`: owner of the certificate of this program.
fn explain(error: &Error, whose: &str, host: &str, own: &str) -> Option<String> {
    let theirs = format!("the certificate of {whose} there");
    let ours = format!("it refuses the certificate of {own}");
    Some(match error {
        Error::InvalidCertificate(
            CertificateError::UnknownIssuer | CertificateError::BadSignature,
        ) => format!("{theirs} is of another fleet: another authority has issued it"),
        Error::InvalidCertificate(CertificateError::ExpiredContext { not_after, .. }) => {
            let at = utc_label(not_after.as_secs());
            format!("{theirs} has expired at {at}: issue a new one with `robot-edge keys`")
        }
        Error::InvalidCertificate(CertificateError::NotValidYetContext { not_before, .. }) => {
            let at = utc_label(not_before.as_secs());
            format!("{theirs} is not valid before {at}: is the clock of this computer right?")
        }
        Error::InvalidCertificate(CertificateError::NotValidForNameContext {
            presented, ..
        }) => {
            let names = presented.join(", ");
            format!("{theirs} is for {names}, not for {host}: connect by such a name")
        }
        Error::InvalidCertificate(other) => format!("{theirs} is not valid: {other}"),
        Error::AlertReceived(
            AlertDescription::UnknownCA
            | AlertDescription::BadCertificate
            | AlertDescription::DecryptError,
        ) => format!("{ours}, which is of another fleet"),
        Error::AlertReceived(AlertDescription::CertificateExpired) => {
            format!("{ours}: by its clock it has expired or is not valid yet")
        }
        Error::InvalidMessage(_) => {
            "it answers without TLS: was it started without --keys?".to_owned()
        }
        _ => return None,
    })
}

fn client_config(credentials: &Credentials) -> Option<(Arc<ClientConfig>, Owner)> {
    let mut roots = RootCertStore::empty();
    for certificate in CertificateDer::pem_file_iter(credentials.ca_certificate()).ok()? {
        roots.add(certificate.ok()?).ok()?;
    }
    let own = CertificateDer::pem_file_iter(credentials.link_certificate()).ok()?;
    let own: Vec<_> = own.collect::<Result<_, _>>().ok()?;
    let key = PrivateKeyDer::from_pem_file(credentials.link_key()).ok()?;
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let checks = WebPkiServerVerifier::builder_with_provider(Arc::new(roots), provider.clone());
    let verifier = Arc::new(NamingVerifier {
        checks: checks.build().ok()?,
        owner: Owner::default(),
    });
    let owner = Arc::clone(&verifier.owner);
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .ok()?
        .dangerous()
        .with_custom_certificate_verifier(verifier)
        .with_client_auth_cert(own, key)
        .ok()?;
    Some((Arc::new(config), owner))
}

/// Owner of the listener's certificate, once it is known.
type Owner = Arc<Mutex<Option<String>>>;

fn lock(owner: &Owner) -> std::sync::MutexGuard<'_, Option<String>> {
    owner.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Checks as usual, and notes whose certificate it is.
#[derive(Debug)]
struct NamingVerifier {
    checks: Arc<WebPkiServerVerifier>,
    owner: Owner,
}

impl ServerCertVerifier for NamingVerifier {
    fn verify_server_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        server_name: &ServerName<'_>,
        ocsp_response: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        if let Ok((_, certificate)) = X509Certificate::from_der(end_entity) {
            let name = certificate.subject().iter_common_name().next();
            let name = name.and_then(|name| name.as_str().ok());
            *lock(&self.owner) = name.map(str::to_owned);
        }
        self.checks
            .verify_server_cert(end_entity, intermediates, server_name, ocsp_response, now)
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.checks
            .verify_tls12_signature(message, certificate, signed)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.checks
            .verify_tls13_signature(message, certificate, signed)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.checks.supported_verify_schemes()
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::net::TcpListener;
    use std::path::{Path, PathBuf};

    use zenoh::Wait as _;

    use super::*;
    use crate::credentials::{IssueRequest, issue};
    use crate::endpoints::Channel;
    use crate::sessions::{Endpoints, Side, open};

    /// Keys of a vehicle and of an operator.
    fn fleet(folder: &Path) -> [PathBuf; 2] {
        let request = IssueRequest {
            folder: folder.to_owned(),
            vehicles: ["scout".parse().unwrap()].into(),
            people: [("anna".parse().unwrap(), teleop::Role::Operator)].into(),
            days: 1,
            ..IssueRequest::default()
        };
        issue(&request).unwrap();
        ["vehicles/scout", "people/anna"].map(|place| folder.join(place))
    }

    /// What an operator learns of a vehicle.
    fn problem(vehicle: &Path, host: &str, operator: &Credentials) -> Option<String> {
        let port = TcpListener::bind(("127.0.0.1", 0))
            .unwrap()
            .local_addr()
            .unwrap()
            .port();
        let endpoints = Endpoints {
            listen: vec![format!("tls/127.0.0.1:{port}")],
            credentials: Some(Credentials::open(vehicle).unwrap()),
            ..Endpoints::default()
        };
        let session = open(Side::Edge, Channel::Control, &endpoints).unwrap();
        let stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        let problem = certificate_problem(stream, host, operator);
        session.close().wait().unwrap();
        problem
    }

    #[test]
    fn wrong_certificates_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let [vehicle, operator] = fleet(&at("a"));
        let [_, stranger] = fleet(&at("b"));
        let open = |folder: &Path| Credentials::open(folder).unwrap();

        assert_eq!(problem(&vehicle, "127.0.0.1", &open(&operator)), None);
        assert_eq!(
            problem(&vehicle, "127.0.0.1", &open(&stranger)).unwrap(),
            "the certificate of vehicle:scout there is of another fleet: another authority has issued it"
        );
        // A stranger who trusts the authority.
        let half_known = open(&stranger);
        fs::copy(operator.join("ca.pem"), half_known.ca_certificate()).unwrap();
        assert_eq!(
            problem(&vehicle, "127.0.0.1", &half_known).unwrap(),
            "it refuses the certificate of operator:anna, which is of another fleet"
        );
        let elsewhere = problem(&vehicle, "boat.example", &open(&operator)).unwrap();
        assert!(
            elsewhere.starts_with("the certificate of vehicle:scout there is for ")
                && elsewhere.ends_with(", not for boat.example: connect by such a name"),
            "{elsewhere}"
        );

        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let address = listener.local_addr().unwrap();
        let answer = std::thread::spawn(move || {
            use std::io::Write as _;
            listener
                .accept()
                .unwrap()
                .0
                .write_all(b"SSH-2.0-OpenSSH_9.2\r\n")
                .unwrap();
        });
        let stream = TcpStream::connect(address).unwrap();
        assert_eq!(
            certificate_problem(stream, "127.0.0.1", &open(&operator)).unwrap(),
            "it answers without TLS: was it started without --keys?"
        );
        answer.join().unwrap();
    }

    #[test]
    fn times_are_dates() {
        let time = |secs| UnixTime::since_unix_epoch(Duration::from_secs(secs));
        let says = |error| {
            explain(
                &Error::InvalidCertificate(error),
                "vehicle:scout",
                "boat",
                "operator:anna",
            )
            .unwrap()
        };
        assert_eq!(
            says(CertificateError::ExpiredContext {
                time: time(1_772_368_497),
                not_after: time(1_772_368_496)
            }),
            "the certificate of vehicle:scout there has expired at 2026-03-01T12:34:56Z: issue a new one with \
             `robot-edge keys`"
        );
        assert_eq!(
            says(CertificateError::NotValidYetContext {
                time: time(5),
                not_before: time(1_772_368_496)
            }),
            "the certificate of vehicle:scout there is not valid before 2026-03-01T12:34:56Z: is the clock of this \
             computer right?"
        );
    }
}
