//! Where a tilting laser should look: at what the obstacle map does not know ahead (\[LOD\] §6.2 asks
//! for it; docs/methods.md, section 1).
//!
//! A laser that is fixed at a small angle maps the ground where it meets it, metres ahead. What is
//! nearer stays unknown after a turn on the spot, and what is low there is never seen.

use measurement::pose::Pose;
use nalgebra::{Point3, Vector3};
use serde::Deserialize;

use crate::elevation::CellClass;
use crate::obstacle::ObstacleMap;
use crate::registered_scan::RegisteredScan;
use crate::vehicle::VehicleConfig;

/// Settings of `[sensors.NAME.tilt.search]`: angles of the beams below the horizontal of the base frame.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TiltSearchConfig {
    /// Where it looks when all is known up to there, degrees.
    pub rest_deg: f64,
    /// The lowest that it looks, degrees.
    pub lowest_deg: f64,
}

impl Default for TiltSearchConfig {
    fn default() -> Self {
        Self {
            rest_deg: 7.5,
            lowest_deg: 50.0,
        }
    }
}

/// Looks at unknown cells of the obstacle map in the vehicle's way, from near to far, then at rest for a while.
#[derive(Clone, Debug)]
pub struct TiltSearch {
    config: TiltSearchConfig,
    /// In the base frame, metres.
    sensor_x_m: f64,
    /// Above the ground, metres.
    sensor_height_m: f64,
    /// Half the width of the way, metres.
    half_width_m: f64,
    /// From the base frame to the vehicle's front, metres.
    front_m: f64,
    state: State,
}

#[derive(Clone, Copy, Debug)]
enum State {
    /// Scans since it looks at rest.
    Resting { scans: u32 },
    /// What lies nearer than this has been looked at, metres ahead of the base frame.
    Searching { from_m: f64 },
}

/// Scans at rest between two searches: what is unknown in the shadow of something stays so.
const REST_SCANS: u32 = 10;
/// So near to the rest angle it is at rest, radians.
const AT_REST_RAD: f64 = 0.02;

impl TiltSearch {
    /// For a laser at that place of the base frame.
    pub fn new(
        config: TiltSearchConfig,
        sensor_in_base: Vector3<f64>,
        vehicle: &VehicleConfig,
    ) -> Self {
        Self {
            config,
            sensor_x_m: sensor_in_base.x,
            sensor_height_m: sensor_in_base.z - vehicle.bottom_z_m,
            half_width_m: 0.5 * vehicle.width_m,
            front_m: vehicle.footprint_offset_m + 0.5 * vehicle.length_m,
            state: State::Resting { scans: 0 },
        }
    }

    /// The angle to look at after this scan, below the horizontal of the base frame, radians.
    pub fn angle_rad(&mut self, map: &ObstacleMap, scan: &RegisteredScan) -> f64 {
        let rest_rad = self.config.rest_deg.to_radians();
        let Some(looks_at_rad) = looks_at_rad(scan) else {
            return rest_rad;
        };
        let from_m = match &mut self.state {
            State::Resting { scans } => {
                *scans += u32::from((looks_at_rad - rest_rad).abs() < AT_REST_RAD);
                if *scans < REST_SCANS {
                    return rest_rad;
                }
                self.front_m
            }
            // Up to where the beams end now, and one cell on: it does not stop at what stays unknown.
            State::Searching { from_m } => {
                let looked_m =
                    self.sensor_x_m + self.sensor_height_m / libm::tan(looks_at_rad.max(rest_rad));
                let cell_m = map.size().sides_m()[0];
                if (looked_m - *from_m).abs() <= cell_m {
                    *from_m += cell_m;
                }
                *from_m
            }
        };
        let unknown_m = self.first_unknown_m(map, &scan.odom_from_base, from_m);
        self.state = unknown_m.map_or(State::Resting { scans: 0 }, |from_m| State::Searching {
            from_m,
        });
        unknown_m.map_or(rest_rad, |at_m| self.angle_of(at_m))
    }

    fn angle_of(&self, at_m: f64) -> f64 {
        libm::atan2(self.sensor_height_m, at_m - self.sensor_x_m)
    }

