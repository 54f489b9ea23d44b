//! The list of those who may watch or drive one vehicle.
//!
//! It is beside the vehicle's certificate, is edited by hand, and is read again while the vehicle runs: who is taken
//! off it neither drives nor watches any more, who is put on it does.

use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;
use std::str::FromStr;

use protocol::keys::{OperatorId, RobotId};
use protocol::signed::PublicKey;
use serde::Deserialize;

use crate::credentials::{CredentialsError, files};
use teleop::Role;

pub const MAX_LISTED: usize = 64;
/// The version of the file's format. A file that was cut off before it is no empty list.
const VERSION: u32 = 1;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListedOperator {
    /// The name in the certificate and in the keys of what they send.
    pub name: OperatorId,
    pub role: Role,
    /// What they sign with; observers have none.
    pub key: Option<PublicKey>,
}

/// Those who may watch or drive one vehicle, each name once.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OperatorList {
    people: Vec<ListedOperator>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    version: u32,
    #[serde(default)]
    person: Vec<Entry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: OperatorId,
    role: RoleName,
    key: Option<String>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum RoleName {
    Observer,
    Operator,
    Supervisor,
}

impl From<RoleName> for Role {
    fn from(word: RoleName) -> Self {
        match word {
            RoleName::Observer => Self::Observer,
            RoleName::Operator => Self::Operator,
            RoleName::Supervisor => Self::Supervisor,
        }
    }
}

impl ListedOperator {
    /// Whose certificate is theirs.
    pub fn identity(&self) -> Identity {
        Identity::Person(self.name.clone(), self.role)
    }

    pub(super) fn entry(&self) -> Result<String, CredentialsError> {
        let role = role_name(self.role);
        let key = match self.key.map(|key| key.to_pem()).transpose() {
            Ok(Some(pem)) => format!("key = \"\"\"\n{pem}\"\"\"\n"),
            Ok(None) => String::new(),
            Err(why) => return Err(CredentialsError::Conflict(why.to_string())),
        };
        Ok(format!(
            "\n[[person]]\nname = \"{}\"\nrole = \"{role}\"\n{key}",
            self.name
        ))
    }
}

impl OperatorList {
    pub(super) fn empty_text(robot: &str) -> String {
        format!(
            "# Who may watch or drive {robot}. While the vehicle runs it reads this file again within a second:\n\
             # whoever is taken off it drives no more from then on, and sees nothing of it another second later;\n\
             # whoever is added is let in. All links are closed for a moment then, and a vehicle that is driven stops.\n\
             # A role is one with a certificate: for another role somebody needs new keys. Without this file nobody\n\
             # may drive or watch after 10 s. People are added by `robot-edge keys`, which makes their keys too.\n\
             version = {VERSION}\n"
        )
    }

    /// Reads a list.
    pub fn parse(text: &str) -> Result<Self, String> {
        let file: File = toml::from_str(text).map_err(|why| {
            let at = why.span().map_or(0, |span| span.start);
            let line = text.bytes().take(at).filter(|byte| *byte == b'\n').count() + 1;
            format!("line {line}: {}", why.message())
        })?;
        if file.version != VERSION {
            return Err(format!(
                "version {} of the list is not known to this program, which reads version {VERSION}",
                file.version
            ));
        }
        if file.person.len() > MAX_LISTED {
            return Err(format!(
                "{} people are more than the {MAX_LISTED} that a vehicle tells apart",
                file.person.len()
            ));
        }
        let mut names = BTreeSet::new();
        let mut people = Vec::with_capacity(file.person.len());
        for Entry { name, role, key } in file.person {
            if !names.insert(name.clone()) {
                return Err(format!("{name} is on the list twice"));
            }
            let role = Role::from(role);
            let key = key.map(|pem| PublicKey::from_pem(&pem)).transpose();
            let key = key.map_err(|why| format!("the key of {name}: {why}"))?;
            if role.may_drive() && key.is_none() {
                return Err(format!(
                    "{name} has no key: what an {} sends is signed",
                    role_name(role)
                ));
            }
            people.push(ListedOperator { name, role, key });
        }
        Ok(Self { people })
    }

    /// Reads the list in a file.
    pub fn read(path: &Path) -> Result<Self, CredentialsError> {
        Self::parse(&files::read(path)?).map_err(|why| CredentialsError::content(path, why))
    }

    /// Everybody, in the order of the file.
    pub fn people(&self) -> &[ListedOperator] {
        &self.people
    }

    pub fn find(&self, name: &OperatorId) -> Option<&ListedOperator> {
        self.people.iter().find(|listed| listed.name == *name)
    }
}

/// Who somebody is on the network.
///
/// As a common name it is a word, and for all but routers a colon and a name. No public authority signs such a name: it
/// cannot be that of a host. Zenoh trusts public authorities beside our own, so that matters.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Identity {
    Vehicle(RobotId),
    Person(OperatorId, Role),
    /// Whatever routes between the others.
    Router,
}

/// A common name that `robot-edge keys` does not give.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("its common name {0:?} is not one that `robot-edge keys` gives")]
pub struct InvalidName(pub String);

impl Identity {
    /// Whether a console may accept this identity as a robot, or as the way to one.
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
    use protocol::signed::SecretKey;

    use super::*;

    fn listed(name: &str, role: Role, seed: Option<u8>) -> ListedOperator {
        ListedOperator {
            name: name.parse().unwrap(),
            role,
            key: seed.map(|seed| SecretKey::from_seed(&[seed; 32]).public()),
        }
    }

    fn text(people: &[ListedOperator]) -> String {
        let entries = people.iter().map(|listed| listed.entry().unwrap());
        OperatorList::empty_text("scout") + &entries.collect::<String>()
    }

    #[test]
    fn what_was_written_is_read() {
        let people = [
            listed("anna", Role::Operator, Some(1)),
            listed("sam", Role::Supervisor, Some(2)),
            listed("tv", Role::Observer, None),
        ];
        let list = OperatorList::parse(&text(&people)).unwrap();
        assert_eq!(list.people(), people);
        assert_eq!(list.find(&"sam".parse().unwrap()), Some(&people[1]));
        assert_eq!(list.find(&"mallory".parse().unwrap()), None);
        assert_eq!(
            OperatorList::parse(&text(&[])).unwrap(),
            OperatorList::default()
        );
    }

    #[test]
    fn a_broken_list_is_refused_in_words() {
        let anna = listed("anna", Role::Operator, Some(1));
        let whole = text(std::slice::from_ref(&anna));
        for (broken, says) in [
            (String::new(), "version"),
            ("version = 2".to_owned(), "version 2"),
            (text(&[anna.clone(), anna]), "anna is on the list twice"),
            (
                text(&[listed("bert", Role::Operator, None)]),
                "bert has no key",
            ),
            (whole.replace("operator\"", "captain\""), "captain"),
            (whole.replace("\"anna\"", "\"an na\""), "letters"),
            (whole.replace("PUBLIC", "PRIVATE"), "the key of anna"),
            (whole[..whole.len() - 20].to_owned(), "line"),
            (
                text(
                    &(0..65)
                        .map(|n| listed(&format!("o{n}"), Role::Observer, None))
                        .collect::<Vec<_>>(),
                ),
                "65 people",
            ),
        ] {
            let error = OperatorList::parse(&broken).unwrap_err();
            assert!(error.contains(says), "{says}: {error}");
        }
    }

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
