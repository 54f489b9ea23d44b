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

/// A type of messages that is published.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PublishedType {
    /// In ROS 1 form, `nav_msgs/Path`.
    pub name: &'static str,
    /// Of its definition (REP-2011), which is the same from Iron to Kilted. `tests/python/ros2_client.py` computes them with
    /// `rosbags`.
    pub hash: &'static str,
}

macro_rules! published_types {
    ($($constant:ident, $name:literal, $hash:literal;)*) => {
        impl PublishedType {
            $(
                #[doc = concat!("`", $name, "`.")]
                pub const $constant: Self = Self { name: $name, hash: concat!("RIHS01_", $hash) };
            )*
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$constant),*];
        }
    };
}

published_types! {
    TWIST, "geometry_msgs/Twist", "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a";
    TWIST_STAMPED, "geometry_msgs/TwistStamped", "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64";
    POSE_STAMPED, "geometry_msgs/PoseStamped", "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8";
    TF, "tf2_msgs/TFMessage", "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087";
    ODOMETRY, "nav_msgs/Odometry", "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0";
    PATH, "nav_msgs/Path", "1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b";
    OCCUPANCY_GRID, "nav_msgs/OccupancyGrid", "8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7";
    OCCUPANCY_GRID_UPDATE, "map_msgs/OccupancyGridUpdate", "c4095b0be2e4363f8978a1570e0293ee093436f1e1c61d99b48502ac317025e8";
    GRID_MAP, "grid_map_msgs/GridMap", "343b0e72887541beda6b035cc053f2d6fffaad9d6dcb2773c15a808dfca31fde";
    OCTOMAP, "octomap_msgs/Octomap", "9891a19a05b70ec20aa8f45db3f8300b9ab80afff32c61c549d25087da9625b0";
    POINT_CLOUD, "sensor_msgs/PointCloud2", "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5";
}

/// The keys of a published topic under `rmw_zenoh`: from Iron on, and in Humble, which knows no hashes. `None` where the type
/// is no name of a type.
pub fn rmw_keys(domain: u32, topic: &str, kind: PublishedType) -> Option<[String; 2]> {
    let (bare, type_name) = (bridge_key(topic), dds_name(kind.name)?);
    Some(
        [kind.hash, "TypeHashNotSupported"]
            .map(|hash| format!("{domain}/{bare}/{type_name}/{hash}")),
    )
}

/// The key of a topic that a bridge carries.
pub fn bridge_key(topic: &str) -> &str {
    topic.trim_matches('/')
}

/// The key at which the publisher with number `id` in session `zid` is queried for the last message of `key`, by who
/// subscribes late: that of an `AdvancedPublisher` of zenoh-ext.
pub fn history_key(key: &str, zid: &str, id: u32) -> String {
    format!("{key}/@adv/pub/{zid}/{id}/_")
}

/// Number of the only node of a session, in tokens.
const NODE_ID: u32 = 0;

/// The token of this program's node, in the namespace `/`.
pub fn node_token(domain: u32, zid: &str, node: &str) -> String {
    format!("@ros2_lv/{domain}/{zid}/{NODE_ID}/{NODE_ID}/NN/%/%/{node}")
}

/// The token of publisher number `id` of the node; `None` where the type is no name of a type. All publishers are reliable and
/// keep one message; `is_kept`: for who subscribes late (transient local).
pub fn publisher_token(
    (domain, zid, node): (u32, &str, &str),
    id: u32,
    (topic, kind): (&str, PublishedType),
    is_kept: bool,
) -> Option<String> {
    let topic = topic.replace('/', "%");
    let (type_name, hash) = (dds_name(kind.name)?, kind.hash);
    // Values of rmw/types.h.
    let durability = if is_kept { 1 } else { 2 };
    Some(format!(
        "@ros2_lv/{domain}/{zid}/{NODE_ID}/{id}/MP/%/%/{node}/{topic}/{type_name}/{hash}/1:{durability}:1,1:,:,:,,"
    ))
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

/// The end of a topic that a token announces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TopicEnd {
    /// Who publishes messages.
    Publisher,
    /// Who takes them.
    Subscriber,
}

impl TopicEnd {
    const fn letters(self) -> &'static str {
        match self {
            Self::Publisher => "MP",
            Self::Subscriber => "MS",
        }
    }
}

/// Key expressions of all announcements of publishers or of subscribers: in this domain, and of bridges.
pub fn token_patterns(domain: u32, end: TopicEnd) -> [String; 2] {
    let end = end.letters();
    [
        format!("@ros2_lv/{domain}/*/*/*/{end}/**"),
        format!("@/*/@ros2_lv/{end}/**"),
    ]
}

/// The topic that a token's key announces; `None` if it is not of this end.
pub fn parse_token(token: &str, end: TopicEnd) -> Option<DiscoveredTopic> {
    let chunks: Vec<&str> = token.split('/').collect();
    match chunks[..] {
        [
            "@ros2_lv",
            _domain,
            _session,
            _node_id,
            _id,
            kind,
            _enclave,
            _namespace,
            _node,
            topic,
            type_name,
            _hash,
            _qos,
        ] if kind == end.letters() => Some(DiscoveredTopic {
            stream: Stream {
                name: absolute_name(&topic.replace('%', "/"))?,
                type_name: ros_name(type_name)?,
            },
            key: None,
        }),
        ["@", _session, "@ros2_lv", kind, key, type_name, ..] if kind == end.letters() => {
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
            parse_token(rmw, TopicEnd::Publisher),
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
            parse_token(bridge, TopicEnd::Publisher),
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
    fn a_publisher_is_announced_as_it_is_read() {
        let of = (7, "aa01", "foreshore");
        let map = ("/bot/map", PublishedType::OCCUPANCY_GRID);
        let hash = PublishedType::OCCUPANCY_GRID.hash;
        assert_eq!(
            node_token(7, "aa01", "foreshore"),
            "@ros2_lv/7/aa01/0/0/NN/%/%/foreshore"
        );
        let token = publisher_token(of, 3, map, true).unwrap();
        assert_eq!(
            token,
            format!(
                "@ros2_lv/7/aa01/0/3/MP/%/%/foreshore/%bot%map/nav_msgs::msg::dds_::OccupancyGrid_/{hash}/1:1:1,1:,:,:,,"
            )
        );
        let announced = parse_token(&token, TopicEnd::Publisher).unwrap().stream;
        assert_eq!(announced.name, "/bot/map");
        let [key, _humble] = rmw_keys(7, map.0, map.1).unwrap();
        assert_eq!(rmw_stream(7, &key), Some(announced));
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
            assert_eq!(parse_token(token, TopicEnd::Publisher), None, "{token}");
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_survived(text in "(@ros2_lv|@|[0-9a-z§%:_]*|/|MP|\\PC)*") {
            for end in [TopicEnd::Publisher, TopicEnd::Subscriber] {
                parse_token(&text, end);
            }
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
