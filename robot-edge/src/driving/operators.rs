//! Who may drive, and how the vehicle tells them.

use std::sync::{Arc, Mutex, PoisonError, TryLockError};

use protocol::keys::OperatorId as OperatorName;
use protocol::signed::{PublicKey, SecretKey};

use crate::credentials::OperatorList;
use teleop::{OperatorId, Role};

/// Most operators that are told apart.
pub const MAX_OPERATORS: usize = 64;

/// The list of operators.
///
/// Their numbers live as long as the process: who is taken off the list and put on it again has the same one.
#[derive(Clone, Debug)]
pub struct Operators {
    known: Vec<Operator>,
    is_open: bool,
    pending: PendingOperatorList,
}

/// Where a list is left that is newer than the one in force; the last one counts.
#[derive(Clone, Debug, Default)]
pub struct PendingOperatorList(Arc<Mutex<Option<OperatorList>>>);

impl PendingOperatorList {
    /// Leaves a list for whoever takes it.
    pub fn set(&self, list: OperatorList) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(list);
    }

    /// Takes what was left; whoever is leaving one just now is not waited for.
    pub(crate) fn take(&self) -> Option<OperatorList> {
        match self.0.try_lock() {
            Ok(mut pending) => pending.take(),
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner().take(),
            Err(TryLockError::WouldBlock) => None,
        }
    }
}

/// One operator of the list.
#[derive(Clone, Debug)]
pub struct Operator {
    /// The name in the key of what they send.
    pub name: OperatorName,
    /// What they may do.
    pub role: Role,
    /// What they sign with.
    pub key: PublicKey,
    /// Whether they are on the list now.
    pub is_listed: bool,
}

impl Operators {
    /// Everybody, by whatever name they give, as a supervisor: for a link that only this machine reaches, and for
    /// `--insecure`. What they sign with is [`SecretKey::without_secret`], which proves nothing.
    pub fn open() -> Self {
        Self {
            known: Vec::new(),
            is_open: true,
            pending: PendingOperatorList::default(),
        }
    }

    /// Those of a list who sign, and nobody else.
    pub fn listed(list: &OperatorList) -> Self {
        Self {
            known: signers(list).take(MAX_OPERATORS).collect(),
            is_open: false,
            pending: PendingOperatorList::default(),
        }
    }

    /// Where a newer list is left for these.
    pub fn pending(&self) -> PendingOperatorList {
        self.pending.clone()
    }

    /// Takes the newer list, if there is one: who may no more do what they could, or is told by another key.
    pub(super) fn take_pending(&mut self) -> Option<Vec<OperatorId>> {
        let list = self.pending.take()?;
        let mut revoked = Vec::new();
        for (at, known) in self.known.iter_mut().enumerate() {
            let listed = signers(&list).find(|listed| listed.name == known.name);
            let is_same = listed.as_ref().is_some_and(|listed| {
                listed.key == known.key && (listed.role.may_drive() || !known.role.may_drive())
            });
            if known.is_listed && !is_same {
                revoked.push(OperatorId(at as u32));
            }
            match listed {
                Some(listed) => *known = listed,
                None => known.is_listed = false,
            }
        }
        for listed in signers(&list) {
            if self.known.iter().any(|known| known.name == listed.name) {
                continue;
            }
            if self.known.len() < MAX_OPERATORS {
                self.known.push(listed);
            } else {
                tracing::error!(
                    name = %listed.name,
                    "not more than {MAX_OPERATORS} operators are told apart in one run: start the vehicle again"
                );
            }
        }
        Some(revoked)
    }

    /// Who goes by that name.
    pub fn find(&mut self, name: &OperatorName) -> Option<(OperatorId, &Operator)> {
        let known = self
            .known
            .iter()
            .position(|operator| operator.name == *name);
        let at = known.or_else(|| self.welcome(name))?;
        let operator = self.known.get(at)?;
        operator
            .is_listed
            .then_some((OperatorId(at as u32), operator))
    }

