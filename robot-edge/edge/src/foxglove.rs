//! Maps, scans, poses and events for Foxglove, over its WebSocket protocol, by its own SDK: each channel at most once a second, and
//! only what a client subscribes to.
//!
//! One thread of low priority makes the messages from the tile store and [`crate::publishing::output_inputs`], as [`crate::ros2`] does. Nothing waits
//! for it. The server has no capability: a client can publish nothing, call nothing and set nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::Context as _;
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    ArrowPrimitive, Color, FrameTransform, FrameTransforms, Grid, LinePrimitive, Log,
    PackedElementField, Point3, PointCloud, Pose as FoxglovePose, PoseInFrame, PosesInFrame,
    Quaternion, SceneEntity, SceneEntityDeletion, SceneUpdate, TextPrimitive, Timestamp, Vector2,
    Vector3, line_primitive, log, scene_entity_deletion,
};
use foxglove::websocket::{ChannelView, Client, ServerListener};
use foxglove::{Channel, Context, Encode, WebSocketServer};
use protocol::export::{StampedPose, palette_for};
use protocol::layer::LayerId;
use protocol::message::{Severity, ShoreClass, Shores};
use protocol::mosaic::{KnownTiles, MAX_RASTER_CELLS, Raster};
use protocol::shores::site_letters;

use crate::lock;
use crate::publishing::output_inputs::{OutputSources, VehicleState};
use crate::thread_priority::lower_thread_priority;
use mapping::registered_scan::{BeamOutcome, RegisteredScan};
use measurement::pose::Pose;
use measurement::time::RobotTime;
use network::clock;

const PERIOD: Duration = Duration::from_secs(1);
/// Messages that wait for a slow client; a newer one replaces the oldest.
const BACKLOG: usize = 32;
/// Cells of a grid message, 32 MB. A larger map is sent coarser.
const MAX_GRID_CELLS: usize = 1 << 22;
const MAX_PATH_POSES: usize = 5000;
/// Frame of the layers.
const MAP: &str = "map";

/// The running server. It ends when it is dropped.
pub struct FoxgloveOutput {
    address: SocketAddr,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// Names of the vehicle and of its frames; of the range sensors in the order of their [`SensorId`]s.
///
/// [`SensorId`]: mapping::registered_scan::SensorId
#[derive(Clone, Debug)]
pub struct Names {
    pub vehicle: String,
    pub odom: String,
    pub base: String,
    pub sensors: Vec<String>,
}

impl FoxgloveOutput {
    pub fn start(at: SocketAddr, names: Names, sources: OutputSources) -> anyhow::Result<Self> {
        let is_over = Arc::new(AtomicBool::new(false));
        let is_cancelled = Arc::clone(&is_over);
        let (sender, started) = sync_channel(1);
        let thread = thread::Builder::new().name("foxglove".to_owned());
        let thread = thread.spawn(move || {
            // The server's threads inherit it.
            lower_thread_priority();
            let context = Context::new();
            let subscriptions = Arc::new(NewSubscriptions::default());
            let server = WebSocketServer::new()
                .name(&names.vehicle)
                .bind(at.ip().to_string(), at.port())
                .context(&context)
                .message_backlog_size(BACKLOG)
                .listener(Arc::clone(&subscriptions) as _)
                .start_blocking();
            let (result, server) = match server {
                Ok(server) => (Ok(server.port()), Some(server)),
                Err(why) => (Err(why), None),
            };
            let is_received = sender.send(result).is_ok();
            let Some(server) = server.filter(|_| is_received) else {
                return;
            };
            let mut output = Output::new(names, sources, &context, subscriptions);
            let mut due = clock::now();
            while clock::sleep_until(due, || is_cancelled.load(Ordering::Relaxed)) {
                due = clock::now() + PERIOD;
                output.publish();
            }
            drop(server.stop());
        })?;
        let port = started.recv()?;
        let port = port.with_context(|| format!("--foxglove {at}: cannot listen there"))?;
        Ok(Self {
            address: SocketAddr::new(at.ip(), port),
            is_over,
            thread: Some(thread),
        })
    }

    /// Where it listens.
    pub const fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for FoxgloveOutput {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the output to Foxglove has failed");
        }
    }
}

/// Channels that a client has newly subscribed to: it gets the last message also if nothing has changed.
#[derive(Default)]
struct NewSubscriptions(Mutex<BTreeSet<String>>);

impl ServerListener for NewSubscriptions {
    fn on_subscribe(&self, _client: Client, channel: ChannelView<'_>) {
        lock(&self.0).insert(channel.topic().to_owned());
    }
}

/// A channel, and which state of its content was sent.
struct Topic<M: Encode, S> {
    channel: Channel<M>,
    sent: Option<S>,
}

