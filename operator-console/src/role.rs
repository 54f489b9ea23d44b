//! What the keys of a person let them do, as far as a console knows it.

use teleop::Role;

/// What is said to who may only watch.
pub const OBSERVER_HINT: &str = "Observers neither drive nor stop the vehicle";
/// What is said to who may drive, and not take over.
pub const OPERATOR_HINT: &str = "Only supervisors take over: request a handover";

/// Whether who shows this role is proven to have no right to drive or to stop: nothing that they sign would be obeyed.
/// `None`, where nobody has proven a role, is no such proof: whoever may have the right must be able to press the stop.
pub const fn is_observer(role: Option<Role>) -> bool {
    match role {
        Some(role) => !role.may_drive(),
        None => false,
    }
}

/// Whether who shows this role is proven to have no right to take over. `None` is no such proof here either.
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
    fn only_a_proven_observer_is_kept_from_the_stop() {
        for (role, expected) in [
            (None, false),
            (Some(Role::Operator), false),
            (Some(Role::Supervisor), false),
            (Some(Role::Observer), true),
        ] {
            assert_eq!(is_observer(role), expected, "{role:?}");
        }
    }

    #[test]
    fn only_who_is_proven_to_be_no_supervisor_is_kept_from_taking_over() {
        for (role, expected) in [
            (None, false),
            (Some(Role::Operator), true),
            (Some(Role::Supervisor), false),
            (Some(Role::Observer), true),
        ] {
            assert_eq!(cannot_take_over(role), expected, "{role:?}");
        }
    }
}
