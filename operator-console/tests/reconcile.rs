//! Synchronization of the map over any link: an edge's real store and replies, a console's real model, and a link that
//! loses, delays, fails and restarts in simulated time.

#![allow(clippy::unwrap_used, reason = "all of it is tests")]

use std::collections::VecDeque;
use std::sync::Mutex;
use std::time::Duration;

use edge::publishing::pushed_tiles::PushedTiles;
use edge::publishing::replies;
use measurement::time::Monotonic;
use operator_console::model::{ConsoleModel, Incoming, ModelSettings, OpenSessions, Outgoing};
use protocol::keys::{RobotId, Topic};
use protocol::layer::LayerId;
use protocol::message::{Info, LayerInfo};
use protocol::tile::{BootId, TileCells, TileKey};
use protocol::tile_store::{LayerGrid, TileStore};
use protocol::wire::{self, Header};
use serde::Serialize;
use serde::de::DeserializeOwned;

const LAYERS: [LayerId; 2] = [LayerId::Occupancy, LayerId::Elevation];
const STEP_MS: u64 = 10;

/// Linear congruential generator of Numerical Recipes: reproducible runs.
struct Chance(u64);

impl Chance {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % limit
    }

    fn happens(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }
}

struct Link {
    /// Messages in flight with their arrival times.
    on_the_way: VecDeque<(u64, Incoming)>,
    loss_percent: u64,
    delay_ms: u64,
    is_cut: bool,
}

impl Link {
    fn carry(&mut self, now_ms: u64, incoming: Incoming, chance: &mut Chance) {
        let is_lost = self.is_cut || chance.happens(self.loss_percent);
        // The end of a request arrives even if its replies are lost: it times out.
        if matches!(incoming, Incoming::Ended { .. }) {
            self.on_the_way.push_back((
                now_ms + if is_lost { 3000 } else { self.delay_ms },
                incoming,
            ));
        } else if !is_lost {
            self.on_the_way
                .push_back((now_ms + self.delay_ms, incoming));
        }
    }
}

struct Run {
    edge: Edge,
    model: ConsoleModel,
    link: Link,
    chance: Chance,
    now_ms: u64,
    is_mapping: bool,
    bytes_down: usize,
}

impl Run {
    fn new(seed: u64, loss_percent: u64) -> Self {
        let settings = ModelSettings {
            robot: "scout".parse().unwrap(),
            session: BootId([200; 16]),
            tile_store_mb: 64,
            layers: LayerId::ALL.into_iter().collect(),
        };
        Self {
            edge: Edge::start(1),
            model: ConsoleModel::new(settings),
            link: Link {
                on_the_way: VecDeque::new(),
                loss_percent,
                delay_ms: 70,
                is_cut: false,
            },
            chance: Chance(seed),
            now_ms: 1_000,
            is_mapping: true,
            bytes_down: 0,
        }
    }

    fn deliver(&mut self, messages: Vec<(String, Vec<u8>)>) {
        for (key, payload) in messages {
            self.bytes_down += payload.len();
            self.link.carry(
                self.now_ms,
                Incoming::Sample { key, payload },
                &mut self.chance,
            );
        }
    }

    fn step(&mut self) {
        self.now_ms += STEP_MS;
        let now = Monotonic::from_nanos(self.now_ms * 1_000_000);
        if self.is_mapping && self.now_ms % 1000 < 200 {
            let pushed = self.edge.map(&mut self.chance);
            self.deliver(pushed);
        }
        if self.now_ms % 1000 == 250 {
            let head = self.edge.head();
            self.deliver(vec![head]);
        }
        while self
            .link
            .on_the_way
            .iter()
            .any(|(at, _)| *at <= self.now_ms)
        {
            let index = self
                .link
                .on_the_way
                .iter()
                .position(|(at, _)| *at <= self.now_ms)
                .unwrap();
            let (_, incoming) = self.link.on_the_way.remove(index).unwrap();
            self.model.apply(incoming, now);
        }
        for outgoing in self.model.outgoing(OpenSessions::BOTH, now) {
            let Outgoing::Get {
                request,
                key,
                payload,
                ..
            } = outgoing
            else {
                continue;
            };
            if !self.link.is_cut && !self.chance.happens(self.link.loss_percent) {
                for (key, payload) in self.edge.answer(&key, &payload) {
                    self.bytes_down += payload.len();
                    self.link.carry(
                        self.now_ms,
                        Incoming::Reply {
                            request,
                            key,
                            payload,
                        },
                        &mut self.chance,
                    );
                }
            }
            self.link
                .carry(self.now_ms, Incoming::Ended { request }, &mut self.chance);
        }
    }

