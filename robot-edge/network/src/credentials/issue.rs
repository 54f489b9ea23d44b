//! `robot-edge keys`: makes what is missing, and leaves alone what is there.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use protocol::keys::{OperatorId, RobotId};
use protocol::signed::SecretKey;
use rcgen::{KeyPair, PublicKeyData as _};

use super::authority::{self, Authority};
use super::files::{self, Readers};
use super::{Certificate, CredentialsError, Identity, ListedOperator, OperatorList};
use crate::credentials::files::{
    CA_CERTIFICATE, CERTIFICATE, FleetFolder, PRIVATE_KEY, SIGNING_KEY,
};
use crate::security::RouterConfig;
use teleop::Role;

/// By these a vehicle and a router are always reached from their own machine.
const OWN_HOSTS: [&str; 3] = ["localhost", "127.0.0.1", "::1"];

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct IssueRequest {
    pub folder: PathBuf,
    pub vehicles: Vec<RobotId>,
    /// Names and addresses of the one vehicle.
    pub hosts: Vec<String>,
    /// People, for the vehicles named, or for all where none is.
    pub people: BTreeMap<OperatorId, Role>,
    /// Names and addresses of the router, if one is wanted.
    pub router_hosts: Vec<String>,
    /// How long new certificates are good for.
    pub days: u32,
}

/// Makes what is missing of what `request` names; what it did, in words, line by line.
///
/// No key, certificate or list entry is ever changed. A router's configuration follows from these and is rewritten.
pub fn issue(request: &IssueRequest) -> Result<Vec<String>, CredentialsError> {
    if !request.hosts.is_empty() && request.vehicles.len() != 1 {
        return Err(CredentialsError::Conflict(
            "--host names where one vehicle is reached: give one --robot with it".to_owned(),
        ));
    }
    let fleet = FleetFolder::new(&request.folder);
    files::make_folder(&request.folder, Readers::Owner)?;
    let authority = Authority::open(&fleet.authority())?;
    let mut fleet = Fleet {
        folder: fleet,
        authority,
        days: request.days,
        done: Vec::new(),
    };
    for robot in &request.vehicles {
        fleet.vehicle(robot, &request.hosts)?;
    }
    let every_vehicle = fleet.folder.vehicles()?;
    let vehicles = if request.vehicles.is_empty() {
        &every_vehicle
    } else {
        &request.vehicles
    };
    for (name, role) in &request.people {
        let person = fleet.person(name, *role)?;
        for robot in vehicles {
            fleet.list(robot, &person)?;
        }
    }
    fleet.router(&every_vehicle, &request.router_hosts)?;
    Ok(fleet.done)
}

struct Fleet {
    folder: FleetFolder,
    authority: Authority,
    days: u32,
    done: Vec<String>,
}

impl Fleet {
    fn vehicle(&mut self, robot: &RobotId, hosts: &[String]) -> Result<(), CredentialsError> {
        let folder = self.folder.vehicle(robot);
        let identity = Identity::Vehicle(robot.clone());
        let is_new = self.link_identity(&folder, &identity, hosts)?;
        let list = self.folder.operators(robot);
        if !list.exists() {
            files::create(
                &list,
                &OperatorList::empty_text(robot.as_str()),
                Readers::All,
            )?;
        }
        if is_new {
            self.done.push(format!(
                "{}: for the vehicle, `robot-edge ... --keys` with a copy of it",
                folder.display()
            ));
        }
        Ok(())
    }

    fn person(
        &mut self,
        name: &OperatorId,
        role: Role,
    ) -> Result<ListedOperator, CredentialsError> {
        let folder = self.folder.person(name);
        let listed = |key| ListedOperator {
            name: name.clone(),
            role,
            key,
        };
        let is_new = self.link_identity(&folder, &listed(None).identity(), &[])?;
        let key = role
            .may_drive()
            .then(|| signing_key(&folder.join(SIGNING_KEY)))
            .transpose()?;
        if is_new {
            self.done.push(format!(
                "{}: for {name}, `operator-console --keys` with a copy of it",
                folder.display()
            ));
        }
        Ok(listed(key.map(|key| key.public())))
    }

    /// Puts somebody on a vehicle's list.
    fn list(&mut self, robot: &RobotId, person: &ListedOperator) -> Result<(), CredentialsError> {
        let path = self.folder.operators(robot);
        let text = files::read(&path)?;
        let list =
            OperatorList::parse(&text).map_err(|why| CredentialsError::content(&path, why))?;
        match list.find(&person.name) {
            Some(listed) if listed == person => return Ok(()),
            Some(_other) => {
                return Err(CredentialsError::content(
                    &path,
                    format!(
                        "{} is on the list with another role or key: take that entry off, then run this again",
                        person.name
                    ),
                ));
            }
            None => {}
        }
        let text = text + &person.entry()?;
        // What is written must be a list: too many people are found here, not on the vehicle.
        OperatorList::parse(&text).map_err(|why| CredentialsError::content(&path, why))?;
        files::replace(&path, &text, Readers::All)?;
        self.done.push(format!(
            "{}: lists {}; the vehicle lets them in once it has this, by `robot-edge install-keys`",
            path.display(),
            person.identity()
        ));
        Ok(())
    }

