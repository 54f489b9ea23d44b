//! Makes the maps again after a loop was closed, while the old ones are served.
//!
//! When it begins and when the new maps replace the old ones are numbers of mapped scans, so that the maps depend on the data alone.

use std::borrow::Cow;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use anyhow::anyhow;

use super::kept_scans::{KeptMark, KeptScans};
use super::maps::Maps;
use crate::config::Config;
use localization::scan_localization::MapFromOdom;
use mapping::registered_scan::RegisteredScan;
use measurement::pose::Pose;
use protocol::tile::BootId;

/// The maps are made again when a place of the vehicle has moved farther, metres.
const LEAST_MOVE_M: f64 = 0.05;
/// Scans between the decision and the exchange, and from the exchange to the next decision, …
const LEAST_SCANS: u64 = 20;
/// …and one for so many bytes of kept scans: the more there are, the longer it takes. At 10 Hz this is twice as long as it took.
const BYTES_PER_SCAN: u64 = 500_000;

/// Where `odom` lies in the maps, and the maps that are being made.
#[derive(Debug)]
pub(super) struct MapCorrection {
    config: Arc<Config>,
    kept: KeptScans,
    in_effect: Arc<MapFromOdom>,
    /// That of the last closure.
    newest: Arc<MapFromOdom>,
    rebuild: Option<Rebuild>,
    /// Scans in the maps at which the next rebuild may begin.
    next_at: u64,
    /// Scans cannot be kept, or the maps not be made.
    has_failed: bool,
}

#[derive(Debug)]
struct Rebuild {
    to: Arc<MapFromOdom>,
    /// Of the kept scans.
    scans: u64,
    thinned: u32,
    /// The maps are exchanged at this number of mapped scans.
    exchange_at: u64,
    thread: MakingMaps,
}

pub(super) type MakingMaps = JoinHandle<anyhow::Result<Maps>>;

#[derive(Clone, Debug)]
pub(super) struct CorrectionCheckpoint {
    kept: KeptMark,
    in_effect: Arc<MapFromOdom>,
    newest: Arc<MapFromOdom>,
    /// Where the maps were being made: to what, and when they are exchanged.
    rebuild: Option<(Arc<MapFromOdom>, u64)>,
    next_at: u64,
}

impl MapCorrection {
    /// `kept`: of earlier runs that made the map. `way`: where `odom` lies in the map of this run.
    pub(super) fn new(config: &Config, kept: KeptScans, way: MapFromOdom) -> Self {
        let way = Arc::new(way);
        Self {
            config: Arc::new(config.clone()),
            kept,
            in_effect: Arc::clone(&way),
            newest: way,
            rebuild: None,
            next_at: 0,
            has_failed: false,
        }
    }

    pub(super) const fn kept(&mut self) -> &mut KeptScans {
        &mut self.kept
    }

    /// Where `odom` lies in the maps at their newest scan.
    pub(super) fn map_from_odom(&self) -> Pose {
        self.in_effect.newest()
    }

    /// Where `odom` lies in the maps.
    pub(super) fn in_effect(&self) -> &Arc<MapFromOdom> {
        &self.in_effect
    }

    /// A loop was closed.
    pub(super) fn correct(&mut self, way: Arc<MapFromOdom>) {
        self.newest = way;
    }

    /// A new map begins.
    pub(super) fn begin_map(&mut self, way: Arc<MapFromOdom>) {
        self.rebuild = None;
        self.kept.begin_session(way.session());
        self.in_effect = Arc::clone(&way);
        self.newest = way;
    }

    /// Keeps a scan, in `odom`, that was mapped. Begins to make the maps again, if that is due after so many mapped scans, and returns
    /// them when it is time to exchange them. After an error it does nothing more.
    pub(super) fn keep(
        &mut self,
        scan: &RegisteredScan,
        mapped: u64,
    ) -> anyhow::Result<Option<Maps>> {
        if self.has_failed {
            return Ok(None);
        }
        let due = match self.kept.add(scan) {
            Ok(()) => self.take_due(mapped),
            Err(error) => Err(error.into()),
        };
        self.has_failed = due.is_err();
        due
    }

    fn take_due(&mut self, mapped: u64) -> anyhow::Result<Option<Maps>> {
        match &self.rebuild {
            Some(rebuild) if mapped >= rebuild.exchange_at => self.finish_rebuild(mapped).map(Some),
            Some(_) => Ok(None),
            None => {
                let is_due = mapped >= self.next_at && self.moved_m() > LEAST_MOVE_M;
                if is_due {
                    self.begin(Arc::clone(&self.newest), mapped + self.wait())?;
                }
                Ok(None)
            }
        }
    }

