//! The way that was not heard: asked for when a console joins, and where the link was gone. Pure: the present is a parameter.

use std::num::NonZeroU32;
use std::time::Duration;

use protocol::message::{TrajectoryPart, TrajectoryRequest};
use robot_edge::clock::Monotonic;

use super::incoming::RequestId;
use super::repeated::Repeated;

/// Without a pose for so long, the way has a gap.
pub(super) const GAP: Duration = Duration::from_secs(1);
/// Poses that are fetched for a gap: about 20 kB, whatever lies behind.
const POINTS: u64 = 1000;

/// Fetches what the trail lacks, coarsely.
#[derive(Clone, Debug, Default)]
pub(super) struct TrailSync {
    question: Repeated,
    state: State,
    trajectory: Option<u64>,
    /// Poses of it that lie behind the last gap.
    covered: u64,
}

#[derive(Clone, Copy, Debug, Default)]
enum State {
    #[default]
    Whole,
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
        if let State::Filling { next, .. } = self.state {
            self.covered = next;
        }
        self.state = State::Open;
    }

    /// What to ask now; `number` numbers the question.
    pub(super) fn question(
        &mut self,
        now: Monotonic,
        number: impl FnOnce() -> RequestId,
    ) -> Option<(RequestId, TrajectoryRequest)> {
        let (from, step) = match self.state {
            State::Whole => return None,
            State::Open => (self.covered, NonZeroU32::MAX),
            State::Filling { next, step, .. } => (next, step),
        };
        if !self.question.is_due(now) {
            return None;
        }
        let request = number();
        self.question.ask(request, now);
        let body = TrajectoryRequest {
            trajectory: self.trajectory,
            from,
            step,
        };
        Some((request, body))
    }

    /// Takes an answer to `request`: `None` where it was not asked here.
    pub(super) fn take(
        &mut self,
        part: &TrajectoryPart,
        request: RequestId,
    ) -> Option<Vec<(i64, [f64; 2])>> {
        if !self.question.is_answered(request) {
            return None;
        }
        self.question.goes_well();
        let is_other = self.trajectory.replace(part.trajectory) != Some(part.trajectory);
        if is_other {
            self.covered = 0;
            if part.rows.is_empty() && part.poses > 0 {
                self.state = State::Open;
                return Some(Vec::new());
            }
        }
        match self.state {
            State::Whole => {}
            State::Open => {
                let lacking = part.poses.saturating_sub(self.covered);
                let step = u32::try_from(lacking.div_ceil(POINTS)).unwrap_or(u32::MAX);
                self.state = match NonZeroU32::new(step) {
                    None => State::Whole,
                    Some(step) => State::Filling {
                        next: self.covered,
                        until: part.poses,
                        step,
                    },
                };
                return Some(Vec::new());
            }
            State::Filling { next, until, step } => {
                let next = next.saturating_add(part.rows.len() as u64 * u64::from(step.get()));
                self.state = if part.rows.is_empty() || next >= until {
                    self.covered = until;
                    State::Whole
                } else {
                    State::Filling { next, until, step }
                };
            }
        }
        let points = part.part().map(|pose| {
            let [x, y, _] = pose.position_m();
            (pose.stamp_ns, [x, y])
        });
        Some(points.collect())
    }

    /// No more answers to a question will come; true if it was asked here.
    pub(super) fn ended(&mut self, request: RequestId, now: Monotonic) -> bool {
        self.question.ended(request, now)
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
    fn fetch(sync: &mut TrailSync, trajectory: u64, poses: u64) -> (Vec<i64>, u64) {
        let (mut stamps, mut number) = (Vec::new(), 0);
        while let Some((request, body)) = sync.question(at(0), || RequestId(number)) {
            number += 1;
            let part = robot(trajectory, poses, body);
            let points = sync.take(&part, request).unwrap();
            stamps.extend(points.iter().map(|(stamp_ns, _)| *stamp_ns));
        }
        (stamps, number)
    }

    #[test]
    fn a_long_way_is_fetched_coarsely_and_a_gap_from_where_it_began() {
        let mut sync = TrailSync::default();
        assert_eq!(
            fetch(&mut sync, 0, 9),
            (vec![], 0),
            "nothing is lacking yet"
        );
        sync.gap();
        let (stamps, questions) = fetch(&mut sync, 0, 100_000);
        let expected: Vec<_> = (0..100_000).step_by(100).collect();
        assert_eq!((stamps, questions), (expected, 3));
        sync.gap();
        let (stamps, _) = fetch(&mut sync, 0, 100_020);
        assert_eq!(stamps, (100_000..100_020).collect::<Vec<_>>());
        sync.gap();
        assert_eq!(fetch(&mut sync, 0, 100_020), (vec![], 1));
    }

    #[test]
    fn another_trajectory_is_fetched_from_its_beginning() {
        let mut sync = TrailSync::default();
        sync.gap();
        fetch(&mut sync, 0, 50);
        sync.gap();
        let (stamps, _) = fetch(&mut sync, 1, 30);
        assert_eq!(stamps, (0..30).collect::<Vec<_>>());
        sync.gap();
        assert_eq!(fetch(&mut sync, 2, 0).0, [0; 0]);
    }

    #[test]
    fn a_robot_that_tells_nothing_is_asked_ever_more_seldom() {
        let mut sync = TrailSync::default();
        sync.gap();
        let (first, _) = sync.question(at(0), || RequestId(1)).unwrap();
        assert_eq!(sync.question(at(3999), || RequestId(2)), None);
        assert!(sync.ended(first, at(10)) && !sync.ended(first, at(10)));
        assert_eq!(sync.question(at(509), || RequestId(2)), None);
        let (second, _) = sync.question(at(510), || RequestId(2)).unwrap();
        assert!(sync.ended(second, at(510)));
        assert_eq!(sync.question(at(1509), || RequestId(3)), None);
        assert!(sync.question(at(1510), || RequestId(3)).is_some());
        assert_eq!(
            sync.take(
                &robot(
                    0,
                    1,
                    TrajectoryRequest {
                        trajectory: None,
                        from: 0,
                        step: NonZeroU32::MIN
                    }
                ),
                first
            ),
            None
        );
    }
}