    /// The nearest row of cells across the way with an unknown one, from `from_m` up to where the beams end
    /// at rest or something stands in the way, metres ahead of the base frame.
    fn first_unknown_m(
        &self,
        map: &ObstacleMap,
        odom_from_base: &Pose,
        from_m: f64,
    ) -> Option<f64> {
        let cell_m = map.size().sides_m()[0];
        let ground_m = |angle_deg: f64| {
            self.sensor_x_m + self.sensor_height_m / libm::tan(angle_deg.to_radians())
        };
        let nearest_m = ground_m(self.config.lowest_deg).max(from_m);
        let rows = libm::floor((ground_m(self.config.rest_deg) - nearest_m) / cell_m);
        let columns = libm::ceil(2.0 * self.half_width_m / cell_m) as u32;
        let class = |at_m: f64, column: u32| {
            let aside_m =
                self.half_width_m * (2.0 * f64::from(column) / f64::from(columns.max(1)) - 1.0);
            let point = odom_from_base * Point3::new(at_m, aside_m, 0.0);
            map.grid()
                .get(map.size().containing(point.xy()))
                .copied()
                .unwrap_or(CellClass::Unknown)
        };
        for row in 0..rows.max(0.0) as u32 {
            let at_m = nearest_m + cell_m * f64::from(row);
            let classes = (0..=columns).map(|column| class(at_m, column));
            let (mut is_unknown, mut is_blocked) = (false, false);
            for class in classes {
                is_unknown |= class == CellClass::Unknown;
                is_blocked |= class == CellClass::Obstacle;
            }
            if is_blocked {
                return None;
            }
            if is_unknown {
                return Some(at_m);
            }
        }
        None
    }
}

/// How far below the horizontal of the base frame the beam points that points ahead, radians.
fn looks_at_rad(scan: &RegisteredScan) -> Option<f64> {
    let base_from_odom = scan.odom_from_base.rotation.inverse();
    let directions = scan
        .beams
        .iter()
        .map(|beam| base_from_odom * (beam.end_in_odom - beam.origin_in_odom));
    let ahead = directions.min_by(|a, b| {
        libm::fabs(libm::atan2(a.y, a.x)).total_cmp(&libm::fabs(libm::atan2(b.y, b.x)))
    })?;
    Some(libm::atan2(-ahead.z, ahead.x))
}

#[cfg(test)]
mod tests {
    use measurement::pose::planar;
    use measurement::time::RobotTime;

    use super::*;
    use crate::MappingConfig;
    use crate::registered_scan::{BeamOutcome, RegisteredBeam, ScanKind, SensorId};
    use crate::terrain::Terrain;

    const CONFIG: TiltSearchConfig = TiltSearchConfig {
        rest_deg: 10.0,
        lowest_deg: 45.0,
    };

    /// A laser 1 m high at the base frame of a vehicle 1 m long and 0.6 m wide, on level ground with a wall across
    /// the way or none; cells of 0.2 m. The beams are where the servo was asked to be.
    struct Rig {
        terrain: Terrain,
        search: TiltSearch,
        odom_from_base: Pose,
        wall_m: f64,
        /// Where the ground gives no echo, metres ahead.
        black_m: std::ops::Range<f64>,
        angle_rad: f64,
        scans: i64,
    }

    impl Rig {
        fn new() -> Self {
            Self::of_length(1.0)
        }

        fn of_length(length_m: f64) -> Self {
            let vehicle = VehicleConfig {
                length_m,
                width_m: 0.6,
                ..VehicleConfig::default()
            };
            Self {
                terrain: Terrain::new(&MappingConfig::default(), vehicle.shape(), &[]),
                search: TiltSearch::new(CONFIG, Vector3::new(0.0, 0.0, 1.0), &vehicle),
                odom_from_base: planar(3.0, 1.0, 2.0),
                wall_m: f64::INFINITY,
                black_m: 0.0..0.0,
                angle_rad: CONFIG.rest_deg.to_radians(),
                scans: 0,
            }
        }

        /// Scans where it is asked to look; returns how far ahead that is on the ground, metres.
        fn scan(&mut self) -> f64 {
            let ground_m = 1.0 / libm::tan(self.angle_rad);
            let end_m = ground_m.min(self.wall_m);
            let height_m = 1.0 - end_m * libm::tan(self.angle_rad);
            let beams = (0..=80).map(|index| RegisteredBeam {
                origin_in_odom: self.odom_from_base * Point3::new(0.0, 0.0, 1.0),
                end_in_odom: self.odom_from_base
                    * Point3::new(end_m, 0.025 * f64::from(index) - 1.0, height_m),
                outcome: if self.black_m.contains(&end_m) {
                    BeamOutcome::Miss
                } else {
                    BeamOutcome::Hit
                },
                index,
                range_m: end_m as f32,
            });
            let scan = RegisteredScan {
                stamp: RobotTime::from_nanos(40_000_000 * self.scans),
                sensor: SensorId(0),
                beam_step_rad: 0.004,
                kind: ScanKind::Beams,
                own_body_hits: 0,
                odom_from_base: self.odom_from_base,
                beams: beams.collect(),
            };
            self.scans += 1;
            self.terrain.integrate(&scan);
            self.angle_rad = self.search.angle_rad(self.terrain.obstacle(), &scan);
            ground_m
        }

