//! A planar laser, sonar or rotating lidar: geometry, timing and errors of its beams, and its mount on a vehicle.

use measurement::cloud::{Cloud, CloudPoint};
use measurement::pose::Pose;
use measurement::scan::Scan;
use nalgebra::{Point3, Vector2, Vector3};

use crate::noise::NoiseStream;
use crate::scene::{Echo, Growth, Receiver, Scene};
use crate::tilt_servo::TiltServo;
use crate::vegetation::Cone;

/// A planar laser as its data sheet and its driver describe it, or a sonar, whose beams of sound are cast like
/// light. A rotating lidar is one laser above the other, each of these properties: [`RangeSensor::rings_rad`].
///
/// Beams are cast along exactly the f32 angles and at exactly the f32 times that the scan carries, so
/// that a message describes its sweep without rounding.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanarLaser {
    pub beams: u32,
    pub angle_min_rad: f32,
    pub angle_increment_rad: f32,
    /// Time from a beam to the next, seconds; 0 where all leave at once.
    pub time_increment_s: f32,
    pub rate_hz: f64,
    pub range_min_m: f32,
    pub range_max_m: f32,
    /// Readings are whole multiples of this, metres; 0 where they are not rounded.
    pub range_step_m: f64,
    /// Full angle of a beam's cone, radians; 0 is a line. It matters where [`LaserErrors::mixed_pixels`]
    /// are on.
    pub beam_divergence_rad: f64,
}

/// Reflectivity of all solids to a lidar, percent: world files give them none.
const INTENSITY: f32 = 50.0;

/// How readings err.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaserErrors {
    pub range_noise_m: f64,
    /// Probability that a beam gives no reading at all.
    pub dropout: f64,
    /// Probability that a beam whose footprint straddles an edge gives a range of both sides mixed
    /// instead of the one along its axis; 0 turns mixed pixels off.
    pub mixed_pixels: f64,
}

#[derive(Clone, Debug)]
pub(crate) struct LaserNoise {
    range: NoiseStream,
    dropout: NoiseStream,
    mirror: NoiseStream,
    mixed: NoiseStream,
}

impl LaserNoise {
    pub(crate) fn new(seed: u64, sensor: &str) -> Self {
        let stream = |purpose: &str| NoiseStream::new(seed, &format!("{sensor}/{purpose}"));
        Self {
            range: stream("range"),
            dropout: stream("dropout"),
            mirror: stream("mirror"),
            mixed: stream("mixed"),
        }
    }
}

impl PlanarLaser {
    /// Hokuyo URG-04LX-UG01. Data sheet: 1024 steps a turn, of which 683 over 240°, one turn in 100 ms,
    /// 20 … 5600 mm.
    pub(crate) fn urg_04lx_ug01() -> Self {
        let step_rad = std::f64::consts::TAU / 1024.0;
        Self {
            beams: 683,
            angle_min_rad: (-341.0 * step_rad) as f32,
            angle_increment_rad: step_rad as f32,
            time_increment_s: (0.1_f64 / 1024.0) as f32,
            rate_hz: 10.0,
            range_min_m: 0.02,
            range_max_m: 5.6,
            range_step_m: 0.0,
            // Data sheet: a spot of 40 mm at 4 m.
            beam_divergence_rad: 0.01,
        }
    }

    /// SICK LMS111 as the elevation document sets it up [LOD §5]: 120° of its 270°, which the document
    /// counts from 30° to 150° with 90° straight ahead, in steps of 0.25° at 25 Hz. Data sheet: 0.5 … 20 m
    /// and 15 mrad; its mirror turns once a scan, so 1440 steps take 40 ms.
    pub(crate) fn lms111() -> Self {
        let step_rad = 0.25_f64.to_radians();
        Self {
            beams: 481,
            angle_min_rad: (-240.0 * step_rad) as f32,
            angle_increment_rad: step_rad as f32,
            time_increment_s: (0.04_f64 / 1440.0) as f32,
            rate_hz: 25.0,
            range_min_m: 0.5,
            range_max_m: 20.0,
            range_step_m: 0.0,
            beam_divergence_rad: 0.015,
        }
    }

