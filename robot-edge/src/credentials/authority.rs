//! The fleet's own certificate authority. Its key never leaves the folder in which it was made.

use std::path::Path;
use std::time::Duration;

use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa,
    Issuer, KeyPair, KeyUsagePurpose, SerialNumber, date_time_ymd,
};

use super::files::{self, Readers};
use super::folder::{CA_CERTIFICATE, CA_KEY};
use super::{CredentialsError, Identity};
use crate::clock;

/// How long the authority itself is good for.
const AUTHORITY_DAYS: u32 = 20 * 365;
/// Certificates begin this long before they are made: not every machine's clock is right.
const CLOCK_TOLERANCE: Duration = Duration::from_hours(24);
const DAY: Duration = Duration::from_hours(24);

/// What signs certificates.
pub(super) struct Authority {
    pem: String,
    issuer: Issuer<'static, KeyPair>,
}

impl Authority {
    /// The authority in `folder`, which is made where there is none.
    pub(super) fn open(folder: &Path) -> Result<Self, CredentialsError> {
        let [certificate, key] = [CA_CERTIFICATE, CA_KEY].map(|name| folder.join(name));
        match (certificate.exists(), key.exists()) {
            (false, false) => Self::make(folder),
            (true, true) => {
                let pem = files::read(&certificate)?;
                let key_pair = key_pair(&key)?;
                let issuer = Issuer::from_ca_cert_pem(&pem, key_pair)
                    .map_err(|why| CredentialsError::content(&certificate, why.to_string()))?;
                Ok(Self { pem, issuer })
            }
            (is_there, _) => {
                let missing = if is_there { key } else { certificate };
                Err(CredentialsError::Conflict(format!(
                    "{} is missing: without it nobody can be added. Put it back, or begin a fleet in another folder",
                    missing.display()
                )))
            }
        }
    }

    fn make(folder: &Path) -> Result<Self, CredentialsError> {
        let mut params = CertificateParams::default();
        let id = serial_number()?;
        let tag = id
            .to_bytes()
            .iter()
            .take(4)
            .fold(0, |tag: u32, byte| tag << 8 | u32::from(*byte));
        params.distinguished_name = named(&format!("Foreshore authority {tag:08x}"));
        params.serial_number = Some(id);
        // It signs people and machines, and no other authorities.
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        set_validity(&mut params, AUTHORITY_DAYS);
        let key_pair = KeyPair::generate()?;
        let pem = params.self_signed(&key_pair)?.pem();
        files::make_folder(folder, Readers::Owner)?;
        files::create(
            &folder.join(CA_KEY),
            &key_pair.serialize_pem(),
            Readers::Owner,
        )?;
        files::create(&folder.join(CA_CERTIFICATE), &pem, Readers::All)?;
        Ok(Self {
            pem,
            issuer: Issuer::new(params, key_pair),
        })
    }

    /// Its own certificate.
    pub(super) fn pem(&self) -> &str {
        &self.pem
    }

    /// A certificate for the owner of `key_pair`, good for `days` from now.
    ///
    /// Whoever is reached at one of `hosts` may listen; the others may only connect, so that no person's certificate
    /// passes for a vehicle's.
    pub(super) fn certificate(
        &self,
        identity: &Identity,
        hosts: &[String],
        days: u32,
        key_pair: &KeyPair,
    ) -> Result<String, CredentialsError> {
        let mut params = CertificateParams::new(hosts)?;
        params.distinguished_name = named(&identity.to_string());
        params.serial_number = Some(serial_number()?);
        params.is_ca = IsCa::ExplicitNoCa;
        params.use_authority_key_identifier_extension = true;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ClientAuth];
        if identity.serves_consoles() {
            params.insert_extended_key_usage(ExtendedKeyUsagePurpose::ServerAuth);
        }
        set_validity(&mut params, days);
        Ok(params.signed_by(key_pair, &self.issuer)?.pem())
    }
}

/// The key pair in a file that only its owner reads.
pub(super) fn key_pair(path: &Path) -> Result<KeyPair, CredentialsError> {
    let pem = zeroize::Zeroizing::new(files::read_secret(path)?);
    KeyPair::from_pem(&pem).map_err(|_why| {
        CredentialsError::content(
            path,
            "no private key in PEM (`-----BEGIN PRIVATE KEY-----`)",
        )
    })
}

fn named(common_name: &str) -> DistinguishedName {
    let mut name = DistinguishedName::new();
    name.push(DnType::CommonName, common_name);
    name
}

fn set_validity(params: &mut CertificateParams, days: u32) {
    let now = date_time_ymd(1970, 1, 1) + Duration::from_secs(clock::seconds_since_1970());
    params.not_before = now - CLOCK_TOLERANCE;
    params.not_after = now + days * DAY;
}

/// RFC 5280, section 4.1.2.2: unique, positive, at most 20 bytes.
fn serial_number() -> Result<SerialNumber, CredentialsError> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)?;
    bytes[0] = bytes[0] & 0x7f | 0x40;
    Ok(SerialNumber::from(bytes.to_vec()))
}
