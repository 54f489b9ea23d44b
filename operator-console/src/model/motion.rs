//! How a vehicle moves, and whether that is what its motors are told: it goes or is stuck, still brakes, lies still, or
//! something else moves it.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{Info, Pose, Status, TeleopState};

use super::standstill_detector::StandstillDetector;
use super::stuck_detector::StuckDetector;
use super::{ConsoleModel, LinkState, SILENT_AFTER_UNSTEADY};

/// A vehicle that is slower than this stands, m/s and rad/s.
pub(super) const MOVING: f32 = 0.05;
/// Wind and current seldom carry a boat that is faster than this, m/s.
pub const DRIFTING_MPS: f32 = 0.5;
/// A vehicle may stand so much later than its stopping ramp says: drives lag, and a speed is measured over a while.
const LAG: Duration = Duration::from_secs(1);
/// No vehicle takes longer to stop.
const LONGEST_RAMP: Duration = Duration::from_secs(30);

/// What moves a vehicle that nobody drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UncommandedMotion {
    /// Its own program, or a simulated tour.
    Autonomous,
    /// That, or a current that is faster than usual: of a boat nobody knows.
    MaybeDrifting,
}

/// What its statuses tell of how a vehicle moves.
#[derive(Clone, Debug, Default)]
pub(super) struct Motion {
    pub(super) stuck_detector: StuckDetector,
    pub(super) standstill: StandstillDetector,
    braking: Braking,
}

impl Motion {
    /// The robot tells what its motors are told; `pose` is the newest.
    pub(super) fn update(
        &mut self,
        status: &Status,
        pose: Option<&Pose>,
        info: Option<&Info>,
        now: Monotonic,
    ) {
        self.stuck_detector.update(status, pose, now);
        self.standstill.update(pose, now);
        self.braking.update(status, pose, info, now);
    }
}

/// Until when a vehicle may move that was told to stand, whoever told it: its operator, the collision monitor, or a stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Braking {
    /// Whether its motors were told to move when they were heard of last.
    is_commanded: bool,
    stops_by: Option<Monotonic>,
}

impl Braking {
    fn update(
        &mut self,
        status: &Status,
        pose: Option<&Pose>,
        info: Option<&Info>,
        now: Monotonic,
    ) {
        let applied = status.teleop.as_ref().map(|teleop| teleop.applied);
        let is_commanded = applied.is_some_and(|commanded| {
            commanded.linear_mps.abs() > 0.0 || commanded.angular_radps.abs() > 0.0
        });
        let was_commanded = std::mem::replace(&mut self.is_commanded, is_commanded);
        if is_commanded {
            self.stops_by = None;
        } else if was_commanded {
            let ramp = pose.zip(info).map(|(pose, info)| ramp(pose, info));
            self.stops_by = Some(now + ramp.unwrap_or_default() + LAG);
        }
    }

    fn may_move(self, now: Monotonic) -> bool {
        self.stops_by.is_some_and(|stops_by| now < stops_by)
    }
}

/// How long a vehicle takes that brakes as hard as it does in stops.
fn ramp(pose: &Pose, info: &Info) -> Duration {
    let axes = [
        (pose.speed_mps, info.stop_decel_mps2),
        (pose.turn_rate_radps, info.stop_decel_radps2),
    ];
    let ramps = axes.map(|(speed, decel)| {
        // One that has not told how hard it brakes has none.
        Duration::try_from_secs_f32(speed.abs() / decel).unwrap_or_default()
    });
    ramps[0].max(ramps[1]).min(LONGEST_RAMP)
}

impl ConsoleModel {
    /// The speed of a vehicle that moves, forwards, m/s; `None` where it stands.
    pub fn moves(&self) -> Option<f32> {
        let (pose, _) = self.vehicle.pose()?;
        let is_moving = pose.speed_mps.abs() >= MOVING || pose.turn_rate_radps.abs() >= MOVING;
        is_moving.then_some(pose.speed_mps)
    }

    /// Whether it moves because it was told to stand a moment ago, and brakes. What floats does not brake.
    pub fn brakes(&self, now: Monotonic) -> bool {
        self.moves().is_some() && !self.floats() && self.motion.braking.may_move(now)
    }

    /// What moves a vehicle that nobody drives, where it is heard and does.
    pub fn uncommanded_motion(&self, now: Monotonic) -> Option<UncommandedMotion> {
        let teleop = self.teleop()?;
        let (_, at) = self.vehicle.pose()?;
        let is_fresh = self.connection.state(now) == LinkState::Live
            && now.since(at) <= SILENT_AFTER_UNSTEADY
            && !self.reports_ended()
            && !self.awaits_status();
        let is_undriven = teleop.state == TeleopState::Idle && !self.brakes(now);
        let speed_mps = self.moves().filter(|_| is_fresh && is_undriven)?;
        if self.floats() {
            (speed_mps.abs() > DRIFTING_MPS).then_some(UncommandedMotion::MaybeDrifting)
        } else {
            Some(UncommandedMotion::Autonomous)
        }
    }

    /// Whether it is a boat, as far as it has said what it is.
    pub fn is_boat(&self) -> bool {
        self.info().is_some_and(|info| info.is_boat)
    }

