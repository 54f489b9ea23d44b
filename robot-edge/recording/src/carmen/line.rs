//! One line of a CARMEN log: text to meaning.
//!
//! Formats as CARMEN's `logger/readlog.c` and the header comments of the published logs give them, fields
//! separated by blanks:
//!
//! ```text
//! ODOM        x y θ  v ω a  ipc_stamp host logger_stamp
//! FLASER      n [n ranges]  laser: x y θ  robot: x y θ  ipc_stamp host logger_stamp
//! RAWLASER1   type start fov step max accuracy mode  n [n ranges]  m [m remissions]  ipc_stamp host logger_stamp
//! ROBOTLASER1 as RAWLASER1 up to the remissions, then
//!             laser: x y θ  robot: x y θ  v ω forward side turn_axis  ipc_stamp host logger_stamp
//! ```

use std::f64::consts::{FRAC_PI_2, PI};

use measurement::drops::DropReason;
use measurement::pose::{Pose, planar};
use measurement::scan::Scan;
use measurement::time::RobotTime;
use measurement::{MeasurementData, OwnPose};

/// SICK lasers report "nothing seen" as 81.83 m or 81.91 m and measure no farther than this, metres.
pub(super) const DEFAULT_RANGE_MAX_M: f32 = 80.0;

/// Vehicle frame of `ODOM` lines.
pub(super) const BASE_FRAME: &str = "base_link";

/// How the fields of a line are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layout {
    /// `ODOM`.
    Odom,
    /// `FLASER`, `RLASER`.
    Laser,
    /// `RAWLASER0` … `RAWLASER4`.
    RawLaser,
    /// `ROBOTLASER0` … `ROBOTLASER4`.
    RobotLaser,
}

/// Layout and frame of the messages called `keyword`; `None` if they are not read.
pub(super) fn layout_of(keyword: &str) -> Option<(Layout, &'static str)> {
    if let Some(laser) = keyword.strip_prefix("RAWLASER") {
        return Some((Layout::RawLaser, numbered_laser_frame(laser)?));
    }
    if let Some(laser) = keyword.strip_prefix("ROBOTLASER") {
        return Some((Layout::RobotLaser, numbered_laser_frame(laser)?));
    }
    match keyword {
        "ODOM" => Some((Layout::Odom, "odom")),
        "FLASER" => Some((Layout::Laser, "laser")),
        "RLASER" => Some((Layout::Laser, "rear_laser")),
        _ => None,
    }
}

/// CARMEN numbers its lasers: 1 looks ahead, 2 back.
fn numbered_laser_frame(number: &str) -> Option<&'static str> {
    match number {
        "0" | "1" => Some("laser"),
        "2" => Some("rear_laser"),
        "3" => Some("laser3"),
        "4" => Some("laser4"),
        _ => None,
    }
}

/// Whether `keyword` could be the name of a message: `SYNC`, `SM_UPDATE`, `LASER3`.
pub(super) fn is_message_name(keyword: &str) -> bool {
    let bytes = keyword.as_bytes();
    bytes.first().is_some_and(u8::is_ascii_uppercase)
        && bytes.len() <= 40
        && bytes
            .iter()
            .all(|&b| b.is_ascii_uppercase() || b.is_ascii_digit() || b == b'_')
}

