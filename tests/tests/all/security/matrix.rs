//! Role × key × verb: every cell allowed or refused, directly and through a router.
//!
//! A refused put still returns `Ok`, so arrivals are observed at the vehicle. An allowed message sent later on the
//! same link arrives later, so no test waits for something not to happen.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use zenoh::{Session, Wait as _};

use super::{person, vehicle};
use crate::fleet::{Fleet, quic};
use crate::processes::{free_port, wait_until};

const TIMEOUT: Duration = Duration::from_secs(20);

/// Keys that the vehicle publishes.
const PUBLISHED: [&str; 7] = [
    "pose",
    "status",
    "event",
    "map_head",
    "shores",
    "scan",
    "map/occupancy/changes",
];
/// Keys that it answers to everyone.
const ANSWERED: [&str; 7] = [
    "info",
    "ping",
    "shores",
    "voxels",
    "trajectory",
    "map/occupancy/tiles",
    "map/elevation/digests",
];
const VERBS: [&str; 5] = ["drive", "estop", "reset", "lease", "set"];
const PEOPLE: [&str; 4] = ["anna", "bert", "sam", "tv"];

/// A vehicle that records everything that reaches it.
struct Vehicle {
    session: Session,
    arrived: Arc<Mutex<BTreeSet<String>>>,
}

impl Vehicle {
    fn new(fleet: &Fleet, listen: &[String], connect: &[String]) -> Self {
        let session = vehicle(fleet, listen, connect);
        let arrived = Arc::new(Mutex::new(BTreeSet::new()));
        let note = Arc::clone(&arrived);
        session
            .declare_subscriber("foreshore/scout/**")
            .callback(move |sample| {
                let word = format!("{} {}", sample.kind(), sample.key_expr());
                note.lock().unwrap().insert(word);
            })
            .background()
            .wait()
            .unwrap();
        let note = Arc::clone(&arrived);
        session
            .declare_queryable("foreshore/scout/**")
            .callback(move |query| {
                let word = format!("GET {}", query.key_expr());
                note.lock().unwrap().insert(word);
                query.reply(query.key_expr().clone(), "yes").wait().unwrap();
            })
            .background()
            .wait()
            .unwrap();
        Self { session, arrived }
    }

    fn has(&self, word: &str) -> bool {
        self.arrived.lock().unwrap().contains(word)
    }
}

fn every_key() -> Vec<String> {
    let commands = PEOPLE
        .iter()
        .flat_map(|name| VERBS.map(|verb| format!("op/{name}/{verb}")));
    let others = ["view/0123", "alive", "op/anna", "map/occupancy/**", "**"];
    let mut keys: Vec<_> = PUBLISHED
        .into_iter()
        .chain(ANSWERED)
        .chain(others)
        .map(str::to_owned)
        .collect();
    keys.extend(commands);
    keys
}

/// The rights of each role.
fn may(name: &str, verb: &str, key: &str) -> bool {
    let own = |verb: &str| name != "tv" && key == format!("op/{name}/{verb}");
    let (drive, requests) = VERBS.split_first().unwrap();
    match verb {
        "PUT" => key == "view/0123" || own(drive),
        "GET" => ANSWERED.contains(&key) || requests.iter().any(|request| own(request)),
        _ => false,
    }
}

/// Checks every key and verb of what people send.
fn sent(vehicle: &Vehicle, sessions: &[(&str, Session)]) -> usize {
    let mut cells = 0;
    for (name, session) in sessions {
        vehicle.arrived.lock().unwrap().clear();
        let mut answers = Vec::new();
        for key in every_key() {
            let full = format!("foreshore/scout/{key}");
            session.put(full.clone(), "x").wait().unwrap();
            session.delete(full.clone()).wait().unwrap();
            let replies = session.get(full).timeout(TIMEOUT).wait().unwrap();
            answers.push((key, replies));
        }
        // Keys outside this vehicle.
        session
            .put("foreshore/barge/op/anna/drive", "x")
            .wait()
            .unwrap();
        session.put("elsewhere", "x").wait().unwrap();
        let mark = format!("foreshore/scout/view/mark-{name}");
        session.put(mark.clone(), "x").wait().unwrap();
        wait_until("the mark arrives", || vehicle.has(&format!("PUT {mark}")));
        for (key, replies) in answers {
            for verb in ["PUT", "DELETE", "GET"] {
                let is_there = vehicle.has(&format!("{verb} foreshore/scout/{key}"));
                assert_eq!(is_there, may(name, verb, &key), "{name} {verb} {key}");
                cells += 1;
            }
            if may(name, "GET", &key) {
                let reply = replies.recv_timeout(TIMEOUT).unwrap().expect(&key);
                assert!(reply.result().is_ok(), "{name} asks {key}");
            }
        }
        let arrived = vehicle.arrived.lock().unwrap();
        let strange = arrived
            .iter()
            .find(|word| !word.contains("foreshore/scout/"));
        assert_eq!(strange, None);
    }
    cells
}

