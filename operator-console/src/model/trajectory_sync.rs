//! The whole way of the vehicle, fetched when somebody exports it. Pure: the present is a parameter.

use std::num::NonZeroU32;
use std::sync::Arc;

use measurement::time::Monotonic;
use protocol::export::StampedPose;
use protocol::message::{TrajectoryPart, TrajectoryRequest};

use super::incoming::RequestId;
use super::reject_reason::RejectReason;
use super::retry::RetryTimer;

/// Longest way. A robot keeps no more poses.
pub(super) const MAX_POSES: u64 = 1_000_000;

/// How far fetching is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum TrajectoryProgress {
    /// Nobody wants it.
    #[default]
    Unwanted,
    /// It is asked for.
    Waiting,
    /// Parts of it come.
    Fetching {
        /// Poses that came.
        fetched: u64,
        /// Poses that it had when it was asked for.
        of: u64,
    },
    /// Here it is, oldest first.
    Ready(Arc<[StampedPose]>),
}

/// Fetches the trajectory of one run of a robot.
#[derive(Clone, Debug, Default)]
pub(super) struct TrajectorySync {
    query: RetryTimer,
    phase: Phase,
}

#[derive(Clone, Debug, Default)]
enum Phase {
    #[default]
    Unwanted,
    Fetching {
        /// Which, and how many poses it had, once it is known.
        of: Option<(u64, u64)>,
        poses: Vec<StampedPose>,
    },
    Ready(Arc<[StampedPose]>),
}

impl TrajectorySync {
    /// It is wanted as it is now, whatever was fetched before.
    pub(super) fn want(&mut self) {
        *self = Self {
            phase: Phase::begin(),
            ..Self::default()
        };
    }

    /// Nobody wants it any more.
    pub(super) fn drop_all(&mut self) {
        *self = Self::default();
    }

    /// Another run of the robot began.
    pub(super) fn forget(&mut self) {
        if self.is_wanted() {
            self.want();
        } else {
            self.drop_all();
        }
    }

    /// Whether somebody waits for it.
    pub(super) const fn is_wanted(&self) -> bool {
        matches!(self.phase, Phase::Fetching { .. })
    }

    pub(super) fn progress(&self) -> TrajectoryProgress {
        match &self.phase {
            Phase::Unwanted => TrajectoryProgress::Unwanted,
            Phase::Fetching { of: None, .. } => TrajectoryProgress::Waiting,
            Phase::Fetching {
                of: Some((_, of)),
                poses,
            } => TrajectoryProgress::Fetching {
                fetched: poses.len() as u64,
                of: *of,
            },
            Phase::Ready(poses) => TrajectoryProgress::Ready(Arc::clone(poses)),
        }
    }

    /// What to ask now; `number` numbers the question.
    pub(super) fn query(
        &mut self,
        now: Monotonic,
        number: impl FnOnce() -> RequestId,
    ) -> Option<(RequestId, TrajectoryRequest)> {
        let Phase::Fetching { of, poses } = &self.phase else {
            return None;
        };
        if !self.query.is_due(now) {
            return None;
        }
        let request = number();
        self.query.ask(request, now);
        let body = TrajectoryRequest {
            trajectory: of.map(|(trajectory, _)| trajectory),
            from: poses.len() as u64,
            step: NonZeroU32::MIN,
        };
        Some((request, body))
    }

