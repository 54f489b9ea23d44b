//! Fetches the trajectory: completely for an export, coarsely where the trail has a gap.

use std::num::NonZeroU32;
use std::sync::Arc;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::export::StampedPose;
use protocol::message::{TrajectoryPart, TrajectoryRequest};

use super::messages::{RejectReason, RequestId};
use super::retry::{ANSWER_TIMEOUT, RetryTimer};

/// A robot keeps no more poses.
pub(super) const MAX_POSES: u64 = 1_000_000;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum TrajectoryProgress {
    #[default]
    Unwanted,
    Waiting,
    Fetching {
        fetched: u64,
        of: u64,
    },
    Ready(Arc<[StampedPose]>),
}

/// Fetches the complete trajectory of one run of a robot.
#[derive(Clone, Debug, Default)]
pub(super) struct TrajectorySync {
    pub(super) query: RetryTimer,
    pub(super) progress: TrajectoryProgress,
    /// Number of the fetched trajectory and its length at the first request.
    of: Option<(u64, u64)>,
    poses: Vec<StampedPose>,
}

impl TrajectorySync {
    pub(super) fn want(&mut self) {
        *self = Self {
            progress: TrajectoryProgress::Waiting,
            ..Self::default()
        };
    }

    pub(super) fn forget(&mut self) {
        if self.is_wanted() {
            self.want();
        } else {
            *self = Self::default();
        }
    }

    pub(super) const fn is_wanted(&self) -> bool {
        matches!(
            self.progress,
            TrajectoryProgress::Waiting | TrajectoryProgress::Fetching { .. }
        )
    }

    pub(super) fn query(
        &mut self,
        now: Monotonic,
        number: impl FnOnce() -> RequestId,
    ) -> Option<(RequestId, TrajectoryRequest)> {
        if !self.is_wanted() {
            return None;
        }
        let request = self.query.request(ANSWER_TIMEOUT, now, number)?;
        let body = TrajectoryRequest {
            trajectory: self.of.map(|(trajectory, _)| trajectory),
            from: self.poses.len() as u64,
            step: NonZeroU32::MIN,
        };
        Some((request, body))
    }

    /// Takes a reply; returns whether it was requested here.
    pub(super) fn take(
        &mut self,
        part: &TrajectoryPart,
        request: RequestId,
        now: Monotonic,
    ) -> Result<bool, RejectReason> {
        if !self.query.is_answered(request) {
            return Ok(false);
        }
        if !self.is_wanted() {
            return Err(RejectReason::OldRevision);
        }
        let (trajectory, wanted) = *self.of.get_or_insert((part.trajectory, part.poses));
        let is_other = trajectory != part.trajectory;
        let is_less = part.rows.is_empty() && (self.poses.len() as u64) < wanted;
        if is_other || is_less || wanted > MAX_POSES {
            (self.of, self.poses) = (None, Vec::new());
            self.progress = TrajectoryProgress::Waiting;
            self.query.backoff.fail(now);
            return is_other.then_some(true).ok_or(RejectReason::Malformed);
        }
        self.query.backoff.succeed();
        self.poses.extend(part.part());
        let fetched = self.poses.len() as u64;
        self.progress = if fetched >= wanted {
            TrajectoryProgress::Ready(std::mem::take(&mut self.poses).into())
        } else {
            let of = wanted;
            TrajectoryProgress::Fetching { fetched, of }
        };
        Ok(true)
    }
}

/// Without a pose for this long, the trail has a gap.
pub(super) const GAP: Duration = Duration::from_secs(1);
/// Poses that are fetched for a gap: about 20 kB for any length.
const POINTS: u64 = 1000;
/// Period of requests of the number of poses, so that a later gap is filled from there.
const COUNT_PERIOD: Duration = Duration::from_secs(20);

#[derive(Clone, Debug, Default)]
pub(super) struct TrailSync {
    pub(super) query: RetryTimer,
    state: State,
    /// Another gap came while this one is filled.
    is_open_again: bool,
    trajectory: Option<u64>,
    /// Poses before the next gap.
    covered: u64,
}

#[derive(Clone, Copy, Debug, Default)]
enum State {
    #[default]
    Unknown,
    Whole {
        looked: Monotonic,
    },
    /// The length of the gap is requested.
    Open,
    Filling {
        next: u64,
        until: u64,
        step: NonZeroU32,
    },
}

impl TrailSync {
    pub(super) const fn gap(&mut self) {
        match self.state {
            State::Unknown | State::Whole { .. } | State::Open => self.state = State::Open,
            State::Filling { .. } => self.is_open_again = true,
        }
    }

