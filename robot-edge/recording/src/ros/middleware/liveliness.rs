//! Announcements of topics: Zenoh's liveliness tokens.

use super::ros_name;
use measurement::Stream;

/// Who carries a topic's messages into Zenoh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TopicTransport {
    /// The publisher itself, by `rmw_zenoh`.
    Rmw,
    /// `zenoh-bridge-ros2dds`.
    Bridge,
}

/// A topic that somebody publishes, as announced.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DiscoveredTopic {
    /// Topic and type.
    pub stream: Stream,
    /// By whom.
    pub transport: TopicTransport,
    /// The key of its messages, where the announcement says it.
    pub key: Option<String>,
}

/// Key expressions of all announcements of publishers: in this domain, and of bridges.
pub fn token_patterns(domain: u32) -> [String; 2] {
    [
        format!("@ros2_lv/{domain}/*/*/*/MP/**"),
        "@/*/@ros2_lv/MP/**".to_owned(),
    ]
}

/// What the key of a token announces; `None` where it is no publisher of messages.
pub fn parse_token(token: &str) -> Option<DiscoveredTopic> {
    let chunks: Vec<&str> = token.split('/').collect();
    match chunks[..] {
        [
            "@ros2_lv",
            _domain,
            _session,
            _node_id,
            _id,
            "MP",
            _enclave,
            _namespace,
            _node,
            topic,
            type_name,
            _hash,
            _qos,
        ] => Some(DiscoveredTopic {
            stream: Stream {
                name: absolute_name(&topic.replace('%', "/"))?,
                type_name: ros_name(type_name)?,
            },
            transport: TopicTransport::Rmw,
            key: None,
        }),
        ["@", _session, "@ros2_lv", "MP", key, type_name, ..] => {
            let key = key.replace('§', "/");
            let type_name = type_name.replace('§', "/");
            Some(DiscoveredTopic {
                stream: Stream {
                    name: absolute_name(&key)?,
                    type_name: crate::ros::ros1_type_name(&type_name),
                },
                transport: TopicTransport::Bridge,
                key: Some(key),
            })
        }
        _ => None,
    }
}

/// A topic's name, with its slash in front.
fn absolute_name(topic: &str) -> Option<String> {
    let bare = topic.strip_prefix('/').unwrap_or(topic);
    let is_name = !bare.is_empty()
        && bare
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '/' | '~'));
    is_name.then(|| format!("/{bare}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_of_both_kinds_announce_topics() {
        let rmw = "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MP/%/%/talker/%bot%scan/\
                   sensor_msgs::msg::dds_::LaserScan_/RIHS01_64c1/::,7:,:,:,,";
        assert_eq!(
            parse_token(rmw),
            Some(DiscoveredTopic {
                stream: Stream {
                    name: "/bot/scan".to_owned(),
                    type_name: "sensor_msgs/LaserScan".to_owned(),
                },
                transport: TopicTransport::Rmw,
                key: None,
            })
        );
        let bridge = "@/b1c2/@ros2_lv/MP/bot§tf_static/tf2_msgs§msg§TFMessage/:1:1:,1";
        assert_eq!(
            parse_token(bridge),
            Some(DiscoveredTopic {
                stream: Stream {
                    name: "/bot/tf_static".to_owned(),
                    type_name: "tf2_msgs/TFMessage".to_owned(),
                },
                transport: TopicTransport::Bridge,
                key: Some("bot/tf_static".to_owned()),
            })
        );
    }

    #[test]
    fn what_announces_no_publisher_is_passed_over() {
        for token in [
            "",
            "@ros2_lv/0/aa/0/0/NN/%/%/talker",
            "@ros2_lv/0/aa/0/11/MS/%/%/l/%scan/sensor_msgs::msg::dds_::LaserScan_/x/q",
            "@/aa/@ros2_lv/MS/scan/sensor_msgs§msg§LaserScan/q",
            "@/aa/@ros2_lv/MP/scan*/sensor_msgs§msg§LaserScan/q",
            "@ros2_lv/0/aa/0/10/MP/%/%/t/%/sensor_msgs::msg::dds_::LaserScan_/x/q",
        ] {
            assert_eq!(parse_token(token), None, "{token}");
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_survived(text in "(@ros2_lv|@|[0-9a-z§%:_]*|/|MP|\\PC)*") {
            parse_token(&text);
            super::super::rmw_stream(0, &text);
        }
    }
}