    /// Takes an answer to `request`; whether it was asked here.
    ///
    /// # Errors
    /// Where it is no answer to that.
    pub(super) fn take(
        &mut self,
        part: &TrajectoryPart,
        request: RequestId,
        now: Monotonic,
    ) -> Result<bool, RejectReason> {
        if !self.query.is_answered(request) {
            return Ok(false);
        }
        let Phase::Fetching { of, poses } = &mut self.phase else {
            return Err(RejectReason::OldRevision);
        };
        if of.is_some_and(|(trajectory, _)| trajectory != part.trajectory) {
            self.phase = Phase::begin();
            self.query.fail(now);
            return Ok(true);
        }
        let (_, wanted) = *of.get_or_insert((part.trajectory, part.poses));
        let is_less = part.rows.is_empty() && (poses.len() as u64) < wanted;
        if is_less || wanted > MAX_POSES {
            self.phase = Phase::begin();
            self.query.fail(now);
            return Err(RejectReason::Malformed);
        }
        self.query.succeed();
        poses.extend(part.part());
        if poses.len() as u64 >= wanted {
            self.phase = Phase::Ready(std::mem::take(poses).into());
        }
        Ok(true)
    }

    /// No more answers to a question will come; true if it was asked here.
    pub(super) fn ended(&mut self, request: RequestId, now: Monotonic) -> bool {
        self.query.ended(request, now)
    }
}

impl Phase {
    const fn begin() -> Self {
        Self::Fetching {
            of: None,
            poses: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use protocol::message::MAX_TRAJECTORY_POSES;

    use super::*;

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
    fn it_is_fetched_as_it_was_when_it_was_wanted() {
        let mut sync = TrajectorySync::default();
        assert_eq!(ask(&mut sync, 0), None);
        sync.want();
        assert_eq!(sync.progress(), TrajectoryProgress::Waiting);
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
        assert_eq!(sync.progress(), progress);
        let second = ask(&mut sync, 3).unwrap();
        assert_eq!((second.trajectory, second.from), (Some(7), fetched));
        assert!(sync.is_wanted());
        // It went on meanwhile.
        assert_eq!(take(&mut sync, &part(7, 705, fetched), 3), Ok(true));
        let TrajectoryProgress::Ready(poses) = sync.progress() else {
            panic!("{:?}", sync.progress());
        };
        assert_eq!(&poses[..], (0..705).map(pose).collect::<Vec<_>>());
        assert!(!sync.is_wanted());
        assert_eq!(ask(&mut sync, 4), None);
        sync.want();
        assert_eq!(sync.progress(), TrajectoryProgress::Waiting);
    }

    #[test]
    fn one_that_was_wound_meanwhile_is_fetched_anew() {
        let mut sync = TrajectorySync::default();
        sync.want();
        ask(&mut sync, 1);
        assert_eq!(take(&mut sync, &part(7, 700, 0), 1), Ok(true));
        ask(&mut sync, 2);
        let other = TrajectoryPart::new(8, 3, std::iter::empty());
        assert_eq!(take(&mut sync, &other, 2), Ok(true));
        assert_eq!(
            ask(&mut sync, 3),
            None,
            "not at once: it may be wound on and on"
        );
        let later = Monotonic::default() + Duration::from_millis(500);
        let (_, request) = sync.query(later, || RequestId(3)).unwrap();
        assert_eq!(request.from, 0);
        assert_eq!(take(&mut sync, &part(8, 3, 0), 3), Ok(true));
        let ready = TrajectoryProgress::Ready((0..3).map(pose).collect());
        assert_eq!(sync.progress(), ready);
    }

    #[test]
    fn a_robot_that_has_not_moved_has_an_empty_one_and_nonsense_is_refused() {
        let mut sync = TrajectorySync::default();
        sync.want();
        ask(&mut sync, 1);
        assert_eq!(take(&mut sync, &part(0, 0, 0), 1), Ok(true));
        assert_eq!(sync.progress(), TrajectoryProgress::Ready([].into()));
        for nonsense in [
            TrajectoryPart::new(0, 5, std::iter::empty()),
            TrajectoryPart::new(0, MAX_POSES + 1, (0..5).map(pose)),
        ] {
            sync.want();
            ask(&mut sync, 2);
            assert_eq!(take(&mut sync, &nonsense, 2), Err(RejectReason::Malformed));
            assert_eq!(sync.progress(), TrajectoryProgress::Waiting);
            assert_eq!(ask(&mut sync, 3), None, "not at once");
        }
    }
}
