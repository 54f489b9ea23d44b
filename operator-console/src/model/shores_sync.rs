//! The robot's shores and when to request them.
//!
//! Shores are pushed when they change. A push may be lost or sent before this console joined, so the console also polls
//! with the revision that it holds. The reply is a few bytes if nothing is newer.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{Shores, ShoresReply, ShoresRequest};

use super::messages::{RejectReason, RequestId};
use super::retry::RetryTimer;
use super::shore_outlines::ShoreOutlines;

/// Time from a reply to the next request.
const PERIOD: Duration = Duration::from_secs(2);
/// A later reply is still taken, but a new request is sent.
const PATIENCE: Duration = Duration::from_secs(4);

#[derive(Clone, Debug, Default)]
pub(super) struct ShoresSync {
    revision: u64,
    pub(super) shores: Option<Shores>,
    pub(super) outlines: ShoreOutlines,
    epoch: Option<u32>,
    /// Sequence number of the newest message about shores.
    last_seq: Option<u64>,
    pub(super) query: RetryTimer,
}

impl ShoresSync {
    /// Whether the shores are known; if the robot's data ended with message `ended_seq`, from after it.
    pub(super) fn is_current(&self, ended_seq: Option<u64>) -> bool {
        self.last_seq
            .is_some_and(|seq| ended_seq.is_none_or(|ended_seq| seq > ended_seq))
    }

    pub(super) fn forget(&mut self) {
        self.restart(0, None);
    }

    /// Sets the epoch of the maps and returns whether it is new. Then the shores of the old maps are void.
    pub(super) fn of_epoch(&mut self, epoch: u32) -> bool {
        let before = self.epoch;
        self.epoch = before.max(Some(epoch));
        let is_new = before.is_some_and(|before| epoch > before);
        if is_new {
            // The shores held may belong to the new maps already, so they are requested again.
            self.restart(self.revision.saturating_sub(1), self.epoch);
        }
        is_new
    }

    fn restart(&mut self, revision: u64, epoch: Option<u32>) {
        *self = Self {
            revision,
            epoch,
            ..Self::default()
        };
    }

    pub(super) fn query(
        &mut self,
        now: Monotonic,
        number: impl FnOnce() -> RequestId,
    ) -> Option<(RequestId, ShoresRequest)> {
        let request = self.query.request(PATIENCE, now, number)?;
        let newer_than = self.revision;
        Some((request, ShoresRequest { newer_than }))
    }

