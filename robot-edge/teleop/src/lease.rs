//! The lease: at most one operator drives (P2), and only by the newest grant (P3).

use std::time::Duration;

use measurement::time::Monotonic;

/// Who may drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LeaseHolder {
    /// Who.
    pub operator: OperatorId,
    /// When the lease was granted or last renewed.
    pub renewed: Monotonic,
}

/// A request for a lease that another operator holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Waiting {
    /// Who.
    pub operator: OperatorId,
    /// When they last asked.
    pub requested_at: Monotonic,
}

/// Why a lease was granted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum GrantReason {
    /// It was free, or already held by the same operator.
    Request,
    /// The holder consented, or released it during the wait.
    HandOver,
    /// A supervisor took it.
    TakeOver,
}

/// The holder, the next holder and the waiting operator.
///
/// There is never a holder together with a next holder: the lease of the holder ends at once, and the next holder gets
/// it at standstill.
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

    /// Renews the lease: the holder sent a command.
    pub fn renew(&mut self, now: Monotonic) {
        if let Some(holder) = &mut self.holder {
            holder.renewed = now;
        }
    }

    /// Whether no command renewed the lease for longer than `lease`.
    pub fn is_expired(&self, now: Monotonic, lease: Duration) -> bool {
        self.holder
            .is_some_and(|holder| now.since(holder.renewed) > lease)
    }

    /// Lets `operator` wait unless another operator waits; returns whether they wait.
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

    /// Removes `operator` as waiting or next; returns whether they were either. The waiting operator becomes next
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

    /// Drops a request older than `longest`.
    pub fn expire_request(&mut self, now: Monotonic, longest: Duration) {
        if self
            .waiting
            .is_some_and(|waiting| now.since(waiting.requested_at) > longest)
        {
            self.waiting = None;
        }
    }
}

/// An operator by its number in the vehicle's list of operator keys; the number lives as long as the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct OperatorId(pub u32);

/// What an operator may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// May only watch.
    Observer,
    /// May drive and stop the vehicle.
    Operator,
    /// May also take over the lease and reset emergency stops.
    Supervisor,
}

impl Role {
    /// Whether it may hold the lease, and stop the vehicle.
    pub const fn may_drive(self) -> bool {
        match self {
            Self::Observer => false,
            Self::Operator | Self::Supervisor => true,
        }
    }
}

/// The caller's handle for the answer to a request; opaque to the arbiter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RequestId(pub u64);

/// The sender of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Caller {
    /// Who.
    pub operator: OperatorId,
    /// What they may do.
    pub role: Role,
    /// Where the answer goes.
    pub request: RequestId,
}

/// Names one emergency stop; a reset must know it. Grows with each, also over restarts that find one stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EStopId(pub u64);

/// Who stopped the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EStopSource {
    /// An operator, over the link.
    Operator(OperatorId),
    /// A person or button at the vehicle.
    Local,
}

/// What the previous run left on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StoredEStop {
    /// None was in force.
    None,
    /// This one was.
    Latched(EStopId),
    /// Unreadable: an emergency stop is assumed.
    Unreadable,
}

/// An emergency stop in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EStop {
    /// Its name.
    pub id: EStopId,
    /// It is stored and survives a restart; only then it is acknowledged and can be reset remotely.
    pub is_stored: bool,
    /// Time of the last request for it. A reset must carry a younger token.
    pub last_requested: Monotonic,
    /// When storing was last requested.
    pub store_requested: Monotonic,
}
