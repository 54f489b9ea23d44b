//! How ROS 2 goes over Zenoh: keys, announcements and attachments of `rmw_zenoh` and of `zenoh-bridge-ros2dds`, pure.
//!
//! `rmw_zenoh` (`ros2/rmw_zenoh`, docs/design.md): a topic's key is `domain/topic/type/hash`, and every message has an
//! attachment. The bridge (`eclipse-zenoh/zenoh-plugin-ros2dds`): the key is the topic alone, and only the announcement
//! says its type. Both carry CDR behind an encapsulation header, as a ROS 2 recording does.

pub mod attachment;
mod keys;
mod liveliness;

pub use keys::{HistoryKeys, rmw_pattern, rmw_stream, twist_keys};
pub use liveliness::{DiscoveredTopic, TopicTransport, parse_token, token_patterns};

/// Greatest domain id: DDS has no ports for more (ROS 2 documentation, "The `ROS_DOMAIN_ID`").
pub const MAX_DOMAIN: u32 = 232;

/// `sensor_msgs/LaserScan` → `sensor_msgs::msg::dds_::LaserScan_`; `None` where it is no name of a type.
fn dds_name(type_name: &str) -> Option<String> {
    let (package, name) = type_name.split_once('/')?;
    Some(format!("{package}::msg::dds_::{name}_"))
}

/// The same the other way round.
fn ros_name(dds_name: &str) -> Option<String> {
    let (package, name) = dds_name.split_once("::msg::dds_::")?;
    let name = name.strip_suffix('_')?;
    let is_name = |part: &str| {
        !part.is_empty() && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    (is_name(package) && is_name(name)).then(|| format!("{package}/{name}"))
}
