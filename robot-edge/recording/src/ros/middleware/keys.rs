//! Keys of topics.

use super::{dds_name, ros_name};
use measurement::Stream;

/// The key expression of every topic of a type in a domain under `rmw_zenoh`, whatever the hash of its definition;
/// `type_name` as in `sensor_msgs/LaserScan`. `None` where it is no name of a type.
pub fn rmw_pattern(domain: u32, type_name: &str) -> Option<String> {
    Some(format!("{domain}/**/{}/*", dds_name(type_name)?))
}

/// The topic and type that a key of `rmw_zenoh` names; `None` where it is none of this domain.
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

/// Where what was said once, and holds, can be asked for: static transforms. There is one for each way in which
/// publishers have kept it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HistoryKeys(Vec<String>);

impl HistoryKeys {
    /// The static transforms of a domain, and of what bridges carry.
    pub fn of_static_transforms(domain: u32) -> Self {
        const TF: &str = "tf2_msgs::msg::dds_::TFMessage_";
        Self(vec![
            // `AdvancedPublisher` of zenoh-ext, in rmw_zenoh since 0.2 and in newer bridges.
            format!("{domain}/**/tf_static/{TF}/*/@adv/**"),
            "**/tf_static/@adv/**".to_owned(),
            // `PublicationCache` before it: the session's id goes before the key.
            format!("*/{domain}/**/tf_static/{TF}/*"),
            "@ros2_pub_cache/*/**/tf_static".to_owned(),
        ])
    }

    /// The key expressions.
    pub fn iter(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(String::as_str)
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
}
