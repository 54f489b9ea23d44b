//! A simulated world through the edge's own pipeline.

use std::sync::MutexGuard;

use protocol::tile::BootId;
use protocol::tile_store::TileStore;

use super::ExperimentError;
use crate::app::{self, placing};
use crate::config::{self, Config, Override};
use crate::mapping::posed_scan::PosedScan;
use crate::measurement::{Measurement, Stream};
use crate::pipeline::{Happening, Pipeline};
use crate::robot_time::RobotDuration;
use crate::simulation::source::START;
use crate::simulation::{SimulatedSource, SimulationOptions, World};

/// A vehicle that drives through a world and maps it.
pub struct SimulatedRun {
    source: SimulatedSource,
    /// The first measurement that is not in the pipeline yet.
    next: Option<Measurement>,
    pipeline: Pipeline,
}

impl SimulatedRun {
    /// At the start of the world's path.
    ///
    /// # Errors
    /// Where the options or the configuration make no sense for this world.
    pub fn new(
        world: &World,
        options: SimulationOptions,
        config: &Config,
    ) -> Result<Self, ExperimentError> {
        let mut source = SimulatedSource::new(world, options)?;
        Ok(Self {
            pipeline: pipeline(config, source.streams())?,
            next: source.next_measurement(),
            source,
        })
    }

    /// As [`new`](Self::new), with the configuration of the world's own vehicle and `settings`
    /// (`key=value`) over it.
    ///
    /// # Errors
    /// As [`new`](Self::new), and where a setting is none.
    pub fn with_settings(
        world: &World,
        options: SimulationOptions,
        settings: &[&str],
    ) -> Result<Self, ExperimentError> {
        Self::new(world, options, &vehicle_config(world, settings)?)
    }

    /// Maps all that was measured up to `until_s` after the start.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn advance_to(&mut self, until_s: f64) -> Result<(), ExperimentError> {
        self.advance_with(until_s, |_, _| ())
    }

    /// The same; hands every scan that got into the map to `mapped`, with the maps as they are then.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn advance_with(
        &mut self,
        until_s: f64,
        mut mapped: impl FnMut(&Pipeline, &PosedScan),
    ) -> Result<(), ExperimentError> {
        let until = START + RobotDuration::from_secs_f64(until_s);
        let mut scans = Vec::new();
        while let Some(measurement) = self.next.take_if(|next| next.stamp <= until) {
            self.pipeline
                .push(measurement, |scan| scans.push(scan.clone()))?;
            for scan in scans.drain(..) {
                mapped(&self.pipeline, &scan);
            }
            self.next = self.source.next_measurement();
        }
        Ok(())
    }

    /// Maps the rest and publishes all of it.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn finish(mut self) -> Result<Pipeline, ExperimentError> {
        self.advance_to(self.duration_s())?;
        self.pipeline.finish(|_| ())?;
        Ok(self.pipeline)
    }

    /// How long the vehicle drives, seconds.
    pub fn duration_s(&self) -> f64 {
        self.source.duration_s()
    }

    /// Changes of the ground plane and jumps of poses since the last call, in order.
    pub fn take_happenings(&mut self) -> Vec<Happening> {
        self.pipeline.take_happenings()
    }

    /// The maps as they are now.
    pub const fn pipeline(&self) -> &Pipeline {
        &self.pipeline
    }

    /// What is published so far: at most `streaming.publish_period_s` behind the map.
    pub fn store(&self) -> MutexGuard<'_, TileStore> {
        self.pipeline.publisher().store()
    }
}

/// Empty maps of the vehicle whose sensors give these streams, set up as `robot-edge simulate` does it (a
/// test compares the two).
///
/// # Errors
/// Where the configuration does not fit.
pub fn pipeline(config: &Config, streams: &[Stream]) -> Result<Pipeline, ExperimentError> {
    let laser = placing::main_laser(config)?;
    let placer = placing::placer_settings(config, laser, app::pose_origin(config, streams)?);
    Ok(Pipeline::new(config, placer, BootId([0; 16]), false)?)
}

/// The configuration of the world's vehicle, with `settings` (`key=value`) over it.
///
/// # Errors
/// Where a setting is none.
pub fn vehicle_config(world: &World, settings: &[&str]) -> Result<Config, ExperimentError> {
    let overrides: Result<Vec<Override>, _> =
        settings.iter().map(|setting| setting.parse()).collect();
    Ok(config::load(world.vehicle(), &overrides?)?)
}
