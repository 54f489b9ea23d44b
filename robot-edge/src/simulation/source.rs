//! A simulated run as a source of measurements.

mod ticks;

use std::collections::VecDeque;
use std::sync::Arc;

use crate::measurement::{FrameId, Measurement, MeasurementData, Stream, StreamId};
use crate::pose::Pose;
use crate::robot_time::{RobotDuration, RobotTime};
use crate::simulation::laser::{LaserErrors, LaserNoise};
use crate::simulation::path::Path;
use crate::simulation::scene::Scene;
use crate::simulation::source::ticks::{Ticks, seconds};
use crate::simulation::vehicle::SimulatedVehicle;
use crate::simulation::world::World;

/// The stamp of time 0 of every run: 2000-01-01T00:00:00Z. Not zero, which in ROS messages means that
/// there is no stamp.
pub const START: RobotTime = RobotTime::from_nanos(946_684_800_000_000_000);

/// What differs between runs in the same world.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct SimulationOptions {
    /// Chooses the noise.
    pub seed: u64,
    /// Ends the run before the path does, seconds.
    pub duration_s: Option<f64>,
    /// Standard deviation of ranges in place of the world's, metres.
    pub range_noise_m: Option<f64>,
    /// Probability of a dropout in place of the world's.
    pub dropout: Option<f64>,
}

/// An option that makes no sense.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("`{option}` is {value}, it must be {must_be}")]
pub struct OptionError {
    /// Name of the option.
    pub option: &'static str,
    /// What was given.
    pub value: f64,
    /// What is allowed.
    pub must_be: &'static str,
}

/// Drives a world's path and yields what the vehicle's sensors say, in the order of stamps.
///
/// `/tf_static` comes once, `/tf` and `/odom` say the same true pose at the odometry's rate, `/scan` comes
/// at the laser's. A scan's stamp is that of beam 0, so the poses of its later beams follow it. The last
/// scan is one whose last beam still has a pose after it.
pub struct SimulatedSource {
    scene: Arc<Scene>,
    path: Arc<Path>,
    vehicle: SimulatedVehicle,
    errors: LaserErrors,
    noise: LaserNoise,
    streams: Vec<Stream>,
    frames: Frames,
    odometry: Ticks,
    scans: Ticks,
    /// At most the measurements of one instant.
    ready: VecDeque<Measurement>,
}

const TF_STATIC: StreamId = StreamId(0);
const TF: StreamId = StreamId(1);
const ODOM: StreamId = StreamId(2);
const SCAN: StreamId = StreamId(3);

struct Frames {
    odom: FrameId,
    base: FrameId,
    laser: FrameId,
}

impl SimulatedSource {
    /// A run from the beginning of the world's path.
    pub fn new(world: &World, options: SimulationOptions) -> Result<Self, OptionError> {
        let defaults = world.laser_errors();
        let errors = LaserErrors {
            range_noise_m: options.range_noise_m.unwrap_or(defaults.range_noise_m),
            dropout: options.dropout.unwrap_or(defaults.dropout),
        };
        let duration_s = options.duration_s.unwrap_or(f64::INFINITY);
        not_negative("duration_s", duration_s)?;
        not_negative("range_noise_m", errors.range_noise_m)?;
        if !(0.0..=1.0).contains(&errors.dropout) {
            return Err(OptionError {
                option: "dropout",
                value: errors.dropout,
                must_be: "a probability from 0 to 1",
            });
        }
        let vehicle = world.simulated_vehicle().clone();
        let run_s = duration_s.min(world.path().duration_s());
        let odometry = Ticks::until(run_s, vehicle.odometry_rate_hz);
        let last_pose_s = odometry.last_s();
        let scans = Ticks::until(
            last_pose_s - vehicle.laser.sweep_duration_s(),
            vehicle.laser.rate_hz,
        );
        let mut source = Self {
            scene: Arc::clone(world.scene()),
            path: Arc::clone(world.path()),
            noise: LaserNoise::new(options.seed, "laser"),
            errors,
            streams: streams(),
            frames: Frames {
                odom: FrameId::from("odom"),
                base: FrameId::from("base_link"),
                laser: FrameId::from("laser"),
            },
            odometry,
            scans,
            ready: VecDeque::new(),
            vehicle,
        };
        source.push_mount();
        Ok(source)
    }