    fn floats(&self) -> bool {
        self.is_boat() || self.teleop().is_some_and(|teleop| teleop.is_drifting)
    }
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::message::Velocity;
    use protocol::tile::BootId;

    use super::*;
    use crate::model::RequestId;
    use crate::test_support::{
        announce_boot, at, idle_teleop_status, inject, inject_reply, pose_at_rest, scout,
    };

    fn robot(is_boat: bool) -> ConsoleModel {
        let mut model = scout();
        let info = Info {
            is_boat,
            stop_decel_mps2: 1.0,
            ..Info::default()
        };
        inject_reply(&mut model, RequestId(0), Topic::Info, &info, at(0));
        model
    }

    /// At a time, ms, it does this: it moves so fast, and its motors are told another speed, m/s.
    fn hears(
        model: &mut ConsoleModel,
        ms: u64,
        state: TeleopState,
        [speed_mps, linear_mps]: [f32; 2],
    ) {
        let pose = Pose {
            speed_mps,
            ..pose_at_rest()
        };
        let mut teleop = idle_teleop_status();
        teleop.state = state;
        teleop.applied = Velocity {
            linear_mps,
            angular_radps: 0.0,
        };
        let status = Status {
            teleop: Some(teleop),
            ..Status::default()
        };
        inject(model, Topic::Pose, &pose, at(ms));
        inject(model, Topic::Status, &status, at(ms));
    }

    #[test]
    fn who_was_told_to_stand_brakes_as_long_as_that_takes_whoever_told_it() {
        for (cut, after) in [
            // The guard, before the key is let go.
            (TeleopState::Driving, TeleopState::Held),
            (TeleopState::EStop, TeleopState::EStop),
            (TeleopState::Held, TeleopState::Idle),
        ] {
            let mut model = robot(false);
            hears(&mut model, 500, TeleopState::Driving, [1.0, 1.0]);
            assert!(!model.brakes(at(500)), "it is told to go");
            hears(&mut model, 1_000, cut, [0.8, 0.0]);
            hears(&mut model, 1_500, after, [0.5, 0.0]);
            // 0.8 s of braking and 1 s of lag.
            let brakes = [1_000, 1_500, 2_790, 2_810].map(|ms| model.brakes(at(ms)));
            assert_eq!(brakes, [true, true, true, false], "{after:?}");
            hears(&mut model, 2_000, after, [0.01, 0.0]);
            assert!(!model.brakes(at(2_000)), "it stands");
        }
    }

    #[test]
    fn who_was_never_told_to_go_does_not_brake_and_what_floats_cannot() {
        let mut pushed = robot(false);
        for ms in [1_000, 1_500] {
            hears(&mut pushed, ms, TeleopState::Held, [0.5, 0.0]);
        }
        assert!(!pushed.brakes(at(1_500)));
        let mut boat = robot(true);
        hears(&mut boat, 1_000, TeleopState::Driving, [1.0, 1.0]);
        hears(&mut boat, 1_500, TeleopState::Held, [0.9, 0.0]);
        assert!(!boat.brakes(at(1_500)));
    }

    #[test]
    fn what_moves_a_vehicle_that_nobody_drives_is_known_while_it_is_heard() {
        let moved_by = |is_boat, state, speeds, ms| {
            let mut model = robot(is_boat);
            hears(&mut model, 1_000, TeleopState::Idle, [0.0; 2]);
            hears(&mut model, 1_500, state, speeds);
            model.uncommanded_motion(at(ms))
        };
        let idle = TeleopState::Idle;
        let by_itself = Some(UncommandedMotion::Autonomous);
        assert_eq!(moved_by(false, idle, [-0.5, 0.0], 1_600), by_itself);
        assert_eq!(moved_by(false, idle, [0.01, 0.0], 1_600), None, "it stands");
        assert_eq!(moved_by(false, TeleopState::Held, [0.5, 0.0], 1_600), None);
        assert_eq!(moved_by(false, idle, [0.5, 0.0], 9_000), None, "silent");
        assert_eq!(moved_by(true, idle, [0.4, 0.0], 1_600), None, "it drifts");
        let or_adrift = Some(UncommandedMotion::MaybeDrifting);
        assert_eq!(moved_by(true, idle, [1.5, 0.0], 1_600), or_adrift);
        // Who has given back a vehicle that brakes has not left it to itself.
        let mut left = robot(false);
        hears(&mut left, 1_000, TeleopState::Driving, [1.0, 1.0]);
        hears(&mut left, 1_500, idle, [0.5, 0.0]);
        assert_eq!(left.uncommanded_motion(at(1_500)), None);
        // It has restarted: what it does now, it has not said.
        let mut restarted = robot(false);
        hears(&mut restarted, 1_000, idle, [0.5, 0.0]);
        assert_eq!(restarted.uncommanded_motion(at(1_100)), by_itself);
        announce_boot(&mut restarted, BootId([9; 16]), at(1_200));
        assert!(restarted.awaits_status());
        assert_eq!(restarted.uncommanded_motion(at(1_200)), None);
    }
}
