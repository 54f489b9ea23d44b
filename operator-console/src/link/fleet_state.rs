//! How a robot is by its own word, in one of a few: for the list of robots, and for alerts of those that are not shown.

use protocol::keys::OperatorId;
use protocol::message::{Status, TeleopState};

/// How a robot is, by its own word.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FleetState {
    /// It cannot be driven: a recording, or a robot without motors.
    NotDrivable,
    /// Its data has ended: there is nothing more to drive.
    Ended,
    /// Nobody drives it.
    Free,
    /// This operator does.
    DrivenBy(OperatorId),
    /// An emergency stop is active.
    EStop {
        /// Its data has ended, too.
        has_ended: bool,
    },
    /// It does not trust itself.
    Fault {
        /// Its data has ended, too.
        has_ended: bool,
    },
}

impl FleetState {
    /// What a status says.
    pub fn of(status: &Status) -> Self {
        let Some(teleop) = &status.teleop else {
            return if status.has_ended {
                Self::Ended
            } else {
                Self::NotDrivable
            };
        };
        let has_ended = status.has_ended;
        match (&teleop.state, teleop.estop, &teleop.lease.holder) {
            (TeleopState::Fault(_), ..) => Self::Fault { has_ended },
            (_, Some(_), _) => Self::EStop { has_ended },
            (_, None, _) if has_ended => Self::Ended,
            (_, None, Some(holder)) => Self::DrivenBy(holder.clone()),
            (_, None, None) => Self::Free,
        }
    }

    /// Whether it said that its data has ended: that it is not heard any more is no news then.
    pub const fn has_ended(&self) -> bool {
        match self {
            Self::Ended => true,
            Self::EStop { has_ended } | Self::Fault { has_ended } => *has_ended,
            Self::NotDrivable | Self::Free | Self::DrivenBy(_) => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::{EStopStatus, FaultReason, TeleopStatus};

    use super::*;
    use crate::test_support::idle_teleop_status;

    #[test]
    fn what_matters_most_is_said() {
        let state = |teleop: &TeleopStatus| {
            FleetState::of(&Status {
                teleop: Some(teleop.clone()),
                ..Status::default()
            })
        };
        let mut teleop = idle_teleop_status();
        let anna: OperatorId = "anna".parse().unwrap();
        teleop.lease.holder = Some(anna.clone());
        assert_eq!(state(&teleop), FleetState::DrivenBy(anna));
        teleop.estop = Some(EStopStatus {
            number: 3,
            is_stored: true,
        });
        let has_ended = false;
        assert_eq!(state(&teleop), FleetState::EStop { has_ended });
        teleop.state = TeleopState::Fault(FaultReason::Actuator);
        assert_eq!(state(&teleop), FleetState::Fault { has_ended });
    }

    #[test]
    fn a_robot_whose_data_has_ended_is_not_free() {
        let state = |teleop, has_ended| {
            FleetState::of(&Status {
                teleop,
                has_ended,
                ..Status::default()
            })
        };
        let mut teleop = idle_teleop_status();
        assert_eq!(state(Some(teleop.clone()), false), FleetState::Free);
        assert_eq!(state(Some(teleop.clone()), true), FleetState::Ended);
        assert_eq!(state(None, true), FleetState::Ended);
        assert_eq!(state(None, false), FleetState::NotDrivable);
        teleop.state = TeleopState::Fault(FaultReason::Actuator);
        let fault = FleetState::Fault { has_ended: true };
        assert_eq!(
            state(Some(teleop.clone()), true),
            fault,
            "that matters more"
        );
        teleop.state = TeleopState::EStop;
        teleop.estop = Some(EStopStatus {
            number: 3,
            is_stored: true,
        });
        // Whoever stops a vehicle and closes it then hears of both.
        for has_ended in [false, true] {
            let stopped = state(Some(teleop.clone()), has_ended);
            assert_eq!(stopped, FleetState::EStop { has_ended });
            assert_eq!(stopped.has_ended(), has_ended);
        }
        assert!(FleetState::Ended.has_ended() && !FleetState::Free.has_ended());
    }
}
