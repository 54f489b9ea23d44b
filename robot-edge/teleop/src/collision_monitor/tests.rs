//! The collision monitor in worlds of flat walls and pillars: of a vehicle that stands ([`Scene`]), and of one that obeys
//! with a delay ([`Drive`]).

mod arcs_and_contacts;
mod closed_loop;
mod docking;
mod situations;
mod unknown_space;

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::{Point2, Point3, Vector2, Vector3};

use crate::arbiter::factor_within;
use crate::collision_monitor::footprint::Footprint;
use crate::collision_monitor::{
    BlockageDetector, CollisionMonitor, CollisionMonitorConfig, CollisionMonitorInput,
    CollisionMonitorRules, CopyRequest, LocalMap, ObstacleScan, OdometrySample,
};
use crate::config::{Rules, TeleopConfig};
use crate::interface::{CollisionMonitorOutput, SpeedLimits};
use crate::locomotion::{LocomotionConfig, LocomotionMode};
use crate::motion::{Motion, MotionTarget, Velocity};
use mapping::ground_plane::GroundPlane;
use mapping::obstacle::ObstacleConfig;
use mapping::occupancy_grid::{OccupancyConfig, OccupancyGrid};
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, ScanKind, SensorId};
use mapping::vehicle::VehicleConfig;
use measurement::pose::{Pose, planar};
use measurement::time::{Monotonic, RobotTime};
use protocol::message::DockingChoice;

const TICK: Duration = Duration::from_millis(20);

/// Time of the first scan.
const START: Monotonic = Monotonic::from_nanos(1_000_000_000);

/// Rounds and time from scan to scan.
const SCAN_ROUNDS: u64 = 2;
const SCAN_PERIOD: Duration = Duration::from_millis(40);

const CREEP_MPS: f64 = 0.1;

/// A vehicle of the given size that turns at most 1 rad/s.
pub(super) fn vehicle(length_m: f64, width_m: f64, max_speed_mps: f64) -> VehicleConfig {
    VehicleConfig {
        length_m,
        width_m,
        max_speed_mps,
        ..VehicleConfig::default()
    }
}

/// Walls, each from one point to another, metres in `odom`.
type Walls = Vec<[Point2<f64>; 2]>;

fn wall(from: [f64; 2], to: [f64; 2]) -> [Point2<f64>; 2] {
    [from.into(), to.into()]
}

fn pillar(centre: [f64; 2], edge_m: f64) -> Walls {
    let half = 0.5 * edge_m;
    let corner = |x: f64, y: f64| [centre[0] + x * half, centre[1] + y * half];
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| corner(x, y));
    (0..4)
        .map(|n| wall(corners[n], corners[(n + 1) % 4]))
        .collect()
}

/// How the laser sees.
#[derive(Clone, Copy, Debug)]
struct Laser {
    mount_x_m: f64,
    beams: u32,
    field_of_view_rad: f64,
    range_max_m: f64,
}

impl Laser {
    const ALL_DIRECTIONS: Self = Self {
        mount_x_m: 0.0,
        beams: 721,
        field_of_view_rad: std::f64::consts::TAU * 720.0 / 721.0,
        range_max_m: 20.0,
    };

    /// At the front, and it sees the half ahead.
    const AHEAD: Self = Self {
        mount_x_m: 0.35,
        beams: 361,
        field_of_view_rad: std::f64::consts::PI,
        range_max_m: 20.0,
    };

