//! A world seen from above, a planar laser in it, and a vehicle that does what it is told with a delay.

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::{Point2, Point3, Vector2};

use crate::collision_monitor::footprint::Footprint;
use crate::collision_monitor::{
    BlockageDetector, CollisionMonitor, CollisionMonitorConfig, CollisionMonitorInput,
    CollisionMonitorRules, LocalMap, ObstacleScan, OdometrySample,
};
use crate::config::TeleopConfig;
use crate::input::CollisionMonitorOutput;
use crate::motion::Velocity;
use crate::motion::{AxisLimits, Motion, MotionTarget};
use mapping::ground_plane::GroundPlane;
use mapping::obstacle::ObstacleConfig;
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, SensorId};
use mapping::vehicle::VehicleConfig;
use measurement::pose::{Pose, planar};
use measurement::time::Monotonic;
use measurement::time::RobotTime;

pub(super) const TICK: Duration = Duration::from_millis(20);

/// Of every drive: a clock that runs.
const START: Monotonic = Monotonic::from_nanos(1_000_000_000);

/// Rounds from sweep to sweep.
const SWEEP_ROUNDS: u64 = 2;

/// Walls, each from one point to another, metres in `odom`.
pub(super) type Walls = Vec<[Point2<f64>; 2]>;

pub(super) fn wall(from: [f64; 2], to: [f64; 2]) -> [Point2<f64>; 2] {
    [from.into(), to.into()]
}

pub(super) fn pillar(centre: [f64; 2], edge_m: f64) -> Walls {
    let half = 0.5 * edge_m;
    let corner = |x: f64, y: f64| [centre[0] + x * half, centre[1] + y * half];
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| corner(x, y));
    (0..4)
        .map(|n| wall(corners[n], corners[(n + 1) % 4]))
        .collect()
}

/// How the laser sees.
#[derive(Clone, Copy, Debug)]
pub(super) struct Laser {
    pub(super) mount_x_m: f64,
    pub(super) beams: u32,
    pub(super) field_of_view_rad: f64,
    pub(super) range_max_m: f64,
}

impl Laser {
    pub(super) const ALL_DIRECTIONS: Self = Self {
        mount_x_m: 0.0,
        beams: 721,
        field_of_view_rad: std::f64::consts::TAU * 720.0 / 721.0,
        range_max_m: 20.0,
    };

    pub(super) fn scan(&self, walls: &Walls, odom_from_base: &Pose) -> RegisteredScan {
        let step = self.field_of_view_rad / f64::from(self.beams - 1);
        let origin = odom_from_base * Point3::new(self.mount_x_m, 0.0, 0.2);
        let beams = (0..self.beams).map(|index| {
            let angle = f64::from(index) * step - 0.5 * self.field_of_view_rad;
            let direction = odom_from_base.rotation
                * nalgebra::Vector3::new(libm::cos(angle), libm::sin(angle), 0.0);
            let range = walls
                .iter()
                .filter_map(|wall| range_m(origin.xy(), direction.xy(), wall))
                .fold(f64::INFINITY, f64::min);
            let is_hit = range < self.range_max_m;
            let range_m = range.min(self.range_max_m);
            RegisteredBeam {
                origin_in_odom: origin,
                end_in_odom: origin + direction * range_m,
                outcome: if is_hit {
                    BeamOutcome::Hit
                } else {
                    BeamOutcome::Miss
                },
                index,
                range_m: range_m as f32,
            }
        });
        RegisteredScan {
            stamp: RobotTime::from_nanos(0),
            sensor: SensorId(0),
            beam_step_rad: step,
            own_body_hits: 0,
            odom_from_base: *odom_from_base,
            beams: beams.collect(),
        }
    }
}

fn range_m(origin: Point2<f64>, direction: Vector2<f64>, wall: &[Point2<f64>; 2]) -> Option<f64> {
    let along = wall[1] - wall[0];
    let to = wall[0] - origin;
    let cross = |a: Vector2<f64>, b: Vector2<f64>| a.x * b.y - a.y * b.x;
    let turn = cross(direction, along);
    let (range, share) = (cross(to, along) / turn, cross(to, direction) / turn);
    (range >= 0.0 && (0.0..=1.0).contains(&share)).then_some(range)
}

/// What the vehicle is.
#[derive(Clone, Debug)]
pub(super) struct Setup {
    pub(super) guard: CollisionMonitorConfig,
    pub(super) teleop: TeleopConfig,
    pub(super) vehicle: VehicleConfig,
}