/// Why a line cannot be decoded.
#[derive(Debug, PartialEq, thiserror::Error)]
pub(super) enum LineError {
    #[error("ends before {0}")]
    Missing(&'static str),
    #[error("goes on after its last field with {0:?}")]
    TooManyFields(String),
    #[error("{field} is not a number: {text:?}")]
    NotANumber { field: &'static str, text: String },
    #[error("the stamp is {0} s")]
    BadStamp(f64),
    #[error("a pose is not finite")]
    BadPose,
    #[error("a scan {0}")]
    BadScan(&'static str),
}

impl LineError {
    pub(super) const fn reason(&self) -> DropReason {
        match self {
            Self::Missing(_) | Self::TooManyFields(_) | Self::NotANumber { .. } => {
                DropReason::Damaged
            }
            Self::BadStamp(_) => DropReason::BadStamp,
            Self::BadPose => DropReason::BadPose,
            Self::BadScan(_) => DropReason::BadScan,
        }
    }
}

/// Reads the fields behind the keyword of a line.
///
/// `laser_range_max_m` is where `FLASER` and `RLASER` ranges become misses: these lines name no limit.
pub(super) fn parse(
    layout: Layout,
    fields: &str,
    laser_range_max_m: f32,
) -> Result<(RobotTime, MeasurementData), LineError> {
    let mut fields = Fields(fields.split_ascii_whitespace());
    let data = match layout {
        Layout::Odom => fields.odometry()?,
        Layout::Laser => fields.laser(laser_range_max_m)?,
        Layout::RawLaser => MeasurementData::Scan {
            scan: fields.configured_laser()?,
            own_pose: None,
        },
        Layout::RobotLaser => {
            let scan = fields.configured_laser()?;
            let own_pose = Some(fields.own_pose()?);
            for name in ["speed", "turn rate", "safety", "safety", "turn axis"] {
                fields.number::<f64>(name)?;
            }
            MeasurementData::Scan { scan, own_pose }
        }
    };
    Ok((fields.stamps()?, data))
}

struct Fields<'a>(std::str::SplitAsciiWhitespace<'a>);

impl Fields<'_> {
    fn odometry(&mut self) -> Result<MeasurementData, LineError> {
        let odom_from_base = self.pose()?;
        for name in ["speed", "turn rate", "acceleration"] {
            self.number::<f64>(name)?;
        }
        Ok(MeasurementData::Odometry {
            child: BASE_FRAME.into(),
            odom_from_base,
        })
    }

    fn laser(&mut self, range_max_m: f32) -> Result<MeasurementData, LineError> {
        let ranges_m = self.ranges()?;
        // Half a circle from right to left. That even counts leave out the last beam and odd counts hold
        // both ends was measured by the sharpness of the maps of 8 published logs.
        let steps = match ranges_m.len() {
            0 => return Err(LineError::BadScan("without beams")),
            1 => 1,
            n if n % 2 == 0 => n,
            n => n - 1,
        };
        let scan = Scan {
            angle_min_rad: -FRAC_PI_2 as f32,
            angle_increment_rad: (PI / steps as f64) as f32,
            time_increment_s: 0.0,
            range_min_m: 0.0,
            range_max_m,
            ranges_m,
        };
        let own_pose = Some(self.own_pose()?);
        Ok(MeasurementData::Scan { scan, own_pose })
    }

    /// The part that `RAWLASER` and `ROBOTLASER` share.
    fn configured_laser(&mut self) -> Result<Scan, LineError> {
        self.number::<f64>("laser type")?;
        let angle_min_rad = self.number::<f64>("start angle")? as f32;
        self.number::<f64>("field of view")?;
        let angle_increment_rad = self.number::<f64>("angular resolution")? as f32;
        let maximum_m = self.number::<f32>("maximum range")?;
        self.number::<f64>("accuracy")?;
        self.number::<f64>("remission mode")?;
        let ranges_m = self.ranges()?;
        let remissions: usize = self.number("number of remissions")?;
        for _ in 0..remissions {
            self.number::<f32>("a remission")?;
        }
        if ranges_m.is_empty() {
            return Err(LineError::BadScan("without beams"));
        }
        if !(angle_min_rad.is_finite() && angle_increment_rad.is_finite()) {
            return Err(LineError::BadScan("with an angle that is not finite"));
        }
        let range_max_m = if maximum_m > 0.0 {
            maximum_m.min(DEFAULT_RANGE_MAX_M)
        } else {
            DEFAULT_RANGE_MAX_M
        };
        Ok(Scan {
            angle_min_rad,
            angle_increment_rad,
            time_increment_s: 0.0,
            range_min_m: 0.0,
            range_max_m,
            ranges_m,
        })
    }

    fn ranges(&mut self) -> Result<Vec<f32>, LineError> {
        let count: usize = self.number("number of ranges")?;
        // A wrong count must not allocate more memory than the line could fill.
        let most = self.0.size_hint().1.unwrap_or(0);
        let mut ranges_m = Vec::with_capacity(count.min(most));
        for _ in 0..count {
            ranges_m.push(self.number("a range")?);
        }
        Ok(ranges_m)
    }

    fn own_pose(&mut self) -> Result<OwnPose, LineError> {
        Ok(OwnPose {
            odom_from_sensor: self.pose()?,
            odom_from_base: self.pose()?,
        })
    }

    fn pose(&mut self) -> Result<Pose, LineError> {
        let [x_m, y_m, yaw_rad] = [self.number("x")?, self.number("y")?, self.number("θ")?];
        if [x_m, y_m, yaw_rad]
            .iter()
            .all(|value: &f64| value.is_finite())
        {
            Ok(planar(x_m, y_m, yaw_rad))
        } else {
            Err(LineError::BadPose)
        }
    }

    /// The three fields every line ends with, and the end itself.
    fn stamps(mut self) -> Result<RobotTime, LineError> {
        let ipc_stamp_s = self.number("ipc stamp")?;
        self.next("host")?;
        self.number::<f64>("logger stamp")?;
        if let Some(text) = self.0.next() {
            return Err(LineError::TooManyFields(shortened(text)));
        }
        RobotTime::from_secs_f64(ipc_stamp_s).ok_or(LineError::BadStamp(ipc_stamp_s))
    }

    fn number<T: std::str::FromStr>(&mut self, field: &'static str) -> Result<T, LineError> {
        let text = self.next(field)?;
        text.parse().ok().ok_or_else(|| LineError::NotANumber {
            field,
            text: shortened(text),
        })
    }

    fn next(&mut self, field: &'static str) -> Result<&str, LineError> {
        self.0.next().ok_or(LineError::Missing(field))
    }
}

fn shortened(text: &str) -> String {
    text.chars().take(20).collect()
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "numbers must arrive bit for bit")]
mod tests {
    use super::*;
    use measurement::pose::yaw_rad;

