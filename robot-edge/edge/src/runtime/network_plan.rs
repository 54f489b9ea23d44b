//! Network settings of a run, from the command line, the configuration and the keys.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use protocol::keys::RobotId;
use protocol::tile::BootId;

use crate::cli::NetworkOptions;
use crate::config::Config;
use crate::driving::OperatorListWatcher;
use crate::driving::operators::PendingOperatorList;
use crate::events::event;
use crate::exit::UsageError;
use crate::server::publish_state::PublishState;
use network::audit::{Audit, AuditLog};
use network::credentials::{Credentials, OperatorList};
use network::endpoints::{DEFAULT_CONTROL, DEFAULT_SECURED_CONTROL, check, is_loopback};
use network::sessions::Endpoints;
use network::zenoh_config_file;

#[derive(Clone, Debug)]
pub(super) struct NetworkPlan {
    pub(super) robot: RobotId,
    pub(super) endpoints: Endpoints,
    /// Operators who may drive; without a list, everyone.
    pub(super) operators: Option<OperatorList>,
    pub(super) audit: Option<PathBuf>,
    /// An endpoint was specified, so that a failure to open it is an error.
    pub(super) is_requested: bool,
    pub(super) keep_serving: bool,
}

impl NetworkPlan {
    /// `None` without network.
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
                return Err(open_without_keys(endpoint).into());
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

    pub(super) const fn robot(&self) -> &RobotId {
        &self.robot
    }

    /// Whether the map is served after the end of the data.
    pub(super) const fn keeps_serving(&self) -> bool {
        self.keep_serving
    }
}

/// Converts a vehicle name to a robot id: characters that a key cannot contain become `_`.
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

pub(super) fn open_without_keys(endpoint: &str) -> UsageError {
    UsageError(format!(
        "{endpoint}: whoever reaches this address could watch the robot and drive it, unencrypted and without saying who \
         they are. Make keys (`robot-edge keys --help`) and give --keys; if an open robot is meant, say --insecure"
    ))
}

pub(super) fn print_security_notice(endpoints: &Endpoints, out: &mut dyn Write) -> io::Result<()> {
    let mut endpoint_list = endpoints.listen.iter().chain(&endpoints.connect);
    match &endpoints.credentials {
        Some(credentials) => match credentials.warning() {
            Some(warning) => writeln!(out, "warning: {warning}"),
            None => Ok(()),
        },
        None if endpoint_list.all(|endpoint| is_loopback(endpoint)) => Ok(()),
        None => writeln!(
            out,
            "warning: INSECURE: anybody who reaches it may watch this robot and drive it; nothing is encrypted, and nobody \
             proves who they are"
        ),
    }
}

pub(super) fn open_audit_log(
    path: &Path,
    robot: &RobotId,
    config: &Config,
    boot: BootId,
) -> anyhow::Result<AuditLog> {
    let run = format!("{:032x}", u128::from_be_bytes(boot.0));
    let log =
        AuditLog::open(path, run).with_context(|| format!("link.audit_log: {}", path.display()))?;
    // The hash of the effective configuration; it is comparable only between equal versions.
    let hash = blake3::hash(format!("{config:?}").as_bytes()).to_hex();
    log.audit().write(
        "start",
        format!(
            "{robot} starts, version {}, configuration {hash}",
            env!("CARGO_PKG_VERSION")
        ),
    );
    Ok(log)
}

/// Watches the operator list, and publishes and audits its changes.
pub(super) fn watch_operator_list(
    credentials: &Credentials,
    list: OperatorList,
    newer: Vec<PendingOperatorList>,
    publish_state: &Arc<PublishState>,
    audit: Option<Audit>,
) -> anyhow::Result<OperatorListWatcher> {
    let publish_state = Arc::clone(publish_state);
    let publish_event = move |kind: &'static str, message: String| {
        if let Some(audit) = &audit {
            audit.write(kind, message.clone());
        }
        publish_state.publish_event(event(kind, message));
    };
    let path = credentials.operator_list();
    OperatorListWatcher::start(path, list, newer, Box::new(publish_event))
        .context("no thread can be had to watch the list of operators")
}
