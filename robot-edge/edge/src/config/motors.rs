//! Settings of `[motors]`.

use serde::Deserialize;

use super::config_layer::{join, quoted};
use super::error::{ConfigIssue, Problem};
use crate::actuators::mavlink::MavlinkConfig;
use crate::actuators::roboteq::RoboteqConfig;
use teleop::{LocomotionConfig, LocomotionModes};

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotorsConfig {
    /// How the wheels can be set; a boat has the mode `differential`.
    pub modes: LocomotionModes,
    pub min_turn_radius_m: f64,
    pub mode_change_s: f64,
    /// A Roboteq AX3500 on a serial line.
    pub roboteq: Option<RoboteqConfig>,
    /// An autopilot that drives, over `MAVLink`.
    pub mavlink: Option<MavlinkConfig>,
    /// Motors of a ROS 2 system, by velocity messages.
    pub ros2_twist: Option<TwistConfig>,
}

impl MotorsConfig {
    /// Whether real motors are configured.
    pub const fn has_motors(&self) -> bool {
        self.roboteq.is_some() || self.mavlink.is_some() || self.ros2_twist.is_some()
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TwistConfig {
    pub topic: String,
    pub message: VelocityMessage,
}

/// Which message velocities are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VelocityMessage {
    /// What the subscribers announce that they take; without any, `Twist`.
    #[default]
    Auto,
    /// `geometry_msgs/Twist`.
    Twist,
    /// `geometry_msgs/TwistStamped`, which `diff_drive_controller` and Nav2 take since Jazzy.
    TwistStamped,
}

impl Default for TwistConfig {
    fn default() -> Self {
        Self {
            topic: "/cmd_vel".to_owned(),
            message: VelocityMessage::Auto,
        }
    }
}

impl Default for MotorsConfig {
    fn default() -> Self {
        let LocomotionConfig {
            modes,
            min_turn_radius_m,
            mode_change_s,
        } = LocomotionConfig::default();
        Self {
            modes,
            min_turn_radius_m,
            mode_change_s,
            roboteq: None,
            mavlink: None,
            ros2_twist: None,
        }
    }
}

impl MotorsConfig {
    pub(crate) const fn locomotion(&self) -> LocomotionConfig {
        LocomotionConfig {
            modes: self.modes,
            min_turn_radius_m: self.min_turn_radius_m,
            mode_change_s: self.mode_change_s,
        }
    }

