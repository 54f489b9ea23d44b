//! Requests to the robot, one after another: the robot takes none that was overtaken by a later one.

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::LeaseRequest;

use super::messages::{RequestKind, RequestNumber};

/// Requests that wait for their turn at most.
const MAX_WAITING: usize = 8;
/// What is not answered after this long will not be. The link gives up earlier.
pub(super) const LONGEST: Duration = Duration::from_secs(4);

/// The request that is on its way, and those after it.
#[derive(Clone, Debug, Default)]
pub(super) struct Requests {
    waiting: VecDeque<RequestKind>,
    asked: Option<(RequestNumber, RequestKind, Monotonic)>,
}

impl Requests {
    /// Lets a request wait for its turn; gives it back where too many do.
    pub(super) fn push(&mut self, asked: RequestKind) -> Result<(), RequestKind> {
        if self.waiting.len() >= MAX_WAITING {
            return Err(asked);
        }
        self.waiting.push_back(asked);
        Ok(())
    }

    /// The request whose turn it is.
    pub(super) fn next(&mut self) -> Option<RequestKind> {
        if self.asked.is_some() {
            return None;
        }
        self.waiting.pop_front()
    }

    /// It is on its way.
    pub(super) fn sent(&mut self, request: RequestNumber, asked: RequestKind, now: Monotonic) {
        self.asked = Some((request, asked, now));
    }

    /// The request of this number was answered, or will not be: what it was.
    pub(super) fn take(&mut self, request: RequestNumber) -> Option<RequestKind> {
        let (_, asked, _) = self.asked.take_if(|(number, ..)| *number == request)?;
        Some(asked)
    }

    /// The request that was not answered in time.
    pub(super) fn take_overdue(&mut self, now: Monotonic) -> Option<RequestKind> {
        let (_, asked, _) = self.asked.take_if(|(_, _, at)| now.since(*at) >= LONGEST)?;
        Some(asked)
    }

    /// When something is to be done about them.
    pub(super) fn due(&self, now: Monotonic) -> Option<Monotonic> {
        match &self.asked {
            Some((_, _, at)) => Some(*at + LONGEST),
            None => self.waiting.front().map(|_| now),
        }
    }

    /// Whether something is on its way or waits.
    pub(super) fn is_busy(&self) -> bool {
        self.asked.is_some() || !self.waiting.is_empty()
    }

    /// Whether the lease is asked for, and the answer is not here.
    pub(super) fn asks_for_lease(&self) -> bool {
        self.asked
            .as_ref()
            .is_some_and(|(_, asked, _)| match asked {
                RequestKind::Lease(request) => match request {
                    LeaseRequest::Request | LeaseRequest::TakeOver => true,
                    LeaseRequest::Release | LeaseRequest::HandOver(_) | LeaseRequest::Refuse(_) => {
                        false
                    }
                },
                RequestKind::Reset(_) | RequestKind::Set(_) => false,
            })
    }

    /// Everything is forgotten: the robot that was asked is no more.
    pub(super) fn clear(&mut self) -> impl Iterator<Item = RequestKind> {
        let asked = self.asked.take().map(|(_, asked, _)| asked);
        asked.into_iter().chain(std::mem::take(&mut self.waiting))
    }
}
