//! How a run is on the network: what the command line, the configuration and the keys say.

use std::path::PathBuf;

use protocol::keys::RobotId;

use super::people;
use crate::cli::NetworkOptions;
use crate::config::Config;
use crate::credentials::{Credentials, OperatorList};
use crate::exit::UsageError;
use crate::link::endpoints::{DEFAULT_CONTROL, DEFAULT_SECURED_CONTROL, check, is_loopback};
use crate::link::sessions::Endpoints;
use crate::link::zenoh_config_file;

/// How a run is on the network.
#[derive(Clone, Debug)]
pub(super) struct NetworkPlan {
    pub(super) robot: RobotId,
    pub(super) endpoints: Endpoints,
    /// Who may drive; without a list, whoever reaches it.
    pub(super) people: Option<OperatorList>,
    /// The audit log's file.
    pub(super) audit: Option<PathBuf>,
    /// Whether an endpoint was named: then mapping without it is not what was asked for.
    pub(super) is_asked_for: bool,
    pub(super) stay: bool,
}

impl NetworkPlan {
    /// What the command line and the configuration say; `None` for no network.
    ///
    /// # Errors
    /// Where an endpoint is none, or open to others without being said to be, and where keys cannot be used.
    pub(super) fn new(
        options: &NetworkOptions,
        robot: Option<&RobotId>,
        config: &Config,
    ) -> anyhow::Result<Option<Self>> {
        if options.no_network {
            return Ok(None);
        }
        let named = |flags: &[String], setting: &Option<String>| {
            if flags.is_empty() {
                setting.iter().cloned().collect()
            } else {
                flags.to_vec()
            }
        };
        let mut listen: Vec<String> = named(&options.listen, &config.link.listen);
        let connect: Vec<String> = named(&options.connect, &config.link.connect);
        let keys = options.keys.as_deref().or(config.link.keys.as_deref());
        let keys = keys
            .map(|folder| Credentials::of_vehicle(folder, robot))
            .transpose()?;
        let named_by_keys = keys.as_ref().map(|(_, name, _)| name.clone());
        for endpoint in listen.iter().chain(&connect) {
            check(endpoint, keys.is_some()).map_err(|err| UsageError(err.to_string()))?;
            if keys.is_none() && !options.insecure && !is_loopback(endpoint) {
                return Err(people::open_to_all(endpoint).into());
            }
        }
        let is_asked_for = !(listen.is_empty() && connect.is_empty());
        if !is_asked_for {
            let default = if keys.is_some() {
                DEFAULT_SECURED_CONTROL
            } else {
                DEFAULT_CONTROL
            };
            listen.push(default.to_owned());
        }
        let (credentials, people) = keys.map(|(own, _, people)| (own, people)).unzip();
        Ok(Some(Self {
            robot: match named_by_keys.as_ref().or(robot) {
                Some(robot) => robot.clone(),
                None => name_of(&config.vehicle.name),
            },
            endpoints: Endpoints {
                listen,
                connect,
                zenoh_config: zenoh_config_file(options.zenoh_config.clone()),
                credentials,
                people: people.clone().unwrap_or_default(),
                audit: None,
            },
            people,
            audit: config.link.audit.clone(),
            is_asked_for,
            stay: options.stay,
        }))
    }

    /// What this robot is called.
    pub(super) const fn robot(&self) -> &RobotId {
        &self.robot
    }

    /// Whether the map is served on when the data has ended.
    pub(super) const fn stays(&self) -> bool {
        self.stay
    }
}

/// A vehicle's name as a robot's: every sign that a key cannot have becomes `_`.
fn name_of(vehicle: &str) -> RobotId {
    let plain = |sign: char| {
        if sign.is_ascii_alphanumeric() || sign == '-' {
            sign
        } else {
            '_'
        }
    };
    let name: String = vehicle.chars().map(plain).take(64).collect();
    name.parse().unwrap_or_else(|_empty| RobotId::default())
}