    pub(super) fn query(
        &mut self,
        now: Monotonic,
        number: impl FnOnce() -> RequestId,
    ) -> Option<(RequestId, TrajectoryRequest)> {
        let (from, step) = match self.state {
            State::Unknown => return None,
            State::Whole { looked } if now.since(looked) < COUNT_PERIOD => return None,
            State::Whole { .. } | State::Open => (self.covered, NonZeroU32::MAX),
            State::Filling { next, step, .. } => (next, step),
        };
        let request = self.query.request(ANSWER_TIMEOUT, now, number)?;
        let body = TrajectoryRequest {
            trajectory: self.trajectory,
            from,
            step,
        };
        Some((request, body))
    }

    /// Stamps, nanoseconds, and points, metres in `odom`; `None` if not requested here.
    pub(super) fn take(
        &mut self,
        part: &TrajectoryPart,
        request: RequestId,
        now: Monotonic,
    ) -> Option<Vec<(i64, [f64; 2])>> {
        if !self.query.is_answered(request) {
            return None;
        }
        self.query.backoff.succeed();
        let is_other = self.trajectory.replace(part.trajectory) != Some(part.trajectory);
        if is_other {
            self.covered = 0;
            if matches!(self.state, State::Filling { .. }) {
                self.state = State::Open;
                self.query.backoff.fail(now);
                return Some(Vec::new());
            }
        }
        let whole = State::Whole { looked: now };
        let mut points = Vec::new();
        match self.state {
            State::Unknown => {}
            State::Whole { .. } => {
                self.covered = part.poses;
                self.state = whole;
            }
            State::Open => {
                let poses = part.poses.min(MAX_POSES);
                let lacking = poses.saturating_sub(self.covered);
                let step = u32::try_from(lacking.div_ceil(POINTS)).unwrap_or(u32::MAX);
                self.state = NonZeroU32::new(step).map_or(whole, |step| State::Filling {
                    next: self.covered,
                    until: poses,
                    step,
                });
            }
            State::Filling { next, until, step } => {
                let next = next.saturating_add(part.rows.len() as u64 * u64::from(step.get()));
                self.state = if !part.rows.is_empty() && next < until {
                    State::Filling { next, until, step }
                } else {
                    // Some may be newer than the request.
                    self.covered = until.max(next.min(part.poses));
                    let is_open_again = std::mem::take(&mut self.is_open_again);
                    if is_open_again { State::Open } else { whole }
                };
                points.extend(part.part().map(|pose| {
                    let [x, y, _] = pose.position_m();
                    (pose.stamp_ns, [x, y])
                }));
            }
        }
        Some(points)
    }
}

#[cfg(test)]
mod tests {
    use protocol::export::StampedPose;
    use protocol::message::MAX_TRAJECTORY_POSES;
    use std::time::Duration;

    use super::*;
    use crate::test_support::at;

    fn pose(n: u64) -> StampedPose {
        StampedPose::new(n.cast_signed(), [n as f64, 0.5, 0.0], [0.0, 0.0, 0.0, 1.0])
    }

    fn part(trajectory: u64, poses: u64, from: u64) -> TrajectoryPart {
        TrajectoryPart::new(trajectory, poses, (from..poses).map(pose))
    }

    fn ask(sync: &mut TrajectorySync, number: u64) -> Option<TrajectoryRequest> {
        let now = Monotonic::default();
        let asked = sync.query(now, || RequestId(number));
        asked.map(|(_, body)| body)
    }

    fn take(
        sync: &mut TrajectorySync,
        part: &TrajectoryPart,
        number: u64,
    ) -> Result<bool, RejectReason> {
        sync.take(part, RequestId(number), Monotonic::default())
    }

