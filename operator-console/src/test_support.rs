//! Default robot, operator and console for unit tests. A test about one of their values sets it itself.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use edge::publishing::replies::bands_of;
use measurement::time::Monotonic;
use protocol::keys::Topic;
use protocol::layer::LayerId;
use protocol::message::{
    Arming, ChangedTile, Changes, CollisionMonitorState, CommandCounters, DockingSite, EStopStatus,
    GoalStatus, Info, LayerHead, LayerInfo, LeaseStatus, Localization, MapHead, Pose,
    PoseConfidence, Settings, ShoreClass, ShoreCluster, Status, TeleopState, TeleopStatus,
    TileBand, Velocity,
};
use protocol::tile::{BootId, TileKey};
use protocol::tile_store::{LayerGrid, TileStore};
use protocol::wire::{self, Header};
use serde::Serialize;

use crate::model::{ConsoleModel, Incoming, ModelSettings, RequestId};
use crate::teleop_client::{EStopState, Lease, TeleopClientState};
use crate::teleop_input::{DriveInput, SpeedStep};

pub(crate) const BOOT: BootId = BootId([7; 16]);
const CELL_M: f64 = 0.1;

pub(crate) const STORED_ESTOP: EStopStatus = EStopStatus {
    number: 3,
    is_stored: true,
};

/// Milliseconds since the start of the clock.
pub(crate) const fn at(ms: u64) -> Monotonic {
    Monotonic::from_nanos(ms * 1_000_000)
}

/// A console without any message of this robot, which wants these layers.
pub(crate) fn console(robot: &str, layers: &[LayerId]) -> ConsoleModel {
    ConsoleModel::new(ModelSettings {
        robot: robot.parse().unwrap(),
        session: BootId([1; 16]),
        tile_store_mb: 10,
        layers: layers.iter().copied().collect(),
    })
}

/// The same for `scout` without layers.
pub(crate) fn scout() -> ConsoleModel {
    console("scout", &[])
}

/// Passes a published message to the console at `now`.
pub(crate) fn inject<T: Serialize>(
    model: &mut ConsoleModel,
    topic: Topic,
    body: &T,
    now: Monotonic,
) {
    inject_at(model, 0, topic, body, now);
}

/// The same with this stamp, nanoseconds.
pub(crate) fn inject_at<T: Serialize>(
    model: &mut ConsoleModel,
    stamp_ns: i64,
    topic: Topic,
    body: &T,
    now: Monotonic,
) {
    let sample = Incoming::Sample {
        key: topic.key(model.robot()),
        payload: payload(stamp_ns, body),
    };
    model.apply(sample, now);
}

/// A store with cells of 10 cm of these layers.
pub(crate) fn store_of(layers: &[LayerId]) -> TileStore {
    let mut store = TileStore::new(BOOT, 100);
    for layer in layers {
        let (layer, cell_m) = (*layer, CELL_M);
        store.set_grid(LayerGrid { layer, cell_m }).unwrap();
    }
    store
}

/// The robot describes these layers, with cells of 10 cm.
pub(crate) fn describe_layers(model: &mut ConsoleModel, layers: &[LayerId], now: Monotonic) {
    let layers = layers.iter().map(|layer| LayerInfo {
        layer: *layer,
        cell_m: CELL_M,
    });
    let info = Info {
        layers: layers.collect(),
        ..Info::default()
    };
    inject_reply(model, RequestId(1), Topic::Info, &info, now);
}

pub(crate) fn announce_map(model: &mut ConsoleModel, store: &TileStore, now: Monotonic) {
    let layers = store.grids().map(|LayerGrid { layer, .. }| LayerHead {
        layer,
        epoch: store.epoch(layer),
        head_revision: store.head_revision(layer),
        tiles: store.tile_count(layer) as u32,
        root: store.root_digest(layer).unwrap(),
    });
    let layers = layers.collect();
    inject(model, Topic::MapHead, &MapHead { layers }, now);
}

/// Announces an empty map of this run.
pub(crate) fn announce_boot(model: &mut ConsoleModel, run: BootId, now: Monotonic) {
    let sample = Incoming::Sample {
        key: Topic::MapHead.key(model.robot()),
        payload: payload_of(run, 0, &MapHead { layers: Vec::new() }),
    };
    model.apply(sample, now);
}

/// One band as it is pushed.
pub(crate) fn changes(key: TileKey, band: TileBand) -> Changes {
    let (tx, ty) = (key.tx, key.ty);
    let tiles = vec![ChangedTile {
        tx,
        ty,
        older_ns: 0,
        band,
    }];
    Changes { tiles }
}