        /// Where it looked in so many scans.
        fn run(&mut self, scans: usize) -> Vec<f64> {
            (0..scans).map(|_| self.scan()).collect()
        }

        fn class(&self, ahead_m: f64, left_m: f64) -> CellClass {
            let map = self.terrain.obstacle();
            let point = self.odom_from_base * Point3::new(ahead_m, left_m, 0.0);
            let cell = map.size().containing(point.xy());
            map.grid().get(cell).copied().unwrap_or(CellClass::Unknown)
        }
    }

    /// Where it rests: 1 m / tan(10°).
    const REST_M: f64 = 5.67;

    fn is_at_rest(at_m: f64) -> bool {
        (at_m - REST_M).abs() < 0.01
    }

    #[test]
    fn it_looks_at_the_whole_way_from_near_to_far_and_then_rests() {
        let mut rig = Rig::new();
        let looks = rig.run(60);
        assert!(looks[..10].iter().copied().all(is_at_rest));
        assert!((looks[10] - 1.0).abs() < 0.01, "{}", looks[10]);
        assert!(looks[10..].is_sorted(), "{looks:?}");
        assert!(is_at_rest(looks[59]), "{}", looks[59]);
        for ahead_m in [1.1, 2.0, 3.0, 4.0, 5.0] {
            for left_m in [-0.3, 0.0, 0.3] {
                assert_eq!(
                    rig.class(ahead_m, left_m),
                    CellClass::Free,
                    "{ahead_m} {left_m}"
                );
            }
        }
    }

    #[test]
    fn after_a_turn_on_the_spot_it_looks_again() {
        let mut rig = Rig::new();
        rig.run(60);
        assert!(rig.run(60).into_iter().all(is_at_rest), "all is known");
        rig.odom_from_base = planar(3.0, 1.0, 0.5);
        let nearest_m = (0..60).map(|_| rig.scan()).fold(f64::INFINITY, f64::min);
        assert!((nearest_m - 1.0).abs() < 0.01, "{nearest_m}");
        assert_eq!(rig.class(2.0, 0.0), CellClass::Free);
    }

    #[test]
    fn it_begins_at_the_vehicles_front() {
        let nearest_m = |length_m| {
            let looks = Rig::of_length(length_m).run(60);
            looks.into_iter().fold(f64::INFINITY, f64::min)
        };
        // Its lowest angle meets the ground 1 m ahead.
        assert!((nearest_m(1.9) - 1.0).abs() < 0.01, "{}", nearest_m(1.9));
        assert!((nearest_m(4.0) - 2.0).abs() < 0.01, "{}", nearest_m(4.0));
    }

    #[test]
    fn it_goes_on_past_what_stays_unknown_and_looks_there_again() {
        let mut rig = Rig::new();
        rig.black_m = 1.9..2.7;
        let looks = rig.run(120);
        assert_eq!(rig.class(2.3, 0.0), CellClass::Unknown);
        assert_eq!(rig.class(4.0, 0.0), CellClass::Free);
        let looks_there = |looks: &[f64]| looks.iter().any(|at_m| rig.black_m.contains(at_m));
        assert!(
            looks_there(&looks[..60]) && looks_there(&looks[60..]),
            "{looks:?}"
        );
        let rests = looks.iter().filter(|at_m| is_at_rest(**at_m)).count();
        assert!(rests > 30, "{rests}");
    }

    #[test]
    fn it_does_not_look_behind_what_stands_in_the_way() {
        let mut rig = Rig::new();
        rig.wall_m = 3.0;
        rig.run(200);
        assert_eq!(
            rig.class(2.9, 0.0).max(rig.class(3.1, 0.0)),
            CellClass::Obstacle
        );
        assert!(rig.run(60).into_iter().all(is_at_rest));
    }
}