/// Checks every key that people receive.
fn received(vehicle: &Vehicle, sessions: &[(&str, Session)]) -> usize {
    let mut cells = 0;
    for (name, session) in sessions {
        let arrived = Arc::new(Mutex::new(BTreeSet::new()));
        // Each key, and wildcards that access control does not grant.
        for key in
            every_key()
                .iter()
                .map(String::as_str)
                .chain(["view/*", "op/*/drive", "map/*/changes"])
        {
            let note = Arc::clone(&arrived);
            session
                .declare_subscriber(format!("foreshore/scout/{key}"))
                .callback(move |sample| {
                    note.lock().unwrap().insert(sample.key_expr().to_string());
                })
                .background()
                .wait()
                .unwrap();
        }
        let has = |key: &str| {
            let full = format!("foreshore/scout/{key}");
            arrived.lock().unwrap().contains(&full)
        };
        let concrete = || every_key().into_iter().filter(|key| !key.contains('*'));
        // Subscriptions take time to reach the vehicle.
        wait_until("the pose arrives", || {
            for key in concrete() {
                let full = format!("foreshore/scout/{key}");
                vehicle.session.put(full, "x").wait().unwrap();
            }
            PUBLISHED.iter().all(|key| has(key))
        });
        for key in concrete() {
            assert_eq!(
                has(&key),
                PUBLISHED.contains(&key.as_str()),
                "{name} receives {key}"
            );
            cells += 1;
        }
    }
    cells
}

/// Checks liveliness, and declarations that only a vehicle may make.
fn declared(vehicle: &Vehicle, sessions: &[(&str, Session)]) -> usize {
    let key = "foreshore/scout/alive";
    let _alive = vehicle
        .session
        .liveliness()
        .declare_token(key)
        .wait()
        .unwrap();
    let is_seen = |session: &Session, key: &str| {
        let found = session
            .liveliness()
            .get(key)
            .timeout(TIMEOUT)
            .wait()
            .unwrap();
        found.iter().any(|reply| reply.result().is_ok())
    };
    for (name, session) in sessions {
        for key in [key, "foreshore/*/alive"] {
            wait_until(&format!("{name} sees that {key}"), || is_seen(session, key));
        }
        // Nobody sees or asks a person who declares a vehicle's keys.
        let token = "foreshore/barge/alive";
        let _token = session.liveliness().declare_token(token).wait().unwrap();
        let _fake = session
            .declare_queryable("foreshore/scout/info")
            .callback(move |query| {
                query
                    .reply(query.key_expr().clone(), "fake")
                    .wait()
                    .unwrap();
            })
            .wait()
            .unwrap();
        let (_, other) = sessions.iter().find(|(other, _)| other != name).unwrap();
        let replies = other
            .get("foreshore/scout/info")
            .timeout(TIMEOUT)
            .wait()
            .unwrap();
        let replies: Vec<_> = replies.iter().collect();
        assert_eq!(replies.len(), 1, "{name} answers in the vehicle's place");
        let sample = replies[0].result().unwrap();
        assert_eq!(sample.payload().try_to_string().unwrap(), "yes");
        assert!(!is_seen(&vehicle.session, token), "{name} is a vehicle");
        assert!(!is_seen(other, token), "{name} is a vehicle");
    }
    5 * sessions.len()
}

fn every_cell(vehicle: &Vehicle, fleet: &Fleet, port: u16) {
    let sessions = PEOPLE.map(|name| (name, person(fleet, name, port)));
    let cells =
        sent(vehicle, &sessions) + received(vehicle, &sessions) + declared(vehicle, &sessions);
    println!("{cells} cells");
    for (_, session) in sessions {
        session.close().wait().unwrap();
    }
}

#[test]
fn every_role_has_exactly_its_rights() {
    let (fleet, port) = (Fleet::new(), free_port());
    let vehicle = Vehicle::new(&fleet, &[quic(port)], &[]);
    every_cell(&vehicle, &fleet, port);
}

#[test]
fn every_role_has_exactly_its_rights_through_a_router() {
    let (fleet, port) = (Fleet::new(), free_port());
    let _router = fleet.router(port);
    let vehicle = Vehicle::new(&fleet, &[], &[quic(port)]);
    every_cell(&vehicle, &fleet, port);
}