    /// SICK LMS111 over its whole field of view of 270°, as on the land robot of the hybrid perception document
    /// [HYB §2.1], whose 1040 readings are a misprint: steps of 0.25° make 1081 beams.
    pub(crate) fn lms111_270_deg() -> Self {
        let step_rad = 0.25_f64.to_radians();
        Self {
            beams: 1081,
            angle_min_rad: (-540.0 * step_rad) as f32,
            ..Self::lms111()
        }
    }

    /// SICK LD-LRS2100 as the boat of that document sets it up [HYB §2.2]: 1440 beams over 360°, beginning
    /// astern, every 200 ms, to 250 m. Least range (0.5 m, as the preset has it) and divergence (3.5 mrad) are
    /// not the document's.
    pub(crate) fn ld_lrs2100() -> Self {
        let step_rad = 0.25_f64.to_radians();
        Self {
            beams: 1440,
            angle_min_rad: (-720.0 * step_rad) as f32,
            angle_increment_rad: step_rad as f32,
            time_increment_s: (0.2_f64 / 1440.0) as f32,
            rate_hz: 5.0,
            range_min_m: 0.5,
            range_max_m: 250.0,
            range_step_m: 0.0,
            beam_divergence_rad: 0.0035,
        }
    }

    /// Imagenex 837B Delta T as the boat of that document sets it up [HYB §2.2]: 240 ranges "equally spaced on
    /// a 120° interval", here the middles of its 240 parts, all of one ping, ten times a second, to 300 m. The
    /// least range (0.5 m) and a beam 3° wide are assumed. The time that sound takes, 0.4 s from 300 m and
    /// back, is not simulated: a reading is of the moment of its stamp, as its driver's would be after
    /// correction.
    pub(crate) fn delta_t_837b() -> Self {
        let step_rad = 0.5_f64.to_radians();
        Self {
            beams: 240,
            angle_min_rad: (-119.5 * step_rad) as f32,
            angle_increment_rad: step_rad as f32,
            time_increment_s: 0.0,
            rate_hz: 10.0,
            range_min_m: 0.5,
            range_max_m: 300.0,
            range_step_m: 0.0,
            beam_divergence_rad: 3.0_f64.to_radians(),
        }
    }

    /// One laser of a Velodyne VLP-16. Manual: 100 m, 5 to 20 turns a second. It fires every 55.296 µs, here 1800 times a turn, which is
    /// 55.6 µs. Assumed: 3.0 mrad, which a VLS-128 has across (1.5 along its column), and a least range of 0.5 m, as the preset has it (the
    /// manual says 1 m).
    pub(crate) fn vlp_16() -> Self {
        Self {
            range_max_m: 100.0,
            beam_divergence_rad: 0.003,
            ..Self::os1_64()
        }
        .turning(1800)
    }

    /// One laser of an Ouster OS1-64 (revision C or later; before, 0.13°). Data sheet: 120 m, a divergence of 0.18° at half of the maximum,
    /// 512, 1024 or 2048 columns at 10 turns a second. Assumed: a least range of 0.5 m, as the preset has it (revision C: 0.3 m).
    pub(crate) fn os1_64() -> Self {
        Self {
            beams: 0,
            angle_min_rad: 0.0,
            angle_increment_rad: 0.0,
            time_increment_s: 0.0,
            rate_hz: 10.0,
            range_min_m: 0.5,
            range_max_m: 120.0,
            range_step_m: 0.0,
            beam_divergence_rad: 0.18_f64.to_radians(),
        }
        .turning(1024)
    }

    /// The same with a full turn in so many columns: clockwise, as lidars turn, from astern, each beam in the middle of its column.
    #[must_use]
    pub(crate) fn turning(self, columns: u32) -> Self {
        let step_rad = std::f64::consts::TAU / f64::from(columns);
        Self {
            beams: columns,
            angle_min_rad: (std::f64::consts::PI - 0.5 * step_rad) as f32,
            angle_increment_rad: -step_rad as f32,
            time_increment_s: (1.0 / (self.rate_hz * f64::from(columns))) as f32,
            ..self
        }
    }

    /// Time from beam 0 to the last beam, seconds.
    pub(crate) fn sweep_duration_s(&self) -> f64 {
        f64::from(self.beams.saturating_sub(1)) * f64::from(self.time_increment_s)
    }