    fn parse_line(line: &str) -> Result<(RobotTime, MeasurementData), LineError> {
        let (name, fields) = line.split_once(' ').unwrap();
        parse(layout_of(name).unwrap().0, fields, 50.0)
    }

    fn scan_of(line: &str) -> (Scan, Option<OwnPose>) {
        let MeasurementData::Scan { scan, own_pose } = parse_line(line).unwrap().1 else {
            panic!("not a scan: {line}");
        };
        (scan, own_pose)
    }

    #[test]
    fn laser_line_has_separate_laser_and_vehicle_poses() {
        let line = "FLASER 4 6.66 7.16 50 81.83 1.25 2 0.5 1 2 -0.5 21.0199 pippo 22.5";
        let (scan, own_pose) = scan_of(line);
        assert_eq!(scan.ranges_m, [6.66, 7.16, 50.0, 81.83]);
        assert_eq!((scan.range_min_m, scan.range_max_m), (0.0, 50.0));
        assert_eq!(scan.angle_min_rad, -FRAC_PI_2 as f32);
        assert_eq!(scan.angle_increment_rad, (PI / 4.0) as f32);
        let own_pose = own_pose.unwrap();
        assert_eq!(own_pose.odom_from_sensor.translation.x, 1.25);
        assert!((yaw_rad(&own_pose.odom_from_sensor) - 0.5).abs() < 1e-12);
        assert_eq!(own_pose.odom_from_base.translation.x, 1.0);
        assert!((yaw_rad(&own_pose.odom_from_base) + 0.5).abs() < 1e-12);
        assert_eq!(
            parse_line(line).unwrap().0,
            RobotTime::from_secs_f64(21.0199).unwrap()
        );
    }

    #[test]
    fn odd_beam_counts_hold_both_ends_of_the_half_circle() {
        let (scan, _) = scan_of("RLASER 5 1 1 1 1 1 0 0 0 0 0 0 1 host 1");
        assert_eq!(scan.angle_increment_rad, (PI / 4.0) as f32);
        let (scan, _) = scan_of("FLASER 1 3.5 0 0 0 0 0 0 1 host 1");
        assert!(scan.angle_increment_rad.is_finite());
    }

