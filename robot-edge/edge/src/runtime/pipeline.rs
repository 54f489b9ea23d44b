//! The pipeline of a vehicle: measurements → registered scans → maps → tiles, in two stages.
//!
//! A replay, a simulation, a live run and the experiments all use it. The stages run one after the other, or on two threads
//! ([`Pipeline::run_pipelined`]).

use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::thread;

use anyhow::anyhow;
use protocol::tile::BootId;

use super::batching_channel::{MappingInput, batching_channel};
use super::kept_scans::KeptScans;
use super::localization_stage::LocalizationStage;
use super::map_correction::MapCorrection;
use super::mapping_stage::MappingStage;
use super::maps::{MapEvent, Maps, MapsCheckpoint, MapsReport, PausedSnapshot};
use super::source::DataClock;
use super::source_reader::{Batch, SourceEnd};
use super::tilt_control::TiltControl;
use crate::config::Config;
use crate::publishing::publisher::{PublishError, Publisher};
use crate::thread_priority::lower_thread_priority;
use localization::registration::{
    PoseOrigin, RegistrationOutput, RegistrationSettings, ScanRegistration,
};
use mapping::Mapper;
use mapping::registered_scan::RegisteredScan;
use measurement::Measurement;
use measurement::time::RobotTime;
use recording::time_sequencer::Ordered;

pub struct Pipeline {
    // Dropped first: the motors are stopped before a recording is synced to the disk.
    pub(super) mapping: MappingStage,
    pub(super) localization: LocalizationStage,
}

pub(super) struct PipelineCheckpoint {
    registration: ScanRegistration,
    clock: DataClock,
    scans: u64,
    maps: MapsCheckpoint,
}

impl PipelineCheckpoint {
    /// Memory of the maps, bytes; the rest is negligible.
    pub(super) fn bytes(&self) -> usize {
        self.maps.bytes()
    }
}

impl Pipeline {
    /// Empty maps of a vehicle, without network and recording. `encode`: see [`Publisher::new`].
    pub fn new(
        config: &Config,
        registration: RegistrationSettings,
        boot: BootId,
        encode: bool,
    ) -> anyhow::Result<Self> {
        Self::going_on(config, registration, (boot, encode), None)
    }

    /// As [`Self::new`]; `kept`: the scans of the map that is gone on in.
    pub(super) fn going_on(
        config: &Config,
        registration: RegistrationSettings,
        (boot, encode): (BootId, bool),
        kept: Option<KeptScans>,
    ) -> anyhow::Result<Self> {
        let mut maps = Maps::new(config, boot, encode)?;
        let matches_scans = matches!(registration.origin, PoseOrigin::Scans { .. });
        let saved = registration.continuation.as_ref();
        let saved = saved.map(|of| Arc::new(of.saved.map_from_odom()));
        let registration = ScanRegistration::new(registration);
        if matches_scans {
            let way = registration.map_from_odom();
            let new = |kept| MapCorrection::new(config, kept, way);
            maps = match kept.zip(saved) {
                Some((kept, saved)) => maps.going_on(new(kept), saved)?,
                None => maps.with_correction(new(KeptScans::new()?)),
            };
        }
        let mapping = MappingStage::new(maps);
        let localization = LocalizationStage::new(registration, mapping.stats.clone());
        Ok(Self {
            mapping,
            localization,
        })
    }

    /// A servo is turned from the next scan on.
    #[must_use]
    pub fn with_tilt_control(mut self, tilt: Option<TiltControl>) -> Self {
        self.mapping.tilt = tilt;
        self
    }

    /// Registers and maps one measurement. Returns the scans that were mapped.
    pub fn push(&mut self, measurement: Measurement) -> anyhow::Result<Vec<RegisteredScan>> {
        let mut scans = Vec::new();
        let Self {
            localization,
            mapping,
        } = self;
        localization.take_ordered(
            Ordered::Measurement(measurement),
            network::clock::now(),
            &mut |input| {
                scans.extend(mapping.take(input)?);
                Ok(())
            },
        )?;
        Ok(scans)
    }

    pub(super) fn take(&mut self, batch: Batch) -> anyhow::Result<()> {
        let Self {
            localization,
            mapping,
        } = self;
        localization.take(batch, &mut |input| mapping.take(input).map(drop))
    }

    /// Runs `read_source` and the localization stage on a thread of their own, and the mapping stage on this one.
    ///
    /// While a scan is mapped, consoles and the collision monitor receive newer scans and poses. The localization stage never
    /// waits in a live run, because late scans are dropped; otherwise it waits for room in the channel. `lower_priority`:
    /// mapping yields to localization, for a vehicle that can be driven.
    ///
    /// The outer error means that the thread could not start or panicked; the inner one that recording or publishing failed.
    pub(super) fn run_pipelined(
        &mut self,
        read_source: impl FnOnce(&mut dyn FnMut(Batch) -> bool) -> SourceEnd + Send,
        threads: usize,
        lower_priority: bool,
    ) -> anyhow::Result<(SourceEnd, anyhow::Result<()>)> {
        let Self {
            localization,
            mapping,
        } = self;
        thread::scope(|scope| {
            let (mut sender, receiver) = batching_channel(mapping.is_live);
            let localize = move || {
                let mut localized = Ok(());
                let end = read_source(&mut |batch| {
                    if localized.is_ok() {
                        localized = localization.take(batch, &mut |input| sender.add(input));
                    }
                    localized.is_ok()
                });
                // Registered scans are mapped even if localization failed.
                let sent = sender.finish();
                (end, localized.and(sent))
            };
            let localization = thread::Builder::new()
                .name("localization".to_owned())
                .spawn_scoped(scope, localize)?;
            if lower_priority {
                lower_thread_priority();
            }
            let mapped = map_received(receiver, mapping, threads);
            let (end, localized) = localization
                .join()
                .map_err(|_panic| anyhow!("reading or localization failed"))?;
            Ok((end, mapped.and(localized)))
        })
    }