    /// One sweep whose beam 0 leaves at `start_s`, seconds since the beginning. `world_from_laser` gives
    /// its own pose, mount and all, at a time in seconds after beam 0.
    ///
    /// Readings follow REP-117: nothing within range is +∞, too near is −∞, and a dropout is
    /// not-a-number, as `urg_node` gives for the URG's error codes. Every beam draws the same number of
    /// random numbers whatever it meets, so that the noise of a beam does not depend on the world.
    pub(crate) fn sweep(
        &self,
        scene: &Scene,
        errors: LaserErrors,
        noise: &mut LaserNoise,
        start_s: f64,
        world_from_laser: impl Fn(f64) -> Pose,
    ) -> Scan {
        let ranges_m = (0..self.beams)
            .map(|beam| {
                let after_s = f64::from(beam) * f64::from(self.time_increment_s);
                let world_from_laser = world_from_laser(after_s);
                let direction = world_from_laser.rotation * self.direction(beam, 0.0);
                let ray = [world_from_laser.translation.vector, direction];
                self.range_m(scene, errors, noise, start_s + after_s, ray)
            })
            .collect();
        Scan {
            angle_min_rad: self.angle_min_rad,
            angle_increment_rad: self.angle_increment_rad,
            time_increment_s: self.time_increment_s,
            range_min_m: self.range_min_m,
            range_max_m: self.range_max_m,
            ranges_m,
        }
    }

    /// One turn of a lidar whose lasers look so far above its xy plane, the lowest first: column by column, each cast with all lasers at
    /// its own time. [`Self::sweep`] says the rest; what is no hit is without return.
    ///
    /// The lasers of a VLP-16 fire 2.3 µs apart, in which a vehicle at 1.5 m/s goes 3 µm: that is left out.
    pub(crate) fn revolution(
        &self,
        rings_rad: &[f64],
        scene: &Scene,
        errors: LaserErrors,
        noise: &mut LaserNoise,
        start_s: f64,
        world_from_lidar: impl Fn(f64) -> Pose,
    ) -> Cloud {
        let mut cloud = Cloud::default();
        for column in 0..self.beams {
            let after_s = column as f32 * self.time_increment_s;
            let world_from_lidar = world_from_lidar(after_s.into());
            let origin = world_from_lidar.translation.vector;
            for (ring, &elevation_rad) in (0..).zip(rings_rad) {
                let direction = self.direction(column, elevation_rad);
                let ray = [origin, world_from_lidar.rotation * direction];
                let time_s = start_s + f64::from(after_s);
                let range_m = self.range_m(scene, errors, noise, time_s, ray);
                if range_m.is_finite() {
                    let position = direction * f64::from(range_m);
                    cloud.points.push(CloudPoint {
                        position_m: [position.x, position.y, position.z].map(|m| m as f32),
                        after_s,
                        intensity: INTENSITY,
                        ring: Some(ring),
                    });
                } else {
                    cloud.without_return += 1;
                }
            }
        }
        cloud
    }

    /// The reading of one beam, whose ray is an origin and a unit vector in the world.
    fn range_m(
        &self,
        scene: &Scene,
        errors: LaserErrors,
        noise: &mut LaserNoise,
        time_s: f64,
        [origin, axis]: [Vector3<f64>; 2],
    ) -> f32 {
        let range_error_m = errors.range_noise_m * noise.range.normal();
        let surface_chance = noise.mirror.uniform();
        let mixed_chance = noise.mixed.uniform();
        if noise.dropout.uniform() < errors.dropout {
            return f32::NAN;
        }
        let footprint = BeamFootprint {
            scene,
            origin: Point3::from(origin),
            axis,
            divergence_rad: self.beam_divergence_rad,
            max_m: f64::from(self.range_max_m),
            time_s,
            surface_chance,
        };
        footprint
            .path_m(errors.mixed_pixels, mixed_chance)
            .map_or(f32::INFINITY, |path_m| self.reading(path_m + range_error_m))
    }

    /// Unit vector of a beam in the laser's frame, so far above its xy plane.
    pub(crate) fn direction(&self, beam: u32, elevation_rad: f64) -> Vector3<f64> {
        let angle_rad =
            f64::from(self.angle_min_rad) + f64::from(beam) * f64::from(self.angle_increment_rad);
        let level = libm::cos(elevation_rad);
        Vector3::new(
            level * libm::cos(angle_rad),
            level * libm::sin(angle_rad),
            libm::sin(elevation_rad),
        )
    }

