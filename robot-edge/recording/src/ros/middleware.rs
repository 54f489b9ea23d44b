//! ROS 2 over Zenoh: keys, announcements and attachments of `rmw_zenoh` and `zenoh-bridge-ros2dds`.
//!
//! `rmw_zenoh` (`ros2/rmw_zenoh`, docs/design.md): a topic's key is `domain/topic/type/hash`, and every message has an
//! attachment. The bridge (`eclipse-zenoh/zenoh-plugin-ros2dds`): the key is the topic alone, and only the announcement
//! says its type. Both carry CDR behind an encapsulation header, as a ROS 2 recording does.

use measurement::Stream;
use measurement::time::RobotTime;

/// Greatest domain id: DDS has no ports for more (ROS 2 documentation, "The `ROS_DOMAIN_ID`").
pub const MAX_DOMAIN: u32 = 232;

/// `sensor_msgs/LaserScan` → `sensor_msgs::msg::dds_::LaserScan_`; `None` if it is no name of a type.
fn dds_name(type_name: &str) -> Option<String> {
    let (package, name) = type_name.split_once('/')?;
    Some(format!("{package}::msg::dds_::{name}_"))
}

fn ros_name(dds_name: &str) -> Option<String> {
    let (package, name) = dds_name.split_once("::msg::dds_::")?;
    let name = name.strip_suffix('_')?;
    let is_name = |part: &str| {
        !part.is_empty() && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    (is_name(package) && is_name(name)).then(|| format!("{package}/{name}"))
}

/// The key expression of every topic of a type in a domain under `rmw_zenoh`, whatever the hash of its definition;
/// `type_name` as in `sensor_msgs/LaserScan`. `None` where it is no name of a type.
pub fn rmw_pattern(domain: u32, type_name: &str) -> Option<String> {
    Some(format!("{domain}/**/{}/*", dds_name(type_name)?))
}

/// The topic and type that a key of `rmw_zenoh` names; `None` if it is none of this domain.
pub fn rmw_stream(domain: u32, key: &str) -> Option<Stream> {
    let (of_domain, rest) = key.split_once('/')?;
    let (rest, hash) = rest.rsplit_once('/')?;
    let (topic, type_name) = rest.rsplit_once('/')?;
    let is_ours = of_domain.parse() == Ok(domain) && !topic.is_empty() && !hash.is_empty();
    is_ours.then_some(())?;
    Some(Stream {
        name: format!("/{topic}"),
        type_name: ros_name(type_name)?,
    })
}

/// The keys of a topic of `geometry_msgs/Twist`: of `rmw_zenoh` from Iron on, in Humble, and of bridges. Who listens has
/// one of them.
pub fn twist_keys(domain: u32, topic: &str) -> [String; 3] {
    const TWIST: &str = "geometry_msgs::msg::dds_::Twist_";
    /// Of the definition, which has not changed (REP-2011).
    const HASH: &str = "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a";
    let bare = topic.trim_matches('/');
    [
        format!("{domain}/{bare}/{TWIST}/{HASH}"),
        format!("{domain}/{bare}/{TWIST}/TypeHashNotSupported"),
        bare.to_owned(),
    ]
}

/// Keys of queries for the static transforms of a domain and of bridges: they are published once, and publishers keep them in
/// one of these ways.
pub fn static_transform_history(domain: u32) -> [String; 4] {
    const TF: &str = "tf2_msgs::msg::dds_::TFMessage_";
    [
        // `AdvancedPublisher` of zenoh-ext, in rmw_zenoh since 0.2 and in newer bridges.
        format!("{domain}/**/tf_static/{TF}/*/@adv/**"),
        "**/tf_static/@adv/**".to_owned(),
        // `PublicationCache` before it: the session's id goes before the key.
        format!("*/{domain}/**/tf_static/{TF}/*"),
        "@ros2_pub_cache/*/**/tf_static".to_owned(),
    ]
}

/// An announced topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DiscoveredTopic {
    /// Topic and type.
    pub stream: Stream,
    /// The key of its messages, which only `zenoh-bridge-ros2dds` announces.
    pub key: Option<String>,
}

/// Key expressions of all announcements of publishers: in this domain, and of bridges.
pub fn token_patterns(domain: u32) -> [String; 2] {
    [
        format!("@ros2_lv/{domain}/*/*/*/MP/**"),
        "@/*/@ros2_lv/MP/**".to_owned(),
    ]
}