pub(crate) fn push_tile(model: &mut ConsoleModel, store: &TileStore, key: TileKey, now: Monotonic) {
    for (stamp_ns, band) in bands_of(&store.tile(key).unwrap()) {
        let topic = Topic::Changes(key.layer);
        inject_at(model, stamp_ns, topic, &changes(key, band), now);
    }
}

/// Passes a reply to a request to the console at `now`.
pub(crate) fn inject_reply<T: Serialize>(
    model: &mut ConsoleModel,
    request: RequestId,
    topic: Topic,
    body: &T,
    now: Monotonic,
) {
    let reply = Incoming::Reply {
        request,
        key: topic.key(model.robot()),
        payload: payload(0, body),
    };
    model.apply(reply, now);
}

fn payload<T: Serialize>(stamp_ns: i64, body: &T) -> Vec<u8> {
    payload_of(BOOT, stamp_ns, body)
}

/// Sequence numbers rise over all messages.
fn payload_of<T: Serialize>(boot: BootId, stamp_ns: i64, body: &T) -> Vec<u8> {
    static SENT: AtomicU64 = AtomicU64::new(0);
    let seq = SENT.fetch_add(1, Ordering::Relaxed);
    let header = Header {
        boot,
        seq,
        robot_time_ns: stamp_ns,
    };
    wire::encode(&header, body).unwrap()
}

/// 10 voxels without an outline.
pub(crate) fn shore(number: u32, center_m: [f32; 2]) -> ShoreCluster {
    ShoreCluster {
        number,
        class: ShoreClass::Dense,
        voxels: 10,
        rigid_voxels: 0,
        center_m,
        outline: Vec::new(),
    }
}

/// 2 m wide, faces east.
pub(crate) fn docking_site(center_m: [f32; 2]) -> DockingSite {
    DockingSite {
        number: 1,
        center_m,
        heading_rad: 0.0,
        width_m: 2.0,
        vegetation: None,
        price: 0.2,
        approach_m: [0.0; 2],
    }
}

/// A vehicle at the origin of `odom`, along its x axis, without a token.
pub(crate) fn pose_at_rest() -> Pose {
    Pose {
        position_m: [0.0; 3],
        quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
        speed_mps: 0.0,
        lateral_mps: 0.0,
        turn_rate_radps: 0.0,
        token: None,
    }
}

pub(crate) fn localization() -> Localization {
    Localization {
        confidence: PoseConfidence::Determined,
        is_searching: false,
        covariance_m2: [0.0004, 0.0, 0.0001],
        heading_sigma_rad: 0.002,
        inliers: 0.93,
        residual_m: 0.018,
        closures: [5, 1],
        closures_m: None,
    }
}

pub(crate) fn ended_status() -> Status {
    Status {
        has_ended: true,
        ..Status::default()
    }
}

pub(crate) fn status_of(teleop: TeleopStatus) -> Status {
    Status {
        teleop: Some(teleop),
        ..Status::default()
    }
}

/// A robot at rest without a driver.
pub(crate) fn idle_teleop_status() -> TeleopStatus {
    TeleopStatus {
        state: TeleopState::Idle,
        last_stop: None,
        is_drifting: false,
        lease: LeaseStatus::default(),
        arming: Arming::Locked,
        age_ms: None,
        peak_age_ms: None,
        speed_allowed_mps: 0.38,
        requested: Velocity::default(),
        applied: Velocity::default(),
        clamp: None,
        collision_monitor: CollisionMonitorState::Off,
        estop: None,
        counters: CommandCounters::default(),
        settings: Settings {
            budget_kbps: 256,
            collision_monitor: false,
            recording: false,
        },
        barrier: None,
        ground_age_ms: [None; 4],
        battery_v: None,
        docking: None,
        motor_hold: None,
        goal: GoalStatus::default(),
    }
}

/// Anna's teleop client, ready and idle.
pub(crate) fn idle_teleop_client() -> TeleopClientState {
    TeleopClientState {
        operator: "anna".parse().unwrap(),
        role: None,
        lease: Lease::None,
        last_grant: None,
        step: SpeedStep::default(),
        limits: [1.0, 0.0, 1.5],
        drive_input: DriveInput::NEUTRAL,
        keys: Vec::new(),
        ignored: None,
        is_ready: true,
        token_age: Some(Duration::from_millis(20)),
        is_asking: false,
        docking: None,
        goal: None,
        notice: None,
        estop: EStopState::Quiet,
    }
}