impl<M: Encode, S: PartialEq> Topic<M, S> {
    fn new(context: &Arc<Context>, name: &str) -> Self {
        Self {
            channel: context.channel_builder(name).build(),
            sent: None,
        }
    }

    /// Publishes a message with its stamp, if there is a subscriber that lacks `state`.
    fn publish(
        &mut self,
        subscriptions: &NewSubscriptions,
        state: Option<S>,
        make: impl FnOnce() -> Option<(RobotTime, M)>,
    ) {
        if state.is_none() || !self.channel.has_sinks() {
            return;
        }
        let is_new = lock(&subscriptions.0).remove(self.channel.topic());
        if !is_new && self.sent == state {
            return;
        }
        self.sent = state;
        if let Some((stamp, message)) = make() {
            self.channel.log_with_time(&message, nanos(stamp));
        }
    }
}

struct Output {
    names: Names,
    sources: OutputSources,
    context: Arc<Context>,
    subscriptions: Arc<NewSubscriptions>,
    /// Epoch and revision of each layer.
    grids: BTreeMap<LayerId, Topic<Grid, (u32, u64)>>,
    scans: Vec<Topic<PointCloud, RobotTime>>,
    shores: Topic<SceneUpdate, RobotTime>,
    path: Topic<PosesInFrame, StampedPose>,
    pose: Topic<PoseInFrame, RobotTime>,
    transforms: Topic<FrameTransforms, RobotTime>,
    events: Channel<Log>,
}

impl Output {
    fn new(
        names: Names,
        sources: OutputSources,
        context: &Arc<Context>,
        subscriptions: Arc<NewSubscriptions>,
    ) -> Self {
        let scans = names.sensors.iter();
        Self {
            scans: scans
                .map(|name| Topic::new(context, &format!("/scan/{name}")))
                .collect(),
            names,
            sources,
            context: Arc::clone(context),
            subscriptions,
            grids: BTreeMap::new(),
            shores: Topic::new(context, "/shores"),
            path: Topic::new(context, "/path"),
            pose: Topic::new(context, "/pose"),
            transforms: Topic::new(context, "/tf"),
            events: context.channel_builder("/events").build(),
        }
    }

    fn publish(&mut self) {
        let subscriptions = &self.subscriptions;
        let inputs = &self.sources.inputs;
        let vehicle = inputs.vehicle();
        let stamp = vehicle.as_ref().map(|vehicle| vehicle.stamp);
        let names = &self.names;
        self.transforms.publish(subscriptions, stamp, || {
            Some((stamp?, transforms(vehicle?, names)))
        });
        self.pose.publish(subscriptions, stamp, || {
            let message = PoseInFrame {
                timestamp: timestamp(stamp?),
                frame_id: names.odom.clone(),
                pose: Some(pose(&vehicle?.odom_from_base)),
            };
            Some((stamp?, message))
        });
        let wants_scans = self.scans.iter().any(|scan| scan.channel.has_sinks());
        for (sensor, scan) in inputs.take_scans(wants_scans) {
            if let Some(topic) = self.scans.get_mut(usize::from(sensor.0)) {
                topic.publish(subscriptions, Some(scan.stamp), || {
                    Some((scan.stamp, points(&scan, &names.odom)))
                });
            }
        }
        if self.events.has_sinks() {
            for (stamp, event) in inputs.take_events() {
                let level = match event.severity {
                    Severity::Info => log::Level::Info,
                    Severity::Warning => log::Level::Warning,
                    Severity::Alarm => log::Level::Error,
                };
                let message = Log {
                    timestamp: timestamp(stamp),
                    level: level.into(),
                    message: event.message,
                    name: event.kind,
                    ..Log::default()
                };
                self.events.log_with_time(&message, nanos(stamp));
            }
        }
        let shores = inputs.shores();
        let stamp = shores.as_ref().map(|(stamp, _)| *stamp);
        self.shores.publish(subscriptions, stamp, || {
            let (stamp, shores) = shores?;
            Some((stamp, scene(stamp, &shores)))
        });
        let trajectory = &self.sources.trajectory;
        let newest = trajectory.lock().last();
        self.path.publish(subscriptions, newest, || {
            let stamp = RobotTime::from_nanos(newest?.stamp_ns);
            Some((
                stamp,
                path(stamp, &trajectory.snapshot().thinned(MAX_PATH_POSES)),
            ))
        });
        self.publish_grids();
    }

