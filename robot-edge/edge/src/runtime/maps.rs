//! The maps of a vehicle: registered scans in, published tiles out.

mod paused_snapshot;

use std::borrow::Cow;
use std::io;
use std::sync::Arc;

use protocol::message::Shores;
use protocol::tile::{BootId, TileKey};

use super::kept_scans::KeptScans;
use super::map_correction::{CorrectionCheckpoint, MapCorrection, placed};
use super::searched_map::{SearchedMap, SearchedMapCheckpoint};
use super::temporary_file::TemporaryFile;
use crate::config::Config;
use crate::publishing::cells_to_tiles::shores;
use crate::publishing::publisher::{PublishError, Publisher, PublisherState};
use crate::summary::StageTimer;
use localization::OnJump;
use localization::pose_buffer::PoseJump;
use localization::scan_localization::{ConfidenceChange, MapFromOdom, PoseConfidence};
use mapping::Mapper;
use mapping::cost_map::CostMap;
use mapping::depth::DepthMap;
use mapping::occupancy_grid::OccupancyGrid;
use mapping::octree::{BlockFile, LimitedBricks};
use mapping::registered_scan::RegisteredScan;
use mapping::terrain::Terrain;
use measurement::drops::{DropCounts, DropReason};
use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};
use network::clock;
pub use paused_snapshot::PausedSnapshot;
use protocol::geodesy::GeodeticPoint;

/// Minimum time between two reports of evictions.
const EVICTION_REPORT_INTERVAL: RobotDuration = RobotDuration::from_nanos(10_000_000_000);

/// Maximum number of scans between two publications, whatever their stamps are.
const MAX_SCANS_UNPUBLISHED: u32 = 250;

pub struct Maps {
    mapper: Mapper,
    publisher: Publisher,
    tile_store_mb: u32,
    publish_period: RobotDuration,
    on_jump: OnJump,
    events: Vec<MapEvent>,
    progress: MapsProgress,
    /// Where scans are matched and loops closed.
    correction: Option<MapCorrection>,
    /// Where `odom` lay in the maps before they were made again, and where it lies now.
    corrected: Option<(Arc<MapFromOdom>, Arc<MapFromOdom>)>,
    searched: Option<SearchedMap>,
}

