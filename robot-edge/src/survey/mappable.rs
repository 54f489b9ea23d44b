//! Whether a recording can be mapped, and with which command.

use std::fmt;

use super::Survey;
use super::range_sensors::WantedSensor;
use crate::config::{self, Config, presets};
use measurement::StreamId;

/// Whether a recording can be mapped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Mappable {
    /// With this range sensor.
    Yes {
        /// Its stream.
        laser: StreamId,
        /// Where its poses come from, in words.
        pose_source: String,
        /// Whether a replay takes these poses only with `localization.source=auto`: the vehicle that the recording
        /// names wants others, and they are not in it.
        needs_auto: bool,
        /// Whether there are more range sensors, so that one must be named: those of a vehicle that the
        /// recording names and that has them all are mapped together.
        must_be_named: bool,
    },
    /// There are range sensors, but nothing says where they were.
    NoPoseSource,
    /// There is no range sensor.
    NoRangeSensor,
}

impl Survey {
    /// Judges what can be mapped; of several range sensors with poses, the one with the most scans.
    pub fn mappable(&self) -> Mappable {
        let vehicle = self.config_of_vehicle();
        let candidates = self
            .scans
            .iter()
            .filter_map(|scan| Some((scan, self.poses(scan, vehicle.as_ref())?)));
        match candidates.max_by_key(|(scan, poses)| (!poses.needs_auto, scan.stamps.count)) {
            Some((scan, poses)) => Mappable::Yes {
                laser: scan.stream,
                pose_source: poses.description,
                needs_auto: poses.needs_auto,
                must_be_named: self.scans.len() > 1 && self.sensors_of_vehicle().is_none(),
            },
            None if self.scans.is_empty() => Mappable::NoRangeSensor,
            None => Mappable::NoPoseSource,
        }
    }

    /// The settings of the vehicle that the recording names, if it is one that comes with the program.
    fn config_of_vehicle(&self) -> Option<Config> {
        let preset = presets::get(self.vehicle.as_deref()?).ok()?;
        config::load(preset.name, &[]).ok()
    }

    /// The range sensors of that vehicle, if they can be told apart here: each sensor's name and stream.
    fn sensors_of_vehicle(&self) -> Option<Vec<(String, StreamId)>> {
        let config = self.config_of_vehicle()?;
        let sensors = config.range_sensors();
        let wanted: Vec<_> = sensors
            .iter()
            .map(|sensor| WantedSensor {
                name: sensor.name,
                topic: sensor.config.topic.as_deref(),
            })
            .collect();
        let assigned = self.assign_scans(&wanted).ok()?;
        let named = sensors.iter().zip(assigned);
        Some(
            named
                .filter_map(|(sensor, scans)| Some((sensor.name.to_owned(), scans?.stream)))
                .collect(),
        )
    }

    fn write_sensors_of_vehicle(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Some(vehicle), Some(sensors)) = (&self.vehicle, self.sensors_of_vehicle()) else {
            return Ok(());
        };
        if sensors.len() > 1 {
            let named = sensors.iter().map(|(name, stream)| {
                let topic = self.stream(*stream).map_or("", |s| &*s.stream.name);
                format!("{name} ({topic})")
            });
            let named: Vec<_> = named.collect();
            writeln!(f, "  as {vehicle}, with {}", named.join(" and "))?;
        }
        Ok(())
    }

    /// The command that maps it, with the range sensor that it must name, where it must, and the others that it could.
    fn write_replay(
        &self,
        f: &mut fmt::Formatter<'_>,
        laser: Option<StreamId>,
        options: &str,
    ) -> fmt::Result {
        let file = shell_quoted(&self.path.display().to_string());
        let topic = |stream| {
            let named = self.stream(stream);
            let name = named.map_or("", |summary| &summary.stream.name);
            format!("--topic laser={}", shell_quoted(name))
        };
        let named = laser.map(|laser| format!(" {}", topic(laser)));
        let named = named.unwrap_or_default();
        writeln!(f, "  robot-edge replay {file}{named}{options}")?;
        let others = self.scans.iter().map(|scan| scan.stream);
        for other in others.filter(|other| laser.is_some_and(|laser| laser != *other)) {
            writeln!(f, "  or with {}", topic(other))?;
        }
        Ok(())
    }

    pub(super) fn write_mappable(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.mappable() {
            Mappable::Yes {
                laser,
                pose_source,
                needs_auto,
                must_be_named,
            } => {
                writeln!(f, "  {pose_source}")?;
                self.write_sensors_of_vehicle(f)?;
                let options = if needs_auto {
                    " --set localization.source=auto"
                } else {
                    ""
                };
                self.write_replay(f, must_be_named.then_some(laser), options)
            }
            Mappable::NoPoseSource => {
                writeln!(
                    f,
                    "  no: there are no poses of the sensor: neither odometry nor a"
                )?;
                writeln!(f, "  moving transform above {}", self.frames_of_scans())?;
                writeln!(f, "  if the vehicle stood still:")?;
                let several = self.scans.first().filter(|_| self.scans.len() > 1);
                let laser = several.map(|scan| scan.stream);
                self.write_replay(f, laser, " --set localization.source=static")
            }
            Mappable::NoRangeSensor => {
                let clouds = self.streams.iter().any(|summary| {
                    summary.stream.type_name == "sensor_msgs/PointCloud2" && summary.messages > 0
                });
                writeln!(f, "  no: there is no planar range sensor in it")?;
                if clouds {
                    writeln!(
                        f,
                        "  (point clouds are read, but not mapped as a planar laser)"
                    )?;
                }
                Ok(())
            }
        }
    }

    fn frames_of_scans(&self) -> String {
        let mut frames: Vec<&str> = self.scans.iter().map(|scan| &*scan.frame).collect();
        frames.sort_unstable();
        frames.dedup();
        frames.join(", ")
    }
}

fn shell_quoted(text: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "/._-+:@%=,".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        text.to_owned()
    } else {
        format!("'{}'", text.replace('\'', r"'\''"))
    }
}
