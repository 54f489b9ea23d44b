//! Recent states of the collision monitor. Beside an obstacle they may alternate with each scan; the display shows the
//! strictest.

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{Barrier, CollisionMonitorState, TeleopStatus, Velocity};

/// Three statuses of an idle vehicle. Text that changes more often cannot be read.
const WINDOW: Duration = Duration::from_millis(1500);

/// Smallest speed that is shown with two decimals, m/s.
pub const MIN_SHOWN_MPS: f32 = 0.005;
/// Smallest turn rate that is shown in whole degrees, rad/s.
pub const MIN_SHOWN_RADPS: f32 = 0.0087;
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MonitorReport {
    pub state: CollisionMonitorState,
    /// The requested velocity: the state may concern that direction only.
    pub requested: Velocity,
    /// What limits that velocity.
    pub barrier: Option<Barrier>,
}

#[derive(Clone, Debug, Default)]
pub(super) struct MonitorHistory {
    window: TimeWindow<MonitorReport>,
}

impl MonitorHistory {
    pub(super) fn update(&mut self, teleop: Option<&TeleopStatus>, now: Monotonic) {
        let Some(teleop) = teleop else {
            return self.forget();
        };
        let report = MonitorReport {
            state: teleop.collision_monitor,
            requested: teleop.requested,
            barrier: teleop.barrier,
        };
        self.window.add(report, WINDOW, now);
    }

    pub(super) fn forget(&mut self) {
        self.window.clear();
    }

    /// Reports within [`WINDOW`] of the newest, oldest first.
    pub(super) fn recent(&self) -> impl DoubleEndedIterator<Item = &MonitorReport> + Clone {
        let entries = self.window.entries.iter();
        let newest = entries.clone().last().map(|(_, at)| *at);
        let is_late = move |at: Monotonic| newest.is_some_and(|newest| newest.since(at) < WINDOW);
        let late = entries.filter(move |(_, at)| is_late(*at));
        late.map(|(report, _)| report)
    }
}

/// Signs of the requested motion: 1 forward and left, −1 backward and right, 0 neither.
pub fn direction_signs(asked: Velocity) -> [i8; 3] {
    let sign = |speed: f32, least: f32| i8::from(speed >= least) - i8::from(speed <= -least);
    [
        sign(asked.linear_mps, MIN_SHOWN_MPS),
        sign(asked.lateral_mps, MIN_SHOWN_MPS),
        sign(asked.angular_radps, MIN_SHOWN_RADPS),
    ]
}

/// A robot that reports more than twenty times a second gets a shorter window.
const MAX_ENTRIES: usize = 64;

#[derive(Clone, Debug)]
pub(super) struct TimeWindow<T> {
    entries: VecDeque<(T, Monotonic)>,
}

impl<T> Default for TimeWindow<T> {
    fn default() -> Self {
        Self {
            entries: VecDeque::new(),
        }
    }
}

impl<T> TimeWindow<T> {
    /// Adds a value. The newest value older than `span` stays, as it was valid at the beginning of the span.
    pub(super) fn add(&mut self, value: T, span: Duration, now: Monotonic) {
        self.entries.push_back((value, now));
        let is_old = |entries: &VecDeque<(T, Monotonic)>| {
            let second = entries.get(1);
            second.is_some_and(|(_, at)| now.since(*at) >= span) || entries.len() > MAX_ENTRIES
        };
        while is_old(&self.entries) {
            self.entries.pop_front();
        }
    }

    pub(super) fn clear(&mut self) {
        self.entries.clear();
    }

    pub(super) fn spans(&self, span: Duration) -> bool {
        let ends = self.entries.front().zip(self.entries.back());
        ends.is_some_and(|((_, first), (_, last))| last.since(*first) >= span)
    }

    pub(super) fn iter(&self) -> impl DoubleEndedIterator<Item = &T> + Clone {
        self.entries.iter().map(|(value, _)| value)
    }
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::message::{BarrierKind, Status};
    use protocol::tile::BootId;

    use super::*;
    use crate::model::ConsoleModel;
    use crate::test_support::{announce_boot, at, idle_teleop_status, inject, scout, status_of};

