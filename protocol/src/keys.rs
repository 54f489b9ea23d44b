//! Every key expression, built and parsed here and nowhere else.
//!
//! All keys of one robot begin with `foreshore/<robot>/`. *Control* and *bulk* name the session that carries
//! a key: small messages must not wait behind tiles.

use std::fmt;
use std::str::FromStr;

use crate::layer::LayerId;
use crate::tile::TileKey;

/// First chunk of every key.
pub const PREFIX: &str = "foreshore";

/// Name of a robot: 1 to 64 letters, digits, `_` or `-`, so that it is one chunk of a key and matches
/// nothing but itself.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RobotId(String);

/// A name that cannot be part of a key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no robot name: it must be 1 to 64 letters, digits, `_` or `-`")]
pub struct InvalidName(pub String);

impl RobotId {
    /// A name made of bytes, in hexadecimal: what a console session calls itself.
    pub fn from_bytes(bytes: [u8; 16]) -> Self {
        Self(format!("{:032x}", u128::from_be_bytes(bytes)))
    }
}

impl Default for RobotId {
    /// `robot`.
    fn default() -> Self {
        Self("robot".to_owned())
    }
}

impl FromStr for RobotId {
    type Err = InvalidName;

    fn from_str(name: &str) -> Result<Self, InvalidName> {
        let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"_-".contains(&byte);
        if (1..=64).contains(&name.len()) && name.bytes().all(is_plain) {
            Ok(Self(name.to_owned()))
        } else {
            Err(InvalidName(name.chars().take(80).collect()))
        }
    }
}

impl fmt::Display for RobotId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// What a key carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Topic {
    /// Control, queryable: who the robot is and what it maps.
    Info,
    /// Control, liveliness token: presence, for discovery and display.
    Alive,
    /// Control, edge → all: where the vehicle is.
    Pose,
    /// Control, edge → all: state, counters, sensors.
    Status,
    /// Control, edge → all: something happened.
    Event,
    /// Control, edge → all: what the whole map is, in digests.
    MapHead,
    /// Control, queryable: round trip.
    Ping,
    /// Control, console → edge: what a console looks at. One key a console session.
    View,
    /// Bulk, edge → all: one tile.
    Tile(TileKey),
    /// Bulk, queryable: tiles of a layer.
    Tiles(LayerId),
    /// Bulk, queryable: revisions and digests of a layer's tiles.
    Digests(LayerId),
    /// Bulk, edge → all, and queryable: shores and docking sites.
    Shores,
}

impl Topic {
    /// The key of this topic of `robot`. For [`Topic::View`] it matches the views of all consoles.
    pub fn key(self, robot: &RobotId) -> String {
        let rest = match self {
            Self::Info => "info".to_owned(),
            Self::Alive => "alive".to_owned(),
            Self::Pose => "pose".to_owned(),
            Self::Status => "status".to_owned(),
            Self::Event => "event".to_owned(),
            Self::MapHead => "map_head".to_owned(),
            Self::Ping => "ping".to_owned(),
            Self::View => "view/*".to_owned(),
            Self::Tile(TileKey { layer, tx, ty }) => format!("map/{layer}/{tx}/{ty}"),
            Self::Tiles(layer) => format!("map/{layer}/tiles"),
            Self::Digests(layer) => format!("map/{layer}/digests"),
            Self::Shores => "shores".to_owned(),
        };
        format!("{PREFIX}/{robot}/{rest}")
    }

