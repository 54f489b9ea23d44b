//! Key expressions, built and parsed only here.
//!
//! All keys of a robot begin with `foreshore/<robot>/`. *Control* and *bulk* name the session that
//! carries a key: small messages must not wait behind tiles.
//! The names of robots and operators are each a single chunk of a key.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::layer::LayerId;

/// First chunk of every key.
pub const PREFIX: &str = "foreshore";

/// Content of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Topic {
    /// Control, queryable: identity and layers of the robot.
    Info,
    /// Control, liveliness token: presence, for discovery.
    Alive,
    /// Control, edge → all: pose of the vehicle.
    Pose,
    /// Control, edge → all: state, counters, sensors.
    Status,
    /// Control, edge → all: how well matched scans determine the pose.
    Localization,
    /// Control, edge → all: path of the planner.
    Plan,
    /// Control, edge → all: an event.
    Event,
    /// Control, edge → all: digests of the whole map.
    MapHead,
    /// Control, queryable: round trip.
    Ping,
    /// Control, console → edge: view of a console. One key per console session.
    View,
    /// Bulk, edge → all: tiles of a layer that changed.
    Changes(LayerId),
    /// Bulk, queryable: tiles of a layer.
    Tiles(LayerId),
    /// Bulk, queryable: [overviews](crate::tile_store::TileStore::overview) of a layer.
    Overviews(LayerId),
    /// Bulk, queryable: revisions and digests of a layer's tiles.
    Digests(LayerId),
    /// Bulk, edge → all, and queryable: shores and docking sites.
    Shores,
    /// Bulk, queryable: files of the octree.
    Voxels,
    /// Bulk, queryable: pose of the vehicle at each mapped scan.
    Trajectory,
    /// Bulk, edge → all: the last sweep of a sensor, for display.
    Scan,
    /// Control, console → edge, signed: a command or request. One key per operator.
    Operator(OperatorTopic),
}

/// Commands and requests of operators; each has a key of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum OperatorTopic {
    /// Put, 50 Hz while the lease is held: velocity.
    Drive,
    /// Queryable, any operator, 10 Hz until acknowledged: emergency stop.
    EStop,
    /// Queryable: reset of an emergency stop.
    Reset,
    /// Queryable: lease.
    Lease,
    /// Queryable: byte budget, collision monitor, recording.
    Set,
}

impl OperatorTopic {
    /// All topics.
    pub const ALL: [Self; 5] = [
        Self::Drive,
        Self::EStop,
        Self::Reset,
        Self::Lease,
        Self::Set,
    ];

    /// Last chunk of its keys.
    const fn chunk(self) -> &'static str {
        match self {
            Self::Drive => "drive",
            Self::EStop => "estop",
            Self::Reset => "reset",
            Self::Lease => "lease",
            Self::Set => "set",
        }
    }

    fn parse(chunk: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.chunk() == chunk)
    }
}

impl Topic {
    /// Key of this topic of `robot`. For [`Topic::View`] and [`Topic::Operator`] it matches all
    /// consoles or operators, for the edge's subscriptions.
    pub fn key(self, robot: &RobotId) -> String {
        let rest = match self {
            Self::Info => "info".to_owned(),
            Self::Alive => "alive".to_owned(),
            Self::Pose => "pose".to_owned(),
            Self::Status => "status".to_owned(),
            Self::Localization => "localization".to_owned(),
            Self::Plan => "plan".to_owned(),
            Self::Event => "event".to_owned(),
            Self::MapHead => "map_head".to_owned(),
            Self::Ping => "ping".to_owned(),
            Self::View => "view/*".to_owned(),
            Self::Changes(layer) => format!("map/{layer}/changes"),
            Self::Tiles(layer) => format!("map/{layer}/tiles"),
            Self::Overviews(layer) => format!("map/{layer}/overviews"),
            Self::Digests(layer) => format!("map/{layer}/digests"),
            Self::Shores => "shores".to_owned(),
            Self::Voxels => "voxels".to_owned(),
            Self::Trajectory => "trajectory".to_owned(),
            Self::Scan => "scan".to_owned(),
            Self::Operator(topic) => format!("op/*/{}", topic.chunk()),
        };
        format!("{PREFIX}/{robot}/{rest}")
    }

