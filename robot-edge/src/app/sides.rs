//! Both stages of a run, one behind the other or, where time matters, side by side.

use std::sync::mpsc::Receiver;
use std::thread;

use anyhow::anyhow;

use super::background::give_way;
use super::data_clock::DataClock;
use super::feed::{Batch, SourceEnd};
use super::mapping_side::MappingSide;
use super::parcels::parcels;
use super::placing_side::PlacingSide;
use super::step::Step;
use crate::config::Config;
use crate::localization::placer::{BeamPlacer, Placed, PlacerSettings};
use crate::pipeline::{MapsCheckpoint, Standstill};
use crate::streaming::publisher::PublishError;

/// Who places and who maps.
pub(super) struct Sides {
    // Ends first: what is driven is told zero before what is recorded is put on the disk.
    pub(super) mapping: MappingSide,
    pub(super) placing: PlacingSide,
}

/// All that both know at one time of the data.
pub(super) struct SidesCheckpoint {
    placer: BeamPlacer,
    clock: DataClock,
    scans: u64,
    maps: MapsCheckpoint,
}

impl Sides {
    /// Places and maps a batch.
    ///
    /// # Errors
    /// Where the recording cannot be written or publishing stopped.
    pub(super) fn take(&mut self, batch: Batch) -> anyhow::Result<()> {
        let Self { placing, mapping } = self;
        placing.take(batch, &mut |step| Ok(mapping.take(step)?))
    }

    /// Places on a thread of its own what `feed` hands over, and maps here: while a scan is mapped, consoles and the guard hear
    /// of the next ones, and of where the vehicle is. That lasts as long as there is room for what waits to be mapped; where
    /// the present matters, scans that have waited too long are left out, so that there is. Mapping `gives_way` to placing
    /// where somebody drives.
    ///
    /// # Errors
    /// Where no thread can be had, or it failed. Within: where the recording cannot be written or publishing stopped.
    pub(super) fn place_ahead(
        &mut self,
        feed: impl FnOnce(&mut dyn FnMut(Batch) -> bool) -> SourceEnd + Send,
        threads: usize,
        gives_way: bool,
    ) -> anyhow::Result<(SourceEnd, anyhow::Result<()>)> {
        let Self { placing, mapping } = self;
        thread::scope(|scope| {
            let (mut parcels, receiver) = parcels(mapping.is_live);
            let place = move || {
                let mut placed = Ok(());
                let end = feed(&mut |batch| {
                    if placed.is_ok() {
                        placed = placing.take(batch, &mut |step| parcels.add(step));
                    }
                    placed.is_ok()
                });
                // Whatever has stopped placing, what was placed is mapped.
                let sent = parcels.finish();
                (end, placed.and(sent))
            };
            let placing = thread::Builder::new()
                .name("placing".to_owned())
                .spawn_scoped(scope, place)?;
            if gives_way {
                give_way();
            }
            let mapped = map_all(receiver, mapping, threads);
            let (end, placed) = placing
                .join()
                .map_err(|_panic| anyhow!("reading or placing failed"))?;
            Ok((end, mapped.map_err(Into::into).and(placed)))
        })
    }

    /// The data has ended: maps what still waits; `lost` by the source so far.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn finish(&mut self, lost: u64) -> anyhow::Result<()> {
        let Self { placing, mapping } = self;
        let placed = placing.finish(&mut |step| Ok(mapping.take(step)?));
        let finished = placed.and_then(|()| Ok(mapping.finish()?));
        placing.tell_status(lost);
        placing.progress.finish();
        finished
    }

    /// Publishes the maps as if the data ended here; `lost` by the source so far.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn stand_still(&mut self, lost: u64) -> Result<Standstill, PublishError> {
        let mut ended = self.placing.placer.clone();
        let mut waiting: Vec<Placed> = Vec::new();
        ended.finish(&mut waiting);
        let standstill = self.mapping.stand_still(waiting)?;
        if let Some(herald) = &mut self.placing.herald
            && let Some(pose) = ended.newest_pose()
        {
            herald.moved(pose);
        }
        self.placing.tell_status(lost);
        Ok(standstill)
    }

    /// A copy of all that is known now.
    pub(super) fn checkpoint(&self) -> SidesCheckpoint {
        SidesCheckpoint {
            placer: self.placing.placer.clone(),
            clock: self.placing.clock,
            scans: self.mapping.trajectory.lock().scans(),
            maps: self.mapping.maps.checkpoint(),
        }
    }

    /// The data begins anew, and with it the maps.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn begin_anew(
        &mut self,
        config: &Config,
        placer: PlacerSettings,
    ) -> Result<(), PublishError> {
        self.mapping.maps.begin_anew(config)?;
        self.stand_at(BeamPlacer::new(placer), DataClock::default(), 0);
        Ok(())
    }

    /// The data goes on where the copy was taken.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn go_back(&mut self, to: &SidesCheckpoint) -> Result<(), PublishError> {
        self.mapping.maps.go_back(&to.maps)?;
        self.stand_at(to.placer.clone(), to.clock, to.scans);
        Ok(())
    }

    fn stand_at(&mut self, placer: BeamPlacer, clock: DataClock, scans: u64) {
        self.placing.placer = placer;
        self.placing.clock = clock;
        self.placing.streams.clear();
        if let Some(herald) = &mut self.placing.herald {
            herald.wind(clock.elapsed());
        }
        self.mapping.wind(scans);
    }
}

impl SidesCheckpoint {
    /// Memory that it takes, bytes: nearly all of it is the maps'.
    pub(super) fn bytes(&self) -> usize {
        self.maps.bytes()
    }
}

fn map_all(
    receiver: Receiver<Vec<Step>>,
    mapping: &mut MappingSide,
    threads: usize,
) -> Result<(), PublishError> {
    let _pool = pool_around_this_thread(threads);
    // The receiver goes where mapping ends: or who places and waits for room would wait for ever.
    receiver
        .into_iter()
        .flatten()
        .try_for_each(|step| mapping.take(step))
}

/// Makes this thread, which maps, one of those that share the work of a scan: were it outside of their pool, it would
/// have to wake two others for each scan and sleep itself, which costs as much as the second core gains.
///
/// Where that fails, rayon's own pool shares the work, for the same maps.
pub(super) fn pool_around_this_thread(threads: usize) -> Option<rayon::ThreadPool> {
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
