//! Operator of this console, and the rights of its role as far as the console knows it.

use edge::exit::UsageError;
use network::credentials::{self, Credentials};
use protocol::keys::OperatorId;
use protocol::signed::SecretKey;
use teleop::Role;

const NOBODY: &str = "console";

#[derive(Clone)]
pub struct Identity {
    pub operator: OperatorId,
    pub key: SecretKey,
    /// From the certificate; `None` on links without keys.
    pub role: Option<Role>,
}

impl Identity {
    /// For links without keys, where signatures prove nothing.
    pub fn without_keys(operator: OperatorId) -> Self {
        let key = SecretKey::without_secret(&operator);
        Self {
            operator,
            key,
            role: None,
        }
    }

    /// By credentials; else the named operator, else the user of this computer, else `NOBODY`.
    pub fn of(
        named: Option<OperatorId>,
        credentials: Option<&Credentials>,
    ) -> anyhow::Result<Self> {
        if let Some(credentials) = credentials {
            return Self::proven(named, credentials);
        }
        if let Some(operator) = named {
            return Ok(Self::without_keys(operator));
        }
        let users = ["USER", "LOGNAME", "USERNAME"].map(|name| std::env::var(name).ok());
        let operator = first_of(users).map_or_else(|| NOBODY.parse(), Ok)?;
        Ok(Self::without_keys(operator))
    }

    fn proven(named: Option<OperatorId>, credentials: &Credentials) -> anyhow::Result<Self> {
        let (name, role) = match credentials.identity() {
            credentials::Identity::Person(name, role) => (name, *role),
            other @ (credentials::Identity::Vehicle(_) | credentials::Identity::Router) => {
                return Err(UsageError(format!(
                    "--keys: these are those of {other}; a console needs those of a person"
                ))
                .into());
            }
        };
        if let Some(named) = named.filter(|named| named != name) {
            return Err(UsageError(format!(
                "--operator {named}: --keys says that you are {name}; leave one of them out"
            ))
            .into());
        }
        match role {
            // Observers sign nothing: robots reject their commands.
            Role::Observer => Ok(Self {
                role: Some(role),
                ..Self::without_keys(name.clone())
            }),
            Role::Operator | Role::Supervisor => Ok(Self {
                operator: name.clone(),
                key: credentials.signing_key()?,
                role: Some(role),
            }),
        }
    }
}

fn first_of(users: impl IntoIterator<Item = Option<String>>) -> Option<OperatorId> {
    let mut users = users.into_iter().flatten();
    users.find_map(|user| as_operator(&user))
}

/// A user name as an operator name: invalid characters become `_`.
fn as_operator(user: &str) -> Option<OperatorId> {
    let chars = user.chars().take(64).map(|char| match char {
        'a'..='z' | 'A'..='Z' | '0'..='9' | '_' | '-' => char,
        _ => '_',
    });
    chars.collect::<String>().parse().ok()
}

pub const OBSERVER_HINT: &str = "Observers neither drive nor stop the vehicle";
pub const OPERATOR_HINT: &str = "Only supervisors take over: request a handover";

/// Whether a role is proven that may neither drive nor stop: the robot would reject its commands. Without a proven role
/// (`None`) this is false, so that the emergency stop stays available.
pub const fn is_observer(role: Option<Role>) -> bool {
    match role {
        Some(role) => !role.may_drive(),
        None => false,
    }
}

/// Whether a role is proven that may not take over the lease. `None` is no proof here either.
pub const fn cannot_take_over(role: Option<Role>) -> bool {
    match role {
        Some(Role::Observer | Role::Operator) => true,
        Some(Role::Supervisor) | None => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn users_are_operators() {
        let check = |user: &str, expected: Option<&str>| {
            assert_eq!(
                as_operator(user),
                expected.map(|name| name.parse().unwrap())
            );
        };
        check("anna", Some("anna"));
        check("anna.b@host", Some("anna_b_host"));
        check("", None);
        check(&"x".repeat(90), Some(&"x".repeat(64)));
        let users = [None, Some(String::new()), Some("anna".to_owned())];
        assert_eq!(first_of(users), Some("anna".parse().unwrap()));
        assert_eq!(first_of([None, Some(String::new())]), None);
        let named = Identity::of(Some("berta".parse().unwrap()), None).unwrap();
        assert_eq!(named.operator.as_str(), "berta");
        assert_eq!(named.role, None, "no certificate");
    }

    #[test]
    fn only_proven_roles_lose_rights() {
        for (role, observes, cannot_take) in [
            (None, false, false),
            (Some(Role::Operator), false, true),
            (Some(Role::Supervisor), false, false),
            (Some(Role::Observer), true, true),
        ] {
            assert_eq!(is_observer(role), observes, "{role:?}");
            assert_eq!(cannot_take_over(role), cannot_take, "{role:?}");
        }
    }
}
