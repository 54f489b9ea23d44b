//! A simulated world through the edge's pipeline, at library level.

use measurement::Measurement;
use protocol::layer::LayerId;
use protocol::tile_store::RootDigest;
use robot_edge::config::Config;
use robot_edge::experiments::run;
use robot_edge::runtime::Pipeline;
use simulation::{SimulatedSource, SimulationOptions, World};

/// All measurements of a run, by stamp.
pub(crate) fn measurements(world: &World, options: SimulationOptions) -> Vec<Measurement> {
    let mut source = SimulatedSource::new(world, options).unwrap();
    std::iter::from_fn(|| source.next_measurement()).collect()
}

/// The pipeline of `robot-edge simulate` (`determinism.rs` compares the two).
pub(crate) fn pipeline(config: &Config) -> Pipeline {
    run::pipeline(config, &[]).unwrap()
}

/// The configuration of the world's vehicle, changed by `settings` (`key=value`).
pub(crate) fn vehicle_config(world: &World, settings: &[&str]) -> Config {
    run::vehicle_config(world, settings).unwrap()
}

pub(crate) fn digest(pipeline: &Pipeline) -> RootDigest {
    let store = pipeline.publisher().store();
    store.root_digest(LayerId::Occupancy).unwrap()
}
