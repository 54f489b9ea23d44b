//! Who drives from this console.

use protocol::keys::OperatorId;
use protocol::signed::SecretKey;
use robot_edge::credentials::{self, Credentials};
use robot_edge::exit::UsageError;
use teleop::Role;

/// Without a name from the command line or the system.
const NOBODY: &str = "console";

/// An operator, and what their commands are signed with.
#[derive(Clone)]
pub struct Identity {
    /// The name that robots know.
    pub operator: OperatorId,
    /// What only the operator has.
    pub key: SecretKey,
    /// What their certificate says they may do; `None` on links without keys.
    pub role: Option<Role>,
}

impl Identity {
    /// For links without keys: what is signed proves nothing.
    pub fn without_keys(operator: OperatorId) -> Self {
        let key = SecretKey::without_secret(&operator);
        Self {
            operator,
            key,
            role: None,
        }
    }

    /// Whose credentials they are; without any, the operator who is named, else the user of this computer as the
    /// environment names them, else `NOBODY`.
    ///
    /// # Errors
    /// Where the credentials are another's than the one who is named, or not a person's, or their key cannot be read.
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
            // They sign nothing; whatever they send is refused.
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

/// The first name that says anything: a variable may be set, and empty.
fn first_of(users: impl IntoIterator<Item = Option<String>>) -> Option<OperatorId> {
    let mut users = users.into_iter().flatten();
    users.find_map(|user| as_operator(&user))
}

/// A user's name as an operator's: what may not stand in one becomes `_`.
fn as_operator(user: &str) -> Option<OperatorId> {
    let chars = user.chars().take(64).map(|char| match char {
        'a'..='z' | 'A'..='Z' | '0'..='9' | '_' | '-' => char,
        _ => '_',
    });
    chars.collect::<String>().parse().ok()
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
        assert_eq!(named.role, None, "nobody has proven one");
    }
}
