//! Whether a recording can be mapped, and with which command.

use std::fmt;

use super::Survey;
use super::scans::ScanSurvey;
use crate::localization::config::LocalizationConfig;
use crate::measurement::StreamId;

/// Whether a recording can be mapped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Mappable {
    /// With this range sensor.
    Yes {
        /// Its stream.
        laser: StreamId,
        /// Where its poses come from, in words.
        pose_source: String,
        /// Whether there are more range sensors, so that one must be named.
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
        let candidates = self
            .scans
            .iter()
            .filter_map(|scan| Some((scan, self.pose_source(scan)?)));
        match candidates.max_by_key(|(scan, _)| scan.stamps.count) {
            Some((scan, pose_source)) => Mappable::Yes {
                laser: scan.stream,
                pose_source,
                must_be_named: self.scans.len() > 1,
            },
            None if self.scans.is_empty() => Mappable::NoRangeSensor,
            None => Mappable::NoPoseSource,
        }
    }

    fn pose_source(&self, scan: &ScanSurvey) -> Option<String> {
        if scan.has_own_poses {
            return Some("every scan brings its pose".to_owned());
        }
        // As a replay decides with its default settings.
        let base_frame = LocalizationConfig::default().base_frame;
        for start in [&*scan.frame, &base_frame] {
            if let Some(fixed_frame) = self.frames.fixed_above(start, &base_frame, None) {
                return Some(format!("transforms lead from {start} to {fixed_frame}"));
            }
        }
        let odometry = self.best_odometry()?;
        let name = &self.stream(odometry.stream)?.stream.name;
        Some(format!(
            "{name} gives poses of {} in {}",
            odometry.child, odometry.parent
        ))
    }

    pub(super) fn write_mappable(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.mappable() {
            Mappable::Yes {
                laser,
                pose_source,
                must_be_named,
            } => {
                let file = shell_quoted(&self.path.display().to_string());
                let name = self
                    .stream(laser)
                    .map_or("", |summary| &summary.stream.name);
                writeln!(f, "  {pose_source}")?;
                write!(f, "  robot-edge replay {file}")?;
                if must_be_named {
                    write!(f, " --topic laser={}", shell_quoted(name))?;
                }
                writeln!(f)?;
                for other in self.scans.iter().filter(|scan| scan.stream != laser) {
                    if let Some(other) = self.stream(other.stream) {
                        writeln!(
                            f,
                            "  or with --topic laser={}",
                            shell_quoted(&other.stream.name)
                        )?;
                    }
                }
                Ok(())
            }
            Mappable::NoPoseSource => {
                writeln!(
                    f,
                    "  no: nothing says where the sensor was. There is neither odometry nor a"
                )?;
                writeln!(f, "  moving transform above {}", self.frames_of_scans())?;
                let file = shell_quoted(&self.path.display().to_string());
                writeln!(f, "  if the vehicle stood still:")?;
                writeln!(
                    f,
                    "  robot-edge replay {file} --set localization.source=static"
                )?;
                if self.scans.len() > 1 {
                    writeln!(
                        f,
                        "  (of its range sensors, --topic laser=NAME chooses one)"
                    )?;
                }
                Ok(())
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
