//! Placed scans in, published tiles out.

use protocol::message::Shores;
use protocol::tile::{BootId, TileKey};

use super::{MapEvent, ScanObserver};
use crate::clock;
use crate::config::Config;
use crate::streaming::publisher::{PublishError, Publisher};
use crate::streaming::shores::shores;
use crate::summary::StageTimer;
use localization::config::OnJump;
use localization::geodesy::GeodeticPoint;
use localization::pose_jump::PoseJump;
use localization::registration::RegistrationOutput;
use mapping::Mapper;
use measurement::drops::{DropCounts, DropReason};
use measurement::time::{RobotDuration, RobotTime};

/// Maps and publishes. It owns no thread: whoever holds it calls it.
pub struct Maps {
    pub(super) mapper: Mapper,
    pub(super) publisher: Publisher,
    pub(super) publish_period: RobotDuration,
    pub(super) published_at: Option<RobotTime>,
    pub(super) scans_unpublished: u32,
    pub(super) report: MapsReport,
    pub(super) on_jump: OnJump,
    pub(super) map_events: Vec<MapEvent>,
    pub(super) evictions_reported_at: Option<RobotTime>,
    pub(super) shore_updates_taken: u32,
    pub(super) last_scan: Option<RobotTime>,
    /// Where on Earth `odom` is, as far as that is known.
    pub(super) datum: Option<GeodeticPoint>,
}

/// What became of placed scans so far.
#[derive(Clone, Debug, Default)]
pub struct MapsReport {
    /// Scans that are in the map.
    pub scans_mapped: u64,
    /// Placed scans that were left out, by reason.
    pub dropped_scans: DropCounts,
    /// Beams that marked a hit.
    pub hits: u64,
    /// Beams without a return.
    pub misses: u64,
    /// Beams that no layer could take, by reason.
    pub dropped_beams: DropCounts,
    /// Bricks that left the octree to keep its memory limit.
    pub evicted_bricks: u64,
    /// Time spent per scan in the layers, and per publication.
    pub stages: StageTimers,
}

/// Where time goes.
#[derive(Clone, Debug, Default)]
pub struct StageTimers {
    /// Updating every layer, per scan.
    pub mapping: StageTimer,
    /// Turning changed cells into stored tiles, per publication.
    pub publish: StageTimer,
}

/// Least time between two tellings of evictions.
const EVICTION_REPORT_INTERVAL: RobotDuration = RobotDuration::from_nanos(10_000_000_000);

/// Scans after which is published, whatever their stamps say.
const MAX_SCANS_UNPUBLISHED: u32 = 250;

impl Maps {
    /// Empty maps of a vehicle. `encode`: see [`Publisher::new`].
    ///
    /// # Errors
    /// Where the tile store cannot be set up.
    pub fn new(config: &Config, boot: BootId, encode: bool) -> Result<Self, PublishError> {
        let mapper = Mapper::new(
            &config.mapping,
            config.vehicle.shape(),
            &config.range_models(),
        );
        let publisher = Publisher::new(boot, config.streaming.tile_store_mb, &mapper, encode)?;
        Ok(Self {
            mapper,
            publisher,
            publish_period: RobotDuration::from_secs_f64(config.streaming.publish_period_s),
            published_at: None,
            scans_unpublished: 0,
            report: MapsReport::default(),
            on_jump: config.localization.on_jump,
            map_events: Vec::new(),
            evictions_reported_at: None,
            shore_updates_taken: 0,
            last_scan: None,
            datum: None,
        })
    }

