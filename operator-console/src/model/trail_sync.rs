//! The way that was not heard: asked for when a console joins, and where the link was gone. Pure: the present is a parameter.

use std::num::NonZeroU32;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{TrajectoryPart, TrajectoryRequest};

use super::incoming::RequestId;
use super::retry::RetryTimer;
use super::trajectory_sync::MAX_POSES;

/// Without a pose for so long, the way has a gap.
pub(super) const GAP: Duration = Duration::from_secs(1);
/// Poses that are fetched for a gap: about 20 kB, whatever lies behind.
const POINTS: u64 = 1000;
/// How often it is asked how many poses there are, so that a later gap is not looked for in all that was heard.
const COUNT_PERIOD: Duration = Duration::from_secs(20);

/// Fetches what the trail lacks, coarsely.
#[derive(Clone, Debug, Default)]
pub(super) struct TrailSync {
    query: RetryTimer,
    state: State,
    /// Another gap came while this one is filled.
    is_open_again: bool,
    trajectory: Option<u64>,
    /// Poses of it that lie before the next gap.
    covered: u64,
}

#[derive(Clone, Copy, Debug, Default)]
enum State {
    /// No pose has come yet.
    #[default]
    Unknown,
    /// Nothing is lacking.
    Whole { looked: Monotonic },
    /// How long the gap is, is being asked.
    Open,
    Filling {
        next: u64,
        until: u64,
        step: NonZeroU32,
    },
}

impl TrailSync {
    /// Poses did not come for a while.
    pub(super) const fn gap(&mut self) {
        match self.state {
            State::Unknown | State::Whole { .. } | State::Open => self.state = State::Open,
            State::Filling { .. } => self.is_open_again = true,
        }
    }

    /// What to ask now; `number` numbers the question.
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
        if !self.query.is_due(now) {
            return None;
        }
        let request = number();
        self.query.ask(request, now);
        let body = TrajectoryRequest {
            trajectory: self.trajectory,
            from,
            step,
        };
        Some((request, body))
    }

    /// Takes an answer to `request`: the stamps, nanoseconds, and points, metres in `odom`, that it brings. `None` where it
    /// was not asked here.
    pub(super) fn take(
        &mut self,
        part: &TrajectoryPart,
        request: RequestId,
        now: Monotonic,
    ) -> Option<Vec<(i64, [f64; 2])>> {
        if !self.query.is_answered(request) {
            return None;
        }
        self.query.succeed();
        let is_other = self.trajectory.replace(part.trajectory) != Some(part.trajectory);
        if is_other {
            self.covered = 0;
            if matches!(self.state, State::Filling { .. }) {
                self.state = State::Open;
                self.query.fail(now);
                return Some(Vec::new());
            }
        }
        let whole = State::Whole { looked: now };
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
                    // Some may be newer than the question.
                    self.covered = until.max(next.min(part.poses));
                    if std::mem::take(&mut self.is_open_again) {
                        State::Open
                    } else {
                        whole
                    }
                };
                let points = part.part().map(|pose| {
                    let [x, y, _] = pose.position_m();
                    (pose.stamp_ns, [x, y])
                });
                return Some(points.collect());
            }
        }
        Some(Vec::new())
    }

    /// No more answers to a question will come; true if it was asked here.
    pub(super) fn ended(&mut self, request: RequestId, now: Monotonic) -> bool {
        self.query.ended(request, now)
    }
}

#[cfg(test)]
mod tests {
    use protocol::export::StampedPose;

    use super::*;

    fn at(ms: u64) -> Monotonic {
        Monotonic::from_nanos(ms * 1_000_000)
    }

    /// Answers as a robot with so many poses does, a metre apart.
    fn robot(trajectory: u64, poses: u64, request: TrajectoryRequest) -> TrajectoryPart {
        let is_this = request.trajectory.is_none_or(|asked| asked == trajectory);
        let asked = (request.from..poses)
            .step_by(request.step.get() as usize)
            .filter(|_| is_this)
            .map(|n| StampedPose::new(n.cast_signed(), [n as f64, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]));
        TrajectoryPart::new(trajectory, poses, asked)
    }

    /// Asks until nothing is lacking: the stamps that came, and how many questions that took.
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
    fn a_long_way_is_fetched_coarsely_and_a_gap_from_where_it_began() {
        let mut sync = TrailSync::default();
        assert_eq!(fetch(&mut sync, 0, 9, 0).1, 0, "nothing is known yet");
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
    fn what_was_heard_is_not_fetched_for_a_gap_behind_it() {
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
    fn a_gap_while_another_is_filled_is_filled_behind_it() {
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
    fn a_trajectory_that_begins_anew_while_it_is_filled_is_fetched_whole() {
        let mut sync = TrailSync::default();
        sync.gap();
        let (open, body) = sync.query(at(0), || RequestId(1)).unwrap();
        assert_eq!(sync.take(&robot(0, 900, body), open, at(0)), Some(vec![]));
        let (first, body) = sync.query(at(0), || RequestId(2)).unwrap();
        assert_eq!(sync.take(&robot(1, 20, body), first, at(0)), Some(vec![]));
        assert_eq!(fetch(&mut sync, 1, 30, 1_000).0, stamps(0, 30, 1));
    }

    #[test]
    fn another_trajectory_is_fetched_from_its_beginning() {
        let mut sync = TrailSync::default();
        sync.gap();
        fetch(&mut sync, 0, 50, 0);
        sync.gap();
        assert_eq!(fetch(&mut sync, 1, 30, 0).0, stamps(0, 30, 1));
        sync.gap();
        assert_eq!(fetch(&mut sync, 2, 0, 0).0, [0; 0]);
    }

    #[test]
    fn a_robot_that_lies_is_not_asked_without_end() {
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
    fn a_robot_that_tells_nothing_is_asked_ever_more_seldom() {
        let mut sync = TrailSync::default();
        sync.gap();
        let (first, _) = sync.query(at(0), || RequestId(1)).unwrap();
        assert_eq!(sync.query(at(11_999), || RequestId(2)), None);
        assert!(sync.ended(first, at(10)) && !sync.ended(first, at(10)));
        assert_eq!(sync.query(at(509), || RequestId(2)), None);
        let (second, _) = sync.query(at(510), || RequestId(2)).unwrap();
        assert!(sync.ended(second, at(510)));
        assert_eq!(sync.query(at(1509), || RequestId(3)), None);
        assert!(sync.query(at(1510), || RequestId(3)).is_some());
        assert_eq!(
            sync.take(&robot(0, 1, sync_request()), first, at(1510)),
            None
        );
    }
}