    /// All streams of the run; a [`StreamId`] is an index into it.
    pub fn streams(&self) -> &[Stream] {
        &self.streams
    }

    /// Time from the first stamp to the last pose, seconds.
    pub fn duration_s(&self) -> f64 {
        self.odometry.last_s()
    }

    /// The next measurement; `None` at the end of the path or of the duration.
    pub fn next_measurement(&mut self) -> Option<Measurement> {
        if self.ready.is_empty() {
            let pose_nanos = self.odometry.next_nanos();
            let scan_nanos = self.scans.next_nanos();
            if pose_nanos.is_some_and(|pose| scan_nanos.is_none_or(|scan| pose <= scan)) {
                self.odometry.advance();
                self.push_pose(pose_nanos?);
            } else if let Some(nanos) = scan_nanos {
                self.scans.advance();
                self.push_scan(nanos);
            }
        }
        self.ready.pop_front()
    }

    fn push_mount(&mut self) {
        self.ready.push_back(Measurement {
            stamp: START,
            stream: TF_STATIC,
            frame: FrameId::clone(&self.frames.base),
            data: MeasurementData::Transform {
                child: FrameId::clone(&self.frames.laser),
                parent_from_child: self.vehicle.laser.base_from_laser,
                is_static: true,
            },
        });
    }

    fn push_pose(&mut self, nanos: i64) {
        let odom_from_base = self.path.world_from_base(seconds(nanos));
        let child = FrameId::clone(&self.frames.base);
        self.push_in_odom(
            nanos,
            TF,
            MeasurementData::Transform {
                child: FrameId::clone(&child),
                parent_from_child: odom_from_base,
                is_static: false,
            },
        );
        self.push_in_odom(
            nanos,
            ODOM,
            MeasurementData::Odometry {
                child,
                odom_from_base,
            },
        );
    }

    fn push_in_odom(&mut self, nanos: i64, stream: StreamId, data: MeasurementData) {
        self.ready.push_back(Measurement {
            stamp: START + RobotDuration::from_nanos(nanos),
            stream,
            frame: FrameId::clone(&self.frames.odom),
            data,
        });
    }

    fn push_scan(&mut self, nanos: i64) {
        let (path, start_s) = (&self.path, seconds(nanos));
        let world_from_base = |after_s: f64| -> Pose { path.world_from_base(start_s + after_s) };
        let laser = &self.vehicle.laser;
        let scan = laser.sweep(&self.scene, self.errors, &mut self.noise, world_from_base);
        self.ready.push_back(Measurement {
            stamp: START + RobotDuration::from_nanos(nanos),
            stream: SCAN,
            frame: FrameId::clone(&self.frames.laser),
            data: MeasurementData::Scan {
                scan,
                own_pose: None,
            },
        });
    }
}

fn not_negative(option: &'static str, value: f64) -> Result<(), OptionError> {
    if value >= 0.0 {
        Ok(())
    } else {
        Err(OptionError {
            option,
            value,
            must_be: "0 or more",
        })
    }
}

/// In the order of their [`StreamId`]s.
fn streams() -> Vec<Stream> {
    [
        ("/tf_static", "tf2_msgs/TFMessage"),
        ("/tf", "tf2_msgs/TFMessage"),
        ("/odom", "nav_msgs/Odometry"),
        ("/scan", "sensor_msgs/LaserScan"),
    ]
    .map(|(name, type_name)| Stream {
        name: name.to_owned(),
        type_name: type_name.to_owned(),
    })
    .to_vec()
}

#[cfg(test)]
mod tests;
