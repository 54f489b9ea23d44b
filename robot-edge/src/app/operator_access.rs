//! Who may drive, kept as the list says, and what they do, written down.

use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use protocol::keys::RobotId;
use protocol::tile::BootId;

use crate::audit::{Audit, AuditLog};
use crate::config::Config;
use crate::credentials::{Credentials, OperatorList};
use crate::driving::OperatorListWatcher;
use crate::driving::operators::PendingOperatorList;
use crate::events::event;
use crate::exit::UsageError;
use crate::link::endpoints::is_loopback;
use crate::link::publish_state::PublishState;
use crate::link::sessions::Endpoints;

/// Why a robot does not let everybody in without being told to.
pub(super) fn open_without_keys(endpoint: &str) -> UsageError {
    UsageError(format!(
        "{endpoint}: whoever reaches this address could watch the robot and drive it, unencrypted and without saying who \
         they are. Make keys (`robot-edge keys --help`) and give --keys; if an open robot is meant, say --insecure"
    ))
}

/// Says what somebody who starts a robot should know of its keys, or of their lack.
pub(super) fn print_security_notice(endpoints: &Endpoints, out: &mut dyn Write) -> io::Result<()> {
    let mut endpoint_list = endpoints.listen.iter().chain(&endpoints.connect);
    match &endpoints.credentials {
        Some(credentials) => match credentials.warning() {
            Some(warning) => writeln!(out, "network: {warning}"),
            None => Ok(()),
        },
        None if endpoint_list.all(|endpoint| is_loopback(endpoint)) => Ok(()),
        None => writeln!(
            out,
            "network: INSECURE: whoever reaches it may watch this robot and drive it; nothing is encrypted, and nobody \
             proves who they are"
        ),
    }
}

/// Opens the audit log and begins it with what this run is.
pub(super) fn open_audit_log(
    path: &Path,
    robot: &RobotId,
    config: &Config,
    boot: BootId,
) -> anyhow::Result<AuditLog> {
    let run = format!("{:032x}", u128::from_be_bytes(boot.0));
    let log =
        AuditLog::open(path, run).with_context(|| format!("link.audit_log: {}", path.display()))?;
    // Of the configuration as it is in force, however it was put together; equal only between equal versions.
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

/// Keeps the list of operators as the file says, and tells consoles and the audit log when it changes.
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
