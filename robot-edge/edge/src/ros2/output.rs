//! Publishes maps and poses to a ROS 2 system: each topic of `[ros2_output]` while somebody subscribes to it.
//!
//! Two threads of low priority (the second has that of the first) make the messages: poses on one, maps on the other. They read the tile store, as the
//! server of consoles does, and the newest pose and octree of [`OutputInputs`]. Nothing waits for them.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use protocol::layer::LayerId;
use protocol::mosaic::{KnownTiles, MAX_RASTER_CELLS, MosaicError, Raster};
use protocol::tile_store::TileStore;
use zenoh::bytes::ZBytes;
use zenoh::qos::Priority;
use zenoh::query::Queryable;

use super::grid_state::{GridPart, GridState, TooLarge};
use super::node::{
    HistoryQuery, PublisherSettings, RosEndpoint, RosLinkError, RosNode, RosPublisher,
};
use crate::config::ros2_output::{Ros2OutputConfig, RosTopicConfig};
use crate::export::voxels::octomap_tree;
use crate::lock;
use crate::publishing::output_inputs::{OutputInputs, OutputSources, VehicleState};
use crate::thread_priority::lower_thread_priority;
use measurement::cloud::{Cloud, CloudPoint};
use measurement::time::{Monotonic, RobotTime};
use measurement::{Measurement, MeasurementData, StreamId};
use network::clock;
use recording::ros::encode;
use recording::ros::middleware::PublishedType;
use recording::ros::published::{
    PATH_POSE_BYTES, grid_map, occupancy_grid, occupancy_grid_update, octomap, odometry, path,
    transforms,
};

/// Longest sleep, so that the end of the run and queries take effect.
const POLL: Duration = Duration::from_millis(100);
/// Interval of attempts to reach the router.
const RETRY_PERIOD: Duration = Duration::from_secs(1);
/// Late subscribers that wait for an answer.
const MAX_QUERIES: usize = 16;

/// How the ROS 2 system is reached.
#[derive(Clone, Debug)]
pub enum RosTarget {
    /// By the session that the sensors use.
    Node(RosNode),
    /// It is connected to as soon as it is there.
    Endpoint(RosEndpoint),
}

impl RosTarget {
    /// `None` if the run ends before the router is there. `missing`: what waits for it.
    pub(super) fn connect(self, missing: &str, is_over: impl Fn() -> bool) -> Option<RosNode> {
        let at = match self {
            Self::Node(node) => return Some(node),
            Self::Endpoint(at) => at,
        };
        let mut is_reported = false;
        loop {
            match RosNode::open(&at) {
                Ok(node) => return Some(node),
                Err(why) if !is_reported => {
                    tracing::warn!(%why, "{missing}");
                    is_reported = true;
                }
                Err(_) => {}
            }
            if !clock::sleep_until(clock::now() + RETRY_PERIOD, &is_over) {
                return None;
            }
        }
    }
}

/// Names of the frames.
#[derive(Clone, Debug)]
struct Frames {
    map: String,
    odom: String,
    base: String,
    odom_to_base: bool,
}