    fn run_s(&mut self, seconds: u64) {
        for _ in 0..seconds * 1000 / STEP_MS {
            self.step();
        }
    }

    /// Seconds until the map equals the robot's, which no longer changes.
    fn settle(&mut self) -> f64 {
        self.is_mapping = false;
        let from_ms = self.now_ms;
        while !self.is_same() {
            self.step();
            assert!(
                self.now_ms - from_ms < 60_000,
                "not synchronized after a minute: {:?}",
                self.model.map().layer_states().collect::<Vec<_>>()
            );
        }
        Duration::from_millis(self.now_ms - from_ms).as_secs_f64()
    }

    fn is_same(&mut self) -> bool {
        let store = self.edge.store.get_mut().unwrap();
        self.model.map().matches_head()
            && LAYERS.iter().all(|layer| {
                store.root_digest(*layer) == self.model.map().store().root_digest(*layer)
            })
    }
}

#[test]
fn perfect_link_needs_initial_requests_only() {
    let mut run = Run::new(1, 0);
    run.run_s(30);
    assert!(run.settle() < 1.5);
    run.bytes_down = 0;
    run.run_s(20);
    // Twenty heads of two layers, and nothing else.
    assert!(
        run.bytes_down < 20 * 200,
        "{} bytes in 20 s of a map at rest",
        run.bytes_down
    );
}

#[test]
fn losses_heal() {
    for seed in 0..20 {
        let mut run = Run::new(seed, 5);
        run.run_s(20);
        let settled_s = run.settle();
        assert!(settled_s < 15.0, "seed {seed}: {settled_s} s");
    }
}

#[test]
fn map_recovers_within_seconds_after_link_failure() {
    let mut settled: Vec<f64> = (0..20)
        .map(|seed| {
            let mut run = Run::new(seed, 5);
            run.run_s(5);
            run.link.is_cut = true;
            run.run_s(30);
            run.is_mapping = false;
            run.link.is_cut = false;
            run.settle()
        })
        .collect();
    settled.sort_by(f64::total_cmp);
    println!("seconds to heal 30 s of cut at 5 % loss: {settled:.1?}");
    assert!(settled[19] < 15.0 && settled[18] < 8.0, "{settled:?}");
}

#[test]
fn erased_layer_and_restart_replace_the_map() {
    for seed in 0..5 {
        let mut run = Run::new(seed, 2);
        run.run_s(10);
        run.edge
            .store
            .get_mut()
            .unwrap()
            .erase_layer(LayerId::Elevation)
            .unwrap();
        run.settle();
        assert_eq!(run.model.map().store().cells_known(LayerId::Elevation), 0);
        assert_eq!(run.model.map().store().epoch(LayerId::Elevation), 1);
        run.is_mapping = true;
        run.run_s(5);
        run.edge = Edge::start(2);
        run.run_s(5);
        run.settle();
        assert_eq!(run.model.map().store().boot(), BootId([2; 16]));
    }
}

/// Tiles that the robot dropped completely are removed here too.
#[test]
fn tiles_that_the_robot_no_longer_holds_go() {
    let mut run = Run::new(3, 0);
    run.run_s(10);
    run.settle();
    let store = run.edge.store.get_mut().unwrap();
    let (key, _) = store
        .tiles(LayerId::Occupancy)
        .find(|(_, tile)| tile.known() > 0)
        .unwrap();
    store.forget(key);
    let settled_s = run.settle();
    assert!(settled_s < 30.0, "{settled_s} s");
    assert!(run.model.map().store().get(key).is_none());
}

