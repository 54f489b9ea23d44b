//! A simulated world through the edge's own pipeline.

use std::collections::VecDeque;
use std::sync::MutexGuard;

use protocol::layer::{LayerId, UNKNOWN};
use protocol::tile::{BootId, TILE_SIDE};
use protocol::tile_store::TileStore;

use super::session::Rules;
use edge::config::{self, Config, Override};
use edge::runtime::tilt_control::TiltControl;
use edge::runtime::{self, MapEvent, Pipeline, localization_plan};
use mapping::registered_scan::RegisteredScan;
use measurement::time::RobotDuration;
use measurement::{Measurement, MeasurementData, Stream};
use simulation::attitude::Attitude;
use simulation::noise::NoiseStream;
use simulation::source::START;
use simulation::{SimulatedSource, SimulationOptions, World};

/// Changes a measurement before it is mapped.
type Disturbance = dyn FnMut(&mut Measurement);

/// A vehicle that drives through a world and maps it.
pub struct SimulatedRun {
    source: SimulatedSource,
    disturb: Option<Box<Disturbance>>,
    /// The first measurement that is not in the pipeline yet.
    next: Option<Measurement>,
    pipeline: Pipeline,
    tilt: Option<TiltControl>,
}

/// Noise on roll, pitch and yaw of the poses themselves.
struct AttitudeNoise {
    deviation_rad: f64,
    axes: [AveragedNoise; 3],
}

/// Noise of which as many of the last numbers are averaged.
struct AveragedNoise {
    stream: NoiseStream,
    last: VecDeque<f64>,
    averaged: usize,
}

impl SimulatedRun {
    /// At the start of the world's path.
    pub fn new(world: &World, options: SimulationOptions, config: &Config) -> anyhow::Result<Self> {
        let mut source = SimulatedSource::new(world, options)?;
        let tilt = TiltControl::new(config);
        Ok(Self {
            pipeline: pipeline(config, source.streams())?.with_tilt_control(tilt.clone()),
            tilt,
            next: source.next_measurement(),
            source,
            disturb: None,
        })
    }

    /// The same with the world's attitude noise on the transforms that say where the vehicle is, of so many of
    /// them averaged: of a vehicle whose attitude sensor gives its poses, which a simulated source takes from
    /// the truth. To be called before anything is mapped.
    #[must_use]
    pub fn with_noisy_attitudes(self, world: &World, seed: u64, averaged: usize) -> Self {
        let mut noise = AttitudeNoise {
            deviation_rad: world.attitude_noise_rad(),
            axes: ["roll", "pitch", "yaw"].map(|axis| AveragedNoise {
                stream: NoiseStream::new(seed, &format!("experiments/poses/{axis}")),
                last: VecDeque::new(),
                averaged: averaged.max(1),
            }),
        };
        self.with_disturbance(move |measurement| noise.disturb(measurement))
    }

    /// The same with every measurement changed before it is mapped. To be called before anything is mapped.
    #[must_use]
    pub fn with_disturbance(mut self, mut disturb: impl FnMut(&mut Measurement) + 'static) -> Self {
        if let Some(next) = &mut self.next {
            disturb(next);
        }
        self.disturb = Some(Box::new(disturb));
        self
    }

    /// As [`new`](Self::new), with the configuration of the world's own vehicle and `settings`
    /// (`key=value`) over it.
    pub fn with_settings(
        world: &World,
        options: SimulationOptions,
        settings: &[&str],
    ) -> anyhow::Result<Self> {
        Self::new(world, options, &vehicle_config(world, settings)?)
    }

    /// Maps all that was measured up to `until_s` after the start.
    pub fn advance_to(&mut self, until_s: f64) -> anyhow::Result<()> {
        self.advance_with(until_s, |_, _| ())
    }

    /// The same; hands every scan that got into the map to `mapped`, with the maps as they are then.
    pub fn advance_with(
        &mut self,
        until_s: f64,
        mut mapped: impl FnMut(&Pipeline, &RegisteredScan),
    ) -> anyhow::Result<()> {
        let until = START + RobotDuration::from_secs_f64(until_s);
        while let Some(measurement) = self.next.take_if(|next| next.stamp <= until) {
            for scan in self.pipeline.push(measurement)? {
                mapped(&self.pipeline, &scan);
            }
            if let Some(goal) = self.tilt.as_ref().map(TiltControl::goal)
                && let Some(angle_rad) = goal.angle_rad()
            {
                self.source.turn(goal.joint(), angle_rad);
            }
            self.next = self.source.next_measurement();
            if let (Some(disturb), Some(next)) = (&mut self.disturb, &mut self.next) {
                disturb(next);
            }
        }
        Ok(())
    }