    /// Maps the scans that wait for a pose, and publishes everything, at the end of the data.
    pub fn finish(&mut self) -> anyhow::Result<()> {
        let Self {
            localization,
            mapping,
        } = self;
        localization.finish(&mut |input| mapping.take(input).map(drop))?;
        mapping.maps.set_datum(localization.registration.datum());
        mapping.finish()
    }

    /// [`Self::finish`] of a run, whose source has lost `lost` messages.
    pub(super) fn finish_run(&mut self, lost: u64) -> anyhow::Result<()> {
        let finished = self.finish();
        self.mapping.publish();
        self.localization.publish_status(lost);
        self.localization.progress.finish();
        finished
    }

    /// Publishes the maps as if the data ended here. `lost`: as for [`Self::finish_run`].
    pub(super) fn publish_paused(&mut self, lost: u64) -> Result<PausedSnapshot, PublishError> {
        let mut ended = self.localization.registration.clone();
        let mut waiting: Vec<RegistrationOutput> = Vec::new();
        ended.finish(&mut waiting);
        let paused_snapshot = self.mapping.publish_paused(waiting)?;
        if let Some(state_publisher) = &mut self.localization.state_publisher
            && let Some(pose) = ended.newest_pose()
        {
            state_publisher.publish_pose(pose);
        }
        self.localization.publish_status(lost);
        Ok(paused_snapshot)
    }

    pub(super) fn checkpoint(&self) -> PipelineCheckpoint {
        PipelineCheckpoint {
            registration: self.localization.registration.clone(),
            clock: self.localization.clock,
            scans: self.mapping.trajectory.lock().scans(),
            maps: self.mapping.maps.checkpoint(),
        }
    }

    /// Empties the maps for data that starts again.
    pub(super) fn restart(
        &mut self,
        config: &Config,
        registration: RegistrationSettings,
    ) -> anyhow::Result<()> {
        self.mapping.maps.restart(config)?;
        self.reset_to(ScanRegistration::new(registration), DataClock::default(), 0);
        Ok(())
    }

    pub(super) fn restore(&mut self, to: &PipelineCheckpoint) -> anyhow::Result<()> {
        self.mapping.maps.restore(&to.maps)?;
        self.reset_to(to.registration.clone(), to.clock, to.scans);
        Ok(())
    }

    fn reset_to(&mut self, registration: ScanRegistration, clock: DataClock, scans: u64) {
        self.localization.registration = registration;
        self.localization.clock = clock;
        self.localization.streams.clear();
        if let Some(state_publisher) = &mut self.localization.state_publisher {
            state_publisher.seek(clock.elapsed());
        }
        self.mapping.seek(scans);
    }

    pub fn take_map_events(&mut self) -> Vec<MapEvent> {
        self.mapping.maps.take_update().events
    }

    pub const fn registration(&self) -> &ScanRegistration {
        &self.localization.registration
    }

    pub const fn last_scan(&self) -> Option<RobotTime> {
        self.mapping.maps.last_scan()
    }

    pub const fn mapper(&self) -> &Mapper {
        self.mapping.maps.mapper()
    }

    pub const fn publisher(&self) -> &Publisher {
        self.mapping.maps.publisher()
    }

    pub const fn report(&self) -> &MapsReport {
        self.mapping.maps.report()
    }
}

fn map_received(
    receiver: Receiver<Vec<MappingInput>>,
    mapping: &mut MappingStage,
    threads: usize,
) -> anyhow::Result<()> {
    let _pool = join_mapping_pool(threads);
    // The receiver is dropped when mapping fails: otherwise the localization stage would wait for room forever.
    receiver
        .into_iter()
        .flatten()
        .try_for_each(|input| mapping.take(input).map(drop))
}

/// Makes this thread a member of the pool that shares the work of a scan. A thread outside of the pool would wake two others
/// for each scan and sleep, which costs as much as the second core gains.
///
/// If that fails, rayon's global pool is used, with the same maps.
pub(super) fn join_mapping_pool(threads: usize) -> Option<rayon::ThreadPool> {
    if threads < 2 {
        return None;
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .use_current_thread()
        .thread_name(|number| format!("mapping-{number}"))
        .build();
    pool.inspect_err(|error| tracing::warn!(%error, "mapping without threads of its own"))
        .ok()
}

#[cfg(test)]
mod tests;