    /// The place of somebody new, where everybody may come.
    fn welcome(&mut self, name: &OperatorName) -> Option<usize> {
        if !self.is_open || self.known.len() >= MAX_OPERATORS {
            return None;
        }
        self.known.push(Operator {
            name: name.clone(),
            role: Role::Supervisor,
            key: SecretKey::without_secret(name).public(),
            is_listed: true,
        });
        Some(self.known.len() - 1)
    }

    /// The names, by number.
    pub fn names(&self) -> impl Iterator<Item = &OperatorName> {
        self.known.iter().map(|operator| &operator.name)
    }
}

/// Everybody on a list who has a key to sign with.
fn signers(list: &OperatorList) -> impl Iterator<Item = Operator> {
    list.people().iter().filter_map(|listed| {
        Some(Operator {
            name: listed.name.clone(),
            role: listed.role,
            key: listed.key?,
            is_listed: true,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(name: &str) -> OperatorName {
        name.parse().unwrap()
    }

    #[test]
    fn an_open_list_knows_everybody_up_to_its_limit() {
        let mut open = Operators::open();
        for n in 0..MAX_OPERATORS {
            let (id, operator) = open.find(&name(&format!("o{n}"))).unwrap();
            assert_eq!((id.0 as usize, operator.role), (n, Role::Supervisor));
        }
        assert!(open.find(&name("one-too-many")).is_none());
        assert_eq!(open.find(&name("o7")).unwrap().0, OperatorId(7));
    }

    /// A list of names, roles and seeds of keys.
    fn list(people: &[(&str, &str, u8)]) -> OperatorList {
        let entry = |(name, role, seed): &(&str, &str, u8)| {
            let key = SecretKey::from_seed(&[*seed; 32])
                .public()
                .to_pem()
                .unwrap();
            format!("[[person]]\nname = \"{name}\"\nrole = \"{role}\"\nkey = \"\"\"\n{key}\"\"\"\n")
        };
        let text = "version = 1\n".to_owned() + &people.iter().map(entry).collect::<String>();
        OperatorList::parse(&text).unwrap()
    }

    #[test]
    fn a_list_knows_nobody_else() {
        let mut listed = Operators::listed(&list(&[("anna", "operator", 7)]));
        assert_eq!(listed.find(&name("anna")).unwrap().1.role, Role::Operator);
        assert!(listed.find(&name("mallory")).is_none());
    }

    #[test]
    fn a_newer_list_revokes_who_is_off_it_and_numbers_stay() {
        let people = [
            ("anna", "operator", 1),
            ("bert", "operator", 2),
            ("cleo", "operator", 3),
            ("dora", "supervisor", 4),
        ];
        let mut operators = Operators::listed(&list(&people));
        assert_eq!(operators.take_pending(), None);
        let pending = operators.pending();
        pending.set(list(&[]));
        // Bert's key is another, Cleo only watches, Dora may less but may drive, Emil is new.
        pending.set(list(&[
            ("emil", "operator", 5),
            ("dora", "operator", 4),
            ("bert", "operator", 9),
            ("cleo", "observer", 3),
        ]));
        let revoked = [0, 1, 2].map(OperatorId).to_vec();
        assert_eq!(operators.take_pending(), Some(revoked));
        assert!(operators.find(&name("anna")).is_none());
        for (who, number, role, seed) in [
            ("bert", 1, Role::Operator, 9),
            ("cleo", 2, Role::Observer, 3),
            ("dora", 3, Role::Operator, 4),
            ("emil", 4, Role::Operator, 5),
        ] {
            let (id, operator) = operators.find(&name(who)).unwrap();
            let key = SecretKey::from_seed(&[seed; 32]).public();
            assert_eq!((id.0, operator.role, operator.key), (number, role, key));
        }
        pending.set(list(&people[..1]));
        let revoked = [1, 2, 3, 4].map(OperatorId).to_vec();
        assert_eq!(operators.take_pending(), Some(revoked));
        assert_eq!(operators.find(&name("anna")).unwrap().0, OperatorId(0));
        pending.set(list(&people[..1]));
        assert_eq!(operators.take_pending(), Some(Vec::new()));
    }
}
