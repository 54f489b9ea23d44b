//! Settings of `[planner]`.

use std::time::Duration;

use serde::Deserialize;

use super::Config;
use super::config_layer::{join, quoted};
use super::error::{ConfigIssue, Problem};
use super::motors::is_topic;

/// A planner in the ROS 2 system, to which operators send goals.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlannerConfig {
    /// `geometry_msgs/PoseStamped`, to the planner.
    pub goal_topic: String,
    /// `geometry_msgs/Twist` or `TwistStamped`, of the planner.
    pub velocity_topic: String,
    /// `nav_msgs/Path`, of the planner.
    pub path_topic: String,
    /// Longest time from one velocity to the next, by their arrival, milliseconds.
    pub max_gap_ms: u32,
}

impl Default for PlannerConfig {
    fn default() -> Self {
        Self {
            goal_topic: "/goal_pose".to_owned(),
            velocity_topic: "/cmd_vel_nav".to_owned(),
            path_topic: "/plan".to_owned(),
            max_gap_ms: 200,
        }
    }
}

impl PlannerConfig {
    pub const fn max_gap(&self) -> Duration {
        Duration::from_millis(self.max_gap_ms as u64)
    }

    pub(super) fn check(&self, config: &Config) -> Vec<ConfigIssue> {
        let mut issues = Vec::new();
        let mut issue = |key: &str, value: &str, why, allowed: &str| {
            issues.push(ConfigIssue {
                origin: None,
                key: join("planner", key),
                problem: Problem::NotAllowed {
                    value: quoted(value),
                    why,
                    allowed: allowed.to_owned(),
                },
            });
        };
        for (key, topic) in [
            ("goal_topic", &self.goal_topic),
            ("velocity_topic", &self.velocity_topic),
            ("path_topic", &self.path_topic),
        ] {
            if !is_topic(topic) {
                issue(
                    key,
                    topic,
                    "it names a topic of ROS 2",
                    "\"/NAME\" of letters, digits, `_` and `/`",
                );
            }
        }
        let velocity = &self.velocity_topic;
        let to_motors = config.motors.ros2_twist.as_ref().map(|twist| &twist.topic);
        if to_motors == Some(velocity) {
            issue(
                "velocity_topic",
                velocity,
                "the motors would obey the planner itself, past lease and collision monitor",
                "another topic than motors.ros2_twist.topic; the planner must publish there, and not to the motors",
            );
        }
        let own_path = config.ros2_output.path.as_ref().map(|path| &path.topic);
        if own_path == Some(&self.path_topic) {
            issue(
                "path_topic",
                &self.path_topic,
                "the trajectory is published there (ros2_output.path.topic)",
                "the topic of the planner's path",
            );
        }
        issues
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::load;

    fn check(text: &str) -> Result<Option<PlannerConfig>, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("v.toml");
        std::fs::write(&path, format!("preset = \"generic2d\"\n{text}")).unwrap();
        let config = load(path.to_str().unwrap(), &[]).map_err(|error| error.to_string())?;
        Ok(config.planner)
    }

    #[test]
    fn there_is_none_unless_it_is_named() {
        assert_eq!(check(""), Ok(None));
        assert_eq!(check("[planner]"), Ok(Some(PlannerConfig::default())));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let path = "{ topic = \"/plan\", rate_hz = 1.0, max_kb = 10 }";
        for (text, says) in [
            (
                "[planner]\nmax_gap_ms = 201".to_owned(),
                "planner.max_gap_ms",
            ),
            ("[planner]\nmax_gap_ms = 0".to_owned(), "50 to 200"),
            (
                "[planner]\ngoal_topic = \"goal\"".to_owned(),
                "planner.goal_topic",
            ),
            (
                "[motors.ros2_twist]\n[planner]\nvelocity_topic = \"/cmd_vel\"".to_owned(),
                "past lease and collision monitor",
            ),
            (
                format!("[planner]\n[ros2_output]\npath = {path}"),
                "planner.path_topic",
            ),
        ] {
            let error = check(&text).unwrap_err();
            assert!(error.contains(says), "{error}");
        }
    }
}
