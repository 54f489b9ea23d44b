//! What a certificate of `robot-edge keys` says.

use std::collections::BTreeSet;
use std::net::IpAddr;
use std::path::Path;

use x509_parser::certificate::X509Certificate;
use x509_parser::extensions::GeneralName;
use x509_parser::pem::{Pem, parse_x509_pem};
use x509_parser::time::ASN1Time;

use super::{CredentialsError, Identity, files};
use crate::clock;

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
    ///
    /// # Errors
    /// Where either is none, or the signature is another's.
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

    /// Whose it is.
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