/// With sensors whose misses can be trusted.
pub(super) fn trusting_no_returns() -> CollisionMonitorConfig {
    CollisionMonitorConfig {
        treat_no_return_as_free: true,
        ..CollisionMonitorConfig::default()
    }
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            guard: trusting_no_returns(),
            teleop: TeleopConfig::default(),
            vehicle: VehicleConfig::default(),
        }
    }
}

impl Setup {
    pub(super) fn rules(&self) -> CollisionMonitorRules {
        CollisionMonitorRules::new(
            &self.guard,
            &self.teleop,
            &self.vehicle,
            &ObstacleConfig::default(),
        )
        .unwrap()
    }

    fn axes(&self) -> (AxisLimits, AxisLimits) {
        let (teleop, vehicle) = (&self.teleop, &self.vehicle);
        let linear = AxisLimits {
            speed: vehicle.max_speed_mps,
            accel: teleop.accel_mps2,
            jerk: teleop.jerk_mps3,
            stop_decel: teleop.stop_decel_mps2,
        };
        let angular = AxisLimits {
            speed: vehicle.max_turn_rate_radps,
            accel: teleop.accel_radps2,
            jerk: teleop.jerk_radps3,
            stop_decel: teleop.stop_decel_radps2,
        };
        (linear, angular)
    }
}

/// A guarded vehicle in a world.
pub(super) struct Drive {
    pub(super) setup: Setup,
    pub(super) walls: Walls,
    pub(super) laser: Laser,
    pub(super) guard: CollisionMonitor,
    pub(super) map: Option<LocalMap>,
    pub(super) pose: Pose,
    pub(super) motion: Motion,
    pub(super) output: CollisionMonitorOutput,
    /// Commands under way to the motors, one a round.
    delayed: VecDeque<Velocity>,
    /// Standard deviation of ranges, metres, and share of beams that are lost.
    pub(super) noise: (f64, f64),
    random: u64,
    /// What odometry has not told yet, one a round.
    untold: VecDeque<OdometrySample>,
    obstacle_scans: Vec<ObstacleScan>,
    pub(super) blockage: BlockageDetector,
    /// Beams whose part of the window is covered: none of them has an echo.
    pub(super) covered: std::ops::Range<u32>,
    /// Beams of a sweep that hit the vehicle itself, while its window is open.
    pub(super) own_body_hits: u32,
    round: u64,
}

impl Drive {
    /// At the origin, standing; odometry lags behind by some rounds.
    pub(super) fn new(setup: Setup, walls: Walls, odometry_lag: usize) -> Self {
        let rules = setup.rules();
        let delay_rounds = (setup.guard.actuator_delay_s / TICK.as_secs_f64()) as usize;
        let still = OdometrySample {
            odom_from_base: planar(0.0, 0.0, 0.0),
            measured: Velocity::ZERO,
            measured_at: START,
        };
        Self {
            guard: CollisionMonitor::new(rules),
            setup,
            walls,
            laser: Laser::ALL_DIRECTIONS,
            map: None,
            pose: planar(0.0, 0.0, 0.0),
            motion: Motion::default(),
            output: CollisionMonitorOutput::Stale,
            delayed: vec![Velocity::ZERO; delay_rounds].into(),
            noise: (0.0, 0.0),
            random: 0x9E37_79B9_7F4A_7C15,
            untold: vec![still; odometry_lag].into(),
            obstacle_scans: vec![ObstacleScan::default()],
            blockage: BlockageDetector::default(),
            covered: 0..0,
            own_body_hits: 0,
            round: 0,
        }
    }

    pub(super) fn now(&self) -> Monotonic {
        START + TICK * self.round as u32
    }

    pub(super) fn footprint(&self) -> Footprint {
        let vehicle = &self.setup.vehicle;
        Footprint::centred(vehicle.length_m, vehicle.width_m)
            .moved_ahead(vehicle.footprint_offset_m)
    }