    fn report_state(model: &mut ConsoleModel, state: CollisionMonitorState, ms: u64) {
        let teleop = Some(TeleopStatus {
            collision_monitor: state,
            ..idle_teleop_status()
        });
        let status = Status {
            teleop,
            ..Status::default()
        };
        inject(model, Topic::Status, &status, at(ms));
    }

    fn reports(model: &ConsoleModel) -> Vec<CollisionMonitorState> {
        model
            .recent_monitor_states()
            .map(|reports| reports.state)
            .collect()
    }

    #[test]
    fn barrier_is_kept_for_one_direction_and_1500_ms() {
        let barrier = |x_m| Barrier {
            position_m: [x_m, 0.0],
            kind: BarrierKind::Mapped,
        };
        let mut model = scout();
        let mut barrier_after = |linear_mps, reports: Option<Barrier>, ms| {
            let mut teleop = TeleopStatus {
                barrier: reports,
                ..idle_teleop_status()
            };
            teleop.requested.linear_mps = linear_mps;
            let status = status_of(teleop);
            inject(&mut model, Topic::Status, &status, at(ms));
            model.barrier()
        };
        assert_eq!(barrier_after(0.5, None, 1_000), None);
        assert_eq!(
            barrier_after(0.5, Some(barrier(1.0)), 1_100),
            Some(barrier(1.0))
        );
        assert_eq!(
            barrier_after(0.7, Some(barrier(2.0)), 1_200),
            Some(barrier(2.0))
        );
        let comes_and_goes = barrier_after(0.5, None, 2_600);
        assert_eq!(comes_and_goes, Some(barrier(2.0)));
        assert_eq!(barrier_after(-0.5, None, 2_650), None, "other direction");
        assert_eq!(barrier_after(0.5, None, 2_700), None);
    }

    #[test]
    fn monitor_states_are_kept_for_1500_ms_within_one_run() {
        let mut model = scout();
        announce_boot(&mut model, BootId([7; 16]), at(0));
        report_state(&mut model, CollisionMonitorState::Off, 1_000);
        report_state(&mut model, CollisionMonitorState::Silent, 1_010);
        report_state(&mut model, CollisionMonitorState::Stale, 2_499);
        assert_eq!(
            reports(&model),
            [
                CollisionMonitorState::Off,
                CollisionMonitorState::Silent,
                CollisionMonitorState::Stale
            ]
        );
        report_state(&mut model, CollisionMonitorState::Stale, 2_510);
        assert_eq!(reports(&model), [CollisionMonitorState::Stale; 2]);
        // After any time without a status.
        report_state(&mut model, CollisionMonitorState::Silent, 9_000);
        assert_eq!(reports(&model), [CollisionMonitorState::Silent]);
        announce_boot(&mut model, BootId([7; 16]), at(9_100));
        assert_eq!(reports(&model), [CollisionMonitorState::Silent], "same run");
        announce_boot(&mut model, BootId([8; 16]), at(9_200));
        assert_eq!(reports(&model), []);
    }

    const SPAN: Duration = Duration::from_secs(3);

    #[test]
    fn window_keeps_values_that_cover_its_span() {
        let mut recent = TimeWindow::default();
        let mut kept = |ms: u64| -> (Vec<u64>, bool) {
            recent.add(ms, SPAN, at(ms));
            (recent.iter().copied().collect(), recent.spans(SPAN))
        };
        assert_eq!(kept(0), (vec![0], false));
        assert_eq!(kept(1_000), (vec![0, 1_000], false));
        assert_eq!(kept(3_999), (vec![0, 1_000, 3_999], true));
        assert_eq!(kept(4_000), (vec![1_000, 3_999, 4_000], true));
        assert_eq!(kept(9_000), (vec![4_000, 9_000], true));
        recent.clear();
        assert!(!recent.spans(SPAN));
    }

    #[test]
    fn window_is_bounded() {
        let mut recent = TimeWindow::default();
        for ms in 0..1_000 {
            recent.add(ms, SPAN, at(ms));
        }
        assert_eq!(recent.iter().count(), MAX_ENTRIES);
    }
}
