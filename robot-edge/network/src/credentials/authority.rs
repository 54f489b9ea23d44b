//! The fleet's own certificate authority. Its key never leaves the folder in which it was made.

use std::collections::BTreeSet;
use std::net::IpAddr;
use std::path::Path;
use std::time::Duration;

use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa,
    Issuer, KeyPair, KeyUsagePurpose, SerialNumber, date_time_ymd,
};
use x509_parser::certificate::X509Certificate;
use x509_parser::extensions::GeneralName;
use x509_parser::pem::{Pem, parse_x509_pem};
use x509_parser::time::ASN1Time;

use crate::clock;
use crate::credentials::files::{self, CA_CERTIFICATE, CA_KEY, Readers};
use crate::credentials::{CredentialsError, Identity};

const AUTHORITY_DAYS: u32 = 20 * 365;
/// Certificates begin this long before they are made: not every machine's clock is right.
const CLOCK_TOLERANCE: Duration = Duration::from_hours(24);
const DAY: Duration = Duration::from_hours(24);

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

    pub(super) fn pem(&self) -> &str {
        &self.pem
    }

    /// A certificate for the owner of `key_pair`, valid for `days` from now.
    ///
    /// Only the owner of a certificate with `hosts` may listen, so that no person's certificate passes for a vehicle's.
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

/// It is said that a certificate expires this long before it does, seconds.
const EXPIRY_NOTICE_S: i64 = 30 * 86_400;

/// A certificate that the fleet's authority has signed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Certificate {
    identity: Identity,
    /// Seconds since 1970, UTC.
    valid_s: [i64; 2],
    hosts: BTreeSet<String>,
    /// `SubjectPublicKeyInfo` in DER.
    public_key: Vec<u8>,
}

impl Certificate {
    /// Reads the certificate at `path`, signed by the authority whose own is at `authority`.
    pub fn read(path: &Path, authority: &Path) -> Result<Self, CredentialsError> {
        let refused = |why: String| CredentialsError::content(path, why);
        let (pem, authority_pem) = (pem(path)?, pem(authority)?);
        let certificate = x509(path, &pem)?;
        let authority_certificate = x509(authority, &authority_pem)?;
        certificate
            .verify_signature(Some(authority_certificate.public_key()))
            .map_err(|_other| {
                refused(format!(
                    "not signed by the authority of {}: both must come from one folder of `robot-edge keys`",
                    authority.display()
                ))
            })?;
        let common_name = certificate.subject().iter_common_name().next();
        let common_name = common_name.and_then(|name| name.as_str().ok());
        let identity = common_name
            .unwrap_or_default()
            .parse()
            .map_err(|why| refused(format!("{why}")))?;
        let validity = certificate.validity();
        Ok(Self {
            identity,
            valid_s: [&validity.not_before, &validity.not_after].map(ASN1Time::timestamp),
            hosts: hosts(&certificate),
            public_key: certificate.public_key().raw.to_vec(),
        })
    }

    pub const fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The names and addresses by which its owner may be reached.
    pub const fn hosts(&self) -> &BTreeSet<String> {
        &self.hosts
    }

    /// The public key, `SubjectPublicKeyInfo` in DER.
    pub(super) fn public_key(&self) -> &[u8] {
        &self.public_key
    }

    /// What somebody should know about its time, if anything; `now_s` is seconds since 1970.
    pub fn warning(&self, now_s: i64) -> Option<String> {
        let [from_s, until_s] = self.valid_s;
        let day = |seconds: i64| clock::utc_label(u64::try_from(seconds).unwrap_or(0));
        let until = day(until_s);
        let anew = "remove link.pem at home and run `robot-edge keys` again for a new one";
        if now_s < from_s {
            Some(format!(
                "this machine's clock says {}, and the certificate of {} begins at {}: set the clock",
                day(now_s),
                self.identity,
                day(from_s)
            ))
        } else if now_s >= until_s {
            Some(format!(
                "the certificate of {} expired at {until}, and nobody accepts it: {anew}",
                self.identity
            ))
        } else if now_s + EXPIRY_NOTICE_S >= until_s {
            Some(format!(
                "the certificate of {} expires at {until}: {anew}",
                self.identity
            ))
        } else {
            None
        }
    }
}

fn pem(path: &Path) -> Result<Pem, CredentialsError> {
    let text = files::read(path)?;
    let (_, pem) = parse_x509_pem(text.as_bytes()).map_err(|_why| no_certificate(path))?;
    Ok(pem)
}

fn x509<'a>(path: &Path, pem: &'a Pem) -> Result<X509Certificate<'a>, CredentialsError> {
    pem.parse_x509().map_err(|_why| no_certificate(path))
}

fn no_certificate(path: &Path) -> CredentialsError {
    CredentialsError::content(
        path,
        "no certificate in PEM (`-----BEGIN CERTIFICATE-----`)",
    )
}

fn hosts(certificate: &X509Certificate<'_>) -> BTreeSet<String> {
    let Ok(Some(names)) = certificate.subject_alternative_name() else {
        return BTreeSet::new();
    };
    let host = |name: &GeneralName<'_>| {
        if let GeneralName::DNSName(name) = name {
            Some((*name).to_owned())
        } else if let GeneralName::IPAddress(bytes) = name {
            address(bytes).map(|address| address.to_string())
        } else {
            None
        }
    };
    names.value.general_names.iter().filter_map(host).collect()
}

fn address(bytes: &[u8]) -> Option<IpAddr> {
    let v4 = <[u8; 4]>::try_from(bytes).map(IpAddr::from);
    let v6 = || <[u8; 16]>::try_from(bytes).map(IpAddr::from);
    v4.or_else(|_longer| v6()).ok()
}
