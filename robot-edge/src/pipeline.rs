//! Measurements in stamp order in, published tiles out: one vehicle's maps, whatever the source.

use protocol::message::Shores;
use protocol::tile::BootId;

use crate::clock::Monotonic;
use crate::config::Config;
use crate::drops::DropCounts;
use crate::localization::config::OnJump;
use crate::localization::placer::{BeamPlacer, Placed, PlacerSettings};
use crate::localization::pose_jump::PoseJump;
use crate::mapping::Mapper;
use crate::mapping::posed_scan::PosedScan;
use crate::measurement::Measurement;
use crate::robot_time::{RobotDuration, RobotTime};
use crate::streaming::publisher::{PublishError, Publisher};
use crate::streaming::shores::shores;
use crate::summary::StageTimer;

mod checkpoint;
mod standstill;

pub use checkpoint::Checkpoint;
pub use standstill::Standstill;

/// Places, maps and publishes. It owns no thread: whoever holds it calls it.
pub struct Pipeline {
    placer: BeamPlacer,
    mapper: Mapper,
    publisher: Publisher,
    publish_period: RobotDuration,
    published_at: Option<RobotTime>,
    scans_unpublished: u32,
    placed: Vec<Placed>,
    report: PipelineReport,
    on_jump: OnJump,
    happenings: Vec<Happening>,
    evictions_told: Option<RobotTime>,
    shores_taken: u32,
    last_scan: Option<RobotTime>,
}

/// Whoever wants to see scans on their way into the map.
pub trait ScanObserver {
    /// The beams of a scan were placed; it is not in the map yet.
    fn placed(&mut self, _scan: &PosedScan, _mapper: &Mapper) {}

    /// A scan got into the map.
    fn mapped(&mut self, scan: &PosedScan, mapper: &Mapper);
}

/// Nobody looks.
impl ScanObserver for () {
    fn mapped(&mut self, _scan: &PosedScan, _mapper: &Mapper) {}
}

impl<F: FnMut(&PosedScan)> ScanObserver for F {
    fn mapped(&mut self, scan: &PosedScan, _mapper: &Mapper) {
        self(scan);
    }
}

/// Something that the people who watch should know.
#[derive(Clone, Debug, PartialEq)]
pub struct Happening {
    /// When, on the clock of the data.
    pub stamp: RobotTime,
    /// What, in one word: `ground_plane` or `pose_jump`.
    pub kind: &'static str,
    /// What, in a sentence, with the reason.
    pub message: String,
}

/// What became of everything so far.
#[derive(Clone, Debug, Default)]
pub struct PipelineReport {
    /// Scans that are in the map.
    pub scans_mapped: u64,
    /// Beams that marked a hit.
    pub hits: u64,
    /// Beams without a return.
    pub misses: u64,
    /// Beams that no layer could take, by reason.
    pub dropped_beams: DropCounts,
    /// Bricks that left the octree to keep its memory limit.
    pub evicted_bricks: u64,
    /// Time spent per scan in placing its beams and in each layer, and per publication.
    pub stages: Stages,
}

/// Where time goes.
#[derive(Clone, Debug, Default)]
pub struct Stages {
    /// Waiting for poses and placing beams, per measurement.
    pub place: StageTimer,
    /// Updating every layer, per scan.
    pub mapping: StageTimer,
    /// Turning changed cells into stored tiles, per publication.
    pub publish: StageTimer,
}

/// Least time between two tellings of evictions.
const EVICTIONS_APART: RobotDuration = RobotDuration::from_nanos(10_000_000_000);

/// Scans after which is published, whatever their stamps say.
const MAX_SCANS_UNPUBLISHED: u32 = 250;

impl Pipeline {
    /// Empty maps of a vehicle. `encode`: see [`Publisher::new`].
    ///
    /// # Errors
    /// Where the tile store cannot be set up.
    pub fn new(
        config: &Config,
        placer: PlacerSettings,
        boot: BootId,
        encode: bool,
    ) -> Result<Self, PublishError> {
        let mapper = Mapper::new(
            &config.mapping,
            config.vehicle.shape(),
            &config.range_models(),
        );
        let publisher = Publisher::new(boot, config.streaming.store_mb, &mapper, encode)?;
        Ok(Self {
            placer: BeamPlacer::new(placer),
            mapper,
            publisher,
            publish_period: RobotDuration::from_secs_f64(config.streaming.publish_period_s),
            published_at: None,
            scans_unpublished: 0,
            placed: Vec::new(),
            report: PipelineReport::default(),
            on_jump: config.localization.on_jump,
            happenings: Vec::new(),
            evictions_told: None,
            shores_taken: 0,
            last_scan: None,
        })
    }

    /// Stamp of the newest scan in the map.
    pub const fn last_scan(&self) -> Option<RobotTime> {
        self.last_scan
    }