    pub(crate) fn reading(&self, mut range_m: f64) -> f32 {
        if self.range_step_m > 0.0 {
            range_m = libm::round(range_m / self.range_step_m) * self.range_step_m;
        }
        let range_m = range_m as f32;
        if range_m < self.range_min_m {
            f32::NEG_INFINITY
        } else if range_m < self.range_max_m {
            range_m
        } else {
            f32::INFINITY
        }
    }
}

/// A beam as a cone of light.
///
/// A time-of-flight laser whose spot lies partly on a near surface and partly on a far one reports a range between
/// the two, on neither [Hebert and Krotkov 1992, "3D measurements from imaging laser radars"]. Ground that the beam
/// meets at a flat angle and corners are no such edges: the spot is drawn out there, but the surface goes on.
struct BeamFootprint<'a> {
    scene: &'a Scene,
    origin: Point3<f64>,
    /// Unit vector.
    axis: Vector3<f64>,
    divergence_rad: f64,
    max_m: f64,
    time_s: f64,
    /// In [0, 1), for mirrors and glass.
    surface_chance: f64,
}

const RIM_RAYS: usize = 8;

/// Echoes nearer to each other than this come as one pulse, metres: a pulse of some 5 ns to half its
/// height is 1.5 m long there and back. Of echoes farther apart the laser takes one.
const PULSE_LENGTH_M: f64 = 1.5;

/// Jumps smaller than this are within a laser's noise, metres.
const SMALLEST_JUMP_M: f64 = 0.03;

/// One ray of the cone and what it meets.
struct Sample {
    direction: Vector3<f64>,
    echo: Option<Echo>,
}

impl BeamFootprint<'_> {
    /// Length of the path that the laser measures; `None` where nothing comes back.
    ///
    /// `chance` in [0, 1) decides with `mixed_pixels`, the probability of a mixed range at an edge, and
    /// then chooses the mix.
    fn path_m(&self, mixed_pixels: f64, chance: f64) -> Option<f64> {
        if let Some(growth) = self.scene.growth() {
            return self.received_m(growth);
        }
        let axis = self.sample(self.axis);
        let alone_m = axis.echo.map(|echo| echo.path_m);
        if chance >= mixed_pixels || self.divergence_rad <= 0.0 {
            return alone_m;
        }
        let rim = self.ring(1.0);
        let Some(jump) = self.greatest_jump(&axis, &rim) else {
            return alone_m;
        };
        let mix = chance / mixed_pixels;
        if jump.far_m - jump.near_m <= PULSE_LENGTH_M {
            return Some(jump.near_m + (jump.far_m - jump.near_m) * mix);
        }
        let is_near = |sample: &&Sample| {
            let between_m = jump.near_m + PULSE_LENGTH_M;
            sample.echo.is_some_and(|echo| echo.path_m < between_m)
        };
        let near = rim.iter().chain([&axis]).filter(is_near).count();
        if mix * ((RIM_RAYS + 1) as f64) < near as f64 {
            Some(jump.near_m)
        } else {
            jump.far_m.is_finite().then_some(jump.far_m)
        }
    }

    fn sample(&self, direction: Vector3<f64>) -> Sample {
        let echo = self.scene.echo(
            self.origin,
            direction,
            self.max_m,
            self.time_s,
            self.surface_chance,
        );
        Sample { direction, echo }
    }

    /// Rays around the axis at a share of the cone's radius.
    fn ring(&self, share: f64) -> [Sample; RIM_RAYS] {
        let least = self.axis.iamin();
        let mut off_axis = Vector3::zeros();
        off_axis[least] = 1.0;
        let across = self.axis.cross(&off_axis).normalize();
        let up = self.axis.cross(&across);
        let radius = share * libm::tan(0.5 * self.divergence_rad);
        std::array::from_fn(|ray| {
            let angle_rad = std::f64::consts::TAU * ray as f64 / RIM_RAYS as f64;
            let aside = across * libm::cos(angle_rad) + up * libm::sin(angle_rad);
            self.sample((self.axis + aside * radius).normalize())
        })
    }

    /// Between the axis and any ray of the rim.
    fn greatest_jump(&self, axis: &Sample, rim: &[Sample]) -> Option<Jump> {
        rim.iter()
            .filter(|ray| self.is_edge_between(axis, ray))
            .map(|ray| {
                let ends_m = [axis, ray].map(|s| s.echo.map_or(f64::INFINITY, |e| e.path_m));
                Jump {
                    near_m: ends_m[0].min(ends_m[1]),
                    far_m: ends_m[0].max(ends_m[1]),
                }
            })
            .max_by(|a, b| (a.far_m - a.near_m).total_cmp(&(b.far_m - b.near_m)))
    }

    /// Whether the surface does not go on from one ray to the other: neither do both meet the same plane,
    /// nor do the planes that they meet cross between them.
    fn is_edge_between(&self, a: &Sample, b: &Sample) -> bool {
        match (a.echo, b.echo) {
            (None, None) => false,
            (Some(echo), None) => plane_m(a, &echo, b.direction) <= self.max_m,
            (None, Some(echo)) => plane_m(b, &echo, a.direction) <= self.max_m,
            (Some(of_a), Some(of_b)) => {
                let along_a_m = of_a.path_m - plane_m(b, &of_b, a.direction);
                let along_b_m = plane_m(a, &of_a, b.direction) - of_b.path_m;
                of_a.is_straight
                    && of_b.is_straight
                    && (along_a_m > 0.0) == (along_b_m > 0.0)
                    && along_a_m.abs().min(along_b_m.abs()) > SMALLEST_JUMP_M
            }
        }
    }
}

