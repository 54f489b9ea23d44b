//! The robot's side: a store, and the answers that a real edge gives.

use std::sync::Mutex;

use protocol::keys::{RobotId, Topic};
use protocol::layer::LayerId;
use protocol::message::{Info, LayerInfo};
use protocol::tile::codec::Encoder;
use protocol::tile::{BootId, TileCells, TileKey};
use protocol::tile_store::{LayerGrid, TileStore};
use protocol::wire::{self, Header};
use robot_edge::streaming::replies;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{Chance, LAYERS};

/// A robot that maps at random.
pub(super) struct Edge {
    robot: RobotId,
    boot: BootId,
    pub(super) store: Mutex<TileStore>,
    encoder: Encoder,
    seq: u64,
}

impl Edge {
    pub(super) fn start(boot: u8) -> Self {
        let boot = BootId([boot; 16]);
        let mut store = TileStore::new(boot, 64);
        for layer in LAYERS {
            store.set_grid(LayerGrid { layer, cell_m: 0.1 }).unwrap();
        }
        Self {
            robot: "scout".parse().unwrap(),
            boot,
            store: Mutex::new(store),
            encoder: Encoder::new().unwrap(),
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

    /// Changes some tile; the messages that push it.
    pub(super) fn map(&mut self, chance: &mut Chance) -> Vec<(String, Vec<u8>)> {
        let layer = LAYERS[chance.below(2) as usize];
        let key = TileKey {
            layer,
            tx: chance.below(12) as i32 - 6,
            ty: chance.below(12) as i32 - 6,
        };
        let mut cells = TileCells::unknown();
        // Now and then noise, which takes two bands, or nothing at all.
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
        let bands = replies::bands(&self.store, &mut self.encoder, key);
        bands
            .iter()
            .map(|(_, band)| self.message(Topic::Tile(key), band))
            .collect()
    }

    pub(super) fn answer(&mut self, key: &str, payload: &[u8]) -> Vec<(String, Vec<u8>)> {
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
                    limits: [1.0; 2],
                    layers,
                    ..Info::default()
                };
                vec![self.message(topic, &info)]
            }
            Topic::Tiles(layer) => {
                let replies = replies::tiles(
                    &self.store,
                    &mut self.encoder,
                    layer,
                    &request(payload),
                    [0.0; 2],
                );
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
            | Topic::Event
            | Topic::MapHead
            | Topic::Ping
            | Topic::Shores
            | Topic::View
            | Topic::Tile(_)
            | Topic::Voxels
            | Topic::Trajectory
            | Topic::Scan
            | Topic::Operator(_) => Vec::new(),
        }
    }

    pub(super) fn head(&mut self) -> (String, Vec<u8>) {
        let head = replies::head(&self.store);
        self.message(Topic::MapHead, &head)
    }
}