    fn publish_grids(&mut self) {
        let heads: Vec<_> = {
            let store = lock(&self.sources.store);
            let layers = store.grids().map(|grid| grid.layer);
            let head = |layer| (layer, (store.epoch(layer), store.head_revision(layer)));
            layers.map(head).collect()
        };
        for (layer, head) in heads {
            let name = format!("/map/{layer}");
            let topic = self.grids.entry(layer);
            let topic = topic.or_insert_with(|| Topic::new(&self.context, &name));
            let stamp = self.sources.inputs.vehicle().map(|vehicle| vehicle.stamp);
            // Without a pose there is no time yet.
            let state = stamp.map(|_| head);
            topic.publish(&self.subscriptions, state, || {
                let tiles = KnownTiles::of_layer(&lock(&self.sources.store), layer);
                let raster = tiles.and_then(|tiles| tiles.into_raster(MAX_RASTER_CELLS));
                let raster = raster
                    .inspect_err(|why| tracing::warn!(%why, "a layer is not sent to Foxglove"))
                    .ok()??;
                let stamp = stamp?;
                Some((stamp, grid(stamp, &raster)))
            });
        }
    }
}

/// Stamps before 1970 become 0: Foxglove has none.
fn nanos(stamp: RobotTime) -> u64 {
    stamp.as_nanos().max(0).cast_unsigned()
}

fn timestamp(stamp: RobotTime) -> Option<Timestamp> {
    let nanos = nanos(stamp);
    let secs = u32::try_from(nanos / 1_000_000_000).ok()?;
    Timestamp::new_checked(secs, (nanos % 1_000_000_000) as u32)
}

fn pose(pose: &Pose) -> FoxglovePose {
    let position = pose.translation.vector;
    let [x, y, z, w] = pose.rotation.coords.into();
    FoxglovePose {
        position: Some(Vector3 {
            x: position.x,
            y: position.y,
            z: position.z,
        }),
        orientation: Some(Quaternion { x, y, z, w }),
    }
}

/// A place on the ground plane, turned counter-clockwise from x.
fn flat_pose([x, y]: [f64; 2], heading_rad: f64) -> FoxglovePose {
    FoxglovePose {
        position: Some(Vector3 { x, y, z: 0.0 }),
        orientation: Some(Quaternion {
            x: 0.0,
            y: 0.0,
            z: libm::sin(0.5 * heading_rad),
            w: libm::cos(0.5 * heading_rad),
        }),
    }
}

fn transforms(vehicle: VehicleState, names: &Names) -> FrameTransforms {
    let transform = |parent: &str, child: &str, parent_from_child: &Pose| {
        let FoxglovePose {
            position,
            orientation,
        } = pose(parent_from_child);
        FrameTransform {
            timestamp: timestamp(vehicle.stamp),
            parent_frame_id: parent.to_owned(),
            child_frame_id: child.to_owned(),
            translation: position,
            rotation: orientation,
        }
    };
    let of_odom = vehicle
        .map_from_odom
        .map(|pose| transform(MAP, &names.odom, &pose));
    let of_base = transform(&names.odom, &names.base, &vehicle.odom_from_base);
    FrameTransforms {
        transforms: of_odom.into_iter().chain([of_base]).collect(),
    }
}

fn field(name: &str, offset: u32, kind: NumericType) -> PackedElementField {
    PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    }
}

/// The hits of a scan.
fn points(scan: &RegisteredScan, odom: &str) -> PointCloud {
    let hits = scan.beams.iter().filter_map(|beam| match beam.outcome {
        BeamOutcome::Hit => Some(beam.end_in_odom.coords.map(|m| m as f32)),
        BeamOutcome::Miss => None,
    });
    let data: Vec<u8> = hits
        .flat_map(|hit| [hit.x, hit.y, hit.z].map(f32::to_le_bytes))
        .flatten()
        .collect();
    let fields = ["x", "y", "z"].into_iter().zip((0..).step_by(4));
    PointCloud {
        timestamp: timestamp(scan.stamp),
        frame_id: odom.to_owned(),
        pose: Some(pose(&Pose::identity())),
        point_stride: 12,
        fields: fields
            .map(|(name, offset)| field(name, offset, NumericType::Float32))
            .collect(),
        data: data.into(),
    }
}

fn path(stamp: RobotTime, poses: &[StampedPose]) -> PosesInFrame {
    let poses = poses.iter().map(|pose| {
        let [x, y, z] = pose.position_m();
        let [qx, qy, qz, qw] = pose.quaternion_xyzw();
        FoxglovePose {
            position: Some(Vector3 { x, y, z }),
            orientation: Some(Quaternion {
                x: qx,
                y: qy,
                z: qz,
                w: qw,
            }),
        }
    });
    PosesInFrame {
        timestamp: timestamp(stamp),
        frame_id: MAP.to_owned(),
        poses: poses.collect(),
    }
}