    /// Takes what was placed, in the order of the data. Every scan is shown to `observer`.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn take(
        &mut self,
        placed: &RegistrationOutput,
        observer: &mut impl ScanObserver,
    ) -> Result<(), PublishError> {
        let scan = match placed {
            RegistrationOutput::Scan(scan) => scan,
            RegistrationOutput::Jump(jump) => {
                self.on_pose_jump(jump);
                return Ok(());
            }
        };
        let started = clock::now();
        let map = self.mapper.integrate(scan);
        self.report.stages.mapping.record(clock::elapsed(started));
        self.report.scans_mapped += 1;
        self.last_scan = Some(scan.stamp);
        self.report.hits += map.hits;
        self.report.misses += map.misses;
        self.report.dropped_beams.merge(&map.dropped_beams);
        self.report_evictions(scan.stamp, map.evicted_bricks);
        if let Some(change) = map.ground_plane_reset {
            self.add_event(change.stamp, "ground_plane", change.to_string());
        }
        observer.mapped(scan, &self.mapper);
        self.scans_unpublished += 1;
        // Time of the data, so that what is published does not depend on the speed of a replay; and a
        // number of scans, because stamps may stand still and memory has limits.
        let due = self.scans_unpublished >= MAX_SCANS_UNPUBLISHED
            || self
                .published_at
                .is_none_or(|at| scan.stamp.since(at) >= self.publish_period);
        if due {
            self.published_at = Some(scan.stamp);
            self.scans_unpublished = 0;
            self.publish()?;
        }
        Ok(())
    }

    /// A placed scan does not get into the maps, for this reason.
    pub fn count_dropped(&mut self, reason: DropReason) {
        self.report.dropped_scans.add(reason);
    }

    /// The clock of the data started anew; what waited by the old one is still to come.
    pub const fn reset_clock(&mut self) {
        self.published_at = None;
    }

    /// The data ended: publishes all of it.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn finish(&mut self) -> Result<(), PublishError> {
        self.mapper.refresh();
        self.publish()
    }

    /// Where on Earth the origin of `odom` lies, as [`ScanRegistration::datum`](localization::registration::ScanRegistration::datum)
    /// tells it: shores are told with it.
    pub const fn set_datum(&mut self, datum: Option<GeodeticPoint>) {
        self.datum = datum;
    }

    fn on_pose_jump(&mut self, jump: &PoseJump) {
        let maps = match self.on_jump {
            OnJump::Keep => "the maps were kept",
            OnJump::Reset => {
                self.mapper.reset();
                "the maps were erased"
            }
        };
        let message = format!("the poses jumped by {:.2} m: {maps}", jump.distance_m);
        self.add_event(jump.stamp, "pose_jump", message);
    }

    /// Tells of bricks that left the octree, not more often than a person could read it.
    fn report_evictions(&mut self, stamp: RobotTime, bricks: u32) {
        if bricks == 0 {
            return;
        }
        self.report.evicted_bricks += u64::from(bricks);
        let reported_at = self
            .evictions_reported_at
            .filter(|&reported_at| reported_at <= stamp);
        if reported_at
            .is_none_or(|reported_at| stamp.since(reported_at) >= EVICTION_REPORT_INTERVAL)
        {
            self.evictions_reported_at = Some(stamp);
            let bricks = self.report.evicted_bricks;
            let message = format!(
                "the octree is at its memory limit (mapping.octree.memory_limit_mb): {bricks} bricks farthest from the \
                 vehicle are gone so far"
            );
            self.add_event(stamp, "voxels_evicted", message);
        }
    }

    fn add_event(&mut self, stamp: RobotTime, kind: &'static str, message: String) {
        tracing::info!(%stamp, kind, message);
        self.map_events.push(MapEvent {
            stamp,
            kind,
            message,
        });
    }

    /// What happened since the last call, in order.
    pub fn take_map_events(&mut self) -> Vec<MapEvent> {
        std::mem::take(&mut self.map_events)
    }

    fn publish(&mut self) -> Result<(), PublishError> {
        let started = clock::now();
        // Before the first scan there is nothing to publish.
        let stamp = self.last_scan.unwrap_or_default();
        self.publisher.publish(&mut self.mapper, stamp)?;
        self.report.stages.publish.record(clock::elapsed(started));
        Ok(())
    }

    /// Stamp of the newest scan in the map.
    pub const fn last_scan(&self) -> Option<RobotTime> {
        self.last_scan
    }

    /// The maps.
    pub const fn mapper(&self) -> &Mapper {
        &self.mapper
    }

    /// The tiles that were published since the last call.
    pub fn take_changed_tiles(&mut self) -> Vec<TileKey> {
        self.publisher.take_changed()
    }

    /// Shores and docking sites, where they are mapped.
    pub fn shores(&self) -> Option<Shores> {
        let voxels = self.mapper.voxels()?;
        let cell_m = voxels.octree().cell_m();
        Some(shores(voxels.shore()?, cell_m, self.datum))
    }

    /// Shores and docking sites if they were brought up to date since the last call, and the stamp of the last scan.
    pub fn take_shores(&mut self) -> Option<(RobotTime, Shores)> {
        let updates = self.mapper.voxels()?.shore()?.updates();
        if std::mem::replace(&mut self.shore_updates_taken, updates) == updates {
            return None;
        }
        Some((self.last_scan?, self.shores()?))
    }

    /// What was published.
    pub const fn publisher(&self) -> &Publisher {
        &self.publisher
    }

    /// What became of placed scans so far.
    pub const fn report(&self) -> &MapsReport {
        &self.report
    }
}
