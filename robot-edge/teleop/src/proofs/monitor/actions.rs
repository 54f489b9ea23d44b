//! What the arbiter wants done, held against what it may want.

use super::{Monitor, Violation, bit, ensure};
use crate::action::{Action, Actions, ArbiterEvent};
use crate::config::Rules;
use crate::lease::EStopId;
use crate::motion::Velocity;
use measurement::time::Monotonic;
use protocol::message::{Answer, LeaseEnd};

impl Monitor {
    pub(super) fn observe_actions(
        &mut self,
        rules: &Rules,
        now: Monotonic,
        actions: &Actions,
    ) -> Result<(), Violation> {
        for action in actions.iter() {
            match action {
                Action::Notify(ArbiterEvent::LeaseEnded { operator, why }) => {
                    ensure(
                        self.holder == Some(operator),
                        "P2: a lease ends that nobody has",
                    )?;
                    let is_due = now.since(self.renewed) > rules.lease;
                    ensure(
                        is_due || why != LeaseEnd::Expired,
                        "P12: a lease expires too early",
                    )?;
                    self.holder = None;
                    self.forget_commands();
                }
                Action::Notify(ArbiterEvent::LeaseGranted { to, epoch, .. }) => {
                    ensure(self.holder.is_none(), "P2: a second holder")?;
                    ensure(epoch > self.epoch, "P3: the epoch does not grow")?;
                    ensure(
                        self.requested_at & bit(to) != 0,
                        "P2: a lease for who did not ask",
                    )?;
                    ensure(
                        actions.output == Velocity::ZERO,
                        "P2: the lease changes hands on a moving vehicle",
                    )?;
                    (self.holder, self.epoch) = (Some(to), epoch);
                    self.renewed = now;
                    self.requested_at &= !bit(to);
                    self.forget_commands();
                }
                Action::AcknowledgeEStop(EStopId(id))
                | Action::Answer {
                    answer: Answer::EStopped(id),
                    ..
                } => {
                    let is_stored = self
                        .estop
                        .is_some_and(|estop| estop.is_stored && estop.id.0 == id);
                    ensure(
                        is_stored,
                        "P5: an emergency stop is acknowledged before it is stored",
                    )?;
                }
                Action::PublishToken(_)
                | Action::Answer { .. }
                | Action::StoreEStop(_)
                | Action::ClearEStop(_)
                | Action::Notify(_) => {}
            }
        }
        Ok(())
    }
}
