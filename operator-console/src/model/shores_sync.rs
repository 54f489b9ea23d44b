//! The robot's shores as this console holds them, and when it asks for them. Pure: the present is a parameter.
//!
//! Shores are pushed when they change. A push may be lost, and one from before this console joined was never
//! heard, so it also asks, again and again, with the revision that it holds: the answer costs a few bytes where that
//! is the present one.
//!
//! Where the robot's maps begin anew, so do the names of docking sites: the coordinates of before may mean other places.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{Shores, ShoresReply, ShoresRequest};

use super::ConsoleModel;
use super::incoming::RequestId;
use super::reject_reason::RejectReason;
use super::retry::RetryTimer;
use super::shore_outlines::ShoreOutlines;
use super::site_names::{SiteName, SiteNames};

/// Between an answer and the next question.
const PERIOD: Duration = Duration::from_secs(2);
/// An answer that takes longer is not waited for, but taken when it comes.
const PATIENCE: Duration = Duration::from_secs(4);

impl ConsoleModel {
    /// Shores and docking sites, where the robot has told of them.
    pub const fn shores(&self) -> Option<&Shores> {
        self.shores.shores()
    }

    /// What the docking sites are called, in the order of [`Self::shores`]: the best first.
    pub fn site_names(&self) -> &[SiteName] {
        self.shores.site_names()
    }

    /// Where the edges of [`Self::shores`] are, and what is near their docking sites: made once for each report.
    pub const fn shore_outlines(&self) -> &ShoreOutlines {
        self.shores.outlines()
    }
}

/// Shores and docking sites of one run of a robot.
#[derive(Clone, Debug, Default)]
pub(super) struct ShoresSync {
    revision: u64,
    shores: Option<Shores>,
    /// What follows from `shores` alone: made when they come, not when they are drawn.
    outlines: ShoreOutlines,
    names: SiteNames,
    /// The names of the docking sites of `shores`, in their order.
    named: Vec<SiteName>,
    /// The epoch of the maps that the shores are part of, once one was heard of.
    epoch: Option<u32>,
    /// Number of the newest message that told of them; `None` before the first.
    last_seq: Option<u64>,
    query: RetryTimer,
}

impl ShoresSync {
    /// The shores, where the robot has said anything of them.
    pub(super) const fn shores(&self) -> Option<&Shores> {
        self.shores.as_ref()
    }

    /// What follows from the shores alone; nothing before there are any.
    pub(super) const fn outlines(&self) -> &ShoreOutlines {
        &self.outlines
    }

    /// What its docking sites are called, in their order.
    pub(super) fn site_names(&self) -> &[SiteName] {
        &self.named
    }

    /// Whether the robot has said what there is; if its data ended with message `ended_seq`, after that.
    pub(super) fn is_current(&self, ended_seq: Option<u64>) -> bool {
        self.last_seq
            .is_some_and(|seq| ended_seq.is_none_or(|ended_seq| seq > ended_seq))
    }

    /// Another run of the robot began.
    pub(super) fn forget(&mut self) {
        self.restart(0, None);
    }

    /// The robot's maps are of this epoch; whether that is a new one. Then what was told of those before is void, as their
    /// tiles are: a recording was wound back, or the data's clock started anew.
    pub(super) fn of_epoch(&mut self, epoch: u32) -> bool {
        let before = self.epoch;
        self.epoch = before.max(Some(epoch));
        let is_new = before.is_some_and(|before| epoch > before);
        if is_new {
            // What is held may be of the new maps already: then this asks for it once more.
            self.restart(self.revision.saturating_sub(1), self.epoch);
        }
        is_new
    }

    fn restart(&mut self, revision: u64, epoch: Option<u32>) {
        let mut names = std::mem::take(&mut self.names);
        names.restart();
        *self = Self {
            revision,
            names,
            epoch,
            ..Self::default()
        };
    }

    /// The names of its docking sites, to be kept while another robot is shown.
    pub(super) fn take_names(&mut self) -> (Option<u32>, SiteNames) {
        (self.epoch, std::mem::take(&mut self.names))
    }

    /// Goes on with names that were kept, where they are of the same maps and no site was named yet; whether it does.
    pub(super) fn restore(&mut self, epoch: Option<u32>, names: &SiteNames) -> bool {
        let is_same = self.epoch.is_some() && self.epoch == epoch && self.shores.is_none();
        if is_same {
            self.names = names.clone();
        }
        is_same
    }

    /// Asks as soon as may be.
    pub(super) fn hurry(&mut self) {
        self.query.wait_until(Monotonic::default());
    }