struct Jump {
    near_m: f64,
    /// Infinite where there is nothing behind.
    far_m: f64,
}

/// How far it is along another ray to the plane that a sample met; infinite where that ray never meets it.
fn plane_m(of: &Sample, echo: &Echo, direction: Vector3<f64>) -> f64 {
    let distance_m = echo.path_m * of.direction.dot(&echo.normal) / direction.dot(&echo.normal);
    if distance_m > 0.0 {
        distance_m
    } else {
        f64::INFINITY
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Return {
    path_m: f64,
    /// Of the beam's light.
    share: f64,
}

/// Where rays around the axis stand for the rest of the spot, by its radius, and the axis' own part: so
/// chosen that the mean over an even disc is exact for everything up to the third power.
const RING_RADIUS: f64 = 0.816_496_580_927_726;
const AXIS_SHARE: f64 = 0.25;

impl BeamFootprint<'_> {
    /// The range where plants grow; `None` where no echo is strong enough.
    ///
    /// The receiver takes echoes within the length of a pulse for one, at their common centre, and gives the first
    /// that is strong enough: one thin cane in a wide spot is missed, several are seen. Shares are of the spot's
    /// area; echoes do not grow weaker with distance, and plants are seen straight only, not in mirrors.
    fn received_m(&self, growth: &Growth) -> Option<f64> {
        let solids = self.solids();
        let is_closed = solids.iter().map(|r| r.share).sum::<f64>() > 1.0 - 1e-9;
        let farthest_m = solids
            .last()
            .filter(|_| is_closed)
            .map_or(self.max_m, |last| last.path_m);
        let cone = Cone {
            origin: self.origin,
            axis: self.axis,
            spread: libm::tan(0.5 * self.divergence_rad),
        };
        let reach_m = self.scene.reach_m(self.origin, self.axis, farthest_m);
        let lit = growth.vegetation.lit(&cone, reach_m, self.time_s);
        let mut solids = solids.into_iter().peekable();
        let (mut returns, mut through, mut open) = (Vec::new(), 1.0, 1.0);
        for spot in lit {
            while let Some(solid) = solids.next_if(|solid| solid.path_m < spot.distance_m) {
                open -= solid.share;
                returns.push(solid.dimmed(through));
            }
            returns.push(Return {
                path_m: spot.distance_m,
                share: spot.share * open,
            });
            through -= spot.share;
        }
        returns.extend(solids.map(|solid| solid.dimmed(through)));
        first_noticed_m(&returns, growth.receiver)
    }

    /// Shares of the spot that fall on solids, nearest first. A surface that goes on across the spot gives
    /// its range along the axis.
    fn solids(&self) -> Vec<Return> {
        let axis = self.sample(self.axis);
        let mut on_axis = AXIS_SHARE;
        let ring_share = (1.0 - AXIS_SHARE) / RIM_RAYS as f64;
        let of_ray = |ray: &Sample, share| {
            ray.echo.map(|echo| Return {
                path_m: echo.path_m,
                share,
            })
        };
        let mut returns = Vec::with_capacity(RIM_RAYS + 1);
        if self.divergence_rad > 0.0 {
            for ray in self.ring(RING_RADIUS) {
                if self.is_edge_between(&axis, &ray) {
                    returns.extend(of_ray(&ray, ring_share));
                } else {
                    on_axis += ring_share;
                }
            }
        } else {
            on_axis = 1.0;
        }
        returns.extend(of_ray(&axis, on_axis));
        returns.sort_by(|a, b| a.path_m.total_cmp(&b.path_m));
        returns
    }
}

impl Return {
    fn dimmed(self, through: f64) -> Self {
        Self {
            share: self.share * through,
            ..self
        }
    }
}

/// The centre of the first echoes that come at once and are strong enough; `returns` are sorted.
fn first_noticed_m(returns: &[Return], receiver: Receiver) -> Option<f64> {
    let mut rest = returns;
    while let Some(first) = rest.first() {
        let end_m = first.path_m + receiver.separation_m;
        let (at_once, later) = rest.split_at(rest.partition_point(|r| r.path_m <= end_m));
        let share: f64 = at_once.iter().map(|r| r.share).sum();
        if share >= receiver.min_share {
            let moment: f64 = at_once.iter().map(|r| r.share * r.path_m).sum();
            return Some(moment / share);
        }
        rest = later;
    }
    None
}

/// A laser, sonar or lidar on its mount.
#[derive(Clone, Debug, PartialEq)]
pub struct RangeSensor {
    /// Its name among the vehicle's sensors, which is also its frame and that of its noise.
    pub name: &'static str,
    pub stream: &'static str,
    pub planar: PlanarLaser,
    /// Of a rotating lidar, how far its lasers look above its xy plane, the lowest first, radians; none of a planar laser.
    pub rings_rad: Vec<f64>,
    /// Where it is mounted; a tilting one at an angle of 0. The mount may have any attitude.
    pub base_from_mount: Pose,
    /// The servo that tilts it about its own origin; a fixed one has none.
    pub tilt: Option<TiltServo>,
    /// Posts of the vehicle within its view; a lidar has none.
    pub own_posts: &'static [Post],
}

/// An upright post on the vehicle, in its base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Post {
    pub at_m: [f64; 2],
    pub radius_m: f64,
    /// From its foot to its top, metres above the base frame.
    pub heights_m: [f64; 2],
}

