//! Access rights at real listeners, with the files that `robot-edge keys` makes.

mod commands;
mod flood;
mod keys;
mod matrix;
mod operator_list_update;
mod secured_link;
mod unauthorized_peers;

use std::fs;

use foreshore_tests::operator::{Input, Operator};
use network::credentials::Credentials;
use network::endpoints::Channel;
use network::sessions::{self, Endpoints, Side};
use zenoh::Session;

use crate::fleet::{Fleet, quic, text};
use crate::processes::{Running, SERVED, start, wait_until};

/// A simulated robot with the fleet's keys, and an audit log.
fn robot(fleet: &Fleet, how: &str, port: u16) -> Running {
    let (edge, audit) = (fleet.edge(how, &quic(port)), fleet.scratch("audit.jsonl"));
    let audit = format!("link.audit_log=\"{}\"", audit.display());
    // Its name is that of its keys.
    start(&format!(
        "robot-edge simulate rooms {SERVED} {edge} --set {audit}"
    ))
}

fn operator(fleet: &Fleet, name: &str, port: u16) -> Operator {
    let key = Credentials::open(&fleet.person(name))
        .unwrap()
        .signing_key();
    let session = person(fleet, name, port);
    Operator::on(session, "scout", name.parse().unwrap(), key.unwrap()).with_token()
}

/// Kind and message of each line of the audit log.
fn audit(fleet: &Fleet) -> Vec<(String, String)> {
    let line = |line: &str| {
        let line: serde_json::Value = serde_json::from_str(line).unwrap();
        let field = |name: &str| line[name].as_str().unwrap().to_owned();
        (field("kind"), field("message"))
    };
    text(fleet.scratch("audit.jsonl"))
        .lines()
        .map(line)
        .collect()
}

/// The line of the first entry of this kind that contains `says`.
fn position(log: &[(String, String)], kind: &str, says: &str) -> usize {
    let at = log
        .iter()
        .position(|(of, message)| of == kind && message.contains(says));
    at.unwrap_or_else(|| panic!("no {kind}, {says}: {log:#?}"))
}

/// Writes the vehicle's list of operators without `name`.
fn take_off(fleet: &Fleet, name: &str) {
    let path = fleet.vehicle().join("operators.toml");
    let whole = text(&path);
    let entry = whole
        .find(&format!("\n[[person]]\nname = \"{name}\""))
        .unwrap();
    let rest = &whole[entry + 1..];
    let next = rest.find("\n[[person]]").unwrap_or(rest.len());
    let draft = fleet.scratch("operators.new");
    fs::write(&draft, whole[..entry].to_owned() + &rest[next..]).unwrap();
    fs::rename(&draft, &path).unwrap();
}

const TURN: Input = Input::of(0.0, 0.5);

/// The control session of a person; tries again until the endpoint answers.
fn person(fleet: &Fleet, name: &str, port: u16) -> Session {
    let endpoints = fleet.endpoints(name, quic(port));
    let mut session = None;
    wait_until(name, || {
        session = sessions::open(Side::Console, Channel::Control, &endpoints).ok();
        session.is_some()
    });
    session.unwrap()
}

/// The control session of a vehicle with the fleet's keys.
fn vehicle(fleet: &Fleet, listen: &[String], connect: &[String]) -> Session {
    let (credentials, _, people) = Credentials::of_vehicle(&fleet.vehicle(), None).unwrap();
    let endpoints = Endpoints {
        listen: listen.to_vec(),
        connect: connect.to_vec(),
        credentials: Some(credentials),
        operators: people,
        ..Endpoints::default()
    };
    sessions::open(Side::Edge, Channel::Control, &endpoints).unwrap()
}