    /// What to ask now; `number` numbers the question.
    pub(super) fn query(
        &mut self,
        now: Monotonic,
        number: impl FnOnce() -> RequestId,
    ) -> Option<(RequestId, ShoresRequest)> {
        if !self.query.is_due_after(PATIENCE, now) {
            return None;
        }
        let request = number();
        self.query.ask(request, now);
        let newer_than = self.revision;
        Some((request, ShoresRequest { newer_than }))
    }

    /// Shores were pushed, or answered a question, in message `seq`; whether they are others than before.
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
            self.query.succeed();
            self.query.wait_until(now + PERIOD);
        }
        if revision < self.revision {
            return Err(RejectReason::OldRevision);
        }
        let is_newer = revision > self.revision;
        if is_newer && shores.is_none() {
            // It answers a question that was asked with another revision.
            return Ok(false);
        }
        self.last_seq = self.last_seq.max(Some(seq));
        if is_newer {
            self.revision = revision;
            let sites = shores.as_ref().map_or(&[][..], |shores| &shores.sites);
            self.named = self.names.name(sites);
            self.outlines = shores.as_ref().map(ShoreOutlines::of).unwrap_or_default();
            self.shores = shores;
        }
        Ok(is_newer)
    }

    /// No more answers to a question will come; true if it was asked here.
    pub(super) fn ended(&mut self, request: RequestId, now: Monotonic) -> bool {
        self.query.ended(request, now)
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::{DockingSite, ShoreClass, ShoreCluster};

    use super::super::shore_outlines::Outline;
    use super::*;
    use crate::test_support::at;

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

    /// When it asks next, looking every 100 ms, and with which revision.
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
    fn it_asks_at_once_and_then_with_what_it_holds() {
        let mut sync = ShoresSync::default();
        assert_eq!(next(&mut sync, 1_000, 1), (1_000, 0));
        assert!(!sync.is_current(None));
        assert_eq!(
            sync.take(news(4, 0.3), 9, Some(RequestId(1)), at(1_100)),
            Ok(true)
        );
        assert!(!sync.ended(RequestId(1), at(1_100)));
        assert!(sync.is_current(None) && sync.is_current(Some(8)) && !sync.is_current(Some(9)));
        assert_eq!(next(&mut sync, 1_200, 2), (3_100, 4));
        assert_eq!(
            sync.take(nothing(4), 12, Some(RequestId(2)), at(3_200)),
            Ok(false)
        );
        assert!(sync.is_current(Some(11)));
        assert_eq!(sync.shores().map(|shores| shores.cell_m), Some(0.3));
        // A push in between changes what the next question says, not when.
        assert_eq!(sync.take(news(5, 0.4), 13, None, at(3_300)), Ok(true));
        assert_eq!(next(&mut sync, 3_400, 3), (5_200, 5));
    }

    #[test]
    fn what_is_old_or_out_of_bounds_is_refused() {
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
        // An answer to the question before a push was lost: there is more than it says.
        assert_eq!(sync.take(nothing(6), 4, None, at(0)), Ok(false));
        assert!(!sync.is_current(Some(1)));
        assert_eq!(sync.shores().map(|shores| shores.cell_m), Some(0.4));
    }

    /// With docking sites at these places, metres in x.
    fn sites(revision: u64, places_m: &[f32]) -> ShoresReply {
        let site = |x_m: &f32| DockingSite {
            center_m: [*x_m, 0.0],
            heading_rad: 0.0,
            width_m: 4.0,
            mean_cost: 0.2,
        };
        let sites = places_m.iter().map(site).collect();
        ShoresReply {
            revision,
            shores: Some(Shores::gather(0.3, None, Vec::new(), sites)),
        }
    }

    #[test]
    fn docking_sites_are_called_as_before_whatever_their_rank() {
        let mut sync = ShoresSync::default();
        assert_eq!(sync.site_names(), []);
        assert_eq!(sync.take(sites(1, &[0.0, 9.0]), 1, None, at(0)), Ok(true));
        let first = sync.site_names().to_vec();
        assert_eq!(sync.take(sites(2, &[9.3, 0.3]), 2, None, at(0)), Ok(true));
        assert_eq!(sync.site_names(), [first[1], first[0]]);
        // An answer that tells nothing new, and one that is refused, change no name.
        assert_eq!(sync.take(nothing(2), 3, None, at(0)), Ok(false));
        let old = sync.take(sites(1, &[0.0, 9.0]), 4, None, at(0));
        assert_eq!(old, Err(RejectReason::OldRevision));
        assert_eq!(sync.site_names(), [first[1], first[0]]);
        sync.forget();
        assert_eq!(sync.site_names(), []);
        assert_eq!(sync.take(sites(1, &[9.0]), 5, None, at(0)), Ok(true));
        assert_eq!(sync.site_names()[0].to_string(), "A");
        assert!(!first.contains(&sync.site_names()[0]), "of another run");
    }

    #[test]
    fn what_follows_from_shores_is_made_once_for_each_report() {
        /// A bush, so many metres from a docking site.
        fn report(revision: u64, away_m: f32) -> ShoresReply {
            let bush = ShoreCluster {
                number: 3,
                class: ShoreClass::Solid,
                voxels: 10,
                rigid_voxels: 10,
                center_m: [away_m, 0.0],
                outline: Vec::new(),
            };
            let mut news = sites(revision, &[0.0]);
            news.shores.as_mut().unwrap().clusters = vec![bush];
            news
        }
        /// Where what is known is kept, and how far away the bush is, metres.
        fn known(sync: &ShoresSync) -> (*const Outline, f64) {
            let known = sync.outlines();
            assert_eq!(known.outlines().len(), 1);
            let neighbour = known.neighbours()[0].unwrap();
            (known.outlines().as_ptr(), neighbour.away_m)
        }
        let mut sync = ShoresSync::default();
        assert_eq!(sync.outlines(), &ShoreOutlines::default());
        assert_eq!(sync.take(report(1, 4.0), 1, None, at(0)), Ok(true));
        let first = known(&sync);
        assert_eq!((first.1, known(&sync)), (4.0, first));
        // What is no new report makes nothing anew.
        assert_eq!(sync.take(report(1, 9.0), 2, None, at(0)), Ok(false));
        assert_eq!(sync.take(nothing(1), 3, None, at(0)), Ok(false));
        assert_eq!(known(&sync), first);
        // A new one is made while the one of before is still there: it cannot lie in its place.
        assert_eq!(sync.take(report(2, 6.0), 4, None, at(0)), Ok(true));
        let second = known(&sync);
        assert!(second.0 != first.0 && second.1 > 5.9, "{second:?}");
        let old = sync.take(report(1, 4.0), 5, None, at(0));
        assert_eq!(old, Err(RejectReason::OldRevision));
        assert_eq!(known(&sync), second);
        sync.forget();
        assert_eq!(sync.outlines(), &ShoreOutlines::default());
    }

    #[test]
    fn shores_of_maps_that_began_anew_are_asked_for_again() {
        let mut sync = ShoresSync::default();
        assert!(!sync.of_epoch(3), "the first that is heard of");
        assert_eq!(next(&mut sync, 0, 1), (0, 0));
        let request = Some(RequestId(1));
        assert_eq!(
            sync.take(sites(7, &[0.0, 9.0]), 1, request, at(0)),
            Ok(true)
        );
        let first = sync.site_names().to_vec();
        assert!(!sync.of_epoch(3) && !sync.of_epoch(2));
        assert_eq!(sync.site_names(), first);
        assert!(sync.of_epoch(4));
        assert_eq!((sync.shores(), sync.site_names()), (None, &[][..]));
        assert!(!sync.is_current(None));
        // The present list may have come before the announcement: it is taken once more, and none from before it.
        assert_eq!(next(&mut sync, 100, 2), (100, 6));
        let late = sync.take(sites(5, &[9.0]), 2, None, at(100));
        assert_eq!(late, Err(RejectReason::OldRevision));
        let request = Some(RequestId(2));
        assert_eq!(
            sync.take(sites(7, &[9.0, 0.0]), 3, request, at(200)),
            Ok(true)
        );
        assert!(sync.is_current(None) && !sync.of_epoch(4));
        let anew: Vec<_> = sync.site_names().iter().map(SiteName::to_string).collect();
        assert_eq!(anew, ["A", "B"]);
        assert!(first.iter().all(|name| !sync.site_names().contains(name)));
    }

    #[test]
    fn no_answer_is_waited_for_longer_and_longer() {
        let mut sync = ShoresSync::default();
        let mut ms = 0;
        let mut waits = Vec::new();
        for request in 0..7 {
            let (asked, _) = next(&mut sync, ms, request);
            waits.push(asked - ms);
            ms = asked;
            assert!(sync.ended(RequestId(request), at(ms)));
        }
        assert_eq!(waits, [0, 500, 1_000, 2_000, 4_000, 8_000, 8_000]);
        sync.hurry();
        assert_eq!(next(&mut sync, ms, 9).0, ms);
        // A cut swallows question and end.
        assert_eq!(next(&mut sync, ms, 10).0, ms + 4_000);
    }
}