    /// Takes shores from message `seq`, pushed or in reply; returns whether they are newer.
    pub(super) fn take(
        &mut self,
        news: ShoresReply,
        seq: u64,
        request: Option<RequestId>,
        now: Monotonic,
    ) -> Result<bool, RejectReason> {
        let ShoresReply { revision, shores } = news;
        if shores.as_ref().is_some_and(|shores| !shores.is_valid()) {
            return Err(RejectReason::Malformed);
        }
        if request.is_some_and(|request| self.query.is_answered(request)) {
            self.query.backoff.succeed();
            self.query.backoff.not_before = now + PERIOD;
        }
        if revision < self.revision {
            return Err(RejectReason::OldRevision);
        }
        let is_newer = revision > self.revision;
        if is_newer && shores.is_none() {
            // A reply to a request with another revision.
            return Ok(false);
        }
        self.last_seq = self.last_seq.max(Some(seq));
        if is_newer {
            self.revision = revision;
            self.outlines = shores.as_ref().map(ShoreOutlines::of).unwrap_or_default();
            self.shores = shores;
        }
        Ok(is_newer)
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::{DockingSite, ShoreClass, ShoreCluster};

    use super::super::shore_outlines::Outline;
    use super::*;
    use crate::test_support::{at, docking_site, shore};

    fn news(revision: u64, cell_m: f64) -> ShoresReply {
        ShoresReply {
            revision,
            shores: Some(Shores {
                cell_m,
                ..Shores::default()
            }),
        }
    }

    fn nothing(revision: u64) -> ShoresReply {
        ShoresReply {
            revision,
            shores: None,
        }
    }

    /// Time and revision of the next request, polled every 100 ms.
    fn next(sync: &mut ShoresSync, from_ms: u64, request: u64) -> (u64, u64) {
        (from_ms..from_ms + 60_000)
            .step_by(100)
            .find_map(|ms| {
                let (_, query) = sync.query(at(ms), || RequestId(request))?;
                Some((ms, query.newer_than))
            })
            .unwrap()
    }

    #[test]
    fn polls_at_once_and_then_with_held_revision() {
        let mut sync = ShoresSync::default();
        assert_eq!(next(&mut sync, 1_000, 1), (1_000, 0));
        assert!(!sync.is_current(None));
        assert_eq!(
            sync.take(news(4, 0.3), 9, Some(RequestId(1)), at(1_100)),
            Ok(true)
        );
        assert!(!sync.query.ended(RequestId(1), at(1_100)));
        assert!(sync.is_current(None) && sync.is_current(Some(8)) && !sync.is_current(Some(9)));
        assert_eq!(next(&mut sync, 1_200, 2), (3_100, 4));
        assert_eq!(
            sync.take(nothing(4), 12, Some(RequestId(2)), at(3_200)),
            Ok(false)
        );
        assert!(sync.is_current(Some(11)));
        assert_eq!(sync.shores.as_ref().map(|shores| shores.cell_m), Some(0.3));
        // A push changes the revision of the next request, not its time.
        assert_eq!(sync.take(news(5, 0.4), 13, None, at(3_300)), Ok(true));
        assert_eq!(next(&mut sync, 3_400, 3), (5_200, 5));
    }

    #[test]
    fn old_or_invalid_shores_are_rejected() {
        let mut sync = ShoresSync::default();
        assert_eq!(sync.take(news(5, 0.4), 1, None, at(0)), Ok(true));
        assert_eq!(
            sync.take(news(4, 0.3), 2, None, at(0)),
            Err(RejectReason::OldRevision)
        );
        let wrong = news(6, f64::NAN);
        assert_eq!(
            sync.take(wrong, 3, None, at(0)),
            Err(RejectReason::Malformed)
        );
        // A reply to a request from before a push was lost: newer shores exist.
        assert_eq!(sync.take(nothing(6), 4, None, at(0)), Ok(false));
        assert!(!sync.is_current(Some(1)));
        assert_eq!(sync.shores.as_ref().map(|shores| shores.cell_m), Some(0.4));
    }

    /// Docking sites at these x coordinates, metres.
    fn sites(revision: u64, places_m: &[f32]) -> ShoresReply {
        let site = |(number, x_m): (u32, &f32)| DockingSite {
            number,
            width_m: 4.0,
            ..docking_site([*x_m, 0.0])
        };
        let sites = (1..).zip(places_m).map(site).collect();
        ShoresReply {
            revision,
            shores: Some(Shores::gather(0.3, None, Vec::new(), sites)),
        }
    }

    #[test]
    fn outlines_are_computed_once_per_report() {
        /// A bush at this distance from a docking site, metres.
        fn report(revision: u64, away_m: f32) -> ShoresReply {
            let bush = ShoreCluster {
                class: ShoreClass::Solid,
                rigid_voxels: 10,
                ..shore(3, [away_m, 0.0])
            };
            let mut news = sites(revision, &[0.0]);
            news.shores.as_mut().unwrap().clusters = vec![bush];
            news
        }
        /// Address of the outlines, and the distance of the bush, metres.
        fn known(sync: &ShoresSync) -> (*const Outline, f64) {
            let known = &sync.outlines;
            assert_eq!(known.outlines().len(), 1);
            let neighbour = known.neighbours()[0].unwrap();
            (known.outlines().as_ptr(), neighbour.away_m)
        }
        let mut sync = ShoresSync::default();
        assert_eq!(sync.outlines, ShoreOutlines::default());
        assert_eq!(sync.take(report(1, 4.0), 1, None, at(0)), Ok(true));
        let first = known(&sync);
        assert_eq!((first.1, known(&sync)), (4.0, first));
        assert_eq!(sync.take(report(1, 9.0), 2, None, at(0)), Ok(false));
        assert_eq!(sync.take(nothing(1), 3, None, at(0)), Ok(false));
        assert_eq!(known(&sync), first);
        // The new outlines are made while the old ones exist, so the addresses differ.
        assert_eq!(sync.take(report(2, 6.0), 4, None, at(0)), Ok(true));
        let second = known(&sync);
        assert!(second.0 != first.0 && second.1 > 5.9, "{second:?}");
        let old = sync.take(report(1, 4.0), 5, None, at(0));
        assert_eq!(old, Err(RejectReason::OldRevision));
        assert_eq!(known(&sync), second);
        sync.forget();
        assert_eq!(sync.outlines, ShoreOutlines::default());
    }

    #[test]
    fn new_map_epoch_requests_shores_again() {
        let mut sync = ShoresSync::default();
        assert!(!sync.of_epoch(3), "the first epoch");
        assert_eq!(next(&mut sync, 0, 1), (0, 0));
        let request = Some(RequestId(1));
        assert_eq!(
            sync.take(sites(7, &[0.0, 9.0]), 1, request, at(0)),
            Ok(true)
        );
        assert!(!sync.of_epoch(3) && !sync.of_epoch(2));
        assert!(sync.of_epoch(4));
        assert_eq!(sync.shores, None);
        assert!(!sync.is_current(None));
        // The present list may have come before the map head: it is taken once more, but no older one.
        assert_eq!(next(&mut sync, 100, 2), (100, 6));
        let late = sync.take(sites(5, &[9.0]), 2, None, at(100));
        assert_eq!(late, Err(RejectReason::OldRevision));
        let request = Some(RequestId(2));
        assert_eq!(
            sync.take(sites(7, &[9.0, 0.0]), 3, request, at(200)),
            Ok(true)
        );
        assert!(sync.is_current(None) && !sync.of_epoch(4));
    }

    #[test]
    fn unanswered_requests_back_off() {
        let mut sync = ShoresSync::default();
        let mut ms = 0;
        let mut waits = Vec::new();
        for request in 0..7 {
            let (asked, _) = next(&mut sync, ms, request);
            waits.push(asked - ms);
            ms = asked;
            assert!(sync.query.ended(RequestId(request), at(ms)));
        }
        assert_eq!(waits, [0, 500, 1_000, 2_000, 4_000, 8_000, 8_000]);
        sync.query.backoff.not_before = Monotonic::default();
        assert_eq!(next(&mut sync, ms, 9).0, ms);
        // A link failure loses request and end.
        assert_eq!(next(&mut sync, ms, 10).0, ms + 4_000);
    }
}
