//! Settings of `[ros2_output]`.

use serde::Deserialize;

use super::Config;
use super::config_layer::{join, quoted};
use super::error::{ConfigIssue, Problem};
use super::motors::is_topic;

/// What is published to a ROS 2 system: each topic that is named.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Ros2OutputConfig {
    /// Frame of the maps, the parent of `localization.fixed_frame`.
    pub map_frame: String,
    /// Whether `tf` has `localization.base_frame` in `localization.fixed_frame`: not where another node publishes it.
    pub odom_to_base: bool,
    /// `nav_msgs/OccupancyGrid` of the occupancy grid, with updates.
    pub map: Option<RosTopicConfig>,
    /// `nav_msgs/OccupancyGrid` of the cost map, with updates.
    pub cost_map: Option<RosTopicConfig>,
    /// `grid_map_msgs/GridMap`.
    pub elevation: Option<RosTopicConfig>,
    /// `octomap_msgs/Octomap`.
    pub voxels: Option<RosTopicConfig>,
    /// `sensor_msgs/PointCloud2`: the cells of the obstacle map.
    pub obstacles: Option<RosTopicConfig>,
    /// `tf2_msgs/TFMessage`.
    pub tf: Option<RosTopicConfig>,
    /// `nav_msgs/Odometry`.
    pub odometry: Option<RosTopicConfig>,
    /// `nav_msgs/Path`: the trajectory.
    pub path: Option<RosTopicConfig>,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RosTopicConfig {
    pub topic: String,
    /// Most messages per second.
    pub rate_hz: f64,
    /// Larger messages are dropped and counted; kilobytes (10³ bytes).
    pub max_kb: u32,
}

impl RosTopicConfig {
    pub const fn max_bytes(&self) -> u64 {
        self.max_kb as u64 * 1000
    }
}

impl Default for Ros2OutputConfig {
    fn default() -> Self {
        Self {
            map_frame: "map".to_owned(),
            odom_to_base: true,
            map: None,
            cost_map: None,
            elevation: None,
            voxels: None,
            obstacles: None,
            tf: None,
            odometry: None,
            path: None,
        }
    }
}

impl Ros2OutputConfig {
    /// The named topics, by key.
    fn topics(&self) -> impl Iterator<Item = (&'static str, &RosTopicConfig)> {
        let topics = [
            ("map", &self.map),
            ("cost_map", &self.cost_map),
            ("elevation", &self.elevation),
            ("voxels", &self.voxels),
            ("obstacles", &self.obstacles),
            ("tf", &self.tf),
            ("odometry", &self.odometry),
            ("path", &self.path),
        ];
        topics
            .into_iter()
            .filter_map(|(key, topic)| Some((key, topic.as_ref()?)))
    }

    pub fn is_empty(&self) -> bool {
        self.topics().next().is_none()
    }

    pub(super) fn check(&self, config: &Config) -> Vec<ConfigIssue> {
        let mut issues = Vec::new();
        let mut issue = |key: &str, value: String, why, allowed: &str| {
            issues.push(ConfigIssue {
                origin: None,
                key: join("ros2_output", key),
                problem: Problem::NotAllowed {
                    value,
                    why,
                    allowed: allowed.to_owned(),
                },
            });
        };
        for (key, topic) in self.topics() {
            if !is_topic(&topic.topic) {
                issue(
                    &join(key, "topic"),
                    quoted(&topic.topic),
                    "it names a topic of ROS 2",
                    "\"/NAME\" of letters, digits, `_` and `/`",
                );
            }
        }
        let mapping = &config.mapping;
        for (key, topic, layer, is_made) in [
            ("map", &self.map, "occupancy", mapping.occupancy.enabled),
            ("cost_map", &self.cost_map, "cost", mapping.cost.enabled),
            (
                "elevation",
                &self.elevation,
                "elevation",
                mapping.elevation.enabled,
            ),
            ("voxels", &self.voxels, "octree", mapping.octree.enabled),
            (
                "obstacles",
                &self.obstacles,
                "elevation",
                mapping.elevation.enabled,
            ),
        ] {
            if let Some(topic) = topic
                && !is_made
            {
                issue(
                    key,
                    quoted(&topic.topic),
                    "its layer is not mapped",
                    &format!("no such topic, or mapping.{layer}.enabled = true"),
                );
            }
        }
        issues
    }
}

#[cfg(test)]
mod tests {
    use crate::config::load;

    fn check(preset: &str, settings: &[&str]) -> Result<crate::config::Config, String> {
        let settings: Vec<_> = settings.iter().map(|set| set.parse().unwrap()).collect();
        load(preset, &settings).map_err(|error| error.to_string())
    }

    #[test]
    fn nothing_is_published_unless_it_is_named() {
        assert!(check("generic3d", &[]).unwrap().ros2_output.is_empty());
    }

    #[test]
    fn what_is_wrong_is_named() {
        let topic = |topic: &str, rate_hz: &str, max_kb: &str| {
            [
                format!("ros2_output.map.topic='{topic}'"),
                format!("ros2_output.map.rate_hz={rate_hz}"),
                format!("ros2_output.map.max_kb={max_kb}"),
            ]
        };
        for (settings, says) in [
            (
                topic("map", "1", "100"),
                "ros2_output.map.topic`: map is not allowed",
            ),
            (topic("/map", "0", "100"), "ros2_output.map.rate_hz"),
            (topic("/map", "nan", "100"), "above 0, up to 100"),
            (topic("/map", "1", "0"), "1 to 1000000"),
        ] {
            let settings: Vec<_> = settings.iter().map(String::as_str).collect();
            let error = check("generic2d", &settings).unwrap_err();
            assert!(error.contains(says), "{error}");
        }
        let error = check("generic2d", &["ros2_output.map.topic=/map"]).unwrap_err();
        assert!(error.contains("rate_hz"), "{error}");
    }

    #[test]
    fn the_example_of_all_presets_is_valid() {
        let text = |preset: &crate::config::presets::Preset| {
            let (_, output) = preset.text.split_once("\n# [ros2_output]")?;
            Some(format!("[ros2_output]{}", output.replace("\n# ", "\n")))
        };
        let text_of_generic = text(&crate::config::presets::GENERIC).unwrap();
        for preset in crate::config::presets::PRESETS {
            let output = text(preset);
            assert!(
                output.is_none_or(|output| output == text_of_generic),
                "{}",
                preset.name
            );
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("v.toml");
        std::fs::write(&path, format!("preset = \"generic3d\"\n{text_of_generic}")).unwrap();
        let output = check(path.to_str().unwrap(), &[]).unwrap().ros2_output;
        assert_eq!(output.topics().count(), 8);
    }

    #[test]
    fn a_layer_that_is_not_mapped_is_not_published() {
        let settings = [
            "ros2_output.voxels.topic=/octomap",
            "ros2_output.voxels.rate_hz=1",
            "ros2_output.voxels.max_kb=1000",
        ];
        check("generic3d", &settings).unwrap();
        let error = check("generic2d", &settings).unwrap_err();
        assert!(error.contains("mapping.octree.enabled = true"), "{error}");
    }
}