    fn router(&mut self, vehicles: &[RobotId], hosts: &[String]) -> Result<(), CredentialsError> {
        let folder = self.folder.router();
        if hosts.is_empty() && !folder.exists() {
            return Ok(());
        }
        self.link_identity(&folder, &Identity::Router, hosts)?;
        let mut served = Vec::new();
        for robot in vehicles {
            served.push((
                robot.clone(),
                OperatorList::read(&self.folder.operators(robot))?,
            ));
        }
        let config = RouterConfig {
            ca_pem: files::read(&folder.join(CA_CERTIFICATE))?,
            certificate_pem: files::read(&folder.join(CERTIFICATE))?,
            key_pem: files::read_secret(&folder.join(PRIVATE_KEY))?,
            vehicles: served,
        };
        let path = self.folder.router_config();
        files::replace(&path, &config.to_json5(), Readers::Owner)?;
        self.done.push(format!(
            "{}: for the router, `zenohd -c` with a copy of it; it holds the router's key",
            path.display()
        ));
        Ok(())
    }

    /// Key and certificate of somebody; whether any of them is new.
    fn link_identity(
        &self,
        folder: &Path,
        identity: &Identity,
        hosts: &[String],
    ) -> Result<bool, CredentialsError> {
        files::make_folder(folder, Readers::Owner)?;
        let [ca, certificate, key] =
            [CA_CERTIFICATE, CERTIFICATE, PRIVATE_KEY].map(|name| folder.join(name));
        if !ca.exists() {
            files::create(&ca, self.authority.pem(), Readers::All)?;
        }
        let key_pair = if key.exists() {
            authority::key_pair(&key)?
        } else {
            let key_pair = KeyPair::generate()?;
            files::create(&key, &key_pair.serialize_pem(), Readers::Owner)?;
            key_pair
        };
        if certificate.exists() {
            let known = Certificate::read(&certificate, &ca)?;
            check_existing(&certificate, &known, identity, hosts, &key_pair)?;
            return Ok(false);
        }
        let mut all_hosts = hosts.to_vec();
        if identity.serves_consoles() {
            all_hosts.extend(OWN_HOSTS.map(str::to_owned));
            all_hosts.sort();
            all_hosts.dedup();
        }
        let pem = self
            .authority
            .certificate(identity, &all_hosts, self.days, &key_pair)?;
        files::create(&certificate, &pem, Readers::All)?;
        // A folder that does not fit together is found here, not on the vehicle.
        Certificate::read(&certificate, &ca)?;
        Ok(true)
    }
}

fn check_existing(
    path: &Path,
    known: &Certificate,
    identity: &Identity,
    hosts: &[String],
    key_pair: &KeyPair,
) -> Result<(), CredentialsError> {
    if known.identity() != identity {
        return Err(CredentialsError::content(
            path,
            format!(
                "this certificate is of {}, and {identity} is asked for: a name has one role. Choose another name, or \
                 remove the folder and its entries on the lists",
                known.identity()
            ),
        ));
    }
    if known.public_key() != key_pair.subject_public_key_info() {
        return Err(CredentialsError::content(
            path,
            format!(
                "not the certificate of {PRIVATE_KEY} beside it: remove it to have it made anew"
            ),
        ));
    }
    if let Some(host) = hosts.iter().find(|host| !known.hosts().contains(*host)) {
        return Err(CredentialsError::content(
            path,
            format!(
                "this certificate is not good for {host}, and certificates are not written over: remove it and run this \
                 again with all names and addresses"
            ),
        ));
    }
    Ok(())
}

fn signing_key(path: &Path) -> Result<SecretKey, CredentialsError> {
    let refused = |why: String| CredentialsError::content(path, why);
    if path.exists() {
        let pem = zeroize::Zeroizing::new(files::read_secret(path)?);
        return SecretKey::from_pem(&pem).map_err(|why| refused(why.to_string()));
    }
    let mut seed = zeroize::Zeroizing::new([0; 32]);
    getrandom::fill(&mut *seed)?;
    let key = SecretKey::from_seed(&seed);
    let pem = key.to_pem().map_err(|why| refused(why.to_string()))?;
    files::create(path, &pem, Readers::Owner)?;
    Ok(key)
}