/// The part of [`Maps`] that a checkpoint copies besides the layers and the tiles.
#[derive(Clone, Debug, Default)]
struct MapsProgress {
    published_at: Option<RobotTime>,
    scans_unpublished: u32,
    report: MapsReport,
    evictions_reported_at: Option<RobotTime>,
    shore_updates_taken: u32,
    last_scan: Option<RobotTime>,
    /// Position of the origin of `odom` on Earth, if it is known.
    datum: Option<GeodeticPoint>,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapUpdate {
    pub changed_tiles: Vec<TileKey>,
    /// In the order of the data.
    pub events: Vec<MapEvent>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct MapEvent {
    /// On the clock of the data.
    pub stamp: RobotTime,
    /// `ground_plane`, `pose_jump`, `loop_closed`, `localization_…` or `voxels_evicted`.
    pub kind: &'static str,
    /// One sentence with the reason.
    pub message: String,
}

#[derive(Clone, Debug, Default)]
pub struct MapsReport {
    pub scans_mapped: u64,
    /// Registered scans that were dropped, by reason.
    pub dropped_scans: DropCounts,
    pub hits: u64,
    /// Beams without a return.
    pub misses: u64,
    /// Beams that no layer used, by reason.
    pub dropped_beams: DropCounts,
    /// What the octree's memory limit did.
    pub limited: LimitedBricks,
    /// Processing time of updating all layers, per scan.
    pub mapping_time: StageTimer,
    /// Processing time of converting changed cells to stored tiles, per publication.
    pub publish_time: StageTimer,
}

#[derive(Clone, Debug)]
pub struct MapsCheckpoint {
    mapper: Mapper,
    publisher: PublisherState,
    progress: MapsProgress,
    correction: Option<CorrectionCheckpoint>,
    searched: Option<SearchedMapCheckpoint>,
}

impl MapsCheckpoint {
    /// Memory of the layers and the tiles, bytes; the rest is negligible.
    pub fn bytes(&self) -> usize {
        let occupancy = self.mapper.occupancy().map_or(0, OccupancyGrid::bytes);
        let terrain = self.mapper.terrain().map_or(0, Terrain::bytes);
        let voxels = self.mapper.voxels().map_or(0, |voxels| {
            let octree = voxels.octree();
            let cost = voxels.cost().map_or(0, CostMap::bytes);
            let depth = voxels.depth().map_or(0, DepthMap::bytes);
            octree.bytes() + octree.scratch_bytes() + cost + depth
        });
        let searched = self.searched.as_ref();
        let searched = searched.map_or(0, SearchedMapCheckpoint::bytes);
        occupancy + terrain + voxels + self.publisher.bytes() + searched
    }
}

fn mapper(config: &Config) -> Mapper {
    let mut mapper = Mapper::new(
        &config.mapping,
        config.vehicle.shape(),
        &config.range_models(),
    );
    if let Some(voxels) = mapper.voxels_mut() {
        let file: Arc<dyn BlockFile> = Arc::new(TemporaryFile::default());
        voxels.keep_on_disk(&file);
    }
    mapper
}

impl Maps {
    /// Empty maps of a vehicle. `encode`: see [`Publisher::new`].
    pub fn new(config: &Config, boot: BootId, encode: bool) -> Result<Self, PublishError> {
        let mapper = mapper(config);
        Ok(Self {
            publisher: Publisher::new(boot, config.streaming.tile_store_mb, &mapper, encode)?,
            mapper,
            tile_store_mb: config.streaming.tile_store_mb,
            publish_period: RobotDuration::from_secs_f64(config.streaming.publish_period_s),
            on_jump: config.localization.on_jump,
            events: Vec::new(),
            progress: MapsProgress::default(),
            correction: None,
            corrected: None,
            searched: None,
        })
    }

    /// Keeps scans, to make the maps again where a loop is closed.
    pub(super) fn with_correction(mut self, correction: MapCorrection) -> Self {
        self.correction = Some(correction);
        self
    }

    /// Publishes a saved map until the vehicle is found in it. `saved`: where `odom` of its runs lies in it.
    pub(super) fn going_on(
        self,
        correction: MapCorrection,
        saved: Arc<MapFromOdom>,
    ) -> anyhow::Result<Self> {
        let mut maps = self.with_correction(correction);
        maps.search(saved)?;
        Ok(maps)
    }

    fn search(&mut self, map_from_odom: Arc<MapFromOdom>) -> anyhow::Result<()> {
        if let Some(correction) = &mut self.correction {
            let making = correction.make(Arc::clone(&map_from_odom))?;
            let searched = SearchedMap::new(
                map_from_odom,
                Some(making),
                &self.mapper,
                self.tile_store_mb,
            )?;
            self.searched = Some(searched);
        }
        Ok(())
    }

    /// The vehicle was not found: publishes the map of the run.
    fn stop_searching(&mut self) -> Result<(), PublishError> {
        let Some(searched) = self.searched.take() else {
            return Ok(());
        };
        self.publisher.restart(&self.mapper)?;
        self.publisher.replace(&searched.of_run)
    }

    /// The kept scans; `None` if scans are not matched.
    pub(super) fn kept_scans(&mut self) -> Option<&mut KeptScans> {
        Some(self.correction.as_mut()?.kept())
    }

    /// A scan as it lies in the maps.
    pub(super) fn placed<'a>(&self, scan: &'a RegisteredScan) -> Cow<'a, RegisteredScan> {
        placed(scan, &self.map_from_odom())
    }

    /// Where `odom` lies in the maps.
    pub(super) fn map_from_odom(&self) -> Pose {
        let correction = self.correction.as_ref();
        correction.map_or_else(Pose::identity, MapCorrection::map_from_odom)
    }

    /// A loop was closed, or a new map begins.
    pub(super) fn correct(&mut self, way: Arc<MapFromOdom>) {
        let Some(correction) = &mut self.correction else {
            return;
        };
        if !way.begins_map {
            return correction.correct(way);
        }
        let before = Arc::clone(correction.in_effect());
        correction.begin_map(Arc::clone(&way));
        self.corrected = Some((before, way));
        self.searched = None;
        self.mapper.reset();
        let stamp = self.progress.last_scan.unwrap_or_default();
        let message =
            "a new map begins: nothing says how the old one lies to it, until a closure does";
        self.add_event(stamp, "new_map", message.to_owned());
    }