    /// Robot and topic of a received key; `None` for other keys.
    pub fn parse(key: &str) -> Option<(RobotId, Self)> {
        let mut chunks = key.strip_prefix(PREFIX)?.strip_prefix('/')?.splitn(5, '/');
        let robot = chunks.next()?.parse().ok()?;
        let topic = match (chunks.next()?, chunks.next(), chunks.next(), chunks.next()) {
            ("info", None, ..) => Self::Info,
            ("alive", None, ..) => Self::Alive,
            ("pose", None, ..) => Self::Pose,
            ("status", None, ..) => Self::Status,
            ("localization", None, ..) => Self::Localization,
            ("plan", None, ..) => Self::Plan,
            ("event", None, ..) => Self::Event,
            ("map_head", None, ..) => Self::MapHead,
            ("ping", None, ..) => Self::Ping,
            ("shores", None, ..) => Self::Shores,
            ("voxels", None, ..) => Self::Voxels,
            ("trajectory", None, ..) => Self::Trajectory,
            ("scan", None, ..) => Self::Scan,
            ("view", Some(_), None, _) => Self::View,
            ("op", Some(operator), Some(topic), None) => {
                drop(operator.parse::<OperatorId>().ok()?);
                Self::Operator(OperatorTopic::parse(topic)?)
            }
            ("map", Some(layer), Some("changes"), None) => Self::Changes(layer.parse().ok()?),
            ("map", Some(layer), Some("tiles"), None) => Self::Tiles(layer.parse().ok()?),
            ("map", Some(layer), Some("overviews"), None) => Self::Overviews(layer.parse().ok()?),
            ("map", Some(layer), Some("digests"), None) => Self::Digests(layer.parse().ok()?),
            _ => return None,
        };
        Some((robot, topic))
    }
}

/// Changed tiles of all layers of `robot`.
pub fn all_changes(robot: &RobotId) -> String {
    format!("{PREFIX}/{robot}/map/*/changes")
}

/// View of one console; `session` identifies it.
pub fn view_of(robot: &RobotId, session: &RobotId) -> String {
    format!("{PREFIX}/{robot}/view/{session}")
}

/// Key of an operator's commands, the only one that a signature is valid for.
pub fn operator_key(robot: &RobotId, operator: &OperatorId, topic: OperatorTopic) -> String {
    format!("{PREFIX}/{robot}/op/{operator}/{}", topic.chunk())
}

/// Robot, operator and topic of a received key; `None` for keys that [`operator_key`] does not
/// make.
pub fn parse_operator_key(key: &str) -> Option<(RobotId, OperatorId, OperatorTopic)> {
    let Some((robot, Topic::Operator(topic))) = Topic::parse(key) else {
        return None;
    };
    let operator = key.rsplit('/').nth(1)?.parse().ok()?;
    Some((robot, operator, topic))
}

/// All keys of `robot`, for access rules.
pub fn all_of_robot(robot: &RobotId) -> String {
    format!("{PREFIX}/{robot}/**")
}

/// Presence of every robot.
pub fn every_robot_alive() -> String {
    format!("{PREFIX}/*/alive")
}

/// Whether a text obeys the rules of names: 1 to [`MAX_NAME_BYTES`] letters, digits, `_` or `-`.
pub fn is_name(text: &str) -> bool {
    text.parse::<Name>().is_ok()
}

/// Limit of a name.
pub const MAX_NAME_BYTES: usize = 64;

/// Name of a robot: 1 to 64 letters, digits, `_` or `-`, so that it is one chunk of a key without
/// wildcards.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RobotId(Name);

/// Name of an operator, by the same rules; a string in messages.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct OperatorId(Name);

/// A name that cannot be part of a key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no name: it must be 1 to {MAX_NAME_BYTES} letters, digits, `_` or `-`")]
pub struct InvalidName(pub String);

impl RobotId {
    /// Bytes in hexadecimal, for console sessions.
    pub fn from_bytes(bytes: [u8; 16]) -> Self {
        Self(Name(format!("{:032x}", u128::from_be_bytes(bytes))))
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0.0
    }
}

impl OperatorId {
    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0.0
    }
}

impl Default for RobotId {
    /// `robot`.
    fn default() -> Self {
        Self(Name("robot".to_owned()))
    }
}

impl FromStr for RobotId {
    type Err = InvalidName;

    fn from_str(name: &str) -> Result<Self, InvalidName> {
        name.parse().map(Self)
    }
}

