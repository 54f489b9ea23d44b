//! How a run is on the network: what the command line, the configuration and the keys say.

use std::path::PathBuf;

use protocol::keys::RobotId;

use super::operator_access;
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
    pub(super) operators: Option<OperatorList>,
    /// The audit log's file.
    pub(super) audit: Option<PathBuf>,
    /// Whether an endpoint was named: then mapping without it is not what was asked for.
    pub(super) is_requested: bool,
    pub(super) keep_serving: bool,
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
        let robot_by_keys = keys.as_ref().map(|(_, name, _)| name.clone());
        for endpoint in listen.iter().chain(&connect) {
            check(endpoint, keys.is_some()).map_err(|err| UsageError(err.to_string()))?;
            if keys.is_none() && !options.insecure && !is_loopback(endpoint) {
                return Err(operator_access::open_without_keys(endpoint).into());
            }
        }
        let is_requested = !(listen.is_empty() && connect.is_empty());
        if !is_requested {
            let default = if keys.is_some() {
                DEFAULT_SECURED_CONTROL
            } else {
                DEFAULT_CONTROL
            };
            listen.push(default.to_owned());
        }
        let (credentials, operators) = keys.map(|(own, _, operators)| (own, operators)).unzip();
        Ok(Some(Self {
            robot: match robot_by_keys.as_ref().or(robot) {
                Some(robot) => robot.clone(),
                None => robot_id_from(&config.vehicle.name),
            },
            endpoints: Endpoints {
                listen,
                connect,
                zenoh_config: zenoh_config_file(options.zenoh_config.clone()),
                credentials,
                operators: operators.clone().unwrap_or_default(),
                audit: None,
            },
            operators,
            audit: config.link.audit_log.clone(),
            is_requested,
            keep_serving: options.keep_serving,
        }))
    }

    /// What this robot is called.
    pub(super) const fn robot(&self) -> &RobotId {
        &self.robot
    }

    /// Whether the map is served on when the data has ended.
    pub(super) const fn keeps_serving(&self) -> bool {
        self.keep_serving
    }
}

/// A vehicle's name as a robot's: every sign that a key cannot have becomes `_`.
fn robot_id_from(vehicle: &str) -> RobotId {
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
