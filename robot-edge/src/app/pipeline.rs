//! Both stages of a run, one behind the other or, where time matters, side by side.

use std::sync::mpsc::Receiver;
use std::thread;

use anyhow::anyhow;

use super::batching_channel::batching_channel;
use super::data_clock::DataClock;
use super::localization_stage::LocalizationStage;
use super::mapping_input::MappingInput;
use super::mapping_stage::MappingStage;
use super::source_reader::{Batch, SourceEnd};
use super::thread_priority::lower_thread_priority;
use crate::config::Config;
use crate::pipeline::{MapsCheckpoint, PausedSnapshot};
use crate::streaming::publisher::PublishError;
use localization::registration::{RegistrationOutput, RegistrationSettings, ScanRegistration};

/// Who places and who maps.
pub(super) struct PipelineStages {
    // Ends first: what is driven is told zero before what is recorded is put on the disk.
    pub(super) mapping: MappingStage,
    pub(super) localization: LocalizationStage,
}

/// All that both know at one time of the data.
pub(super) struct PipelineCheckpoint {
    registration: ScanRegistration,
    clock: DataClock,
    scans: u64,
    maps: MapsCheckpoint,
}

impl PipelineStages {
    /// Places and maps a batch.
    ///
    /// # Errors
    /// Where the recording cannot be written or publishing stopped.
    pub(super) fn take(&mut self, batch: Batch) -> anyhow::Result<()> {
        let Self {
            localization,
            mapping,
        } = self;
        localization.take(batch, &mut |input| Ok(mapping.take(input)?))
    }

    /// Places on a thread of its own what `read_source` hands over, and maps here: while a scan is mapped, consoles and the guard hear
    /// of the next ones, and of where the vehicle is. That lasts as long as there is room for what waits to be mapped; where
    /// the present matters, scans that have waited too long are left out, so that there is. Mapping `lower_priority` to placing
    /// where somebody drives.
    ///
    /// # Errors
    /// Where no thread can be had, or it failed. Within: where the recording cannot be written or publishing stopped.
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
            let place = move || {
                let mut placed = Ok(());
                let end = read_source(&mut |batch| {
                    if placed.is_ok() {
                        placed = localization.take(batch, &mut |input| sender.add(input));
                    }
                    placed.is_ok()
                });
                // Whatever has stopped placing, what was placed is mapped.
                let sent = sender.finish();
                (end, placed.and(sent))
            };
            let localization = thread::Builder::new()
                .name("localization".to_owned())
                .spawn_scoped(scope, place)?;
            if lower_priority {
                lower_thread_priority();
            }
            let mapped = map_received(receiver, mapping, threads);
            let (end, placed) = localization
                .join()
                .map_err(|_panic| anyhow!("reading or localization failed"))?;
            Ok((end, mapped.map_err(Into::into).and(placed)))
        })
    }

    /// The data has ended: maps what still waits; `lost` by the source so far.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn finish(&mut self, lost: u64) -> anyhow::Result<()> {
        let Self {
            localization,
            mapping,
        } = self;
        let placed = localization.finish(&mut |input| Ok(mapping.take(input)?));
        let finished = placed.and_then(|()| Ok(mapping.finish()?));
        localization.publish_status(lost);
        localization.progress.finish();
        finished
    }

    /// Publishes the maps as if the data ended here; `lost` by the source so far.
    ///
    /// # Errors
    /// Where publishing stopped.
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

    /// A copy of all that is known now.
    pub(super) fn checkpoint(&self) -> PipelineCheckpoint {
        PipelineCheckpoint {
            registration: self.localization.registration.clone(),
            clock: self.localization.clock,
            scans: self.mapping.trajectory.lock().scans(),
            maps: self.mapping.maps.checkpoint(),
        }
    }

    /// The data begins anew, and with it the maps.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn restart(
        &mut self,
        config: &Config,
        registration: RegistrationSettings,
    ) -> Result<(), PublishError> {
        self.mapping.maps.restart(config)?;
        self.reset_to(ScanRegistration::new(registration), DataClock::default(), 0);
        Ok(())
    }

    /// The data goes on where the copy was taken.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn restore(&mut self, to: &PipelineCheckpoint) -> Result<(), PublishError> {
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
}

impl PipelineCheckpoint {
    /// Memory that it takes, bytes: nearly all of it is the maps'.
    pub(super) fn bytes(&self) -> usize {
        self.maps.bytes()
    }
}

fn map_received(
    receiver: Receiver<Vec<MappingInput>>,
    mapping: &mut MappingStage,
    threads: usize,
) -> Result<(), PublishError> {
    let _pool = join_mapping_pool(threads);
    // The receiver goes where mapping ends: or who places and waits for room would wait for ever.
    receiver
        .into_iter()
        .flatten()
        .try_for_each(|input| mapping.take(input))
}

/// Makes this thread, which maps, one of those that share the work of a scan: were it outside of their pool, it would
/// have to wake two others for each scan and sleep itself, which costs as much as the second core gains.
///
/// Where that fails, rayon's own pool shares the work, for the same maps.
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