    #[test]
    fn fetches_the_length_at_the_first_request() {
        let mut sync = TrajectorySync::default();
        assert_eq!(ask(&mut sync, 0), None);
        sync.want();
        assert_eq!(sync.progress, TrajectoryProgress::Waiting);
        let first = ask(&mut sync, 1).unwrap();
        assert_eq!(
            (first.trajectory, first.from, first.step.get()),
            (None, 0, 1)
        );
        assert_eq!(ask(&mut sync, 2), None, "one at a time");
        assert_eq!(take(&mut sync, &part(7, 700, 0), 2), Ok(false));
        assert_eq!(take(&mut sync, &part(7, 700, 0), 1), Ok(true));
        let fetched = MAX_TRAJECTORY_POSES as u64;
        let progress = TrajectoryProgress::Fetching { fetched, of: 700 };
        assert_eq!(sync.progress, progress);
        let second = ask(&mut sync, 3).unwrap();
        assert_eq!((second.trajectory, second.from), (Some(7), fetched));
        assert!(sync.is_wanted());
        // The vehicle moves meanwhile.
        assert_eq!(take(&mut sync, &part(7, 705, fetched), 3), Ok(true));
        let TrajectoryProgress::Ready(poses) = sync.progress.clone() else {
            panic!("{:?}", sync.progress);
        };
        assert_eq!(&poses[..], (0..705).map(pose).collect::<Vec<_>>());
        assert!(!sync.is_wanted());
        assert_eq!(ask(&mut sync, 4), None);
        sync.want();
        assert_eq!(sync.progress, TrajectoryProgress::Waiting);
    }

    #[test]
    fn restarts_after_a_seek() {
        let mut sync = TrajectorySync::default();
        sync.want();
        ask(&mut sync, 1);
        assert_eq!(take(&mut sync, &part(7, 700, 0), 1), Ok(true));
        ask(&mut sync, 2);
        let other = TrajectoryPart::new(8, 3, std::iter::empty());
        assert_eq!(take(&mut sync, &other, 2), Ok(true));
        assert_eq!(ask(&mut sync, 3), None, "not at once: seeks may continue");
        let later = Monotonic::default() + Duration::from_millis(500);
        let (_, request) = sync.query(later, || RequestId(3)).unwrap();
        assert_eq!(request.from, 0);
        assert_eq!(take(&mut sync, &part(8, 3, 0), 3), Ok(true));
        let ready = TrajectoryProgress::Ready((0..3).map(pose).collect());
        assert_eq!(sync.progress, ready);
    }

    #[test]
    fn accepts_empty_and_rejects_invalid_trajectory() {
        let mut sync = TrajectorySync::default();
        sync.want();
        ask(&mut sync, 1);
        assert_eq!(take(&mut sync, &part(0, 0, 0), 1), Ok(true));
        assert_eq!(sync.progress, TrajectoryProgress::Ready([].into()));
        for nonsense in [
            TrajectoryPart::new(0, 5, std::iter::empty()),
            TrajectoryPart::new(0, MAX_POSES + 1, (0..5).map(pose)),
        ] {
            sync.want();
            ask(&mut sync, 2);
            assert_eq!(take(&mut sync, &nonsense, 2), Err(RejectReason::Malformed));
            assert_eq!(sync.progress, TrajectoryProgress::Waiting);
            assert_eq!(ask(&mut sync, 3), None, "not at once");
        }
    }

    /// Reply of a robot with this many poses, one metre apart.
    fn robot(trajectory: u64, poses: u64, request: TrajectoryRequest) -> TrajectoryPart {
        let is_this = request.trajectory.is_none_or(|asked| asked == trajectory);
        let asked = (request.from..poses)
            .step_by(request.step.get() as usize)
            .filter(|_| is_this)
            .map(|n| StampedPose::new(n.cast_signed(), [n as f64, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]));
        TrajectoryPart::new(trajectory, poses, asked)
    }

    /// Requests until nothing is missing; returns the stamps and the number of requests.
    fn fetch(sync: &mut TrailSync, trajectory: u64, poses: u64, ms: u64) -> (Vec<i64>, u64) {
        let (mut stamps, mut number) = (Vec::new(), 0);
        while let Some((request, body)) = sync.query(at(ms), || RequestId(number)) {
            number += 1;
            let part = robot(trajectory, poses, body);
            let points = sync.take(&part, request, at(ms)).unwrap();
            stamps.extend(points.iter().map(|(stamp_ns, _)| *stamp_ns));
        }
        (stamps, number)
    }

    fn stamps(from: i64, to: i64, step: usize) -> Vec<i64> {
        (from..to).step_by(step).collect()
    }

    #[test]
    fn long_trail_is_coarse_and_gap_is_filled_from_its_start() {
        let mut sync = TrailSync::default();
        assert_eq!(fetch(&mut sync, 0, 9, 0).1, 0, "no pose yet");
        sync.gap();
        assert_eq!(
            fetch(&mut sync, 0, 100_000, 0),
            (stamps(0, 100_000, 100), 3)
        );
        sync.gap();
        let lacking = stamps(100_000, 100_020, 1);
        assert_eq!(fetch(&mut sync, 0, 100_020, 0).0, lacking);
        sync.gap();
        assert_eq!(fetch(&mut sync, 0, 100_020, 0), (vec![], 1));
    }