    /// The maps by all closures, at the end of the data, if they differ.
    pub(super) fn take_last(&mut self, mapped: u64) -> anyhow::Result<Option<Maps>> {
        self.rebuild = None;
        if self.has_failed || self.moved_m() <= 0.0 {
            return Ok(None);
        }
        self.begin(Arc::clone(&self.newest), mapped)?;
        self.finish_rebuild(mapped).map(Some)
    }

    pub(super) fn checkpoint(&self) -> CorrectionCheckpoint {
        let rebuild = self.rebuild.as_ref();
        CorrectionCheckpoint {
            kept: self.kept.mark(),
            in_effect: Arc::clone(&self.in_effect),
            newest: Arc::clone(&self.newest),
            rebuild: rebuild.map(|rebuild| (Arc::clone(&rebuild.to), rebuild.exchange_at)),
            next_at: self.next_at,
        }
    }

    pub(super) fn restore(&mut self, to: &CorrectionCheckpoint) -> anyhow::Result<()> {
        self.rebuild = None;
        self.kept.go_back(&to.kept)?;
        self.in_effect = Arc::clone(&to.in_effect);
        self.newest = Arc::clone(&to.newest);
        self.next_at = to.next_at;
        if let Some((way, exchange_at)) = &to.rebuild {
            self.begin(Arc::clone(way), *exchange_at)?;
        }
        Ok(())
    }

    /// The data starts again.
    pub(super) fn clear(&mut self) -> anyhow::Result<()> {
        self.rebuild = None;
        self.in_effect = Arc::default();
        self.newest = Arc::default();
        Ok(self.kept.clear()?)
    }

    fn moved_m(&self) -> f64 {
        if Arc::ptr_eq(&self.newest, &self.in_effect) {
            return 0.0;
        }
        self.newest.distance_m(&self.in_effect)
    }

    fn wait(&self) -> u64 {
        LEAST_SCANS + self.kept.bytes() / BYTES_PER_SCAN
    }

    fn begin(&mut self, to: Arc<MapFromOdom>, exchange_at: u64) -> anyhow::Result<()> {
        let thread = self.make(Arc::clone(&to))?;
        self.rebuild = Some(Rebuild {
            to,
            scans: self.kept.count(),
            thinned: self.kept.thinned(),
            exchange_at,
            thread,
        });
        Ok(())
    }

    /// Makes maps of all kept scans.
    pub(super) fn make(&mut self, way: Arc<MapFromOdom>) -> anyhow::Result<MakingMaps> {
        let mut scans = self.kept.read(0)?;
        let config = Arc::clone(&self.config);
        let make = move || {
            let mut maps = Maps::new(&config, BootId([0; 16]), false)?;
            maps.add_kept(&mut scans, &way)?;
            Ok(maps)
        };
        let thread = thread::Builder::new().name("map-correction".to_owned());
        Ok(thread.spawn(make)?)
    }

    fn finish_rebuild(&mut self, mapped: u64) -> anyhow::Result<Maps> {
        let rebuild = self
            .rebuild
            .take()
            .ok_or_else(|| anyhow!("no maps are being made"))?;
        let made = rebuild.thread.join();
        let mut maps = made.map_err(|_panic| anyhow!("making the maps again failed"))??;
        let mut since = rebuild.scans;
        if self.kept.thinned() != rebuild.thinned {
            maps = Maps::new(&self.config, BootId([0; 16]), false)?;
            since = 0;
        }
        maps.add_kept(&mut self.kept.read(since)?, &rebuild.to)?;
        self.in_effect = rebuild.to;
        self.next_at = mapped + self.wait();
        Ok(maps)
    }
}

/// A scan in the map.
pub(super) fn placed<'a>(
    scan: &'a RegisteredScan,
    map_from_odom: &Pose,
) -> Cow<'a, RegisteredScan> {
    if *map_from_odom == Pose::identity() {
        return Cow::Borrowed(scan);
    }
    let mut scan = scan.clone();
    scan.odom_from_base = map_from_odom * scan.odom_from_base;
    for beam in &mut scan.beams {
        beam.origin_in_odom = map_from_odom * beam.origin_in_odom;
        beam.end_in_odom = map_from_odom * beam.end_in_odom;
    }
    Cow::Owned(scan)
}
