//! Role × key × verb: every cell allowed or refused, directly and through a router.
//!
//! A put that is refused still returns `Ok`, so what arrives is seen at the vehicle. Whatever is sent after it on the
//! same link, and is allowed, arrives after it: no test waits for something not to happen.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::Duration;

use robot_edge::clock;
use robot_edge::credentials::Credentials;
use robot_edge::link::endpoints::Channel;
use robot_edge::link::sessions::{self, Endpoints, Side};
use zenoh::{Session, Wait as _};

use super::router;
use crate::fleet::Fleet;
use crate::link::processes::free_port;

const TIMEOUT: Duration = Duration::from_secs(20);

/// What the vehicle sends by itself.
const TOLD: [&str; 7] = [
    "pose",
    "status",
    "event",
    "map_head",
    "shores",
    "scan",
    "map/occupancy/3/-4",
];
/// What it answers to everybody.
const ASKED: [&str; 7] = [
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

/// A vehicle that takes everything that reaches it.
struct Vehicle {
    session: Session,
    arrived: Arc<Mutex<BTreeSet<String>>>,
}

impl Vehicle {
    fn new(fleet: &Fleet, listen: &[String], connect: &[String]) -> Self {
        let (credentials, _, people) = Credentials::of_vehicle(&fleet.vehicle(), None).unwrap();
        let endpoints = Endpoints {
            listen: listen.to_vec(),
            connect: connect.to_vec(),
            credentials: Some(credentials),
            operators: people,
            ..Endpoints::default()
        };
        let session = sessions::open(Side::Edge, Channel::Control, &endpoints).unwrap();
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

fn until(what: &str, is_so: impl Fn() -> bool) {
    let started = clock::now();
    while !is_so() {
        assert!(clock::elapsed(started) < TIMEOUT, "never: {what}");
        sleep(Duration::from_millis(5));
    }
}

pub(super) fn person(fleet: &Fleet, name: &str, port: u16) -> Session {
    let endpoints = Endpoints {
        connect: vec![format!("quic/127.0.0.1:{port}")],
        credentials: Some(Credentials::open(&fleet.person(name)).unwrap()),
        ..Endpoints::default()
    };
    let started = clock::now();
    loop {
        match sessions::open(Side::Console, Channel::Control, &endpoints) {
            Ok(session) => return session,
            Err(why) => assert!(clock::elapsed(started) < TIMEOUT, "{name}: {why}"),
        }
    }
}

fn every_key() -> Vec<String> {
    let commands = PEOPLE
        .iter()
        .flat_map(|name| VERBS.map(|verb| format!("op/{name}/{verb}")));
    let others = ["view/0123", "alive", "op/anna", "map/occupancy/**", "**"];
    let mut keys: Vec<_> = TOLD
        .into_iter()
        .chain(ASKED)
        .chain(others)
        .map(str::to_owned)
        .collect();
    keys.extend(commands);
    keys
}

/// What the design lets through of what people send.
fn may(name: &str, verb: &str, key: &str) -> bool {
    let own = |verb: &str| name != "tv" && key == format!("op/{name}/{verb}");
    let (drive, requests) = VERBS.split_first().unwrap();
    match verb {
        "PUT" => key == "view/0123" || own(drive),
        "GET" => ASKED.contains(&key) || requests.iter().any(|request| own(request)),
        _ => false,
    }
}

/// What people send, as it arrives.
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
        // Elsewhere than at this vehicle.
        session
            .put("foreshore/barge/op/anna/drive", "x")
            .wait()
            .unwrap();
        session.put("elsewhere", "x").wait().unwrap();
        let mark = format!("foreshore/scout/view/mark-{name}");
        session.put(mark.clone(), "x").wait().unwrap();
        until("the mark arrives", || vehicle.has(&format!("PUT {mark}")));
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

/// What people hear.
fn heard(vehicle: &Vehicle, sessions: &[(&str, Session)]) -> usize {
    let mut cells = 0;
    for (name, session) in sessions {
        let arrived = Arc::new(Mutex::new(BTreeSet::new()));
        // Each key by itself, and all of them at once by a wildcard that access control does not grant.
        for key in
            every_key()
                .iter()
                .map(String::as_str)
                .chain(["view/*", "op/*/drive", "map/*/*/*"])
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
        // A subscription takes a moment to reach the vehicle; all of them go the same way.
        until("the pose arrives", || {
            for key in concrete() {
                let full = format!("foreshore/scout/{key}");
                vehicle.session.put(full, "x").wait().unwrap();
            }
            TOLD.iter().all(|key| has(key))
        });
        for key in concrete() {
            assert_eq!(
                has(&key),
                TOLD.contains(&key.as_str()),
                "{name} hears {key}"
            );
            cells += 1;
        }
    }
    cells
}

/// Presence, and what only a vehicle may declare.
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
            until(&format!("{name} sees that {key}"), || is_seen(session, key));
        }
        // Somebody who plays the vehicle: nobody sees it, nobody asks it.
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
    let cells = sent(vehicle, &sessions) + heard(vehicle, &sessions) + declared(vehicle, &sessions);
    println!("{cells} cells");
    for (_, session) in sessions {
        session.close().wait().unwrap();
    }
}

#[test]
fn every_role_may_do_what_it_may_and_nothing_else() {
    let (fleet, port) = (Fleet::new(), free_port());
    let vehicle = Vehicle::new(&fleet, &[format!("quic/127.0.0.1:{port}")], &[]);
    every_cell(&vehicle, &fleet, port);
}

#[test]
fn every_role_may_do_through_a_router_what_it_may_and_nothing_else() {
    let (fleet, port) = (Fleet::new(), free_port());
    let _router = router::start(&fleet, port);
    let vehicle = Vehicle::new(&fleet, &[], &[format!("quic/127.0.0.1:{port}")]);
    every_cell(&vehicle, &fleet, port);
}
