//! Turns the servo of a laser to where the obstacle map knows nothing ahead.

use crate::config::Config;
use drivers::joint_goal::JointGoal;
use mapping::Mapper;
use mapping::registered_scan::{RegisteredScan, SensorId};
use mapping::tilt_search::TiltSearch;

#[derive(Clone, Debug)]
pub struct TiltControl {
    sensor: SensorId,
    search: TiltSearch,
    goal: JointGoal,
    /// Angle of the sensor per angle of the joint.
    scale: f64,
    /// Angle of the sensor below the horizontal where the joint is at zero, radians.
    at_zero_rad: f64,
}

impl TiltControl {
    /// Of the first sensor with `tilt.search`, where one has it.
    pub fn new(config: &Config) -> Option<Self> {
        config.range_sensors().into_iter().find_map(|sensor| {
            let mount = &sensor.config.mount;
            let tilt = sensor.config.tilt.as_ref()?;
            let place = mount.base_from_sensor().translation.vector;
            Some(Self {
                sensor: sensor.id,
                search: TiltSearch::new(tilt.search?, place, &config.vehicle),
                goal: JointGoal::new(&tilt.joint),
                scale: tilt.scale,
                at_zero_rad: (mount.pitch_deg + tilt.offset_deg).to_radians(),
            })
        })
    }

    /// The goal that it sets.
    pub const fn goal(&self) -> &JointGoal {
        &self.goal
    }

    /// Sets the goal of who turns the joint.
    #[must_use]
    pub fn with_goal(mut self, goal: JointGoal) -> Self {
        self.goal = goal;
        self
    }

    pub(super) fn update(&mut self, scan: &RegisteredScan, mapper: &Mapper) {
        if let Some(terrain) = mapper.terrain()
            && scan.sensor == self.sensor
        {
            let angle_rad = self.search.angle_rad(terrain.obstacle(), scan);
            self.goal.set((angle_rad - self.at_zero_rad) / self.scale);
        }
    }
}

#[cfg(test)]
mod tests {
    use mapping::registered_scan::{BeamOutcome, RegisteredBeam, ScanKind};
    use measurement::pose::Pose;
    use measurement::time::RobotTime;
    use nalgebra::Point3;

    use super::*;
    use crate::config::load;

    #[test]
    fn the_goal_is_an_angle_of_the_joint() {
        let settings = [
            "sensors.laser.mount.pitch_deg=5",
            "sensors.laser.tilt.offset_deg=1.5",
            "sensors.laser.tilt.scale=-0.5",
        ];
        let settings: Vec<_> = settings.iter().map(|set| set.parse().unwrap()).collect();
        let config = load("holos-tilt", &settings).unwrap();
        let mapper = Mapper::new(
            &config.mapping,
            config.vehicle.shape(),
            &config.range_models(),
        );
        let mut control = TiltControl::new(&config).unwrap();
        let mut scan = RegisteredScan {
            stamp: RobotTime::from_nanos(0),
            sensor: SensorId(1),
            kind: ScanKind::Beams,
            beam_step_rad: 0.004,
            odom_from_base: Pose::identity(),
            own_body_hits: 0,
            beams: vec![RegisteredBeam {
                origin_in_odom: Point3::new(0.25, 0.0, 1.08),
                end_in_odom: Point3::new(8.0, 0.0, 0.06),
                outcome: BeamOutcome::Hit,
                index: 0,
                range_m: 8.0,
            }],
        };
        control.update(&scan, &mapper);
        assert_eq!(control.goal().angle_rad(), None, "another sensor");
        scan.sensor = SensorId(0);
        control.update(&scan, &mapper);
        // It rests at 7.5°: 7.5 = 5 + 1.5 - 0.5 · (-2).
        let goal_deg = control.goal().angle_rad().unwrap().to_degrees();
        assert!((goal_deg + 2.0).abs() < 1e-9, "{goal_deg}");
        assert!(TiltControl::new(&load("holos", &[]).unwrap()).is_none());
    }
}