    /// Takes one measurement. Every scan is shown to `observer`.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn push(
        &mut self,
        measurement: Measurement,
        observer: impl ScanObserver,
    ) -> Result<(), PublishError> {
        let started = Monotonic::now();
        self.placer.push(measurement, &mut self.placed);
        self.report.stages.place.record(started.elapsed());
        self.map_placed(observer)
    }

    /// The clock of the data started anew.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn reset_clock(&mut self, observer: impl ScanObserver) -> Result<(), PublishError> {
        self.placer.reset_clock(&mut self.placed);
        self.published_at = None;
        self.map_placed(observer)
    }

    /// The data ended: maps what still waits and publishes all of it.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn finish(&mut self, observer: impl ScanObserver) -> Result<(), PublishError> {
        self.placer.finish(&mut self.placed);
        self.map_placed(observer)?;
        self.mapper.refresh();
        self.publish()
    }

    fn map_placed(&mut self, mut observer: impl ScanObserver) -> Result<(), PublishError> {
        let mut placed = std::mem::take(&mut self.placed);
        for placed in &placed {
            let scan = match placed {
                Placed::Scan(scan) => scan,
                Placed::Jump(jump) => {
                    self.jumped(jump);
                    continue;
                }
            };
            observer.placed(scan, &self.mapper);
            let started = Monotonic::now();
            let map = self.mapper.integrate(scan);
            self.report.stages.mapping.record(started.elapsed());
            self.report.scans_mapped += 1;
            self.last_scan = Some(scan.stamp);
            self.report.hits += map.hits;
            self.report.misses += map.misses;
            self.report.dropped_beams.merge(&map.dropped_beams);
            self.tell_evictions(scan.stamp, map.evicted_bricks);
            if let Some(change) = map.ground_change {
                self.tell(change.stamp, "ground_plane", change.to_string());
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
        }
        placed.clear();
        self.placed = placed;
        Ok(())
    }

    fn jumped(&mut self, jump: &PoseJump) {
        let maps = match self.on_jump {
            OnJump::Keep => "the maps were kept",
            OnJump::Reset => {
                self.mapper.reset();
                "the maps were erased"
            }
        };
        let message = format!("the poses jumped by {:.2} m: {maps}", jump.distance_m);
        self.tell(jump.stamp, "pose_jump", message);
    }

    /// Tells of bricks that left the octree, not more often than a person could read it.
    fn tell_evictions(&mut self, stamp: RobotTime, bricks: u32) {
        if bricks == 0 {
            return;
        }
        self.report.evicted_bricks += u64::from(bricks);
        let told = self.evictions_told.filter(|&told| told <= stamp);
        if told.is_none_or(|told| stamp.since(told) >= EVICTIONS_APART) {
            self.evictions_told = Some(stamp);
            let bricks = self.report.evicted_bricks;
            let message = format!(
                "the octree is at its memory limit (mapping.octree.memory_limit_mb): {bricks} bricks farthest from the \
                 vehicle are gone so far"
            );
            self.tell(stamp, "voxels_evicted", message);
        }
    }

    fn tell(&mut self, stamp: RobotTime, kind: &'static str, message: String) {
        tracing::info!(%stamp, kind, message);
        self.happenings.push(Happening {
            stamp,
            kind,
            message,
        });
    }

    /// What happened since the last call, in order.
    pub fn take_happenings(&mut self) -> Vec<Happening> {
        std::mem::take(&mut self.happenings)
    }

    fn publish(&mut self) -> Result<(), PublishError> {
        let started = Monotonic::now();
        // Before the first scan there is nothing to publish.
        let stamp = self.last_scan.unwrap_or_default();
        self.publisher.publish(&mut self.mapper, stamp)?;
        self.report.stages.publish.record(started.elapsed());
        Ok(())
    }

    /// What became of scans and beams on their way to a pose.
    pub fn placer(&self) -> &BeamPlacer {
        &self.placer
    }

    /// The maps.
    pub const fn mapper(&self) -> &Mapper {
        &self.mapper
    }

    /// The tiles that were published since the last call.
    pub fn take_changed_tiles(&mut self) -> Vec<protocol::tile::TileKey> {
        self.publisher.take_changed()
    }

    /// Shores and docking sites, where they are mapped.
    pub fn shores(&self) -> Option<Shores> {
        let voxels = self.mapper.voxels()?;
        let cell_m = voxels.octree().cell_m();
        Some(shores(voxels.shore()?, cell_m, self.placer.datum()))
    }

    /// Shores and docking sites if they were brought up to date since the last call, and the stamp of the last scan.
    pub fn take_shores(&mut self) -> Option<(RobotTime, Shores)> {
        let updates = self.mapper.voxels()?.shore()?.updates();
        if std::mem::replace(&mut self.shores_taken, updates) == updates {
            return None;
        }
        Some((self.last_scan?, self.shores()?))
    }

    /// What was published.
    pub const fn publisher(&self) -> &Publisher {
        &self.publisher
    }

    /// What became of everything so far.
    pub const fn report(&self) -> &PipelineReport {
        &self.report
    }
}
