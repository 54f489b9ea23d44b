//! What the collision monitor has said of late. Beside an obstacle it may say one thing with one scan and another with
//! the next: whoever reads it is told the tighter of them.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{Barrier, CollisionMonitorState, TeleopStatus, Velocity};

use super::ConsoleModel;
use super::time_window::TimeWindow;

/// Three statuses of a vehicle that nobody drives; words that change more often than this are not read.
const WINDOW: Duration = Duration::from_millis(1500);

/// Less is no speed in two decimals, m/s.
pub const MIN_SHOWN_MPS: f32 = 0.005;
/// Less is no turn in whole degrees, rad/s.
pub const MIN_SHOWN_RADPS: f32 = 0.0087;
/// What a status told of the guard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MonitorReport {
    /// What it said.
    pub guard: CollisionMonitorState,
    /// What was asked for meanwhile: it may speak of that way alone.
    pub requested: Velocity,
    /// What it was that bounded that, where something did.
    pub barrier: Option<Barrier>,
}

/// The same of the last statuses.
#[derive(Clone, Debug, Default)]
pub(super) struct MonitorHistory {
    window: TimeWindow<(MonitorReport, Monotonic)>,
}

impl MonitorHistory {
    /// A status came.
    pub(super) fn update(&mut self, teleop: Option<&TeleopStatus>, now: Monotonic) {
        let Some(teleop) = teleop else {
            return self.forget();
        };
        let report = MonitorReport {
            guard: teleop.collision_monitor,
            requested: teleop.requested,
            barrier: teleop.barrier,
        };
        self.window.add((report, now), WINDOW, now);
    }

    /// Another run of the robot has another guard.
    pub(super) fn forget(&mut self) {
        self.window.clear();
    }

    /// What was told within [`WINDOW`] of the newest, the oldest first.
    fn recent(&self) -> impl DoubleEndedIterator<Item = &MonitorReport> + Clone {
        let newest = self.window.iter().last().map(|(_, at)| *at);
        let is_late = move |at: Monotonic| newest.is_some_and(|newest| newest.since(at) < WINDOW);
        self.window
            .iter()
            .filter(move |(_, at)| is_late(*at))
            .map(|(report, _)| report)
    }
}

impl ConsoleModel {
    /// What the guard said within 1.5 s before the newest status, and in that; the oldest first. It is there to be
    /// read: nothing that commands anything goes by it.
    pub fn recent_monitor_states(&self) -> impl DoubleEndedIterator<Item = &MonitorReport> + Clone {
        self.monitor_history.recent()
    }

    /// What the guard holds the vehicle back for on the way that is asked for, or did lately: it may change its mind with
    /// every scan.
    pub fn barrier(&self) -> Option<Barrier> {
        let mut recent = self.recent_monitor_states().rev().peekable();
        let asked = direction_signs(recent.peek()?.requested);
        let mut of_way = recent.filter(|reports| direction_signs(reports.requested) == asked);
        of_way.find_map(|reports| reports.barrier)
    }
}

/// Whither one goes and turns: 1 forwards and to the left, −1 back and to the right, 0 neither.
pub fn direction_signs(asked: Velocity) -> [i8; 2] {
    let sign = |speed: f32, least: f32| i8::from(speed >= least) - i8::from(speed <= -least);
    [
        sign(asked.linear_mps, MIN_SHOWN_MPS),
        sign(asked.angular_radps, MIN_SHOWN_RADPS),
    ]
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::message::{BarrierKind, Status};
    use protocol::tile::BootId;

    use super::*;
    use crate::test_support::{announce_boot, at, idle_teleop_status, inject, scout};

    /// A status tells this.
    fn tells(model: &mut ConsoleModel, guard: CollisionMonitorState, ms: u64) {
        let teleop = Some(TeleopStatus {
            collision_monitor: guard,
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
            .map(|reports| reports.guard)
            .collect()
    }

    #[test]
    fn what_bounds_the_vehicle_is_known_for_a_second_and_a_half_and_of_one_way() {
        let barrier = |x_m| Barrier {
            position_m: [x_m, 0.0],
            kind: BarrierKind::Mapped,
        };
        let mut model = scout();
        let mut tells = |linear_mps, reports: Option<Barrier>, ms| {
            let mut teleop = TeleopStatus {
                barrier: reports,
                ..idle_teleop_status()
            };
            teleop.requested.linear_mps = linear_mps;
            let status = Status {
                teleop: Some(teleop),
                ..Status::default()
            };
            inject(&mut model, Topic::Status, &status, at(ms));
            model.barrier()
        };
        assert_eq!(tells(0.5, None, 1_000), None);
        assert_eq!(tells(0.5, Some(barrier(1.0)), 1_100), Some(barrier(1.0)));
        assert_eq!(tells(0.7, Some(barrier(2.0)), 1_200), Some(barrier(2.0)));
        let comes_and_goes = tells(0.5, None, 2_600);
        assert_eq!(comes_and_goes, Some(barrier(2.0)));
        assert_eq!(tells(-0.5, None, 2_650), None, "another way");
        assert_eq!(tells(0.5, None, 2_700), None);
    }

    #[test]
    fn what_the_guard_said_counts_for_a_second_and_a_half_and_within_one_run() {
        let mut model = scout();
        announce_boot(&mut model, BootId([7; 16]), at(0));
        tells(&mut model, CollisionMonitorState::Off, 1_000);
        tells(&mut model, CollisionMonitorState::Silent, 1_010);
        tells(&mut model, CollisionMonitorState::Stale, 2_499);
        assert_eq!(
            reports(&model),
            [
                CollisionMonitorState::Off,
                CollisionMonitorState::Silent,
                CollisionMonitorState::Stale
            ]
        );
        tells(&mut model, CollisionMonitorState::Stale, 2_510);
        assert_eq!(reports(&model), [CollisionMonitorState::Stale; 2]);
        // However long no status came.
        tells(&mut model, CollisionMonitorState::Silent, 9_000);
        assert_eq!(reports(&model), [CollisionMonitorState::Silent]);
        announce_boot(&mut model, BootId([7; 16]), at(9_100));
        assert_eq!(
            reports(&model),
            [CollisionMonitorState::Silent],
            "the run that said so"
        );
        announce_boot(&mut model, BootId([8; 16]), at(9_200));
        assert_eq!(reports(&model), []);
    }
}
