//! `robot-edge keys` and `robot-edge install-keys`.

use std::collections::BTreeMap;
use std::io::Write;

use crate::cli::{InstallKeys, Keys};
use crate::exit::{Exit, UsageError};
use network::credentials::{Installed, IssueRequest, install, issue};
use teleop::Role;

pub(super) fn keys(command: &Keys, out: &mut dyn Write) -> anyhow::Result<Exit> {
    let mut people = BTreeMap::new();
    for (names, role) in [
        (&command.operators, Role::Operator),
        (&command.supervisors, Role::Supervisor),
        (&command.observers, Role::Observer),
    ] {
        for name in names {
            let known = people.insert(name.clone(), role);
            if known.is_some_and(|known| known != role) {
                let why = format!("{name} is given two roles: a name has one");
                return Err(UsageError(why).into());
            }
        }
    }
    let done = issue(&IssueRequest {
        folder: command.folder.clone(),
        vehicles: command.robots.clone(),
        hosts: command.hosts.clone(),
        people,
        router_hosts: command.router_hosts.clone(),
        days: command.days,
    })?;
    if done.is_empty() {
        writeln!(out, "nothing to do: everything asked for is there")?;
    }
    for line in done {
        writeln!(out, "{line}")?;
    }
    Ok(Exit::Done)
}

pub(super) fn install_keys(command: &InstallKeys, out: &mut dyn Write) -> anyhow::Result<Exit> {
    let Installed {
        robot,
        people,
        warning,
    } = install(&command.from, &command.to)?;
    let to = command.to.display();
    writeln!(
        out,
        "{to}: the keys of {robot}, with {people} people on its list"
    )?;
    if let Some(warning) = warning {
        writeln!(out, "{warning}")?;
    }
    Ok(Exit::Done)
}
