//! The lease: at most one operator drives (P2), and only by the newest grant (P3).

use std::time::Duration;

use super::operator::OperatorId;
use measurement::time::Monotonic;

/// Who may drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LeaseHolder {
    /// Who.
    pub operator: OperatorId,
    /// When the lease was granted or last renewed.
    pub renewed: Monotonic,
}

/// Who asked for the lease while somebody else held it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Waiting {
    /// Who.
    pub operator: OperatorId,
    /// When they last asked.
    pub requested_at: Monotonic,
}

/// How somebody came by the lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum GrantReason {
    /// It was free, or theirs already.
    Request,
    /// The holder consented, or gave it back while they waited.
    HandOver,
    /// A supervisor took it.
    TakeOver,
}

/// Why somebody lost the lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LeaseEnd {
    /// They gave it back.
    Released,
    /// No command renewed it.
    Expired,
    /// They asked for it anew, as a console does that was restarted.
    Renewed,
    /// They consented to hand it over.
    HandedOver,
    /// A supervisor took it.
    TakenOver,
    /// They are no longer an operator.
    Revoked,
    /// The emergency stop was reset, after which everybody starts anew.
    Reset,
    /// The vehicle is at fault.
    Fault,
}

/// Who holds the lease, who will and who wants to.
///
/// There is never a holder while somebody is next: the lease of who must make room ends at once, and the next is
/// granted when the vehicle stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct Lease {
    /// Grows with every grant; a command must name it.
    pub epoch: u64,
    /// Who may drive.
    pub holder: Option<LeaseHolder>,
    /// Who gets the lease as soon as the output is zero.
    pub next: Option<(OperatorId, GrantReason)>,
    /// Who waits for the holder's consent.
    pub waiting: Option<Waiting>,
}

impl Lease {
    /// Whether `operator` may drive.
    pub fn is_held_by(&self, operator: OperatorId) -> bool {
        self.holder
            .is_some_and(|holder| holder.operator == operator)
    }

    /// Gives the lease to `operator`.
    pub fn grant(&mut self, operator: OperatorId, now: Monotonic) {
        self.epoch += 1;
        self.holder = Some(LeaseHolder {
            operator,
            renewed: now,
        });
        self.next = None;
        if self
            .waiting
            .is_some_and(|waiting| waiting.operator == operator)
        {
            self.waiting = None;
        }
    }

    /// The holder is heard of.
    pub fn renew(&mut self, now: Monotonic) {
        if let Some(holder) = &mut self.holder {
            holder.renewed = now;
        }
    }

    /// Whether the holder has not been heard of for longer than `lease`.
    pub fn is_expired(&self, now: Monotonic, lease: Duration) -> bool {
        self.holder
            .is_some_and(|holder| now.since(holder.renewed) > lease)
    }

    /// Lets `operator` wait, unless somebody else does; says whether they do.
    pub fn wait(&mut self, operator: OperatorId, now: Monotonic) -> bool {
        let is_free = self
            .waiting
            .is_none_or(|waiting| waiting.operator == operator);
        if is_free {
            self.waiting = Some(Waiting {
                operator,
                requested_at: now,
            });
        }
        is_free
    }

    /// Lets `operator` want it no longer, who waits for it or is next; says whether they were. Whoever waits besides is next
    /// instead.
    pub fn withdraw(&mut self, operator: OperatorId) -> bool {
        let waiting = self.waiting;
        self.waiting = waiting.filter(|waiting| waiting.operator != operator);
        let was_next = self.next.is_some_and(|(next, _)| next == operator);
        if was_next {
            let waiting = self.waiting;
            self.next = waiting.map(|waiting| (waiting.operator, GrantReason::HandOver));
        }
        was_next || self.waiting != waiting
    }

    /// Forgets who has waited for longer than `longest`.
    pub fn expire_request(&mut self, now: Monotonic, longest: Duration) {
        if self
            .waiting
            .is_some_and(|waiting| now.since(waiting.requested_at) > longest)
        {
            self.waiting = None;
        }
    }
}
