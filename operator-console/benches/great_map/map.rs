//! A robot that has mapped a great deal, and the console that has received it, message by message.

use measurement::time::Monotonic;
use operator_console::model::{ConsoleModel, Incoming, ModelSettings, RequestId};
use protocol::keys::Topic;
use protocol::layer::LayerId;
use protocol::message::{Info, LayerHead, LayerInfo, MapHead, Pose, TileBand};
use protocol::tile::codec::Encoder;
use protocol::tile::{BootId, TileCells, TileKey};
use protocol::tile_store::{LayerGrid, TileStore};
use protocol::wire::{self, Header};
use robot_edge::clock;
use serde::Serialize;

/// Heights have the most codes of all layers, so the most colours.
pub(crate) const LAYER: LayerId = LayerId::Elevation;
const CELL_M: f64 = 0.1;
/// 10,000 cells.
const SIDE_TILES: i32 = 157;
/// The elevation map that changes as a whole: 401 cells.
const SMALL_TILES: i32 = 7;
const BOOT: BootId = BootId([7; 16]);
/// As the console's own, a layer.
const STORE_MB: u32 = 256;

pub(crate) struct Robot {
    encoder: Encoder,
    seq: u64,
}

/// What lies over the heights, where it is asked for: free but for the walls.
const OVER: LayerId = LayerId::Obstacle;

/// Heights that rise and fall over metres, with walls.
fn code(layer: LayerId, tile: (i32, i32), (x, y): (usize, usize), turn: usize) -> u16 {
    let whole = |n: usize| i64::try_from(n).unwrap();
    let cx = i64::from(tile.0) * 64 + whole(x);
    let cy = i64::from(tile.1) * 64 + whole(y);
    let east = ((cx + 3 * whole(turn)).rem_euclid(900) - 450).abs();
    let hill = east + (cy.rem_euclid(700) - 350).abs();
    let wall = cx % 97 == 0 || cy % 131 == 0;
    let value = match (layer, wall) {
        (OVER, true) => 1.0,
        (OVER, false) => -1.0,
        (_, _) => 0.004 * hill as f32 + if wall { 1.5 } else { 0.0 },
    };
    layer.quantisation().encode(value)
}

/// The robot and the console that holds its map, announced and synchronized: of heights, or of obstacles over them.
pub(crate) fn great_map(has_two_layers: bool) -> (Robot, ConsoleModel) {
    let layers = &[LAYER, OVER][..if has_two_layers { 2 } else { 1 }];
    let tile_store_mb = STORE_MB * u32::from(has_two_layers) + STORE_MB;
    let settings = ModelSettings {
        robot: "great".parse().unwrap(),
        session: BootId([1; 16]),
        tile_store_mb,
        layers: LayerId::ALL.into(),
    };
    let mut model = ConsoleModel::new(settings).unwrap();
    let mut robot = Robot {
        encoder: Encoder::new().unwrap(),
        seq: 0,
    };
    let mut store = TileStore::new(BOOT, tile_store_mb);
    for &layer in layers {
        let cell_m = CELL_M;
        store.set_grid(LayerGrid { layer, cell_m }).unwrap();
    }
    robot.announce(&mut model, &store, layers);
    let info = Info {
        vehicle: "bench".to_owned(),
        source: String::new(),
        footprint_m: [1.2, 0.8],
        limits: [1.0, 1.0],
        layers: layers
            .iter()
            .map(|&layer| LayerInfo {
                layer,
                cell_m: CELL_M,
            })
            .collect(),
        ..Info::default()
    };
    let reply = Incoming::Reply {
        request: RequestId(1),
        key: Topic::Info.key(model.robot()),
        payload: wire::encode(&robot.header(), &info).unwrap(),
    };
    model.apply(reply, clock::now());
    for &layer in layers {
        for index in 0..SIDE_TILES * SIDE_TILES {
            let tile = (index % SIDE_TILES, index / SIDE_TILES);
            let revision = u64::from(index.unsigned_abs()) + 1;
            robot.push_tile(&mut model, layer, tile, (revision, 0));
        }
    }
    let middle_m = f64::from(SIDE_TILES) * 32.0 * CELL_M;
    let pose = Pose {
        position_m: [middle_m, middle_m, 0.0],
        quaternion_xyzw: [0.0, 0.0, 0.3, 0.953_94],
        speed_mps: 0.0,
        turn_rate_radps: 0.0,
        token: None,
    };
    robot.push(&mut model, Topic::Pose, &pose, clock::now());
    (robot, model)
}

impl Robot {
    fn header(&mut self) -> Header {
        self.seq += 1;
        Header {
            boot: BOOT,
            seq: self.seq,
            robot_time_ns: 0,
        }
    }

    fn push<T: Serialize>(
        &mut self,
        model: &mut ConsoleModel,
        topic: Topic,
        body: &T,
        now: Monotonic,
    ) {
        let sample = Incoming::Sample {
            key: topic.key(model.robot()),
            payload: wire::encode(&self.header(), body).unwrap(),
        };
        model.apply(sample, now);
    }

    fn announce(&mut self, model: &mut ConsoleModel, store: &TileStore, layers: &[LayerId]) {
        let head_of = |&layer: &LayerId| LayerHead {
            layer,
            epoch: 0,
            head_revision: store.head_revision(layer),
            tiles: 0,
            root: store.root_digest(layer).unwrap(),
        };
        let head = MapHead {
            layers: layers.iter().map(head_of).collect(),
        };
        self.push(model, Topic::MapHead, &head, clock::now());
    }

    fn push_tile(
        &mut self,
        model: &mut ConsoleModel,
        layer: LayerId,
        tile: (i32, i32),
        (revision, turn): (u64, usize),
    ) {
        let cells = TileCells::from_fn(|x, y| code(layer, tile, (x, y), turn));
        let key = TileKey {
            layer,
            tx: tile.0,
            ty: tile.1,
        };
        let digest = cells.digest();
        let now = clock::now();
        for rows in self.encoder.encode(&cells) {
            let band = TileBand {
                epoch: 0,
                revision,
                digest,
                rows,
            };
            self.push(model, Topic::Tile(key), &band, now);
        }
    }

    /// Every cell of 401 × 401 around the vehicle has another height.
    pub(crate) fn change_elevation(
        &mut self,
        model: &mut ConsoleModel,
        turn: usize,
        _now: Monotonic,
    ) {
        let first = (SIDE_TILES - SMALL_TILES) / 2;
        for index in 0..SMALL_TILES * SMALL_TILES {
            let tile = (first + index % SMALL_TILES, first + index / SMALL_TILES);
            let revision = 1_000_000 + turn as u64 * 100 + u64::from(index.unsigned_abs());
            self.push_tile(model, LAYER, tile, (revision, turn + 1));
        }
    }
}
