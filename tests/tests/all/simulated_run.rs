//! A simulated world through the edge's own pipeline, at library level.

use std::sync::MutexGuard;

use protocol::layer::LayerId;
use protocol::tile::BootId;
use protocol::tile_store::{RootDigest, TileStore};
use robot_edge::app::placing;
use robot_edge::config::{self, Config, Override};
use robot_edge::localization::placer::{MountOrigin, PlacerSettings, PoseOrigin};
use robot_edge::mapping::posed_scan::PosedScan;
use robot_edge::measurement::Measurement;
use robot_edge::pipeline::Pipeline;
use robot_edge::robot_time::RobotDuration;
use robot_edge::simulation::source::START;
use robot_edge::simulation::{SimulatedSource, SimulationOptions, World};

/// A vehicle that drives through a world and maps it.
pub(crate) struct SimulatedRun {
    source: SimulatedSource,
    /// The first measurement that is not in the pipeline yet.
    next: Option<Measurement>,
    pipeline: Pipeline,
}

impl SimulatedRun {
    /// At the start of the world's path.
    pub(crate) fn new(world: &World, options: SimulationOptions, config: &Config) -> Self {
        let mut source = SimulatedSource::new(world, options).unwrap();
        Self {
            next: source.next_measurement(),
            source,
            pipeline: pipeline(config),
        }
    }

    /// Maps all that was measured up to `until_s` after the start.
    pub(crate) fn advance_to(&mut self, until_s: f64) {
        self.advance_with(until_s, |_| ());
    }

    /// The same; hands every scan that got into the map to `mapped`.
    pub(crate) fn advance_with(&mut self, until_s: f64, mut mapped: impl FnMut(&PosedScan)) {
        let until = START + RobotDuration::from_secs_f64(until_s);
        while let Some(measurement) = self.next.take_if(|next| next.stamp <= until) {
            self.pipeline.push(measurement, &mut mapped).unwrap();
            self.next = self.source.next_measurement();
        }
    }

    /// Maps the rest and publishes all of it.
    pub(crate) fn finish(mut self) -> Pipeline {
        self.advance_to(self.duration_s());
        assert_eq!(self.next, None);
        self.pipeline.finish(|_| ()).unwrap();
        self.pipeline
    }

    /// How long the vehicle drives, seconds.
    pub(crate) fn duration_s(&self) -> f64 {
        self.source.duration_s()
    }

    /// What is published so far: at most `streaming.publish_period_s` behind the map.
    pub(crate) fn store(&self) -> MutexGuard<'_, TileStore> {
        self.pipeline.publisher().store()
    }
}

/// Everything that a run measures, in stamp order.
pub(crate) fn measurements(world: &World, options: SimulationOptions) -> Vec<Measurement> {
    let mut source = SimulatedSource::new(world, options).unwrap();
    std::iter::from_fn(|| source.next_measurement()).collect()
}

/// Empty maps of the vehicle, set up as `robot-edge simulate` does it (`determinism.rs` compares the two).
pub(crate) fn pipeline(config: &Config) -> Pipeline {
    Pipeline::new(config, placer_settings(config), BootId([0; 16]), false).unwrap()
}

/// The configuration of the world's vehicle, with `settings` (`key=value`) over it.
pub(crate) fn vehicle_config(world: &World, settings: &[&str]) -> Config {
    let overrides: Vec<Override> = settings
        .iter()
        .map(|setting| setting.parse().unwrap())
        .collect();
    config::load(world.vehicle(), &overrides).unwrap()
}

pub(crate) fn digest(pipeline: &Pipeline) -> RootDigest {
    let store = pipeline.publisher().store();
    store.root_digest(LayerId::Occupancy).unwrap()
}

fn placer_settings(config: &Config) -> PlacerSettings {
    let origin = PoseOrigin::Tf {
        fixed_frame: "odom".into(),
        mount: MountOrigin::Tree,
    };
    placing::placer_settings(config, placing::main_laser(config).unwrap(), origin)
}