    #[test]
    fn received_poses_are_not_fetched_for_a_later_gap() {
        let mut sync = TrailSync::default();
        sync.gap();
        assert_eq!(fetch(&mut sync, 0, 10, 0).0, stamps(0, 10, 1));
        assert_eq!(fetch(&mut sync, 0, 200, 19_999), (vec![], 0));
        assert_eq!(fetch(&mut sync, 0, 300_000, 20_000), (vec![], 1));
        sync.gap();
        let lacking = stamps(300_000, 301_200, 2);
        assert_eq!(fetch(&mut sync, 0, 301_200, 25_000).0, lacking);
    }

    #[test]
    fn second_gap_is_filled_after_the_first() {
        let mut sync = TrailSync::default();
        sync.gap();
        let (open, body) = sync.query(at(0), || RequestId(1)).unwrap();
        assert_eq!(sync.take(&robot(0, 900, body), open, at(0)), Some(vec![]));
        let (first, body) = sync.query(at(0), || RequestId(2)).unwrap();
        sync.gap();
        let points = sync.take(&robot(0, 950, body), first, at(0)).unwrap();
        assert_eq!(points.len(), 500, "what was asked for is not thrown away");
        let (rest, _) = fetch(&mut sync, 0, 1500, 0);
        assert_eq!(rest, stamps(500, 1500, 1));
    }

    #[test]
    fn new_trajectory_during_fill_is_fetched_from_start() {
        let mut sync = TrailSync::default();
        sync.gap();
        let (open, body) = sync.query(at(0), || RequestId(1)).unwrap();
        assert_eq!(sync.take(&robot(0, 900, body), open, at(0)), Some(vec![]));
        let (first, body) = sync.query(at(0), || RequestId(2)).unwrap();
        assert_eq!(sync.take(&robot(1, 20, body), first, at(0)), Some(vec![]));
        assert_eq!(fetch(&mut sync, 1, 30, 1_000).0, stamps(0, 30, 1));
    }

    #[test]
    fn new_trajectory_is_fetched_from_start() {
        let mut sync = TrailSync::default();
        sync.gap();
        fetch(&mut sync, 0, 50, 0);
        sync.gap();
        assert_eq!(fetch(&mut sync, 1, 30, 0).0, stamps(0, 30, 1));
        sync.gap();
        assert_eq!(fetch(&mut sync, 2, 0, 0).0, [0; 0]);
    }

    #[test]
    fn invalid_replies_do_not_cause_endless_requests() {
        let mut sync = TrailSync::default();
        sync.gap();
        let mut asked = 0;
        while let Some((request, _)) = sync.query(at(0), || RequestId(asked)) {
            asked += 1;
            let pose = StampedPose::new(0, [0.0; 3], [0.0; 4]);
            let part = TrajectoryPart::new(0, u64::MAX, [pose].into_iter());
            sync.take(&part, request, at(0));
        }
        assert_eq!(asked, 1 + POINTS);
        let mut sync = TrailSync::default();
        sync.gap();
        let mut asked = 0;
        while let Some((request, _)) = sync.query(at(0), || RequestId(asked)) {
            asked += 1;
            sync.take(&robot(asked, 9, sync_request()), request, at(0));
        }
        assert_eq!(asked, 2, "another trajectory each time");
    }

    const fn sync_request() -> TrajectoryRequest {
        TrajectoryRequest {
            trajectory: None,
            from: 0,
            step: NonZeroU32::MIN,
        }
    }

    #[test]
    fn unanswered_requests_back_off() {
        let mut sync = TrailSync::default();
        sync.gap();
        let (first, _) = sync.query(at(0), || RequestId(1)).unwrap();
        assert_eq!(sync.query(at(11_999), || RequestId(2)), None);
        assert!(sync.query.ended(first, at(10)) && !sync.query.ended(first, at(10)));
        assert_eq!(sync.query(at(509), || RequestId(2)), None);
        let (second, _) = sync.query(at(510), || RequestId(2)).unwrap();
        assert!(sync.query.ended(second, at(510)));
        assert_eq!(sync.query(at(1509), || RequestId(3)), None);
        assert!(sync.query(at(1510), || RequestId(3)).is_some());
        assert_eq!(
            sync.take(&robot(0, 1, sync_request()), first, at(1510)),
            None
        );
    }
}