/// A robot that maps at random.
struct Edge {
    robot: RobotId,
    boot: BootId,
    store: Mutex<TileStore>,
    /// What was pushed, whether it arrived or not.
    pushed: PushedTiles,
    seq: u64,
}

impl Edge {
    fn start(boot: u8) -> Self {
        let boot = BootId([boot; 16]);
        let mut store = TileStore::new(boot, 64);
        for layer in LAYERS {
            store.set_grid(LayerGrid { layer, cell_m: 0.1 }).unwrap();
        }
        Self {
            robot: "scout".parse().unwrap(),
            boot,
            store: Mutex::new(store),
            pushed: PushedTiles::default(),
            seq: 0,
        }
    }

    fn message<T: Serialize>(&mut self, topic: Topic, body: &T) -> (String, Vec<u8>) {
        self.seq += 1;
        let header = Header {
            boot: self.boot,
            seq: self.seq,
            robot_time_ns: 0,
        };
        (topic.key(&self.robot), wire::encode(&header, body).unwrap())
    }

    /// Changes a tile; returns its messages.
    fn map(&mut self, chance: &mut Chance) -> Vec<(String, Vec<u8>)> {
        let layer = LAYERS[chance.below(2) as usize];
        let key = TileKey {
            layer,
            tx: chance.below(12) as i32 - 6,
            ty: chance.below(12) as i32 - 6,
        };
        let mut cells = TileCells::unknown();
        // Sometimes noise, which takes two bands, or an empty tile.
        let known = [0, 1, 50, 4096][chance.below(4) as usize];
        for code in &mut cells.codes_mut()[..known] {
            *code = 1
                + chance.below(200) as u16
                + if layer == LayerId::Elevation {
                    chance.below(9000) as u16
                } else {
                    0
                };
        }
        let _published = self.store.get_mut().unwrap().publish(key, cells).unwrap();
        let changes = self.pushed.changes(&self.store, vec![key]);
        changes
            .iter()
            .map(|(layer, _, changes)| self.message(Topic::Changes(*layer), changes))
            .collect()
    }

    fn answer(&mut self, key: &str, payload: &[u8]) -> Vec<(String, Vec<u8>)> {
        fn request<T: DeserializeOwned>(payload: &[u8]) -> T {
            wire::decode(payload).unwrap().1
        }
        let (_, topic) = Topic::parse(key).unwrap();
        match topic {
            Topic::Info => {
                let layers = LAYERS
                    .map(|layer| LayerInfo { layer, cell_m: 0.1 })
                    .to_vec();
                let info = Info {
                    vehicle: "v".to_owned(),
                    source: "s".to_owned(),
                    footprint_m: [1.0; 2],
                    limits: [1.0, 0.0, 1.0],
                    layers,
                    ..Info::default()
                };
                vec![self.message(topic, &info)]
            }
            Topic::Tiles(layer) => {
                let replies = replies::tiles(&self.store, layer, &request(payload), [0.0; 2]);
                replies
                    .iter()
                    .map(|(_, reply)| self.message(topic, reply))
                    .collect()
            }
            Topic::Overviews(layer) => {
                let replies = replies::overviews(&self.store, layer, &request(payload));
                replies
                    .iter()
                    .map(|(_, reply)| self.message(topic, reply))
                    .collect()
            }
            Topic::Digests(layer) => {
                let replies = [replies::digests(&self.store, layer, request(payload))];
                replies
                    .iter()
                    .map(|reply| self.message(topic, reply))
                    .collect()
            }
            Topic::Alive
            | Topic::Pose
            | Topic::Status
            | Topic::Localization
            | Topic::Plan
            | Topic::Event
            | Topic::MapHead
            | Topic::Ping
            | Topic::Shores
            | Topic::View
            | Topic::Changes(_)
            | Topic::Voxels
            | Topic::Trajectory
            | Topic::Scan
            | Topic::Operator(_) => Vec::new(),
        }
    }

    fn head(&mut self) -> (String, Vec<u8>) {
        let head = replies::head(&self.store);
        self.message(Topic::MapHead, &head)
    }
}
