//! What lies where in a folder of `robot-edge keys`.

use std::path::{Path, PathBuf};

use protocol::keys::{OperatorId, RobotId};

use super::CredentialsError;

/// The authority's certificate, in every folder.
pub(super) const CA_CERTIFICATE: &str = "ca.pem";
/// The authority's key, at home.
pub(super) const CA_KEY: &str = "ca.key.pem";
/// What its owner shows when it connects or is connected to.
pub(super) const CERTIFICATE: &str = "link.pem";
/// The key of that certificate.
pub(super) const PRIVATE_KEY: &str = "link.key.pem";
/// What a person signs commands with.
pub(super) const SIGNING_KEY: &str = "signing.key.pem";
/// Who may watch or drive a vehicle.
pub(super) const OPERATORS: &str = "operators.toml";
/// All that a router needs, in one file.
pub(super) const ROUTER_CONFIG: &str = "router.json5";

/// The folder of a fleet: what stays at home, and one folder for each machine and person to take away.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FleetFolder(PathBuf);

impl FleetFolder {
    /// The fleet at `root`, which need not be there.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self(root.into())
    }

    /// The authority: never leaves home.
    pub fn authority(&self) -> PathBuf {
        self.0.join("authority")
    }

    /// What a vehicle takes with it.
    pub fn vehicle(&self, robot: &RobotId) -> PathBuf {
        self.vehicles_folder().join(robot.as_str())
    }

    /// What a person takes with them.
    pub fn person(&self, name: &OperatorId) -> PathBuf {
        self.0.join("people").join(name.as_str())
    }

    /// What a router takes with it.
    pub fn router(&self) -> PathBuf {
        self.0.join("router")
    }

    /// The list of those who may watch or drive a vehicle.
    pub fn operators(&self, robot: &RobotId) -> PathBuf {
        self.vehicle(robot).join(OPERATORS)
    }

    /// The configuration of a router.
    pub fn router_config(&self) -> PathBuf {
        self.router().join(ROUTER_CONFIG)
    }

    /// Every vehicle of the fleet, by name.
    pub(super) fn vehicles(&self) -> Result<Vec<RobotId>, CredentialsError> {
        let folder = self.vehicles_folder();
        if !folder.exists() {
            return Ok(Vec::new());
        }
        let failed = |why| CredentialsError::Read {
            path: folder.clone(),
            why,
        };
        let mut vehicles = Vec::new();
        for entry in folder.read_dir().map_err(failed)? {
            let name = entry.map_err(failed)?.file_name();
            vehicles.extend(name.to_str().and_then(|name| name.parse().ok()));
        }
        vehicles.sort();
        Ok(vehicles)
    }

    fn vehicles_folder(&self) -> PathBuf {
        self.0.join("vehicles")
    }
}

/// The folder inside `folder` that was probably meant, if it is a whole fleet's.
pub(super) fn subfolder_hint(folder: &Path) -> Option<String> {
    let fleet = FleetFolder::new(folder);
    fleet.authority().exists().then(|| {
        format!(
            "this is a whole fleet's folder: name the one of a vehicle or a person in it, {} or {}",
            folder.join("vehicles").join("NAME").display(),
            folder.join("people").join("NAME").display()
        )
    })
}