    /// Robot and topic of a key that arrived; `None` for keys that are none of ours.
    pub fn parse(key: &str) -> Option<(RobotId, Self)> {
        let mut chunks = key.strip_prefix(PREFIX)?.strip_prefix('/')?.splitn(5, '/');
        let robot = chunks.next()?.parse().ok()?;
        let topic = match (chunks.next()?, chunks.next(), chunks.next(), chunks.next()) {
            ("info", None, ..) => Self::Info,
            ("alive", None, ..) => Self::Alive,
            ("pose", None, ..) => Self::Pose,
            ("status", None, ..) => Self::Status,
            ("event", None, ..) => Self::Event,
            ("map_head", None, ..) => Self::MapHead,
            ("ping", None, ..) => Self::Ping,
            ("shores", None, ..) => Self::Shores,
            ("view", Some(_), None, _) => Self::View,
            ("map", Some(layer), Some("tiles"), None) => Self::Tiles(layer.parse().ok()?),
            ("map", Some(layer), Some("digests"), None) => Self::Digests(layer.parse().ok()?),
            ("map", Some(layer), Some(tx), Some(ty)) => Self::Tile(TileKey {
                layer: layer.parse().ok()?,
                tx: canonical(tx)?,
                ty: canonical(ty)?,
            }),
            _ => return None,
        };
        Some((robot, topic))
    }
}

/// A whole number as it is written in keys: `007` and `+7` would be further keys of the same tile.
fn canonical(text: &str) -> Option<i32> {
    let number: i32 = text.parse().ok()?;
    (number.to_string() == text).then_some(number)
}

/// All tiles of all layers of `robot`.
pub fn all_tiles(robot: &RobotId) -> String {
    format!("{PREFIX}/{robot}/map/*/*/*")
}

/// The view of one console: `session` identifies it while it runs.
pub fn view_of(robot: &RobotId, session: &RobotId) -> String {
    format!("{PREFIX}/{robot}/view/{session}")
}

/// The presence of every robot.
pub fn every_robot_alive() -> String {
    format!("{PREFIX}/*/alive")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn robot() -> RobotId {
        "scout-1".parse().unwrap()
    }

    #[test]
    fn keys_are_those_of_the_specification() {
        let tile = TileKey {
            layer: LayerId::Elevation,
            tx: -3,
            ty: 12,
        };
        for (topic, key) in [
            (Topic::Info, "foreshore/scout-1/info"),
            (Topic::Alive, "foreshore/scout-1/alive"),
            (Topic::Pose, "foreshore/scout-1/pose"),
            (Topic::Status, "foreshore/scout-1/status"),
            (Topic::Event, "foreshore/scout-1/event"),
            (Topic::MapHead, "foreshore/scout-1/map_head"),
            (Topic::Ping, "foreshore/scout-1/ping"),
            (Topic::Shores, "foreshore/scout-1/shores"),
            (Topic::View, "foreshore/scout-1/view/*"),
            (Topic::Tile(tile), "foreshore/scout-1/map/elevation/-3/12"),
            (
                Topic::Tiles(LayerId::Occupancy),
                "foreshore/scout-1/map/occupancy/tiles",
            ),
            (
                Topic::Digests(LayerId::Shore),
                "foreshore/scout-1/map/shore/digests",
            ),
        ] {
            assert_eq!(topic.key(&robot()), key);
            assert_eq!(Topic::parse(key), Some((robot(), topic)), "{key}");
        }
        assert_eq!(all_tiles(&robot()), "foreshore/scout-1/map/*/*/*");
        assert_eq!(
            view_of(&robot(), &"a1".parse().unwrap()),
            "foreshore/scout-1/view/a1"
        );
    }

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
        ] {
            assert_eq!(Topic::parse(key), None, "{key}");
        }
        assert!("".parse::<RobotId>().is_err() && "a/b".parse::<RobotId>().is_err());
    }

    proptest! {
        #[test]
        fn every_tile_has_one_key(tx in any::<i32>(), ty in any::<i32>(), layer in 0usize..6) {
            let topic = Topic::Tile(TileKey { layer: LayerId::ALL[layer], tx, ty });
            prop_assert_eq!(Topic::parse(&topic.key(&robot())), Some((robot(), topic)));
        }

        #[test]
        fn no_key_panics(key in "(foreshore/)?[a-z0-9/*+-]{0,40}") {
            drop(Topic::parse(&key));
        }
    }
}
