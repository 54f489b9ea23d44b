//! Names of robots and operators, each a single chunk of a key.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

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
    use super::*;

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
