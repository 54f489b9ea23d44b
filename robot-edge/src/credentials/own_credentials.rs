//! What `--keys` names: the folder of one vehicle or one person.

use std::path::{Path, PathBuf};

use protocol::keys::RobotId;
use protocol::signed::SecretKey;
use zeroize::Zeroizing;

use super::folder::{
    CA_CERTIFICATE, CERTIFICATE, OPERATORS, PRIVATE_KEY, SIGNING_KEY, subfolder_hint,
};
use super::{Certificate, CredentialsError, Identity, OperatorList, authority, files};
use crate::clock;

/// Who this program is on the network, and whom it believes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Credentials {
    folder: PathBuf,
    certificate: Certificate,
}

impl Credentials {
    /// Reads a vehicle's or person's folder.
    ///
    /// # Errors
    /// Where something is missing, does not fit together, or is a secret that others can read.
    pub fn open(folder: &Path) -> Result<Self, CredentialsError> {
        let [ca, link, key] =
            [CA_CERTIFICATE, CERTIFICATE, PRIVATE_KEY].map(|name| folder.join(name));
        if !link.exists()
            && let Some(why) = subfolder_hint(folder)
        {
            return Err(CredentialsError::content(folder, why));
        }
        let certificate = Certificate::read(&link, &ca)?;
        let key_pair = authority::key_pair(&key)?;
        if rcgen::PublicKeyData::subject_public_key_info(&key_pair) != certificate.public_key() {
            return Err(CredentialsError::content(
                &key,
                "not the key of link.pem beside it",
            ));
        }
        Ok(Self {
            folder: folder.to_owned(),
            certificate,
        })
    }

    /// The credentials of a vehicle that goes by the name of `robot`, or by any where that is `None`.
    ///
    /// # Errors
    /// As [`Self::open`], where they are somebody else's, and where the list of operators cannot be read.
    pub fn of_vehicle(
        folder: &Path,
        robot: Option<&RobotId>,
    ) -> Result<(Self, RobotId, OperatorList), CredentialsError> {
        let own = Self::open(folder)?;
        let Identity::Vehicle(name) = own.identity().clone() else {
            return Err(CredentialsError::content(
                folder,
                format!("these are the keys of {}, not of a vehicle", own.identity()),
            ));
        };
        if let Some(robot) = robot.filter(|robot| **robot != name) {
            return Err(CredentialsError::content(
                folder,
                format!("these are the keys of {name}, and --robot says {robot}"),
            ));
        }
        let list = OperatorList::read(&own.operator_list())?;
        Ok((own, name, list))
    }

    /// Whose they are.
    pub const fn identity(&self) -> &Identity {
        self.certificate.identity()
    }

    /// What the owner should know about its certificate's time, if anything.
    pub fn warning(&self) -> Option<String> {
        let now_s = i64::try_from(clock::seconds_since_1970()).unwrap_or(i64::MAX);
        self.certificate.warning(now_s)
    }

    /// What a person signs commands with.
    ///
    /// # Errors
    /// Where there is none, which is so of observers, or others can read it.
    pub fn signing_key(&self) -> Result<SecretKey, CredentialsError> {
        let path = self.folder.join(SIGNING_KEY);
        let pem = Zeroizing::new(files::read_secret(&path)?);
        SecretKey::from_pem(&pem).map_err(|why| CredentialsError::content(path, why.to_string()))
    }

    /// A vehicle's list of operators.
    pub fn operator_list(&self) -> PathBuf {
        self.folder.join(OPERATORS)
    }

    /// The certificate of the authority that it believes.
    pub fn ca_certificate(&self) -> PathBuf {
        self.folder.join(CA_CERTIFICATE)
    }

    /// What it shows when it connects or is connected to.
    pub fn link_certificate(&self) -> PathBuf {
        self.folder.join(CERTIFICATE)
    }

    /// The key of that.
    pub fn link_key(&self) -> PathBuf {
        self.folder.join(PRIVATE_KEY)
    }
}