    #[test]
    fn configured_laser_lines_name_their_angles_and_limit() {
        let robot = "ROBOTLASER1 0 -1.566433 3.141593 0.017453 81.9 0.01 0 3 14.15 6.73 49.63 \
                     2 0 1 0.1 0.2 0.3 0.4 0.5 0.6 0 0 0 0 0 1232658641.50129 zoidberg2 163.28";
        let (scan, own_pose) = scan_of(robot);
        assert_eq!(scan.angle_min_rad, -1.566433);
        assert_eq!(scan.angle_increment_rad, 0.017453);
        assert_eq!(scan.range_max_m, 80.0);
        assert_eq!(scan.ranges_m, [14.15, 6.73, 49.63]);
        assert_eq!(own_pose.unwrap().odom_from_base.translation.x, 0.4);
        assert_eq!(
            (parse_line(robot).unwrap().0.as_nanos() + 500) / 1000,
            1_232_658_641_501_290
        );

        let raw = "RAWLASER2 1 -2 4 0.006 5.6 0.01 0 2 1 2 0 17.5 host 1";
        let (scan, own_pose) = scan_of(raw);
        assert_eq!((scan.range_max_m, own_pose), (5.6, None));
        assert_eq!(layout_of("RAWLASER2").unwrap().1, "rear_laser");
    }

    #[test]
    fn odometry_line_is_a_pose_in_odom() {
        let (stamp, data) = parse_line("ODOM 1 2 -1.5 0.1 0.2 0.3 70.25 nohost 0").unwrap();
        let MeasurementData::Odometry {
            child,
            odom_from_base,
        } = data
        else {
            panic!("not odometry");
        };
        assert_eq!(&*child, "base_link");
        assert_eq!(odom_from_base.translation.y, 2.0);
        assert!((yaw_rad(&odom_from_base) + 1.5).abs() < 1e-12);
        assert_eq!(stamp.as_nanos(), 70_250_000_000);
    }

    #[test]
    fn lines_that_do_not_hold_together_say_why() {
        let damaged = [
            ("FLASER 3 1 2", "ends before a range"),
            ("FLASER 18446744073709551615 1 2", "ends before a range"),
            (
                "FLASER 1 1.5x 0 0 0 0 0 0 1 host 1",
                "a range is not a number: \"1.5x\"",
            ),
            (
                "FLASER 1 1 2 0 0 0 0 0 0 1 host 1",
                "logger stamp is not a number: \"host\"",
            ),
            (
                "ODOM 0 0 0 0 0 0 1 host 1 2",
                "goes on after its last field with \"2\"",
            ),
        ];
        let damaged =
            damaged.map(|(line, expected)| (line, expected.to_owned(), DropReason::Damaged));
        let others = [
            (
                "FLASER 0 0 0 0 0 0 0 1 host 1",
                "a scan without beams".to_owned(),
                DropReason::BadScan,
            ),
            (
                "ODOM nan 0 0 0 0 0 1 host 1",
                "a pose is not finite".to_owned(),
                DropReason::BadPose,
            ),
            (
                "ODOM 0 0 0 0 0 0 1e300 host 1",
                format!("the stamp is {} s", 1e300),
                DropReason::BadStamp,
            ),
        ];
        for (line, expected, reason) in damaged.into_iter().chain(others) {
            let error = parse_line(line).unwrap_err();
            assert_eq!(
                (error.to_string(), error.reason()),
                (expected, reason),
                "{line}"
            );
        }
    }

    #[test]
    fn message_names_differ_from_garbage() {
        for name in ["SYNC", "SM_UPDATE", "LASER3", "NEFF"] {
            assert!(is_message_name(name), "{name}");
        }
        for name in ["", "3LASER", "flaser", "FLA\u{fffd}SER", &"A".repeat(41)] {
            assert!(!is_message_name(name), "{name}");
        }
    }
}
