//! A console receives the robot's shores whenever it joins and whatever is lost, and its export equals the robot's.

#![allow(
    clippy::unwrap_used,
    reason = "the lint knows functions marked as tests, not what they call"
)]

use std::net::TcpListener;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use edge::driving::operators::PendingOperatorList;
use edge::server::edge::{EdgeLink, EdgeSettings};
use edge::server::publish_state::PublishState;
use measurement::time::{Monotonic, RobotTime};
use network::clock;
use network::sessions::Endpoints;
use operator_console::export::{ExportPart, Snapshot, export_parts};
use operator_console::link::RobotSession;
use operator_console::model::{
    ConsoleModel, Incoming, ModelSettings, OpenSessions, Outgoing, RequestId,
};
use protocol::export::write_shores;
use protocol::keys::{RobotId, Topic};
use protocol::layer::LayerId;
use protocol::message::{
    Datum, DockingSite, Info, LayerHead, LayerInfo, MapHead, ShoreClass, ShoreCluster, Shores,
    ShoresReply, ShoresRequest, Status,
};
use protocol::shores::convex_outline;
use protocol::tile::BootId;
use protocol::tile_store::{LayerGrid, TileStore};
use protocol::wire::{self, Header};
use serde::Serialize;

const CELL_M: f64 = 0.3;

fn robot() -> RobotId {
    "boat".parse().unwrap()
}

const fn at(ms: u64) -> Monotonic {
    Monotonic::from_nanos(ms * 1_000_000)
}

fn shores(voxels: u32) -> Shores {
    let cluster = ShoreCluster {
        number: 3,
        class: ShoreClass::Dense,
        voxels,
        rigid_voxels: voxels / 2,
        center_m: [10.0, 5.0],
        outline: convex_outline([(33, 16), (34, 17)]),
    };
    let site = DockingSite {
        number: 1,
        center_m: [4.0, -9.0],
        heading_rad: 1.0,
        width_m: 5.0,
        vegetation: None,
        price: 0.2,
        approach_m: [0.0; 2],
    };
    let datum = Datum {
        latitude_deg: 38.5,
        longitude_deg: -9.1,
        altitude_m: 50.0,
    };
    Shores::gather(CELL_M, Some(datum), vec![cluster], vec![site])
}

fn settings() -> ModelSettings {
    ModelSettings {
        robot: robot(),
        session: BootId([1; 16]),
        tile_store_mb: 10,
        layers: LayerId::ALL.into_iter().collect(),
    }
}

fn info() -> Info {
    Info {
        vehicle: "riverwatch".to_owned(),
        source: String::new(),
        footprint_m: [3.0, 1.6],
        limits: [2.0, 0.0, 1.0],
        layers: vec![LayerInfo {
            layer: LayerId::Shore,
            cell_m: CELL_M,
        }],
        ..Info::default()
    }
}

fn empty_store(boot: BootId) -> TileStore {
    let mut store = TileStore::new(boot, 10);
    let grid = LayerGrid {
        layer: LayerId::Shore,
        cell_m: CELL_M,
    };
    store.set_grid(grid).unwrap();
    store
}

/// A robot with an empty map, and a console.
struct Rig {
    boot: BootId,
    seq: u64,
    epoch: u32,
    model: ConsoleModel,
}

impl Rig {
    fn new() -> Self {
        Self::of_epoch(0)
    }

    fn of_epoch(epoch: u32) -> Self {
        let mut rig = Self {
            boot: BootId([7; 16]),
            seq: 0,
            epoch,
            model: ConsoleModel::new(settings()),
        };
        rig.announce(0);
        let request = rig.asked("info", 0).unwrap().0;
        rig.reply(request, Topic::Info, &info(), 0);
        rig.announce(0);
        rig
    }

    fn message<T: Serialize>(&mut self, body: &T) -> Vec<u8> {
        self.seq += 1;
        let header = Header {
            boot: self.boot,
            seq: self.seq,
            robot_time_ns: 0,
        };
        wire::encode(&header, body).unwrap()
    }