    pub(super) fn check(&self) -> Vec<ConfigIssue> {
        let of_roboteq = self.roboteq.iter().flat_map(RoboteqConfig::check);
        let of_roboteq = of_roboteq.map(|issue| ("motors.roboteq", issue));
        let of_mavlink = self.mavlink.iter().flat_map(MavlinkConfig::check);
        let of_mavlink = of_mavlink.map(|issue| ("motors.mavlink", issue));
        let mut issues: Vec<_> = of_roboteq
            .chain(of_mavlink)
            .map(|(table, issue)| ConfigIssue {
                key: if issue.key.is_empty() {
                    table.to_owned()
                } else {
                    join(table, &issue.key)
                },
                ..issue
            })
            .collect();
        let mut issue = |key: &str, value: &str, why, allowed: &str| {
            issues.push(ConfigIssue {
                origin: None,
                key: key.to_owned(),
                problem: Problem::NotAllowed {
                    value: quoted(value),
                    why,
                    allowed: allowed.to_owned(),
                },
            });
        };
        for (is_given, why) in [
            (
                self.roboteq.is_some(),
                "motors.roboteq drives the wheels of two sides",
            ),
            (
                self.mavlink.is_some(),
                "motors.mavlink takes a speed ahead and a turn rate",
            ),
        ] {
            if is_given && self.modes != LocomotionModes::DIFFERENTIAL {
                issue(
                    "motors.modes",
                    "other modes",
                    why,
                    "differential = true alone",
                );
            }
        }
        if let (Some(_), Some(mavlink)) = (&self.roboteq, &self.mavlink) {
            issue(
                "motors.mavlink.system",
                &mavlink.system.to_string(),
                "there is motors.roboteq already, and a vehicle has one kind of motors",
                "one of the two",
            );
        }
        if let Some(TwistConfig { topic, .. }) = &self.ros2_twist {
            if self.roboteq.is_some() || self.mavlink.is_some() {
                issue(
                    "motors.ros2_twist",
                    topic,
                    "there are other motors already, and a vehicle has one kind of motors",
                    "one of the kinds",
                );
            }
            if !is_topic(topic) {
                issue(
                    "motors.ros2_twist.topic",
                    topic,
                    "it names a topic of ROS 2",
                    "\"/NAME\" of letters, digits, `_` and `/`",
                );
            }
        }
        issues
    }
}

pub(super) fn is_topic(name: &str) -> bool {
    let is_part = |part: &str| {
        let first_fits = part
            .chars()
            .next()
            .is_some_and(|first| !first.is_ascii_digit());
        first_fits && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    name.len() <= 255
        && name
            .strip_prefix('/')
            .is_some_and(|bare| bare.split('/').all(is_part))
}

#[cfg(test)]
mod tests {
    use crate::config::load;

    const ROBOTEQ: &str = "[motors.roboteq]\nport = \"/dev/ttyS0\"\nleft_channel = \"two\"\n\
                           drive = { track_width_m = 0.5, full_speed_mps = 1.5 }\n";

    fn check(text: &str, settings: &[&str]) -> Result<crate::config::Config, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rover.toml");
        std::fs::write(&path, format!("preset = \"generic2d\"\n{text}")).unwrap();
        let settings: Vec<_> = settings.iter().map(|set| set.parse().unwrap()).collect();
        load(path.to_str().unwrap(), &settings).map_err(|error| error.to_string())
    }

    #[test]
    fn a_roboteq_is_a_table_and_absent_by_default() {
        assert_eq!(load("generic2d", &[]).unwrap().motors.roboteq, None);
        let config = check(ROBOTEQ, &["motors.roboteq.port=/dev/ttyUSB1"]).unwrap();
        let roboteq = config.motors.roboteq.unwrap();
        assert_eq!(roboteq.port.to_str(), Some("/dev/ttyUSB1"));
        assert!((roboteq.drive.full_speed_mps - 1.5).abs() < 1e-12);
        assert!(roboteq.require_watchdog);
    }

    #[test]
    fn what_is_wrong_with_it_is_named() {
        let error = check(&ROBOTEQ.replace("0.5", "0.0"), &[]).unwrap_err();
        assert!(
            error.contains("motors.roboteq.drive.track_width_m"),
            "{error}"
        );
        let error = check(&ROBOTEQ.replace("port", "prot"), &[]).unwrap_err();
        assert!(
            error.contains("motors.roboteq.prot") && error.contains("port"),
            "{error}"
        );
        let error = check(&ROBOTEQ.replace("\"two\"", "\"three\""), &[]).unwrap_err();
        assert!(error.contains("\"one\", \"two\""), "{error}");
    }

    #[test]
    fn encoders_of_a_roboteq_need_pulses_and_two_joints() {
        let encoders = format!(
            "{ROBOTEQ}[motors.roboteq.encoders]\nleft_pulses_per_turn = -500.0\nright_pulses_per_turn = 500.0\n"
        );
        assert_eq!(
            check(ROBOTEQ, &[])
                .unwrap()
                .motors
                .roboteq
                .unwrap()
                .encoders,
            None
        );
        let config = check(&encoders, &[]).unwrap();
        let roboteq = config.motors.roboteq.unwrap();
        assert!(roboteq.encoders().is_some());
        let joints = roboteq.encoders.unwrap();
        assert_eq!(
            [joints.left_joint, joints.right_joint],
            ["left_wheel_joint", "right_wheel_joint"]
        );
        for (set, key, why) in [
            (
                "left_pulses_per_turn=0",
                "left_pulses_per_turn",
                "1 to 10000000",
            ),
            (
                "right_pulses_per_turn=nan",
                "right_pulses_per_turn",
                "1 to 10000000",
            ),
            ("left_joint=''", "left_joint", "it names a wheel"),
            (
                "left_joint=right_wheel_joint",
                "right_joint",
                "a joint other than left_joint",
            ),
            ("joint=a", "joint", "left_joint"),
        ] {
            let error = check(&encoders, &[&format!("motors.roboteq.encoders.{set}")]).unwrap_err();
            let key = format!("motors.roboteq.encoders.{key}");
            assert!(
                error.contains(&key) && error.contains(why),
                "{set}: {error}"
            );
        }
        let one = encoders.replace("right_pulses_per_turn = 500.0\n", "");
        let error = check(&one, &[]).unwrap_err();
        assert!(error.contains("right_pulses_per_turn"), "{error}");
    }

    #[test]
    fn a_roboteq_has_wheels_of_two_sides_and_a_vehicle_has_a_mode() {
        assert!(!load("introbot", &[]).unwrap().motors.modes.differential);
        let error = check(ROBOTEQ, &["motors.modes.crab=true"]).unwrap_err();
        assert!(error.contains("wheels of two sides"), "{error}");
        check("", &["motors.modes.crab=true"]).unwrap();
        let error = check("", &["motors.modes.differential=false"]).unwrap_err();
        assert!(error.contains("at least one mode"), "{error}");
        // 1 m/s² over 4 rad/s².
        let error = check(
            "",
            &[
                "motors.min_turn_radius_m=0.2",
                "motors.modes.double_ackermann=true",
            ],
        )
        .unwrap_err();
        assert!(error.contains("0.25 to 1000"), "{error}");
    }

    #[test]
    fn ros2_twist_needs_a_topic_and_excludes_other_motors() {
        let config = check("[motors.ros2_twist]\n", &[]).unwrap();
        assert_eq!(config.motors.ros2_twist.unwrap().topic, "/cmd_vel");
        for topic in ["/bot/cmd_vel", "/a_1"] {
            check("", &[&format!("motors.ros2_twist.topic={topic}")]).unwrap();
        }
        for topic in ["cmd_vel", "/", "/cmd vel", "/**", "/1st", "/a//b", "/a/"] {
            let error = check("", &[&format!("motors.ros2_twist.topic='{topic}'")]).unwrap_err();
            assert!(
                error.contains("it names a topic of ROS 2"),
                "{topic}: {error}"
            );
        }
        let error = check(ROBOTEQ, &["motors.ros2_twist.topic=/cmd_vel"]).unwrap_err();
        assert!(error.contains("one kind of motors"), "{error}");
    }

    #[test]
    fn an_autopilot_has_one_address_and_numbers_of_systems() {
        let table = |keys: &str| format!("[motors.mavlink]\n{keys}\n");
        let mavlink = check(&table("udp_listen = \"0.0.0.0:14550\""), &[]).unwrap();
        let mavlink = mavlink.motors.mavlink.unwrap();
        assert_eq!(mavlink.numbers(), ([1, 191], 1));
        assert!(!mavlink.request_guided);
        for keys in [
            "tcp = \"127.0.0.1:5760\"",
            "udp = \"[::1]:14550\"",
            "serial = \"/dev/ttyACM0\"\nbaud = 57600",
        ] {
            check(&table(keys), &[]).unwrap();
        }
        for (keys, key, why) in [
            ("", "motors.mavlink", "exactly one"),
            (
                "tcp = \"a:1\"\nudp = \"b:1\"",
                "motors.mavlink",
                "exactly one",
            ),
            (
                "tcp = \"autopilot:5760\"",
                "motors.mavlink.tcp",
                "looks up no names",
            ),
            (
                "udp = \"127.0.0.1\"",
                "motors.mavlink.udp",
                "no host and port",
            ),
            (
                "udp_listen = \"here\"",
                "motors.mavlink.udp_listen",
                "no address and port",
            ),
            (
                "serial = \"/dev/ttyACM0\"\nbaud = 3",
                "motors.mavlink.serial",
                "300 to 12000000",
            ),
            (
                "tcp = \"127.0.0.1:1\"\nbaud = 9600",
                "motors.mavlink.baud",
                "only a serial port",
            ),
            (
                "tcp = \"127.0.0.1:1\"\nsystem = 256",
                "motors.mavlink.system",
                "1 to 255",
            ),
            (
                "tcp = \"127.0.0.1:1\"\nown_component = 0",
                "motors.mavlink.own_component",
                "1 to 255",
            ),
            (
                "tcp = \"127.0.0.1:1\"\nown_component = 1",
                "motors.mavlink.own_component",
                "the autopilot itself",
            ),
            (
                "tcp = \"127.0.0.1:1\"\nsystem_id = 1",
                "motors.mavlink.system_id",
                "system",
            ),
        ] {
            let error = check(&table(keys), &[]).unwrap_err();
            assert!(
                error.contains(key) && error.contains(why),
                "{keys}: {error}"
            );
        }
        let both = format!("{ROBOTEQ}{}", table("tcp = \"127.0.0.1:1\""));
        let error = check(&both, &[]).unwrap_err();
        assert!(error.contains("one kind of motors"), "{error}");
        let error =
            check(&table("tcp = \"127.0.0.1:1\""), &["motors.modes.crab=true"]).unwrap_err();
        assert!(error.contains("a speed ahead and a turn rate"), "{error}");
    }
}