/// The topic that a token's key announces; `None` if it is not a publisher of messages.
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

const ATTACHMENT_BYTES: usize = 33;

const GID_BYTES: u8 = 16;

/// An attachment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Number of the message; a publisher's first has 1.
    pub sequence: i64,
    /// When it was published, on the wall clock of its publisher.
    pub published: RobotTime,
    /// Which publisher.
    pub gid: [u8; 16],
}

impl Attachment {
    /// As bytes.
    pub fn encode(&self) -> [u8; ATTACHMENT_BYTES] {
        let mut bytes = [0; ATTACHMENT_BYTES];
        bytes[..8].copy_from_slice(&self.sequence.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.published.as_nanos().to_le_bytes());
        bytes[16] = GID_BYTES;
        bytes[17..].copy_from_slice(&self.gid);
        bytes
    }

    /// From bytes; `None` if they are none: older forms are not read.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let (sequence, rest) = bytes.split_first_chunk()?;
        let (published_ns, rest) = rest.split_first_chunk()?;
        let (&[length], rest) = rest.split_first_chunk()?;
        let gid = rest.try_into().ok()?;
        (length == GID_BYTES).then(|| Self {
            sequence: i64::from_le_bytes(*sequence),
            published: RobotTime::from_nanos(i64::from_le_bytes(*published_ns)),
            gid,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HASH: &str = "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828";

    #[test]
    fn a_key_names_topic_and_type() {
        let stream = |key: &str| rmw_stream(0, key).map(|stream| (stream.name, stream.type_name));
        let scan = |topic: &str| Some((topic.to_owned(), "sensor_msgs/LaserScan".to_owned()));
        let key = |topic: &str, hash: &str| {
            format!("0/{topic}/sensor_msgs::msg::dds_::LaserScan_/{hash}")
        };
        assert_eq!(stream(&key("scan", HASH)), scan("/scan"));
        assert_eq!(
            stream(&key("bot/front/scan", HASH)),
            scan("/bot/front/scan")
        );
        assert_eq!(stream(&key("scan", "TypeHashNotSupported")), scan("/scan"));
        for nothing in [
            "",
            "0",
            "0/scan",
            "scan",
            "0/sensor_msgs::msg::dds_::LaserScan_/x",
            "1/scan/sensor_msgs::msg::dds_::LaserScan_/x",
            "0/add/example::srv::dds_::AddTwoInts_/x",
            "0/scan/sensor_msgs::msg::dds_::Laser Scan_/x",
            "0/scan/::msg::dds__/x",
        ] {
            assert_eq!(stream(nothing), None, "{nothing}");
        }
    }

    #[test]
    fn a_pattern_holds_the_keys_of_its_type() {
        let pattern = rmw_pattern(7, "sensor_msgs/Imu").unwrap();
        assert_eq!(pattern, "7/**/sensor_msgs::msg::dds_::Imu_/*");
        assert_eq!(rmw_pattern(7, "Imu"), None);
    }

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
                key: Some("bot/tf_static".to_owned()),
            })
        );
    }

    #[test]
    fn tokens_without_publisher_are_ignored() {
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
            super::rmw_stream(0, &text);
        }
    }

    #[test]
    fn it_has_the_bytes_that_ros_reads() {
        let attachment = Attachment {
            sequence: 1,
            published: RobotTime::from_nanos(0x0102_0304),
            gid: std::array::from_fn(|index| index as u8),
        };
        let bytes = attachment.encode();
        let expected = [
            &[1, 0, 0, 0, 0, 0, 0, 0, 4, 3, 2, 1, 0, 0, 0, 0, 16][..],
            &attachment.gid,
        ]
        .concat();
        assert_eq!(bytes[..], expected);
        assert_eq!(Attachment::decode(&bytes), Some(attachment));
        for cut in 0..ATTACHMENT_BYTES {
            assert_eq!(Attachment::decode(&bytes[..cut]), None);
        }
        let mut other = bytes;
        other[16] = 15;
        assert_eq!(Attachment::decode(&other), None);
        assert_eq!(
            Attachment::decode(&[bytes.to_vec(), vec![0]].concat()),
            None
        );
    }
}
