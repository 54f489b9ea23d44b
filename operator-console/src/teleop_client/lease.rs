//! Whether this console drives, as far as it can know.
//!
//! The robot decides. An operator's name may be used by two consoles at once, so this one drives only by a grant that it
//! asked for itself, and never by one that it merely hears of.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::OperatorId;
use protocol::message::LeaseStatus;

/// A status may have been on its way when the robot answered; from then on it must say that we wait.
const SETTLED: Duration = Duration::from_secs(1);

/// What this console has of the lease.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lease {
    /// Nothing, and it asked for nothing.
    #[default]
    None,
    /// It asked, and is to get it when the vehicle stands or the holder consents.
    Waiting {
        /// The newest grant at that time; ours will be a newer one.
        after: u64,
        /// Since when.
        since: Monotonic,
    },
    /// It drives, by this grant.
    Held(u64),
}

/// What a status changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LeaseChange {
    /// This console drives from now on.
    Gained(u64),
    /// It drives no more, or waits in vain.
    Lost,
}

impl Lease {
    /// The grant by which this console drives.
    pub const fn held(self) -> Option<u64> {
        match self {
            Self::Held(epoch) => Some(epoch),
            Self::None | Self::Waiting { .. } => None,
        }
    }

    /// Compares with what the robot says.
    pub(super) fn receive(
        &mut self,
        status: &LeaseStatus,
        me: &OperatorId,
        now: Monotonic,
    ) -> Option<LeaseChange> {
        let is_me = |who: &Option<OperatorId>| who.as_ref() == Some(me);
        match *self {
            Self::None => None,
            Self::Waiting { after, since } => {
                if is_me(&status.holder) && status.epoch > after {
                    *self = Self::Held(status.epoch);
                    return Some(LeaseChange::Gained(status.epoch));
                }
                let waits = is_me(&status.next) || is_me(&status.waiting);
                if waits || now.since(since) < SETTLED {
                    return None;
                }
                *self = Self::None;
                Some(LeaseChange::Lost)
            }
            Self::Held(epoch) => {
                let is_over =
                    status.epoch > epoch || (status.epoch == epoch && !is_me(&status.holder));
                if !is_over {
                    return None;
                }
                *self = Self::None;
                Some(LeaseChange::Lost)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::at;

    fn name(name: &str) -> OperatorId {
        name.parse().unwrap()
    }

    fn status(epoch: u64, holder: &str) -> LeaseStatus {
        LeaseStatus {
            epoch,
            holder: Some(name(holder)),
            ..LeaseStatus::default()
        }
    }

    fn after(lease: Lease, status: &LeaseStatus, ms: u64) -> (Lease, Option<LeaseChange>) {
        let mut lease = lease;
        let change = lease.receive(status, &name("anna"), at(ms));
        (lease, change)
    }

    #[test]
    fn it_ends_when_the_robot_says_so_and_not_by_a_status_from_before() {
        let held = Lease::Held(4);
        assert_eq!(after(held, &status(4, "anna"), 0), (held, None));
        assert_eq!(after(held, &status(3, "bert"), 0), (held, None));
        let lost = (Lease::None, Some(LeaseChange::Lost));
        assert_eq!(
            after(held, &status(5, "anna"), 0),
            lost,
            "another console's"
        );
        assert_eq!(after(held, &status(5, "bert"), 0), lost);
        let released = LeaseStatus {
            epoch: 4,
            ..LeaseStatus::default()
        };
        assert_eq!(after(held, &released, 0), lost);
    }

    #[test]
    fn who_waits_gets_it_by_a_newer_grant_or_waits_in_vain() {
        let waiting = Lease::Waiting {
            after: 4,
            since: at(0),
        };
        assert_eq!(after(waiting, &status(4, "anna"), 0), (waiting, None));
        let gained = (Lease::Held(5), Some(LeaseChange::Gained(5)));
        assert_eq!(after(waiting, &status(5, "anna"), 0), gained);
        let mut asked = status(4, "bert");
        assert_eq!(after(waiting, &asked, 999), (waiting, None), "not told yet");
        assert_eq!(
            after(waiting, &asked, 1000),
            (Lease::None, Some(LeaseChange::Lost))
        );
        asked.waiting = Some(name("anna"));
        assert_eq!(after(waiting, &asked, 60_000), (waiting, None));
    }

    #[test]
    fn a_grant_to_this_name_that_was_not_asked_for_is_another_consoles() {
        assert_eq!(
            after(Lease::None, &status(9, "anna"), 0),
            (Lease::None, None)
        );
    }
}
