//! Where a replay takes poses from, in words: as the vehicle that the recording names wants them.

use super::Survey;
use super::scans::ScanSurvey;
use crate::config::{Config, FixesAndAttitude, ImuConfig, WheelsAndAttitude};
use localization::config::{LocalizationConfig, PoseSource};
use measurement::StreamId;

/// Poses that there are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Poses {
    /// Where they come from.
    pub(super) description: String,
    /// Whether the vehicle wants others, and they are not in the recording.
    pub(super) needs_auto: bool,
}

impl Survey {
    /// The poses for `scan`. `vehicle` is the one that the recording names, if it is one that comes with the program.
    pub(super) fn poses(&self, scan: &ScanSurvey, vehicle: Option<&Config>) -> Option<Poses> {
        let wanted = vehicle.map_or(PoseSource::Auto, |config| config.localization.source);
        let found = self.poses_from(wanted, scan, vehicle);
        if wanted == PoseSource::Auto {
            let needs_auto = false;
            return found.map(|description| Poses {
                description,
                needs_auto,
            });
        }
        let name = self.vehicle.as_deref().unwrap_or_default();
        if let Some(description) = found {
            return Some(Poses {
                description: format!("{description}, as configured for {name}"),
                needs_auto: false,
            });
        }
        let others = self.poses_from(PoseSource::Auto, scan, vehicle)?;
        Some(Poses {
            description: format!(
                "{others}; {name} is configured for another pose source, which is not in it"
            ),
            needs_auto: true,
        })
    }

    /// As a replay decides with the vehicle's settings, see `app/plan.rs`.
    fn poses_from(
        &self,
        source: PoseSource,
        scan: &ScanSurvey,
        vehicle: Option<&Config>,
    ) -> Option<String> {
        let bring = || "every scan brings its pose".to_owned();
        let own = || scan.has_own_poses.then(bring);
        let transforms = || self.transforms(scan, vehicle);
        let odometry = || self.describe_odometry();
        let wheels = || self.wheels_and_attitude(vehicle?);
        let fixes = || self.fixes_and_attitude(vehicle?);
        match source {
            PoseSource::Auto => own()
                .or_else(transforms)
                .or_else(odometry)
                .or_else(wheels)
                .or_else(fixes),
            PoseSource::Log => own(),
            PoseSource::Tf => transforms(),
            PoseSource::Odometry => odometry(),
            PoseSource::Static => Some("the vehicle stands still".to_owned()),
            PoseSource::Wheels => wheels(),
            PoseSource::Gps => fixes(),
        }
    }

    fn transforms(&self, scan: &ScanSurvey, vehicle: Option<&Config>) -> Option<String> {
        let default = LocalizationConfig::default();
        let localization = vehicle.map_or(&default, |config| &config.localization);
        let base_frame = localization.base_frame.as_str();
        let wanted = localization.fixed_frame.as_deref();
        let lead = |start: &str| {
            let fixed_frame = self.frames.fixed_ancestor(start, base_frame, wanted)?;
            Some(format!("transforms lead from {start} to {fixed_frame}"))
        };
        [&*scan.frame, base_frame].into_iter().find_map(lead)
    }

    fn describe_odometry(&self) -> Option<String> {
        let odometry = self.best_odometry()?;
        let name = &self.stream(odometry.stream)?.stream.name;
        Some(format!(
            "{name} gives poses of {} in {}",
            odometry.child, odometry.parent
        ))
    }

    fn wheels_and_attitude(&self, vehicle: &Config) -> Option<String> {
        let sensors = WheelsAndAttitude::of(&vehicle.sensors).ok()?;
        let (_, encoders) = sensors.encoders;
        let (left, right) = (&encoders.left_joint, &encoders.right_joint);
        let both = self
            .joints
            .iter()
            .filter(|joints| joints.names.contains(left) && joints.names.contains(right));
        let angles = self.topic(both.map(|joints| joints.stream), encoders.topic.as_deref())?;
        let attitude = self.attitude_topic(sensors.imu.1)?;
        Some(format!(
            "wheels of {angles} and attitude of {attitude} give poses"
        ))
    }

    fn fixes_and_attitude(&self, vehicle: &Config) -> Option<String> {
        let sensors = FixesAndAttitude::of(&vehicle.sensors).ok()?;
        let (_, receiver) = sensors.gps;
        let with_fix = self.fixes.iter().filter(|fixes| fixes.fixed > 0);
        let fixes = self.topic(
            with_fix.map(|fixes| fixes.stream),
            receiver.topic.as_deref(),
        )?;
        let attitude = self.attitude_topic(sensors.imu.1)?;
        Some(format!(
            "satellite fixes of {fixes} and attitude of {attitude} give poses"
        ))
    }

    fn attitude_topic(&self, imu: &ImuConfig) -> Option<String> {
        let oriented = self.attitudes.iter().filter(|a| a.oriented > 0);
        self.topic(oriented.map(|a| a.stream), imu.topic.as_deref())
    }

    /// The topic of a sensor, of the streams that could be its own: the configured one, or any. Of several the replay asks
    /// which.
    fn topic(
        &self,
        streams: impl Iterator<Item = StreamId>,
        configured: Option<&str>,
    ) -> Option<String> {
        let names = streams.filter_map(|stream| Some(&*self.stream(stream)?.stream.name));
        let fits = |name: &&str| configured.is_none_or(|topic| topic == *name);
        let names: Vec<&str> = names.filter(fits).collect();
        (!names.is_empty()).then(|| names.join(" or "))
    }
}
