//! What the keys of a person let them do, as far as a console knows it.

use robot_edge::teleop::Role;

/// What is said to who may only watch.
pub const WATCHES: &str = "You watch: observers neither drive nor stop the vehicle";

/// Whether who shows this role is proven to have no right to drive or to stop: nothing that they sign would be obeyed.
/// `None`, where nobody has proven a role, is no such proof: whoever may have the right must be able to press the stop.
pub const fn only_watches(role: Option<Role>) -> bool {
    match role {
        Some(role) => !role.may_drive(),
        None => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_proven_observer_is_kept_from_the_stop() {
        for (role, expected) in [
            (None, false),
            (Some(Role::Operator), false),
            (Some(Role::Supervisor), false),
            (Some(Role::Observer), true),
        ] {
            assert_eq!(only_watches(role), expected, "{role:?}");
        }
    }
}