    fn say<T: Serialize>(&mut self, topic: Topic, body: &T, ms: u64) {
        let (key, payload) = (topic.key(&robot()), self.message(body));
        self.model.apply(Incoming::Sample { key, payload }, at(ms));
    }

    fn reply<T: Serialize>(&mut self, request: RequestId, topic: Topic, body: &T, ms: u64) {
        let (key, payload) = (topic.key(&robot()), self.message(body));
        let reply = Incoming::Reply {
            request,
            key,
            payload,
        };
        self.model.apply(reply, at(ms));
        self.model.apply(Incoming::Ended { request }, at(ms));
    }

    fn announce(&mut self, ms: u64) {
        let head = LayerHead {
            layer: LayerId::Shore,
            epoch: self.epoch,
            head_revision: 0,
            tiles: 0,
            root: empty_store(self.boot).root_digest(LayerId::Shore).unwrap(),
        };
        self.say(Topic::MapHead, &MapHead { layers: vec![head] }, ms);
    }

    /// The console's present request for `topic`, and its payload.
    fn asked(&mut self, topic: &str, ms: u64) -> Option<(RequestId, Vec<u8>)> {
        let outgoing = self.model.outgoing(OpenSessions::BOTH, at(ms));
        outgoing.into_iter().find_map(|outgoing| match outgoing {
            Outgoing::Get {
                request,
                key,
                payload,
                ..
            } if key.ends_with(topic) => Some((request, payload)),
            Outgoing::Get { .. } | Outgoing::Put { .. } => None,
        })
    }

    /// The request for shores, and its revision.
    fn asked_shores(&mut self, ms: u64) -> Option<(RequestId, u64)> {
        let (request, payload) = self.asked("/shores", ms)?;
        let (_, ShoresRequest { newer_than }) = wire::decode(&payload).unwrap();
        Some((request, newer_than))
    }

    fn voxels(&self) -> Option<u32> {
        let shores = self.model.shores()?;
        shores.clusters.first().map(|cluster| cluster.voxels)
    }
}

fn news(revision: u64, voxels: u32) -> ShoresReply {
    ShoresReply {
        revision,
        shores: Some(shores(voxels)),
    }
}

const NOTHING_NEWER: fn(u64) -> ShoresReply = |revision| ShoresReply {
    revision,
    shores: None,
};

#[test]
fn late_join_and_lost_push_request_shores() {
    let mut rig = Rig::new();
    assert!(
        !rig.model.is_synchronized(at(0)),
        "the shores are not known"
    );
    let (request, newer_than) = rig.asked_shores(10).unwrap();
    assert_eq!(newer_than, 0);
    rig.reply(request, Topic::Shores, &news(4, 100), 20);
    assert_eq!(rig.voxels(), Some(100));
    assert!(rig.model.is_synchronized(at(20)));
    rig.say(Topic::Shores, &news(5, 200), 500);
    assert_eq!(rig.voxels(), Some(200));
    // Revision 6 is lost.
    assert_eq!(rig.asked_shores(1_900), None);
    let (request, newer_than) = rig.asked_shores(2_100).unwrap();
    assert_eq!(newer_than, 5);
    rig.reply(request, Topic::Shores, &news(6, 300), 2_200);
    assert_eq!(rig.voxels(), Some(300));
}

#[test]
fn ended_robot_needs_last_shores_for_synchronization() {
    let mut rig = Rig::new();
    let (request, _) = rig.asked_shores(10).unwrap();
    rig.reply(request, Topic::Shores, &news(1, 100), 20);
    assert!(rig.model.is_synchronized(at(20)));
    let ended = Status {
        has_ended: true,
        ..Status::default()
    };
    rig.say(Topic::Status, &ended, 100);
    rig.announce(110);
    assert!(rig.model.has_ended() && !rig.model.is_synchronized(at(110)));
    let (request, newer_than) = rig.asked_shores(120).unwrap();
    assert_eq!(newer_than, 1);
    rig.reply(request, Topic::Shores, &NOTHING_NEWER(1), 130);
    assert!(rig.model.is_synchronized(at(130)));
}

