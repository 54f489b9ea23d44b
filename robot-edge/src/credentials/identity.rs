//! Who a certificate says somebody is: its common name.

use std::fmt;
use std::str::FromStr;

use protocol::keys::{OperatorId, RobotId};

use teleop::Role;

/// Who somebody is on the network.
///
/// As a common name it is a word, and for all but routers a colon and a name. No public authority signs such a name: it
/// cannot be that of a host. Zenoh trusts public authorities beside our own, so that matters.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Identity {
    /// A robot.
    Vehicle(RobotId),
    /// Somebody who watches or drives.
    Person(OperatorId, Role),
    /// Whatever routes between the others.
    Router,
}

/// A common name that `robot-edge keys` does not give.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("its common name {0:?} is not one that `robot-edge keys` gives")]
pub struct InvalidName(pub String);

impl Identity {
    /// Whether a console may take who says this for a robot, or for the way to one.
    pub const fn serves_consoles(&self) -> bool {
        match self {
            Self::Vehicle(_) | Self::Router => true,
            Self::Person(..) => false,
        }
    }
}

/// A role in lists and common names.
pub(super) const fn role_name(role: Role) -> &'static str {
    match role {
        Role::Observer => "observer",
        Role::Operator => "operator",
        Role::Supervisor => "supervisor",
    }
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Vehicle(robot) => write!(f, "vehicle:{robot}"),
            Self::Person(name, role) => write!(f, "{}:{name}", role_name(*role)),
            Self::Router => f.write_str("router:"),
        }
    }
}

impl FromStr for Identity {
    type Err = InvalidName;

    fn from_str(common_name: &str) -> Result<Self, InvalidName> {
        let strange = || InvalidName(common_name.to_owned());
        let (word, name) = common_name.split_once(':').ok_or_else(strange)?;
        if (word, name) == ("router", "") {
            return Ok(Self::Router);
        }
        if word == "vehicle" {
            let robot = name.parse().map_err(|_no_name| strange())?;
            return Ok(Self::Vehicle(robot));
        }
        let roles = [Role::Observer, Role::Operator, Role::Supervisor];
        let role = roles.into_iter().find(|role| role_name(*role) == word);
        let name = name.parse().map_err(|_no_name| strange())?;
        role.map(|role| Self::Person(name, role))
            .ok_or_else(strange)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_common_name_is_read_as_it_was_written_and_nothing_else_is() {
        let anna: OperatorId = "anna".parse().unwrap();
        for (identity, name) in [
            (
                Identity::Vehicle("scout-1".parse().unwrap()),
                "vehicle:scout-1",
            ),
            (
                Identity::Person(anna.clone(), Role::Operator),
                "operator:anna",
            ),
            (
                Identity::Person(anna.clone(), Role::Supervisor),
                "supervisor:anna",
            ),
            (Identity::Person(anna, Role::Observer), "observer:anna"),
            (Identity::Router, "router:"),
        ] {
            assert_eq!(identity.to_string(), name);
            assert_eq!(name.parse(), Ok(identity));
        }
        for name in [
            "",
            "anna",
            "router",
            "router:x",
            "vehicle:",
            "vehicle:a b",
            "captain:anna",
            "operator:anna/bert",
            "operator:*",
            "boat.example",
        ] {
            assert_eq!(
                name.parse::<Identity>(),
                Err(InvalidName(name.to_owned())),
                "{name}"
            );
        }
    }
}