/// Numbers of dropped messages, by topic and reason.
pub type Drops = BTreeMap<(String, &'static str), u64>;

/// The running output. It ends when it is dropped.
pub struct RosOutput {
    inputs: OutputInputs,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<Option<Drops>>>,
}

impl RosOutput {
    /// `odom_frame`, `base_frame`: names of the frames of the poses.
    pub fn start(
        config: &Ros2OutputConfig,
        (odom_frame, base_frame): (&str, &str),
        target: RosTarget,
        sources: OutputSources,
    ) -> std::io::Result<Self> {
        let is_over = Arc::new(AtomicBool::new(false));
        let inputs = sources.inputs.clone();
        let output = Output {
            config: config.clone(),
            frames: Frames {
                map: config.map_frame.clone(),
                odom: odom_frame.to_owned(),
                base: base_frame.to_owned(),
                odom_to_base: config.odom_to_base,
            },
            sources,
            is_over: Arc::clone(&is_over),
        };
        let thread = thread::Builder::new().name("ros2-maps".to_owned());
        let thread = thread.spawn(move || {
            lower_thread_priority();
            let node =
                target.connect("maps are not published to ROS 2 yet", || output.is_over())?;
            let run = output.run(&node);
            run.inspect_err(|why| tracing::error!(%why, "nothing is published to ROS 2"))
                .ok()
        })?;
        Ok(Self {
            inputs,
            is_over,
            thread: Some(thread),
        })
    }

    pub const fn inputs(&self) -> &OutputInputs {
        &self.inputs
    }

    /// Ends it; what was dropped.
    pub fn finish(mut self) -> Drops {
        self.join()
    }

    fn join(&mut self) -> Drops {
        self.is_over.store(true, Ordering::Relaxed);
        let joined = self.thread.take().and_then(|thread| thread.join().ok());
        joined.flatten().unwrap_or_default()
    }
}

impl Drop for RosOutput {
    fn drop(&mut self) {
        self.join();
    }
}

struct Output {
    config: Ros2OutputConfig,
    frames: Frames,
    sources: OutputSources,
    is_over: Arc<AtomicBool>,
}

impl Output {
    fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    fn run(&self, node: &RosNode) -> Result<Drops, RosLinkError> {
        let config = &self.config;
        let grid = |layer| Content::Grid(Box::new(GridState::new(layer)));
        let maps = [
            (&config.map, grid(LayerId::Occupancy)),
            (&config.cost_map, grid(LayerId::Cost)),
            (&config.elevation, Content::Elevation { revision: None }),
            (&config.voxels, Content::Voxels { stamp: None }),
            (&config.obstacles, Content::Obstacles),
            (&config.path, Content::Path),
        ];
        let poses = [
            (&config.tf, Content::Transforms { stamp: None }),
            (&config.odometry, Content::Odometry { stamp: None }),
        ];
        let mut maps = Topics::new(node, maps)?;
        let mut poses = Topics::new(node, poses)?;
        thread::scope(|scope| {
            let thread = thread::Builder::new().name("ros2-poses".to_owned());
            let spawned = thread.spawn_scoped(scope, || poses.run(self));
            if let Err(why) = spawned {
                tracing::error!(%why, "no poses are published to ROS 2");
            }
            maps.run(self);
        });
        Ok(maps.drops().chain(poses.drops()).collect())
    }
}

/// What a message is made of, and how much of it was published.
enum Content {
    Grid(Box<GridState>),
    /// Of the layer.
    Elevation {
        revision: Option<(u32, u64)>,
    },
    Voxels {
        stamp: Option<RobotTime>,
    },
    Obstacles,
    Path,
    Transforms {
        stamp: Option<RobotTime>,
    },
    Odometry {
        stamp: Option<RobotTime>,
    },
}

impl Content {
    const fn kind(&self) -> PublishedType {
        match self {
            Self::Grid(_) => PublishedType::OCCUPANCY_GRID,
            Self::Elevation { .. } => PublishedType::GRID_MAP,
            Self::Voxels { .. } => PublishedType::OCTOMAP,
            Self::Obstacles => PublishedType::POINT_CLOUD,
            Self::Path => PublishedType::PATH,
            Self::Transforms { .. } => PublishedType::TF,
            Self::Odometry { .. } => PublishedType::ODOMETRY,
        }
    }

    /// Whether who subscribes late has the last message. It is made when it is asked for.
    const fn is_kept(&self) -> bool {
        matches!(
            self,
            Self::Grid(_) | Self::Elevation { .. } | Self::Voxels { .. }
        )
    }
}

struct Topic {
    name: String,
    content: Content,
    publisher: RosPublisher,
    /// Of a grid.
    updates: Option<RosPublisher>,
    period: Duration,
    due: Monotonic,
    max_bytes: u64,
    had_subscriber: bool,
    /// Of late subscribers, not answered yet.
    queries: Vec<HistoryQuery>,
    too_large: u64,
    /// Farther from the origin than an `OctoMap` reaches.
    voxels_omitted: u64,
    _kept: Vec<Queryable<()>>,
}

struct Topics {
    topics: Vec<Topic>,
    /// Each with the index of its topic.
    queries: Receiver<(usize, HistoryQuery)>,
    /// Without a sender, waiting for queries would end at once.
    _sender: SyncSender<(usize, HistoryQuery)>,
    unanswered: Arc<AtomicU64>,
}

impl Topics {
    fn new<const COUNT: usize>(
        node: &RosNode,
        contents: [(&Option<RosTopicConfig>, Content); COUNT],
    ) -> Result<Self, RosLinkError> {
        let (sender, queries) = sync_channel(MAX_QUERIES);
        let unanswered = Arc::new(AtomicU64::new(0));
        let named = contents
            .into_iter()
            .filter_map(|(config, content)| Some((config.as_ref()?, content)));
        let topics = named
            .enumerate()
            .map(|(index, (config, content))| {
                let (sender, unanswered) = (sender.clone(), Arc::clone(&unanswered));
                Topic::new(node, config, content, move |query| {
                    if sender.try_send((index, query)).is_err() {
                        unanswered.fetch_add(1, Ordering::Relaxed);
                    }
                })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self {
            topics,
            queries,
            _sender: sender,
            unanswered,
        })
    }

    fn run(&mut self, output: &Output) {
        while let Some(due) = self.topics.iter().map(|topic| topic.due).min()
            && !output.is_over()
        {
            let wait = due.since(clock::now()).min(POLL);
            if let Ok((index, query)) = self.queries.recv_timeout(wait)
                && let Some(topic) = self.topics.get_mut(index)
            {
                topic.queries.push(query);
            }
            for topic in &mut self.topics {
                topic.step(output, clock::now());
            }
        }
    }

    fn drops(&self) -> impl Iterator<Item = ((String, &'static str), u64)> {
        let of_topics = self.topics.iter().flat_map(|topic| {
            let of = |reason, count| ((topic.name.clone(), reason), count);
            [
                of("messages larger than max_kb", topic.too_large),
                of("voxels out of an OctoMap's range", topic.voxels_omitted),
            ]
        });
        let unanswered = self.unanswered.load(Ordering::Relaxed);
        let queries = (
            ("late subscribers".to_owned(), "queries beyond 16 at once"),
            unanswered,
        );
        of_topics.chain([queries]).filter(|(_, count)| *count > 0)
    }
}

/// A message, or why there is none.
enum Made {
    Message(Vec<u8>),
    Nothing,
    /// The octree is requested.
    Later,
    TooLarge,
}

impl Topic {
    fn new(
        node: &RosNode,
        config: &RosTopicConfig,
        content: Content,
        answer: impl Fn(HistoryQuery) + Clone + Send + Sync + 'static,
    ) -> Result<Self, RosLinkError> {
        let settings = PublisherSettings {
            priority: Priority::Data,
            is_kept: content.is_kept(),
            is_bridged: false,
        };
        let mut publisher = node.publisher(&config.topic, content.kind(), settings)?;
        publisher.announce(true)?;
        let updates = match content {
            Content::Grid(_) => {
                let settings = PublisherSettings {
                    is_kept: false,
                    ..settings
                };
                let topic = format!("{}_updates", config.topic);
                let kind = PublishedType::OCCUPANCY_GRID_UPDATE;
                let mut updates = node.publisher(&topic, kind, settings)?;
                updates.announce(true)?;
                Some(updates)
            }
            _ => None,
        };
        let kept = if content.is_kept() {
            publisher.keep(answer)?
        } else {
            Vec::new()
        };
        Ok(Self {
            name: config.topic.clone(),
            content,
            publisher,
            updates,
            period: Duration::from_secs_f64(1.0 / config.rate_hz),
            due: clock::now(),
            max_bytes: config.max_bytes(),
            had_subscriber: false,
            queries: Vec::new(),
            too_large: 0,
            voxels_omitted: 0,
            _kept: kept,
        })
    }

    /// Publishes what is due, and answers late subscribers.
    fn step(&mut self, output: &Output, now: Monotonic) {
        let is_due = now >= self.due;
        if is_due {
            self.due = now + self.period;
        }
        if !is_due && self.queries.is_empty() {
            return;
        }
        let takes_updates = self
            .updates
            .as_ref()
            .is_some_and(RosPublisher::has_subscriber);
        let has_subscriber = takes_updates || self.publisher.has_subscriber();
        let is_new = has_subscriber && !self.had_subscriber;
        self.had_subscriber = has_subscriber;
        if !has_subscriber && self.queries.is_empty() {
            if let Content::Voxels { .. } = self.content {
                output.sources.inputs.cancel_octree();
            }
            return;
        }
        let made = if matches!(self.content, Content::Grid(_)) {
            if has_subscriber {
                self.publish_change(output, now, (is_new, takes_updates));
            }
            // Behind that, so that later updates fit what a late subscriber gets.
            self.whole_grid(output)
        } else {
            self.make(output, is_new || !self.queries.is_empty())
        };
        match made {
            Made::Message(message) if message.len() as u64 <= self.max_bytes => {
                let message = ZBytes::from(message);
                for query in std::mem::take(&mut self.queries) {
                    self.publisher.reply(&query, message.clone());
                }
                if has_subscriber && !matches!(self.content, Content::Grid(_)) {
                    self.publisher.put(message);
                }
            }
            Made::Later => self.due = now + POLL,
            Made::Nothing => self.queries.clear(),
            Made::Message(_) | Made::TooLarge => {
                self.queries.clear();
                self.count_too_large(output);
            }
        }
    }

    /// Publishes what changed of a grid.
    fn publish_change(&mut self, output: &Output, now: Monotonic, takers: (bool, bool)) {
        let Content::Grid(state) = &mut self.content else {
            return;
        };
        let change = {
            let store = lock(&output.sources.store);
            state.take_change(&store, now, takers, self.max_bytes)
        };
        let part = match change {
            Ok(Some(collected)) => state.assemble(&collected),
            Ok(None) => return,
            Err(TooLarge) => return self.count_too_large(output),
        };
        let frame = &output.frames.map;
        match (part.first, &mut self.updates) {
            (Some(first), Some(updates)) => {
                let size = part.size;
                updates.put(occupancy_grid_update(
                    part.stamp,
                    frame,
                    first,
                    size,
                    &part.cells,
                ));
            }
            _ => self.publisher.put(grid_message(frame, &part)),
        }
    }

    /// For late subscribers.
    fn whole_grid(&self, output: &Output) -> Made {
        let Content::Grid(state) = &self.content else {
            return Made::Nothing;
        };
        if self.queries.is_empty() {
            return Made::Nothing;
        }
        let whole = state.whole(&lock(&output.sources.store), self.max_bytes);
        match whole {
            Ok(Some(collected)) => Made::Message(grid_message(
                &output.frames.map,
                &state.assemble(&collected),
            )),
            Ok(None) => Made::Nothing,
            Err(TooLarge) => Made::TooLarge,
        }
    }

    /// `is_asked`: also if it has not changed since the last time.
    fn make(&mut self, output: &Output, is_asked: bool) -> Made {
        let Output {
            frames, sources, ..
        } = output;
        match &mut self.content {
            Content::Grid(_) => Made::Nothing,
            Content::Elevation { revision } => {
                let layer = LayerId::Elevation;
                let (newest, stamp, tiles) = {
                    let store = lock(&sources.store);
                    let newest = (store.epoch(layer), store.head_revision(layer));
                    if revision.replace(newest) == Some(newest) && !is_asked {
                        return Made::Nothing;
                    }
                    (
                        newest,
                        newest_stamp(&store, layer),
                        KnownTiles::of_layer(&store, layer),
                    )
                };
                *revision = Some(newest);
                let raster = tiles.and_then(|tiles| tiles.into_raster(self.max_bytes / 4));
                made_of(raster, |raster| {
                    elevation_message(stamp, &frames.map, raster)
                })
            }
            Content::Voxels { stamp } => {
                let Some((at, octree)) = sources.inputs.take_octree() else {
                    return Made::Later;
                };
                if stamp.replace(at) == Some(at) && !is_asked {
                    return Made::Nothing;
                }
                match octomap_tree(&octree) {
                    Ok((tree, omitted)) => {
                        self.voxels_omitted += omitted;
                        Made::Message(octomap(at, &frames.map, octree.cell_m(), &tree))
                    }
                    Err(why) => {
                        tracing::error!(%why, "the octree is not published");
                        Made::Nothing
                    }
                }
            }
            Content::Obstacles => {
                let (stamp, obstacles, heights) = {
                    let store = lock(&sources.store);
                    let tiles = |layer| KnownTiles::of_layer(&store, layer);
                    (
                        newest_stamp(&store, LayerId::Obstacle),
                        tiles(LayerId::Obstacle),
                        tiles(LayerId::Elevation),
                    )
                };
                let raster = |tiles: Result<KnownTiles, _>| tiles?.into_raster(MAX_RASTER_CELLS);
                let heights = raster(heights).ok().flatten();
                made_of(raster(obstacles), |obstacles| {
                    obstacle_message(stamp, &frames.map, obstacles, heights.as_ref())
                })
            }
            Content::Path => {
                let pose_bytes = (PATH_POSE_BYTES + frames.map.len()) as u64;
                let most = usize::try_from(self.max_bytes / pose_bytes).unwrap_or(usize::MAX);
                let poses = sources.trajectory.snapshot().thinned(most);
                let Some(last) = poses.last() else {
                    return Made::Nothing;
                };
                let stamp = RobotTime::from_nanos(last.stamp_ns);
                let poses = poses.iter().map(|pose| {
                    let stamp = RobotTime::from_nanos(pose.stamp_ns);
                    (stamp, pose.position_m(), pose.quaternion_xyzw())
                });
                Made::Message(path(stamp, &frames.map, poses))
            }
            Content::Transforms { stamp } => of_vehicle(sources, stamp, |vehicle| {
                let [map, odom, base] = [&frames.map, &frames.odom, &frames.base];
                let of_odom = vehicle.map_from_odom.map(|pose| (&**map, &**odom, pose));
                let of_base = (&**odom, &**base, vehicle.odom_from_base);
                let of_base = frames.odom_to_base.then_some(of_base);
                let both: Vec<_> = of_odom.into_iter().chain(of_base).collect();
                transforms(vehicle.stamp, &both)
            }),
            Content::Odometry { stamp } => of_vehicle(sources, stamp, |vehicle| {
                let pose = &vehicle.odom_from_base;
                odometry(
                    vehicle.stamp,
                    (&frames.odom, &frames.base, pose),
                    &vehicle.twist,
                )
            }),
        }
    }

    fn count_too_large(&mut self, output: &Output) {
        self.too_large += 1;
        if self.too_large == 1 {
            let (topic, max_kb) = (&self.name, self.max_bytes / 1000);
            let message = format!(
                "{topic} is not published to ROS 2: its messages are larger than the {max_kb} kB of its `max_kb`"
            );
            tracing::warn!(message);
            output.sources.inputs.add_warning(message);
        }
    }
}

/// A message of the newest pose, once for each.
fn of_vehicle(
    sources: &OutputSources,
    sent: &mut Option<RobotTime>,
    message: impl FnOnce(VehicleState) -> Vec<u8>,
) -> Made {
    let newest = sources.inputs.vehicle();
    match newest.filter(|vehicle| *sent != Some(vehicle.stamp)) {
        Some(vehicle) => {
            *sent = Some(vehicle.stamp);
            Made::Message(message(vehicle))
        }
        None => Made::Nothing,
    }
}

fn newest_stamp(store: &TileStore, layer: LayerId) -> RobotTime {
    let stamps = store.tiles(layer).map(|(_, stored)| stored.stamp_ns());
    RobotTime::from_nanos(stamps.max().unwrap_or_default())
}

fn made_of(
    raster: Result<Option<Raster>, MosaicError>,
    message: impl FnOnce(&Raster) -> Option<Vec<u8>>,
) -> Made {
    match raster {
        Ok(Some(raster)) => message(&raster).map_or(Made::Nothing, Made::Message),
        Ok(None) | Err(MosaicError::NoGrid(_)) => Made::Nothing,
        Err(MosaicError::TooLarge { .. }) => Made::TooLarge,
    }
}

fn grid_message(frame: &str, part: &GridPart) -> Vec<u8> {
    let place = (part.cell_m, part.origin_m);
    occupancy_grid(part.stamp, frame, place, part.size, &part.cells)
}

fn elevation_message(stamp: RobotTime, frame: &str, raster: &Raster) -> Option<Vec<u8>> {
    let quantisation = raster.layer().quantisation();
    let (width, height) = (raster.width(), raster.height());
    let (mut codes, mut values) = (Vec::new(), Vec::with_capacity(width * height));
    for y in (0..height).rev() {
        raster.read_row(y, &mut codes);
        let row = codes.iter().rev();
        values.extend(row.map(|&code| quantisation.decode(code).unwrap_or(f32::NAN)));
    }
    let (low, high) = raster.corners_m();
    let centre_m = [0, 1].map(|axis| 0.5 * (low[axis] + high[axis]));
    let size = [u32::try_from(width).ok()?, u32::try_from(height).ok()?];
    let place = (raster.cell_m(), centre_m);
    let layer = raster.layer().name();
    Some(grid_map(stamp, frame, place, layer, size, &values))
}

/// The middles of the cells with obstacles, as high as the elevation map says there, else at zero.
fn obstacle_message(
    stamp: RobotTime,
    frame: &str,
    obstacles: &Raster,
    heights: Option<&Raster>,
) -> Option<Vec<u8>> {
    let quantisation = obstacles.layer().quantisation();
    let ([left_m, low_m], _) = obstacles.corners_m();
    let cell_m = obstacles.cell_m();
    let middle_m = |first_m: f64, cell: usize| first_m + (cell as f64 + 0.5) * cell_m;
    let (mut codes, mut points) = (Vec::new(), Vec::new());
    for y in 0..obstacles.height() {
        obstacles.read_row(y, &mut codes);
        for (x, &code) in codes.iter().enumerate() {
            if quantisation.decode(code).is_some_and(|class| class > 0.0) {
                let (x_m, y_m) = (middle_m(left_m, x), middle_m(low_m, y));
                let z_m = heights.and_then(|heights| heights.value_at(x_m, y_m));
                points.push(CloudPoint {
                    position_m: [x_m as f32, y_m as f32, z_m.unwrap_or(0.0)],
                    after_s: 0.0,
                    intensity: 0.0,
                    ring: None,
                });
            }
        }
    }
    let cloud = Measurement {
        stamp,
        stream: StreamId(0),
        frame: frame.into(),
        data: MeasurementData::Cloud(Cloud {
            points,
            without_return: 0,
        }),
    };
    Some(encode(&cloud, PublishedType::POINT_CLOUD.name)?.1)
}

#[cfg(test)]
mod tests;
