//! Rights of an operator's role, as far as the console knows it.

use teleop::Role;

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
    fn only_proven_observers_cannot_stop() {
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
    fn only_proven_non_supervisors_cannot_take_over() {
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