    /// Maps the rest and publishes all of it.
    pub fn finish(mut self) -> anyhow::Result<Pipeline> {
        self.advance_to(self.duration_s())?;
        self.pipeline.finish()?;
        Ok(self.pipeline)
    }

    /// Seconds.
    pub fn duration_s(&self) -> f64 {
        self.source.duration_s()
    }

    /// Changes of the ground plane and jumps of poses since the last call, in order.
    pub fn take_map_events(&mut self) -> Vec<MapEvent> {
        self.pipeline.take_map_events()
    }

    pub const fn pipeline(&self) -> &Pipeline {
        &self.pipeline
    }

    /// What is published so far: at most `streaming.publish_period_s` behind the map.
    pub fn store(&self) -> MutexGuard<'_, TileStore> {
        self.pipeline.publisher().store()
    }
}

impl AttitudeNoise {
    fn disturb(&mut self, measurement: &mut Measurement) {
        if let MeasurementData::Transform {
            parent_from_child,
            is_static: false,
            ..
        } = &mut measurement.data
        {
            let truth = Attitude::of(&parent_from_child.rotation);
            let [roll, pitch, yaw] = &mut self.axes;
            let read = |truth_rad: f64, noise: &mut AveragedNoise| {
                truth_rad + self.deviation_rad * noise.next()
            };
            parent_from_child.rotation = Attitude {
                roll_rad: read(truth.roll_rad, roll),
                pitch_rad: read(truth.pitch_rad, pitch),
                yaw_rad: read(truth.yaw_rad, yaw),
            }
            .rotation();
        }
    }
}

impl AveragedNoise {
    fn next(&mut self) -> f64 {
        while self.last.len() >= self.averaged {
            self.last.pop_front();
        }
        while self.last.len() < self.averaged {
            self.last.push_back(self.stream.normal());
        }
        self.last.iter().sum::<f64>() / self.averaged as f64
    }
}

/// Empty maps of the vehicle whose sensors give these streams, set up as `robot-edge simulate` does it (a
/// test compares the two).
pub fn pipeline(config: &Config, streams: &[Stream]) -> anyhow::Result<Pipeline> {
    let registration = localization_plan::registration_settings(
        config,
        &runtime::simulated_localization_plan(config, streams)?,
    );
    Pipeline::new(config, registration, BootId([0; 16]), false)
}

/// The configuration of the world's vehicle, with `settings` (`key=value`) over it.
pub fn vehicle_config(world: &World, settings: &[&str]) -> anyhow::Result<Config> {
    config_by(world, Rules::Own, settings)
}

/// The same, by the rules of the vehicle's own preset or of its document.
pub(super) fn config_by(world: &World, rules: Rules, settings: &[&str]) -> anyhow::Result<Config> {
    let overrides: Result<Vec<Override>, _> =
        settings.iter().map(|setting| setting.parse()).collect();
    let preset = match rules {
        Rules::Own => world.vehicle().to_owned(),
        Rules::Document => format!("{}-document", world.vehicle()),
    };
    Ok(config::load(&preset, &overrides?)?)
}

/// Index and code of every known cell of a published layer.
pub fn known_cells(store: &TileStore, layer: LayerId) -> impl Iterator<Item = ([i64; 2], u16)> {
    let cells = store.tiles(layer).flat_map(|(key, stored)| {
        let (x, y) = key.first_cell();
        let rows = stored.cells().into_iter();
        rows.flat_map(|cells| cells.codes().chunks_exact(TILE_SIDE))
            .zip(y..)
            .flat_map(move |(row, y)| (x..).zip(row).map(move |(x, &code)| ([x, y], code)))
    });
    cells.filter(|(_, code)| *code != UNKNOWN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averaged_noise_is_as_much_smaller_as_it_must_be() {
        let deviation = |averaged| {
            let mut noise = AveragedNoise {
                stream: NoiseStream::new(1, "test"),
                last: VecDeque::new(),
                averaged,
            };
            let squares = (0..20_000).map(|_| noise.next().powi(2));
            libm::sqrt(squares.sum::<f64>() / 20_000.0)
        };
        assert!((deviation(1) - 1.0).abs() < 0.02, "{}", deviation(1));
        let expected = 1.0 / libm::sqrt(10.0);
        assert!((deviation(10) - expected).abs() < 0.03, "{}", deviation(10));
    }
}