    /// Where `odom` lay in the maps before, and where it lies now, if the maps were made again since the last call.
    pub(super) fn take_correction(&mut self) -> Option<(Arc<MapFromOdom>, Arc<MapFromOdom>)> {
        self.corrected.take()
    }

    /// Keeps a scan, in `odom`, that was mapped, and exchanges the maps if that is due.
    ///
    /// If that fails, as on a full disk, mapping and driving go on: the maps are not corrected any more.
    pub(super) fn keep(&mut self, scan: &RegisteredScan) -> Result<(), PublishError> {
        let Some(correction) = &mut self.correction else {
            return Ok(());
        };
        let before = Arc::clone(correction.in_effect());
        match correction.keep(scan, self.progress.report.scans_mapped) {
            Ok(Some(maps)) => self.exchange(maps, before),
            Ok(None) => Ok(()),
            Err(error) => {
                let message = format!("loops correct the maps no more: {error:#}");
                self.add_event(scan.stamp, "correction_stopped", message);
                Ok(())
            }
        }
    }

    /// Adds kept scans.
    pub(super) fn add_kept(
        &mut self,
        scans: &mut dyn Iterator<Item = io::Result<(u32, RegisteredScan)>>,
        way: &MapFromOdom,
    ) -> anyhow::Result<()> {
        for scan in scans {
            let (session, scan) = scan?;
            // What is not in this map waits for a closure.
            if let Some(map_from_odom) = way.at((session, scan.stamp)) {
                self.integrate(&placed(&scan, &map_from_odom));
                self.publish_if_due()?;
            }
        }
        Ok(())
    }

    /// Replaces all layers and tiles by those of `maps`. Tiles that are the same are not published again.
    fn exchange(&mut self, mut maps: Self, before: Arc<MapFromOdom>) -> Result<(), PublishError> {
        maps.finish()?;
        self.publish()?;
        self.searched = None;
        self.publisher.replace(&maps.publisher)?;
        self.mapper = maps.mapper;
        let stamp = self.progress.last_scan.unwrap_or_default();
        if let Some(correction) = &self.correction {
            let now = Arc::clone(correction.in_effect());
            let moved_m = now.distance_m(&before);
            let message = if moved_m.is_finite() {
                format!(
                    "a loop was closed: the maps were made again, places moved by up to {moved_m:.2} m"
                )
            } else {
                "an older map was joined: the maps were made again of both".to_owned()
            };
            self.corrected = Some((before, now));
            self.add_event(stamp, "loop_closed", message);
        }
        Ok(())
    }

    /// Updates all layers with a registered scan, placed. [`Self::publish_if_due`] follows each call.
    pub fn integrate(&mut self, scan: &RegisteredScan) {
        let started = clock::now();
        let map = self.mapper.integrate(scan);
        let report = &mut self.progress.report;
        report.mapping_time.record(clock::elapsed(started));
        report.scans_mapped += 1;
        report.hits += map.hits;
        report.misses += map.misses;
        report.dropped_beams.merge(&map.dropped_beams);
        self.progress.last_scan = Some(scan.stamp);
        self.progress.scans_unpublished += 1;
        self.report_limited(scan.stamp, map.limited);
        if let Some(change) = map.ground_plane_reset {
            self.add_event(change.stamp, "ground_plane", change.to_string());
        }
    }

    /// Publishes the changed tiles once per publication period.
    ///
    /// The period is time of the data, so that the published tiles do not depend on the speed of a replay. The number of
    /// scans limits memory if stamps do not advance.
    pub fn publish_if_due(&mut self) -> Result<(), PublishError> {
        let progress = &mut self.progress;
        let Some(stamp) = progress.last_scan else {
            return Ok(());
        };
        let is_due = progress.scans_unpublished >= MAX_SCANS_UNPUBLISHED
            || progress
                .published_at
                .is_none_or(|at| stamp.since(at) >= self.publish_period);
        if !is_due {
            return Ok(());
        }
        progress.published_at = Some(stamp);
        progress.scans_unpublished = 0;
        self.publish()
    }

    pub fn take_update(&mut self) -> MapUpdate {
        MapUpdate {
            changed_tiles: self.publisher.take_changed(),
            events: std::mem::take(&mut self.events),
        }
    }