#[test]
fn shores_of_another_run_are_rejected() {
    let mut rig = Rig::new();
    let (request, _) = rig.asked_shores(10).unwrap();
    rig.reply(request, Topic::Shores, &news(9, 100), 20);
    let old = rig.message(&news(10, 200));
    rig.boot = BootId([8; 16]);
    rig.announce(100);
    assert_eq!(rig.voxels(), None);
    let key = Topic::Shores.key(&robot());
    let late = Incoming::Sample { key, payload: old };
    rig.model.apply(late, at(110));
    assert_eq!(rig.voxels(), None);
    let (request, _) = rig.asked("info", 120).unwrap();
    rig.reply(request, Topic::Info, &info(), 120);
    let (request, newer_than) = rig.asked_shores(130).unwrap();
    assert_eq!(newer_than, 0);
    rig.reply(request, Topic::Shores, &news(1, 300), 140);
    assert_eq!(rig.voxels(), Some(300));
}

/// A control endpoint whose port and the next one are free.
fn free_endpoint() -> String {
    loop {
        let control = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let port = control.local_addr().unwrap().port();
        if port < u16::MAX && TcpListener::bind(("127.0.0.1", port + 1)).is_ok() {
            return format!("tcp/127.0.0.1:{port}");
        }
    }
}

/// Waits for shores with this number of voxels, 20 s at most.
#[track_caller]
fn wait_for(session: &RobotSession, voxels: u32) {
    let is_there = || {
        let model = session.model();
        let clusters = model.shores().map(|shores| shores.clusters.clone());
        let first = clusters
            .unwrap_or_default()
            .first()
            .map(|cluster| cluster.voxels);
        first == Some(voxels) && model.is_synchronized(clock::now())
    };
    let was_there = !clock::sleep_until(clock::now() + Duration::from_secs(20), is_there);
    assert!(was_there, "no shores of {voxels} voxels");
}

#[test]
fn shores_arrive_and_both_sides_export_the_same() {
    let endpoint = free_endpoint();
    let boot = BootId([7; 16]);
    let publish_state = Arc::new(PublishState::default());
    let edge = EdgeSettings {
        driving: None,
        robot: robot(),
        boot,
        endpoints: Endpoints {
            listen: vec![endpoint.clone()],
            ..Endpoints::default()
        },
        newer_operators: PendingOperatorList::default(),
        budget_kbps: 256,
        info: info(),
    };
    let store = Arc::new(Mutex::new(empty_store(boot)));
    let link = EdgeLink::open(edge, store, Arc::clone(&publish_state)).unwrap();
    let stamp = RobotTime::from_nanos(5);
    publish_state.set_shores(stamp, Arc::new(shores(100)));
    let endpoints = Endpoints {
        connect: vec![endpoint],
        ..Endpoints::default()
    };
    let first = RobotSession::open(settings(), &endpoints, || {});
    wait_for(&first, 100);
    publish_state.set_shores(stamp, Arc::new(shores(200)));
    wait_for(&first, 200);
    let late = ModelSettings {
        session: BootId([2; 16]),
        ..settings()
    };
    let late = RobotSession::open(late, &endpoints, || {});
    wait_for(&late, 200);

    let dir = tempfile::tempdir().unwrap();
    let by_edge = write_shores(&dir.path().join("edge"), &shores(200)).unwrap();
    let by_console = dir.path().join("console");
    let exported = export_parts(&by_console, ExportPart::all(), |part, _| {
        ControlFlow::Continue(Ok(Snapshot::of(&late.handle().lock(), part)))
    });
    let files = exported.unwrap().files;
    assert!(
        files.contains(&by_console.join("shores.geojson")),
        "{files:?}"
    );
    let read = |path| std::fs::read_to_string(path).unwrap();
    let text = read(by_edge);
    assert!(text.contains("WGS-84: longitude") && text.contains("\"voxels\":200"));
    assert_eq!(text, read(by_console.join("shores.geojson")));
    drop(link);
}