/// Values of the layer, and the colours of its exported picture; NaN and transparent where unknown.
fn grid(stamp: RobotTime, raster: &Raster) -> Grid {
    let size = |step| [raster.width(), raster.height()].map(|cells| cells.div_ceil(step));
    let mut step = 1;
    while size(step).iter().product::<usize>() > MAX_GRID_CELLS {
        step *= 2;
    }
    let [columns, rows] = size(step);
    let cell_m = raster.cell_m() * step as f64;
    let palette = palette_for(raster);
    let quantisation = raster.layer().quantisation();
    let (mut codes, mut data) = (Vec::new(), Vec::with_capacity(8 * columns * rows));
    for row in (0..rows).rev() {
        raster.read_deciding(step, row, 0..columns, &mut codes);
        for &code in &codes {
            let value = quantisation.decode(code);
            let mut color = palette.color(code);
            if value.is_none() {
                color[3] = 0;
            }
            data.extend(value.unwrap_or(f32::NAN).to_le_bytes());
            data.extend(color);
        }
    }
    let ([x_m, _], [_, y_max_m]) = raster.corners_m();
    let colors = ["red", "green", "blue", "alpha"].into_iter().zip(4..);
    Grid {
        timestamp: timestamp(stamp),
        frame_id: MAP.to_owned(),
        pose: Some(flat_pose([x_m, y_max_m - rows as f64 * cell_m], 0.0)),
        column_count: columns as u32,
        cell_size: Some(Vector2 {
            x: cell_m,
            y: cell_m,
        }),
        row_stride: 8 * columns as u32,
        cell_stride: 8,
        fields: [field("value", 0, NumericType::Float32)]
            .into_iter()
            .chain(colors.map(|(name, offset)| field(name, offset, NumericType::Uint8)))
            .collect(),
        data: data.into(),
    }
}

/// Outlines and numbers of shores; docking sites as arrows with their letters. It replaces the previous ones.
fn scene(stamp: RobotTime, shores: &Shores) -> SceneUpdate {
    let entity = |id: String| SceneEntity {
        timestamp: timestamp(stamp),
        frame_id: MAP.to_owned(),
        id,
        ..SceneEntity::default()
    };
    let label = |text: String, at_m: [f32; 2]| TextPrimitive {
        pose: Some(flat_pose(at_m.map(f64::from), 0.0)),
        billboard: true,
        font_size: 16.0,
        scale_invariant: true,
        color: Some(color([1.0, 1.0, 1.0])),
        text,
    };
    let clusters = shores.clusters.iter().map(|cluster| {
        let corner = |&(x, y): &(i32, i32)| Point3 {
            x: f64::from(x) * shores.cell_m,
            y: f64::from(y) * shores.cell_m,
            z: 0.0,
        };
        let outline = LinePrimitive {
            r#type: line_primitive::Type::LineLoop.into(),
            pose: Some(flat_pose([0.0, 0.0], 0.0)),
            thickness: 2.0,
            scale_invariant: true,
            points: cluster.outline.iter().map(corner).collect(),
            color: Some(color(match cluster.class {
                ShoreClass::Sparse => [0.6, 0.9, 0.4],
                ShoreClass::Dense => [0.1, 0.6, 0.2],
                ShoreClass::Solid => [0.9, 0.2, 0.1],
            })),
            ..LinePrimitive::default()
        };
        SceneEntity {
            lines: vec![outline],
            texts: vec![label(cluster.number.to_string(), cluster.center_m)],
            ..entity(format!("shore {}", cluster.number))
        }
    });
    let sites = shores.sites.iter().map(|site| {
        let [at_m, from_m] = [site.center_m, site.approach_m].map(|at| at.map(f64::from));
        let name = site_letters(site.number);
        let arrow = ArrowPrimitive {
            pose: Some(flat_pose(from_m, f64::from(site.heading_rad))),
            shaft_length: libm::hypot(at_m[0] - from_m[0], at_m[1] - from_m[1]),
            shaft_diameter: 0.2,
            head_length: 0.6,
            head_diameter: 0.6,
            color: Some(color([1.0, 0.7, 0.0])),
        };
        SceneEntity {
            arrows: vec![arrow],
            texts: vec![label(name.clone(), site.center_m)],
            ..entity(format!("docking site {name}"))
        }
    });
    SceneUpdate {
        deletions: vec![SceneEntityDeletion {
            timestamp: timestamp(stamp),
            r#type: scene_entity_deletion::Type::All.into(),
            id: String::new(),
        }],
        entities: clusters.chain(sites).collect(),
    }
}

const fn color([r, g, b]: [f64; 3]) -> Color {
    Color { r, g, b, a: 1.0 }
}

#[cfg(test)]
mod tests;