    pub fn count_dropped(&mut self, reason: DropReason) {
        self.progress.report.dropped_scans.add(reason);
    }

    /// The clock of the data was reset; scans with stamps of the old clock may follow.
    pub const fn reset_clock(&mut self) {
        self.progress.published_at = None;
    }

    pub fn finish(&mut self) -> Result<(), PublishError> {
        self.mapper.refresh();
        self.publish()
    }

    /// The maps by all closures, at the end of the data.
    pub(super) fn finish_correction(&mut self) -> anyhow::Result<()> {
        let mapped = self.progress.report.scans_mapped;
        let Some(correction) = &mut self.correction else {
            return Ok(());
        };
        let before = Arc::clone(correction.in_effect());
        if let Some(maps) = correction.take_last(mapped)? {
            self.exchange(maps, before)?;
        }
        Ok(self.stop_searching()?)
    }

    pub const fn set_datum(&mut self, datum: Option<GeodeticPoint>) {
        self.progress.datum = datum;
    }

    /// Keeps or erases the maps at a pose jump, as configured.
    pub fn on_pose_jump(&mut self, jump: &PoseJump) {
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

    /// Says how sure the poses are.
    pub(super) fn on_confidence(&mut self, change: ConfidenceChange) {
        let (kind, message) = match change.confidence {
            PoseConfidence::Determined => {
                ("localization_certain", "the scans determine the pose again")
            }
            PoseConfidence::UncertainAlong => (
                "localization_uncertain",
                "the scans do not determine the position along one direction, as in a corridor",
            ),
            PoseConfidence::OdometryOnly => (
                "localization_uncertain",
                "the scans do not fit the map: the poses are those of odometry alone",
            ),
            PoseConfidence::Lost => (
                "localization_lost",
                "neither the scans nor another sensor determine where the vehicle is",
            ),
        };
        self.add_event(change.stamp, kind, message.to_owned());
    }

    fn report_limited(&mut self, stamp: RobotTime, now: LimitedBricks) {
        if now == LimitedBricks::default() {
            return;
        }
        let progress = &mut self.progress;
        let limited = &mut progress.report.limited;
        limited.on_disk += now.on_disk;
        limited.coarse += now.coarse;
        limited.removed += now.removed;
        limited.disk_failures += now.disk_failures;
        let reported_at = progress
            .evictions_reported_at
            .filter(|&reported_at| reported_at <= stamp);
        if reported_at
            .is_none_or(|reported_at| stamp.since(reported_at) >= EVICTION_REPORT_INTERVAL)
        {
            progress.evictions_reported_at = Some(stamp);
            let LimitedBricks {
                on_disk,
                coarse,
                removed,
                disk_failures,
            } = progress.report.limited;
            let disk = match disk_failures {
                0 => String::new(),
                count => format!("; the disk (TMPDIR) failed {count} times"),
            };
            let message = format!(
                "the octree is at its memory limit (mapping.octree.memory_limit_mb): of the bricks of 4 x 4 x 4 voxels farthest \
                 from the vehicle {on_disk} went to disk so far, {coarse} became one voxel each, and {removed} are gone{disk}"
            );
            self.add_event(stamp, "voxels_evicted", message);
        }
    }

    fn add_event(&mut self, stamp: RobotTime, kind: &'static str, message: String) {
        tracing::info!(%stamp, kind, message);
        self.events.push(MapEvent {
            stamp,
            kind,
            message,
        });
    }

    fn publish(&mut self) -> Result<(), PublishError> {
        let started = clock::now();
        // Before the first scan there is nothing to publish.
        let stamp = self.progress.last_scan.unwrap_or_default();
        if let Some(searched) = &mut self.searched {
            self.publisher.set_now(&self.mapper, stamp);
            searched.publish_run(&mut self.mapper, stamp)?;
            self.publish_searched()?;
        } else {
            self.publisher.publish(&mut self.mapper, stamp)?;
        }
        let elapsed = clock::elapsed(started);
        self.progress.report.publish_time.record(elapsed);
        Ok(())
    }

    fn publish_searched(&mut self) -> Result<(), PublishError> {
        match self.searched.as_mut().and_then(SearchedMap::take_made) {
            None => Ok(()),
            Some(Ok(mut saved)) => {
                saved.finish()?;
                self.publisher.replace(&saved.publisher)
            }
            Some(Err(error)) => {
                let stamp = self.progress.last_scan.unwrap_or_default();
                let message = format!("the saved map cannot be shown: {error:#}");
                self.add_event(stamp, "map_not_shown", message);
                self.stop_searching()
            }
        }
    }

    pub const fn last_scan(&self) -> Option<RobotTime> {
        self.progress.last_scan
    }

    pub const fn mapper(&self) -> &Mapper {
        &self.mapper
    }

    pub const fn publisher(&self) -> &Publisher {
        &self.publisher
    }

    pub const fn report(&self) -> &MapsReport {
        &self.progress.report
    }

    pub fn shores(&self) -> Option<Shores> {
        let voxels = self.mapper.voxels()?;
        let cell_m = voxels.octree().cell_m();
        Some(shores(voxels.shore()?, cell_m, self.progress.datum))
    }

    /// Shores and docking sites if they were updated since the last call, and the stamp of the last scan.
    pub fn take_shores(&mut self) -> Option<(RobotTime, Shores)> {
        if self.searched.is_some() {
            return None;
        }
        let updates = self.mapper.voxels()?.shore()?.updates();
        let taken = &mut self.progress.shore_updates_taken;
        if std::mem::replace(taken, updates) == updates {
            return None;
        }
        self.last_scan().zip(self.shores())
    }

    /// Shores and docking sites if they were ever updated, and the stamp of the last scan.
    pub fn current_shores(&self) -> Option<(RobotTime, Shores)> {
        let is_known = self.mapper.voxels()?.shore()?.updates() > 0;
        Some((self.last_scan().filter(|_| is_known)?, self.shores()?))
    }

    pub fn checkpoint(&self) -> MapsCheckpoint {
        MapsCheckpoint {
            mapper: self.mapper.clone(),
            publisher: self.publisher.state(),
            progress: self.progress.clone(),
            correction: self.correction.as_ref().map(MapCorrection::checkpoint),
            searched: self.searched.as_ref().map(SearchedMap::checkpoint),
        }
    }

    /// Restores a checkpoint. Each layer gets a new epoch, which invalidates the tiles published since.
    pub fn restore(&mut self, checkpoint: &MapsCheckpoint) -> anyhow::Result<()> {
        if let (Some(correction), Some(to)) = (&mut self.correction, &checkpoint.correction) {
            correction.restore(to)?;
        }
        self.searched = None;
        if let Some(to) = &checkpoint.searched {
            self.search(Arc::clone(&to.map_from_odom))?;
            if let Some(searched) = &mut self.searched {
                searched.restore(to)?;
            }
        }
        self.publisher.restore(&checkpoint.publisher)?;
        self.mapper = checkpoint.mapper.clone();
        self.progress = checkpoint.progress.clone();
        self.events.clear();
        Ok(())
    }

    /// Empties the maps. Each layer gets a new epoch.
    pub fn restart(&mut self, config: &Config) -> anyhow::Result<()> {
        if let Some(correction) = &mut self.correction {
            correction.clear()?;
        }
        self.mapper = mapper(config);
        self.publisher.restart(&self.mapper)?;
        self.searched = None;
        self.progress = MapsProgress::default();
        self.events.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};
    use std::thread;
    use std::time::Duration;

    use anyhow::anyhow;
    use nalgebra::Point3;
    use protocol::layer::LayerId;
    use protocol::tile::{BootId, TileCells};

    use super::*;
    use localization::registration::RegistrationOutput;
    use mapping::registered_scan::{
        BeamOutcome, RegisteredBeam, RegisteredScan, ScanKind, SensorId,
    };
    use measurement::pose::Pose;

    /// Hit of the scan in the map, and of the scan that waits, metres.
    pub(super) const BEFORE_M: [f64; 2] = [3.05, 0.05];
    pub(super) const WAITING_M: [f64; 2] = [0.05, 8.05];

    pub(super) fn take(maps: &mut Maps, registered: &RegistrationOutput) {
        match registered {
            RegistrationOutput::Scan(scan) => {
                maps.integrate(scan);
                maps.publish_if_due().unwrap();
            }
            RegistrationOutput::Jump(jump) => maps.on_pose_jump(jump),
            RegistrationOutput::Corrected(way) => maps.correct(Arc::clone(way)),
            RegistrationOutput::Confidence(change) => maps.on_confidence(*change),
        }
    }

    pub(super) fn maps(on_jump: OnJump) -> Maps {
        let mut config = Config::default();
        config.mapping.octree.enabled = true;
        config.localization.on_jump = on_jump;
        Maps::new(&config, BootId([1; 16]), false).unwrap()
    }

    /// Five beams, one above the other, into one voxel.
    pub(super) fn scan(stamp_ns: i64, [x, y]: [f64; 2]) -> RegistrationOutput {
        let beams = (0..5).map(|index| {
            let origin = Point3::new(0.05, 0.05, 0.05);
            let end = Point3::new(x, y, 0.01 + 0.02 * f64::from(index));
            RegisteredBeam {
                origin_in_odom: origin,
                end_in_odom: end,
                outcome: BeamOutcome::Hit,
                index,
                range_m: (end - origin).norm() as f32,
            }
        });
        RegistrationOutput::Scan(RegisteredScan {
            stamp: RobotTime::from_nanos(stamp_ns),
            sensor: SensorId(0),
            beam_step_rad: 0.005,
            kind: ScanKind::Beams,
            own_body_hits: 0,
            odom_from_base: Pose::identity(),
            beams: beams.collect(),
        })
    }

    fn tiles(maps: &Maps) -> BTreeMap<TileKey, TileCells> {
        let store = maps.publisher().store();
        let tiles = LayerId::ALL
            .into_iter()
            .flat_map(|layer| store.tiles(layer));
        let cells = tiles.filter_map(|(key, stored)| Some((key, stored.cells()?.clone())));
        cells.collect()
    }

    #[test]
    fn of_a_run_that_is_not_found_only_the_newest_cells_are_kept() {
        let mut config = Config::default();
        config.mapping.octree.enabled = true;
        config.mapping.cost.enabled = true;
        let boot = BootId([1; 16]);
        let kept = KeptScans::new().unwrap();
        let correction = MapCorrection::new(&config, kept, MapFromOdom::default());
        let mut alone = Maps::new(&config, boot, false).unwrap();
        let mut searched = Maps::new(&config, boot, false).unwrap();
        searched = searched.going_on(correction, Arc::default()).unwrap();
        for n in 0..20 {
            let scan = scan(n * 1_000_000_000, [BEFORE_M, WAITING_M][n as usize % 2]);
            take(&mut alone, &scan);
            take(&mut searched, &scan);
            let cost = searched.mapper.voxels_mut().unwrap().cost_mut().unwrap();
            assert_eq!(cost.take_changed(), []);
            let of_run = &mut searched.searched.as_mut().unwrap().of_run;
            assert_eq!(of_run.take_changed(), []);
        }
        assert_eq!(tiles(&searched), BTreeMap::new());
        let checkpoint = searched.checkpoint();
        searched.restore(&checkpoint).unwrap();
        searched.finish_correction().unwrap();
        searched.finish().unwrap();
        alone.finish().unwrap();
        assert!(tiles(&alone).keys().any(|key| key.layer == LayerId::Cost));
        assert_eq!(tiles(&searched), tiles(&alone));
    }

    #[test]
    fn a_saved_map_that_cannot_be_shown_leaves_the_map_of_the_run() {
        let mut maps = maps(OnJump::Keep);
        let making = thread::spawn(|| Err(anyhow!("no space left")));
        let searched = SearchedMap::new(Arc::default(), Some(making), &maps.mapper, 64);
        maps.searched = Some(searched.unwrap());
        take(&mut maps, &scan(0, BEFORE_M));
        for _ in 0..1000 {
            maps.publish().unwrap();
            if maps.searched.is_none() {
                break;
            }
            thread::sleep(Duration::from_millis(1));
        }
        let update = maps.take_update();
        let failed = MapEvent {
            stamp: RobotTime::from_nanos(0),
            kind: "map_not_shown",
            message: "the saved map cannot be shown: no space left".to_owned(),
        };
        assert_eq!(update.events, [failed]);
        let published: BTreeSet<_> = update.changed_tiles.into_iter().collect();
        assert_eq!(published, tiles(&maps).into_keys().collect());
        assert_ne!(published, BTreeSet::new());
    }
}
