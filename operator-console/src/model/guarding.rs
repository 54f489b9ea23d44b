//! What the collision guard has said of late. Beside an obstacle it may say one thing with one scan and another with
//! the next: whoever reads it is told the tighter of them.

use std::time::Duration;

use protocol::message::{Barrier, Guard, TeleopStatus, Velocity};
use robot_edge::clock::Monotonic;

use super::ConsoleModel;
use super::recent::Recent;

/// Three statuses of a vehicle that nobody drives; words that change more often than this are not read.
const LATELY: Duration = Duration::from_millis(1500);

/// Less is no speed in two decimals, m/s.
pub const LEAST_MPS: f32 = 0.005;
/// Less is no turn in whole degrees, rad/s.
pub const LEAST_RADPS: f32 = 0.0087;
/// What a status told of the guard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guarding {
    /// What it said.
    pub guard: Guard,
    /// What was asked for meanwhile: it may speak of that way alone.
    pub requested: Velocity,
    /// What it was that bounded that, where something did.
    pub barrier: Option<Barrier>,
}

/// The same of the last statuses.
#[derive(Clone, Debug, Default)]
pub(super) struct Guardings {
    heard: Recent<(Guarding, Monotonic)>,
}

impl Guardings {
    /// A status came.
    pub(super) fn hear(&mut self, teleop: Option<&TeleopStatus>, now: Monotonic) {
        let Some(teleop) = teleop else {
            return self.forget();
        };
        let guarding = Guarding {
            guard: teleop.guard,
            requested: teleop.requested,
            barrier: teleop.barrier,
        };
        self.heard.add((guarding, now), LATELY, now);
    }

    /// Another run of the robot has another guard.
    pub(super) fn forget(&mut self) {
        self.heard.clear();
    }

    /// What was told within [`LATELY`] of the newest, the oldest first.
    fn lately(&self) -> impl DoubleEndedIterator<Item = &Guarding> + Clone {
        let newest = self.heard.iter().last().map(|(_, at)| *at);
        let is_late = move |at: Monotonic| newest.is_some_and(|newest| newest.since(at) < LATELY);
        self.heard
            .iter()
            .filter(move |(_, at)| is_late(*at))
            .map(|(guarding, _)| guarding)
    }
}

impl ConsoleModel {
    /// What the guard said within 1.5 s before the newest status, and in that; the oldest first. It is there to be
    /// read: nothing that commands anything goes by it.
    pub fn guard_lately(&self) -> impl DoubleEndedIterator<Item = &Guarding> + Clone {
        self.guardings.lately()
    }

    /// What the guard holds the vehicle back for on the way that is asked for, or did lately: it may change its mind with
    /// every scan.
    pub fn barrier(&self) -> Option<Barrier> {
        let mut lately = self.guard_lately().rev().peekable();
        let asked = way(lately.peek()?.requested);
        let mut of_way = lately.filter(|told| way(told.requested) == asked);
        of_way.find_map(|told| told.barrier)
    }
}

/// Whither one goes and turns: 1 forwards and to the left, −1 back and to the right, 0 neither.
pub fn way(asked: Velocity) -> [i8; 2] {
    let sign = |speed: f32, least: f32| i8::from(speed >= least) - i8::from(speed <= -least);
    [
        sign(asked.linear_mps, LEAST_MPS),
        sign(asked.angular_radps, LEAST_RADPS),
    ]
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::message::{BarrierKind, Status};
    use protocol::tile::BootId;

    use super::*;
    use crate::pretend::{at, says, scout, standing, starts};

    /// A status tells this.
    fn tells(model: &mut ConsoleModel, guard: Guard, ms: u64) {
        let teleop = Some(TeleopStatus {
            guard,
            ..standing()
        });
        let status = Status {
            teleop,
            ..Status::default()
        };
        says(model, Topic::Status, &status, at(ms));
    }

    fn told(model: &ConsoleModel) -> Vec<Guard> {
        model.guard_lately().map(|told| told.guard).collect()
    }

    #[test]
    fn what_bounds_the_vehicle_is_known_for_a_second_and_a_half_and_of_one_way() {
        let barrier = |x_m| Barrier {
            position_m: [x_m, 0.0],
            kind: BarrierKind::Mapped,
        };
        let mut model = scout();
        let mut tells = |linear_mps, told: Option<Barrier>, ms| {
            let mut teleop = TeleopStatus {
                barrier: told,
                ..standing()
            };
            teleop.requested.linear_mps = linear_mps;
            let status = Status {
                teleop: Some(teleop),
                ..Status::default()
            };
            says(&mut model, Topic::Status, &status, at(ms));
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
        starts(&mut model, BootId([7; 16]), at(0));
        tells(&mut model, Guard::Off, 1_000);
        tells(&mut model, Guard::Silent, 1_010);
        tells(&mut model, Guard::Stale, 2_499);
        assert_eq!(told(&model), [Guard::Off, Guard::Silent, Guard::Stale]);
        tells(&mut model, Guard::Stale, 2_510);
        assert_eq!(told(&model), [Guard::Stale; 2]);
        // However long no status came.
        tells(&mut model, Guard::Silent, 9_000);
        assert_eq!(told(&model), [Guard::Silent]);
        starts(&mut model, BootId([7; 16]), at(9_100));
        assert_eq!(told(&model), [Guard::Silent], "the run that said so");
        starts(&mut model, BootId([8; 16]), at(9_200));
        assert_eq!(told(&model), []);
    }
}