    /// One round: the guard speaks, the arbiter moves towards `requested` within that (or stops, where nothing is), and
    /// the vehicle does what it was told some time ago.
    pub(super) fn round(&mut self, requested: Option<Velocity>) {
        self.evaluate(requested.unwrap_or_default());
        let (linear, angular) = self.setup.axes();
        let limits = (&linear, &angular);
        self.motion = match requested {
            Some(requested) if self.output != CollisionMonitorOutput::Stale => {
                let caps = self.output.caps();
                let within = |speed: f64, cap: f64| {
                    if speed.abs() > cap {
                        cap / speed.abs()
                    } else {
                        1.0
                    }
                };
                let factor = within(requested.linear_mps, caps.0.towards(requested.linear_mps))
                    .min(within(
                        requested.angular_radps,
                        caps.1.towards(requested.angular_radps),
                    ));
                let target = requested.scaled(factor);
                self.motion
                    .towards(&MotionTarget { target, caps }, TICK, limits)
            }
            Some(_) | None => self.motion.stopping(TICK, limits),
        };
        self.delayed.push_back(self.motion.velocity());
        let moves = self.delayed.pop_front().unwrap();
        let tick_s = TICK.as_secs_f64();
        for _ in 0..20 {
            let (gone, turned) = (
                moves.linear_mps * tick_s / 20.0,
                moves.angular_radps * tick_s / 20.0,
            );
            self.pose *= planar(gone, 0.0, turned);
        }
        self.pose.rotation.renormalize();
        self.round += 1;
        self.untold.push_back(OdometrySample {
            odom_from_base: self.pose,
            measured: moves,
            measured_at: self.now(),
        });
    }

    /// The guard's word on what is around now.
    pub(super) fn evaluate(&mut self, requested: Velocity) {
        let now = self.now();
        if self.round.is_multiple_of(SWEEP_ROUNDS) {
            let mut scan = self.laser.scan(&self.walls, &self.pose);
            self.disturb(&mut scan);
            let plane = GroundPlane::under(&self.pose);
            let period = TICK * SWEEP_ROUNDS as u32;
            let rules = *self.guard.rules();
            self.cover(&mut scan);
            self.blockage.update(&scan, now);
            self.obstacle_scans[0].read(&scan, &plane, &rules, &self.blockage, (now, period));
        }
        let odometry = self.untold.front().copied().unwrap_or(OdometrySample {
            odom_from_base: self.pose,
            measured: Velocity::ZERO,
            measured_at: now,
        });
        if self.round > 0 {
            self.untold.pop_front();
        }
        self.output = self.guard.output(
            &CollisionMonitorInput {
                obstacle_scans: &self.obstacle_scans,
                map: self.map.as_ref(),
                odometry: Some(odometry),
                commanded: self.motion.velocity(),
                requested,
            },
            now,
        );
    }

    fn cover(&self, scan: &mut RegisteredScan) {
        if self.covered.is_empty() {
            scan.own_body_hits = self.own_body_hits;
        }
        let range_m = self.laser.range_max_m;
        for beam in &mut scan.beams {
            if self.covered.contains(&beam.index) {
                let along = (beam.end_in_odom - beam.origin_in_odom).normalize();
                beam.end_in_odom = beam.origin_in_odom + along * range_m;
                beam.outcome = BeamOutcome::Miss;
                beam.range_m = range_m as f32;
            }
        }
    }

    fn disturb(&mut self, scan: &mut RegisteredScan) {
        let (deviation_m, lost) = self.noise;
        let mut random = || {
            self.random ^= self.random << 13;
            self.random ^= self.random >> 7;
            self.random ^= self.random << 17;
            (self.random >> 11) as f64 / (1_u64 << 53) as f64
        };
        scan.beams.retain_mut(|beam| {
            // The sum of twelve is as good as normal, with a variance of 1.
            let error_m = deviation_m * ((0..12).map(|_| random()).sum::<f64>() - 6.0);
            let along = (beam.end_in_odom - beam.origin_in_odom).normalize();
            beam.end_in_odom += along * error_m;
            random() >= lost
        });
    }

    /// How far the nearest wall is from the footprint, metres; negative inside.
    pub(super) fn gap_m(&self) -> f64 {
        let footprint = self.footprint();
        let base_from_odom = self.pose.inverse();
        let points = self.walls.iter().flat_map(|wall| {
            let along = wall[1] - wall[0];
            let steps = ((along.norm() / 0.005) as usize).max(1);
            (0..=steps).map(move |n| wall[0] + along * (n as f64 / steps as f64))
        });
        points
            .map(|point| {
                let at = base_from_odom * Point3::new(point.x, point.y, 0.0);
                let x = (at.x - footprint.front_m).max(footprint.rear_m - at.x);
                let y = at.y.abs() - footprint.half_width_m;
                if x > 0.0 && y > 0.0 {
                    libm::hypot(x, y)
                } else {
                    x.max(y)
                }
            })
            .fold(f64::INFINITY, f64::min)
    }
}