impl RangeSensor {
    /// That of its messages.
    pub(crate) const fn type_name(&self) -> &'static str {
        if self.rings_rad.is_empty() {
            "sensor_msgs/LaserScan"
        } else {
            "sensor_msgs/PointCloud2"
        }
    }

    pub(crate) fn base_from_sensor(&self, time_s: f64) -> Pose {
        match &self.tilt {
            None => self.base_from_mount,
            Some(servo) => self.base_from_mount * servo.mount_from_sensor(time_s),
        }
    }

    /// Makes the beams of a sweep that began at `time_s` end at the vehicle's own posts.
    pub(crate) fn add_own_posts(&self, scan: &mut Scan, time_s: f64) {
        if self.own_posts.is_empty() {
            return;
        }
        for (beam, range_m) in (0..).zip(&mut scan.ranges_m) {
            let after_s = f64::from(beam) * f64::from(self.planar.time_increment_s);
            let base_from_sensor = self.base_from_sensor(time_s + after_s);
            let origin = base_from_sensor.translation.vector;
            let direction = base_from_sensor.rotation * self.planar.direction(beam, 0.0);
            let posts = self.own_posts.iter();
            let nearest_m = posts
                .filter_map(|post| post.distance_m(&origin, &direction))
                .fold(f64::INFINITY, f64::min);
            if nearest_m < f64::from(*range_m) {
                *range_m = self.planar.reading(nearest_m);
            }
        }
    }
}

impl Post {
    fn distance_m(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let level = direction.xy();
        let along = level.try_normalize(1e-9)?;
        let to = Vector2::from(self.at_m) - origin.xy();
        let (ahead_m, aside_m) = (along.dot(&to), along.perp(&to));
        let inside_m2 = self.radius_m * self.radius_m - aside_m * aside_m;
        if ahead_m <= 0.0 || inside_m2 <= 0.0 {
            return None;
        }
        let distance_m = (ahead_m - inside_m2.sqrt()) / level.norm();
        let height_m = origin.z + direction.z * distance_m;
        let [foot_m, top_m] = self.heights_m;
        (foot_m..=top_m).contains(&height_m).then_some(distance_m)
    }
}

#[cfg(test)]
mod tests;