    fn scan(&self, walls: &Walls, odom_from_base: &Pose) -> RegisteredScan {
        let step = self.field_of_view_rad / f64::from(self.beams - 1);
        let origin = odom_from_base * Point3::new(self.mount_x_m, 0.0, 0.2);
        let beams = (0..self.beams).map(|index| {
            let angle = f64::from(index) * step - 0.5 * self.field_of_view_rad;
            let direction =
                odom_from_base.rotation * Vector3::new(libm::cos(angle), libm::sin(angle), 0.0);
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
            kind: ScanKind::Beams,
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

/// The settings of a vehicle.
#[derive(Clone, Debug)]
pub(super) struct Setup {
    pub(super) monitor: CollisionMonitorConfig,
    pub(super) teleop: TeleopConfig,
    pub(super) vehicle: VehicleConfig,
}

/// With sensors whose misses can be trusted.
fn trusting_no_returns() -> CollisionMonitorConfig {
    CollisionMonitorConfig {
        treat_no_return_as_free: true,
        ..CollisionMonitorConfig::default()
    }
}

impl Default for Setup {
    /// 0.8 × 0.6 m, at most 1 m/s and 1 rad/s; its corners are 0.5 m from its middle. Margins of 10 cm ahead and 3 cm at
    /// the sides.
    fn default() -> Self {
        Self {
            monitor: trusting_no_returns(),
            teleop: TeleopConfig::default(),
            vehicle: vehicle(0.8, 0.6, 1.0),
        }
    }
}

impl Setup {
    pub(super) fn rules(&self) -> CollisionMonitorRules {
        CollisionMonitorRules::new(
            &self.monitor,
            &self.teleop,
            &self.vehicle,
            &ObstacleConfig::default(),
        )
        .unwrap()
    }

    /// A scan of a sensor that was never covered.
    pub(super) fn obstacle_scan(&self, scan: &RegisteredScan, at: Monotonic) -> ObstacleScan {
        let mut obstacle_scan = ObstacleScan::default();
        obstacle_scan.read(
            scan,
            &GroundPlane::under(&scan.odom_from_base),
            &self.rules(),
            &BlockageDetector::default(),
            (at, SCAN_PERIOD),
            None,
        );
        obstacle_scan
    }

    /// A map of what a laser sees from `pose` in all directions.
    fn map(
        &self,
        walls: &Walls,
        pose: &Pose,
        (measured_at, period): (Monotonic, Duration),
    ) -> LocalMap {
        let mut grid = OccupancyGrid::new(&OccupancyConfig::default());
        for _ in 0..3 {
            grid.integrate(&Laser::ALL_DIRECTIONS.scan(walls, pose));
        }
        let mut map = LocalMap::default();
        let request = CopyRequest {
            measured_at,
            period,
            centre: Point2::from(pose.translation.vector.xy()),
            reach_m: self.rules().window_m(),
            map_from_odom: nalgebra::Isometry2::identity(),
        };
        map.copy_occupancy(&grid, request);
        map
    }
}

fn limits_of(output: CollisionMonitorOutput) -> SpeedLimits {
    match output {
        CollisionMonitorOutput::Limits(limits) => limits,
        CollisionMonitorOutput::Off | CollisionMonitorOutput::Stale => panic!("{output:?}"),
    }
}

/// Whether unknown ground lets it creep ahead, and no faster.
fn creeps_ahead(limits: &SpeedLimits) -> bool {
    limits.in_unknown_space && limits.forward_mps <= CREEP_MPS + 1e-9
}

/// A vehicle in its first round: it stands, unless odometry says otherwise.
struct Scene {
    setup: Setup,
    obstacle_scans: Vec<ObstacleScan>,
    map: Option<LocalMap>,
    odometry: Option<OdometrySample>,
    commanded: Velocity,
    docking: Option<DockingChoice>,
    now: Monotonic,
    /// That of the last output.
    monitor: CollisionMonitor,
}

impl Scene {
    /// At the origin.
    fn new(setup: Setup, laser: Laser, walls: &Walls) -> Self {
        Self::at(planar(0.0, 0.0, 0.0), setup, laser, walls)
    }

    fn at(pose: Pose, setup: Setup, laser: Laser, walls: &Walls) -> Self {
        Self {
            obstacle_scans: vec![setup.obstacle_scan(&laser.scan(walls, &pose), START)],
            map: None,
            odometry: Some(OdometrySample {
                odom_from_base: pose,
                measured: Velocity::ZERO,
                measured_at: START,
            }),
            commanded: Velocity::ZERO,
            docking: None,
            now: START,
            monitor: CollisionMonitor::new(setup.rules()),
            setup,
        }
    }

    /// As measured and commanded, driving all the time.
    fn driving(mut self, velocity: Velocity) -> Self {
        self.odometry.as_mut().unwrap().measured = velocity;
        self.commanded = velocity;
        self
    }

    /// So long after the scan, with a new pose.
    fn wait(&mut self, millis: u64) {
        self.now = START + Duration::from_millis(millis);
        self.odometry.as_mut().unwrap().measured_at = self.now;
    }

    /// The output of a new monitor.
    fn output(&mut self, requested: Velocity) -> CollisionMonitorOutput {
        self.monitor = CollisionMonitor::new(self.setup.rules());
        self.next_output(requested)
    }

    fn next_output(&mut self, requested: Velocity) -> CollisionMonitorOutput {
        let input = CollisionMonitorInput {
            obstacle_scans: &self.obstacle_scans,
            map: self.map.as_ref(),
            odometry: self.odometry,
            commanded: self.commanded,
            requested,
            docking: self.docking,
        };
        self.monitor.output(&input, self.now)
    }

    fn limits(&mut self, requested: Velocity) -> SpeedLimits {
        limits_of(self.output(requested))
    }
}

/// A vehicle with a collision monitor in a world.
struct Drive {
    setup: Setup,
    walls: Walls,
    laser: Laser,
    monitor: CollisionMonitor,
    map: Option<LocalMap>,
    pose: Pose,
    motion: Motion,
    output: CollisionMonitorOutput,
    /// Commands under way to the motors, one a round.
    delayed: VecDeque<Velocity>,
    /// Standard deviation of ranges, metres, and share of beams that are lost.
    noise: (f64, f64),
    random: u64,
    /// What odometry has not reported yet, one a round.
    untold: VecDeque<OdometrySample>,
    obstacle_scans: Vec<ObstacleScan>,
    blockage: BlockageDetector,
    /// Beams whose part of the window is covered: none of them has an echo.
    covered: std::ops::Range<u32>,
    /// Beams of a sweep that hit the vehicle itself, while its window is open.
    own_body_hits: u32,
    round: u64,
}

impl Drive {
    /// At the origin, standing; odometry lags behind by some rounds.
    fn new(setup: Setup, walls: Walls, odometry_lag: usize) -> Self {
        let rules = setup.rules();
        let delay_rounds = (setup.monitor.actuator_delay_s / TICK.as_secs_f64()) as usize;
        let still = OdometrySample {
            odom_from_base: planar(0.0, 0.0, 0.0),
            measured: Velocity::ZERO,
            measured_at: START,
        };
        Self {
            monitor: CollisionMonitor::new(rules),
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

    fn now(&self) -> Monotonic {
        START + TICK * self.round as u32
    }

    fn footprint(&self) -> Footprint {
        let vehicle = &self.setup.vehicle;
        Footprint::centred(vehicle.length_m, vehicle.width_m)
            .moved_ahead(vehicle.footprint_offset_m)
    }

    /// One round: the collision monitor limits, the arbiter moves towards `requested` within that (or stops, where nothing is), and
    /// the vehicle does what it was commanded some time ago.
    fn round(&mut self, requested: Option<Velocity>) {
        self.evaluate(requested.unwrap_or_default());
        let locomotion = LocomotionConfig::default();
        let rules = Rules::new(&self.setup.teleop, &self.setup.vehicle, &locomotion).unwrap();
        let limits = &rules.limits;
        let turn_rate_at = (rules.locomotion, LocomotionMode::Differential);
        self.motion = match requested {
            Some(requested) if self.output != CollisionMonitorOutput::Stale => {
                let caps = self.output.caps();
                let target = requested.scaled(factor_within(requested, caps));
                let aim = MotionTarget {
                    target,
                    caps,
                    turn_rate_at,
                };
                self.motion.towards(&aim, TICK, limits)
            }
            Some(_) | None => self.motion.stopping(TICK, limits),
        };
        self.delayed.push_back(self.motion.velocity());
        let moves = self.delayed.pop_front().unwrap();
        let tick_s = TICK.as_secs_f64();
        for _ in 0..20 {
            let step = moves.scaled(tick_s / 20.0);
            self.pose *= planar(step.linear_mps, step.lateral_mps, step.angular_radps);
        }
        self.pose.rotation.renormalize();
        self.round += 1;
        self.untold.push_back(OdometrySample {
            odom_from_base: self.pose,
            measured: moves,
            measured_at: self.now(),
        });
    }

    /// The output for what is around now.
    fn evaluate(&mut self, requested: Velocity) {
        let now = self.now();
        if self.round.is_multiple_of(SCAN_ROUNDS) {
            let mut scan = self.laser.scan(&self.walls, &self.pose);
            self.disturb(&mut scan);
            let plane = GroundPlane::under(&self.pose);
            let rules = *self.monitor.rules();
            self.cover(&mut scan);
            self.blockage.update(&scan, now);
            let times = (now, SCAN_PERIOD);
            self.obstacle_scans[0].read(&scan, &plane, &rules, &self.blockage, times, None);
        }
        let odometry = self.untold.front().copied().unwrap_or(OdometrySample {
            odom_from_base: self.pose,
            measured: Velocity::ZERO,
            measured_at: now,
        });
        if self.round > 0 {
            self.untold.pop_front();
        }
        self.output = self.monitor.output(
            &CollisionMonitorInput {
                obstacle_scans: &self.obstacle_scans,
                map: self.map.as_ref(),
                odometry: Some(odometry),
                commanded: self.motion.velocity(),
                requested,
                docking: None,
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

    fn drive_for(&mut self, rounds: u32, requested: Velocity) {
        for _ in 0..rounds {
            self.round(Some(requested));
        }
    }

    fn limits(&self) -> SpeedLimits {
        limits_of(self.output)
    }

    /// How far the nearest wall is from the footprint, metres; negative inside.
    fn gap_m(&self) -> f64 {
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

#[test]
fn noise_at_the_greatest_speed_is_not_overspeed() {
    for (limit, measured, expected) in [
        (3.0, 3.08, 0.0),
        (3.0 * (1.0 - 1e-12), -3.08, 0.0),
        (3.0, 3.1, 0.1),
        (2.9, 2.9, 0.0),
        (2.9, 2.95, 0.05),
        (0.0, -0.25, -0.25),
    ] {
        // What holds the other way does not matter.
        for other in [0.0, 3.0] {
            let limits = if measured < 0.0 {
                (other, limit)
            } else {
                (limit, other)
            };
            let is = super::beyond(limits, measured, 3.0);
            assert!((is - expected).abs() < 1e-9, "{limit} {measured}: {is}");
        }
    }
}