impl FromStr for OperatorId {
    type Err = InvalidName;

    fn from_str(name: &str) -> Result<Self, InvalidName> {
        name.parse().map(Self)
    }
}

impl fmt::Display for RobotId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl fmt::Display for OperatorId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Rules for all names.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String")]
struct Name(String);

impl FromStr for Name {
    type Err = InvalidName;

    fn from_str(name: &str) -> Result<Self, InvalidName> {
        let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"_-".contains(&byte);
        if (1..=MAX_NAME_BYTES).contains(&name.len()) && name.bytes().all(is_plain) {
            Ok(Self(name.to_owned()))
        } else {
            Err(InvalidName(name.chars().take(80).collect()))
        }
    }
}

impl TryFrom<String> for Name {
    type Error = InvalidName;

    fn try_from(name: String) -> Result<Self, InvalidName> {
        name.parse()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn other_keys_are_none_of_ours() {
        for key in [
            "",
            "foreshore",
            "foreshore/",
            "foreshore/a",
            "other/a/pose",
            "foreshore/a b/pose",
            "foreshore/*/pose",
            "foreshore/a/pose/x",
            "foreshore/a/map",
            "foreshore/a/map/occupancy",
            "foreshore/a/map/occupancy/1",
            "foreshore/a/map/snow/1/2",
            "foreshore/a/map/occupancy/01/2",
            "foreshore/a/map/occupancy/+1/2",
            "foreshore/a/map/occupancy/1/2/3",
            "foreshore/a/map/occupancy/99999999999/2",
            "foreshore/a/view",
            "foreshore/a/shores/1",
            "foreshore/a/scan/laser",
            "foreshore/a/op",
            "foreshore/a/op/drive",
            "foreshore/a/op/anna",
            "foreshore/a/op/anna/",
            "foreshore/a/op/anna/honk",
            "foreshore/a/op/anna/Drive",
            "foreshore/a/op/anna/drive/x",
            "foreshore/a/op//drive",
            "foreshore/a/op/**/drive",
            "foreshore/a/op/an na/drive",
        ] {
            assert_eq!(Topic::parse(key), None, "{key}");
            assert_eq!(parse_operator_key(key), None, "{key}");
        }
        assert!("".parse::<RobotId>().is_err() && "a/b".parse::<RobotId>().is_err());
    }

    proptest! {
        #[test]
        fn no_key_panics(key in "(foreshore/)?[a-z0-9/*+-]{0,40}") {
            drop(Topic::parse(&key));
        }

        #[test]
        fn every_operator_has_one_key_for_each_topic(
            robot in "[A-Za-z0-9_-]{1,64}",
            operator in "[A-Za-z0-9_-]{1,64}",
            topic in prop::sample::select(&OperatorTopic::ALL),
        ) {
            let (robot, operator) = (robot.parse().unwrap(), operator.parse().unwrap());
            let key = operator_key(&robot, &operator, topic);
            prop_assert_eq!(parse_operator_key(&key), Some((robot, operator, topic)));
        }
    }

    #[test]
    fn names_are_single_chunks_of_keys() {
        let longest = "a".repeat(MAX_NAME_BYTES);
        for name in ["a", "scout-1", "A_9-", &longest] {
            assert_eq!(name.parse::<RobotId>().unwrap().as_str(), name);
            assert_eq!(name.parse::<OperatorId>().unwrap().to_string(), name);
        }
        for name in ["", "a/b", "*", "a b", "é", "$x", "a\0", &(longest + "a")] {
            let refused = name.parse::<OperatorId>().unwrap_err();
            assert_eq!(refused, InvalidName(name.to_owned()));
            assert_eq!(name.parse::<RobotId>(), Err(refused));
        }
    }

    #[test]
    fn invalid_names_do_not_decode() {
        let name: OperatorId = "anna".parse().unwrap();
        let bytes = postcard::to_stdvec(&name).unwrap();
        assert_eq!(bytes, b"\x04anna");
        assert_eq!(postcard::from_bytes::<OperatorId>(&bytes), Ok(name));
        assert!(postcard::from_bytes::<OperatorId>(b"\x04an/a").is_err());
        assert!(postcard::from_bytes::<OperatorId>(b"\x00").is_err());
        let long = [&[65][..], &[b'a'; 65]].concat();
        assert!(postcard::from_bytes::<OperatorId>(&long).is_err());
    }
}
