//! Lease state of this console.
//!
//! The robot decides. Two consoles may use one operator's name at once, so this console drives only with a grant that
//! it requested itself.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::OperatorId;
use protocol::message::LeaseStatus;

/// A status may have been sent before the robot's answer; from then on it must show that this console waits.
const SETTLED: Duration = Duration::from_secs(1);

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lease {
    #[default]
    None,
    /// Requested; granted when the vehicle stands still or the holder consents.
    Waiting {
        /// The newest grant at the request; this console's will be newer.
        after: u64,
        since: Monotonic,
    },
    Held(u64),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LeaseChange {
    Gained(u64),
    Lost,
}

impl Lease {
    pub const fn held(self) -> Option<u64> {
        match self {
            Self::Held(epoch) => Some(epoch),
            Self::None | Self::Waiting { .. } => None,
        }
    }

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
    fn lease_ends_by_new_status_only() {
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
    fn waiting_ends_by_newer_grant_or_timeout() {
        let waiting = Lease::Waiting {
            after: 4,
            since: at(0),
        };
        assert_eq!(after(waiting, &status(4, "anna"), 0), (waiting, None));
        let gained = (Lease::Held(5), Some(LeaseChange::Gained(5)));
        assert_eq!(after(waiting, &status(5, "anna"), 0), gained);
        let mut asked = status(4, "bert");
        assert_eq!(
            after(waiting, &asked, 999),
            (waiting, None),
            "status may be older"
        );
        assert_eq!(
            after(waiting, &asked, 1000),
            (Lease::None, Some(LeaseChange::Lost))
        );
        asked.waiting = Some(name("anna"));
        assert_eq!(after(waiting, &asked, 60_000), (waiting, None));
    }

    #[test]
    fn unrequested_grant_belongs_to_another_console() {
        assert_eq!(
            after(Lease::None, &status(9, "anna"), 0),
            (Lease::None, None)
        );
    }
}
