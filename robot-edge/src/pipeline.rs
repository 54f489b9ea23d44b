//! Measurements in stamp order in, published tiles out: one vehicle's maps, whatever the source.
//!
//! Two stages: a [`ScanRegistration`] places scans, [`Maps`] map and publish them. Here they follow each other, one measurement at
//! a time; whoever drives lets the first go ahead of the second (`app/pipeline.rs`).

use protocol::tile::BootId;

use crate::config::Config;
use crate::streaming::publisher::{PublishError, Publisher};
use localization::registration::{RegistrationOutput, RegistrationSettings, ScanRegistration};
use mapping::Mapper;
use mapping::registered_scan::RegisteredScan;
use measurement::Measurement;
use measurement::time::RobotTime;

mod checkpoint;
mod maps;
mod paused_snapshot;

pub use checkpoint::MapsCheckpoint;
pub use maps::{Maps, MapsReport, StageTimers};
pub use paused_snapshot::PausedSnapshot;

/// Both stages. It owns no thread: whoever holds it calls it.
pub struct Pipeline {
    registration: ScanRegistration,
    maps: Maps,
    placed: Vec<RegistrationOutput>,
}

/// Whoever wants to see scans on their way into the map.
pub trait ScanObserver {
    /// A scan got into the map.
    fn mapped(&mut self, scan: &RegisteredScan, mapper: &Mapper);
}

/// Nobody looks.
impl ScanObserver for () {
    fn mapped(&mut self, _scan: &RegisteredScan, _mapper: &Mapper) {}
}

impl<F: FnMut(&RegisteredScan)> ScanObserver for F {
    fn mapped(&mut self, scan: &RegisteredScan, _mapper: &Mapper) {
        self(scan);
    }
}

/// Something that the people who watch should know.
#[derive(Clone, Debug, PartialEq)]
pub struct MapEvent {
    /// When, on the clock of the data.
    pub stamp: RobotTime,
    /// What, in one word: `ground_plane` or `pose_jump`.
    pub kind: &'static str,
    /// What, in a sentence, with the reason.
    pub message: String,
}

impl Pipeline {
    /// Empty maps of a vehicle. `encode`: see [`Publisher::new`].
    ///
    /// # Errors
    /// Where the tile store cannot be set up.
    pub fn new(
        config: &Config,
        registration: RegistrationSettings,
        boot: BootId,
        encode: bool,
    ) -> Result<Self, PublishError> {
        Ok(Self {
            registration: ScanRegistration::new(registration),
            maps: Maps::new(config, boot, encode)?,
            placed: Vec::new(),
        })
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
        self.registration.push(measurement, &mut self.placed);
        self.map_placed(observer)
    }

    /// The clock of the data started anew.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn reset_clock(&mut self, observer: impl ScanObserver) -> Result<(), PublishError> {
        self.registration.reset_clock(&mut self.placed);
        self.maps.reset_clock();
        self.map_placed(observer)
    }

    /// The data ended: maps what still waits and publishes all of it.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn finish(&mut self, observer: impl ScanObserver) -> Result<(), PublishError> {
        self.registration.finish(&mut self.placed);
        self.map_placed(observer)?;
        self.maps.finish()
    }

    fn map_placed(&mut self, mut observer: impl ScanObserver) -> Result<(), PublishError> {
        self.maps.set_datum(self.registration.datum());
        let Self { placed, maps, .. } = self;
        placed
            .drain(..)
            .try_for_each(|placed| maps.take(&placed, &mut observer))
    }

    /// What happened since the last call, in order.
    pub fn take_map_events(&mut self) -> Vec<MapEvent> {
        self.maps.take_map_events()
    }

    /// What became of scans and beams on their way to a pose.
    pub const fn registration(&self) -> &ScanRegistration {
        &self.registration
    }

    /// Stamp of the newest scan in the map.
    pub const fn last_scan(&self) -> Option<RobotTime> {
        self.maps.last_scan()
    }

    /// The maps.
    pub const fn mapper(&self) -> &Mapper {
        self.maps.mapper()
    }

    /// What was published.
    pub const fn publisher(&self) -> &Publisher {
        self.maps.publisher()
    }

    /// What became of placed scans so far.
    pub const fn report(&self) -> &MapsReport {
        self.maps.report()
    }
}
