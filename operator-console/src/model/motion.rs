//! Detects from poses and motor commands whether a vehicle is stuck, still brakes, stands still, or moves without a
//! command.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{Info, Pose, Status, TeleopState, Velocity};

use super::monitor_history::TimeWindow;

/// A slower vehicle stands still, m/s and rad/s.
pub(super) const MOVING: f32 = 0.05;
/// Wind and current seldom move a boat faster, m/s.
pub const DRIFTING_MPS: f32 = 0.5;
/// A vehicle may stop this much later than its stopping ramp: drives lag, and speed is measured over some time.
const LAG: Duration = Duration::from_secs(1);
const LONGEST_RAMP: Duration = Duration::from_secs(30);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UncommandedMotion {
    /// Its own program, or the route of a simulated world.
    Autonomous,
    /// Of a boat: its own program or an unusually fast current.
    MaybeDrifting,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Motion {
    pub(super) stuck_detector: StuckDetector,
    pub(super) standstill: StandstillDetector,
    pub(super) braking: Braking,
}

impl Motion {
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

/// Until when a vehicle may move after a stop command of its operator, the collision monitor or a stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Braking {
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
            commanded.linear_mps.abs() > 0.0
                || commanded.lateral_mps.abs() > 0.0
                || commanded.angular_radps.abs() > 0.0
        });
        let was_commanded = std::mem::replace(&mut self.is_commanded, is_commanded);
        if is_commanded {
            self.stops_by = None;
        } else if was_commanded {
            let ramp = pose.zip(info).map(|(pose, info)| ramp(pose, info));
            self.stops_by = Some(now + ramp.unwrap_or_default() + LAG);
        }
    }

    pub(super) fn may_move(self, now: Monotonic) -> bool {
        self.stops_by.is_some_and(|stops_by| now < stops_by)
    }
}

/// Time to stop from the present speed with the deceleration of stops.
fn ramp(pose: &Pose, info: &Info) -> Duration {
    let axes = [
        (pose.ground_speed_mps(), info.stop_decel_mps2),
        (pose.turn_rate_radps, info.stop_decel_radps2),
    ];
    let ramps = axes.map(|(speed, decel)| {
        // Unknown deceleration gives no time.
        Duration::try_from_secs_f32(speed.abs() / decel).unwrap_or_default()
    });
    ramps[0].max(ramps[1]).min(LONGEST_RAMP)
}

/// The vehicle must have been in place for this long.
const MIN_TIME: Duration = Duration::from_secs(3);
/// Limit of movement, metres: 0.05 m/s for that time. Positions accurate to 2 cm differ by less; with worse ones a
/// vehicle never counts as still.
const MAX_DRIFT_M: f64 = 0.15;

/// Detects standstill by positions: the speed is along the x axis only, so it misses sideways drift, and it is noisy
/// with GNSS.
#[derive(Clone, Debug, Default)]
pub(super) struct StandstillDetector {
    places_m: TimeWindow<[f64; 2]>,
    pub(super) is_still: bool,
}

impl StandstillDetector {
    fn update(&mut self, pose: Option<&Pose>, now: Monotonic) {
        let Some(pose) = pose else {
            *self = Self::default();
            return;
        };
        let [x_m, y_m, _] = pose.position_m;
        self.places_m.add([x_m, y_m], MIN_TIME, now);
        let mut places_m = self.places_m.iter();
        let has_stayed = places_m.all(|[was_x_m, was_y_m]| {
            let (dx_m, dy_m) = (x_m - was_x_m, y_m - was_y_m);
            dx_m * dx_m + dy_m * dy_m < MAX_DRIFT_M * MAX_DRIFT_M
        });
        // Without enough positions the measured speed decides.
        let is_slow = pose.ground_speed_mps().abs() < MOVING || self.places_m.spans(MIN_TIME);
        self.is_still = has_stayed && is_slow && pose.turn_rate_radps.abs() < MOVING;
    }
}

/// Below this speed friction and waves explain a difference, m/s.
const MIN_COMMAND_MPS: f32 = 0.3;
/// A vehicle with less than this share of the commanded speed does not follow.
const SHARE: f32 = 0.1;
/// Speed noise of a vehicle at rest, m/s: positions accurate to 2 cm, half a second apart, give a standard deviation of
/// 0.06 m/s. One such value is no motion; the mean of some seconds is.
const NOISE_MPS: f32 = 0.25;
/// A vehicle that is faster by this much in the newer half of the window than in the older one accelerates, m/s. For
/// example, a boat that still coasted the other way has to come to rest first. Noise seldom reaches half of it.
const ACCELERATING_MPS: f32 = 0.125;
/// Boats and heavy vehicles need time to start.
const PATIENCE: Duration = Duration::from_secs(3);

#[derive(Clone, Debug, Default)]
pub(super) struct StuckDetector {
    /// Measured speed minus the least speed of a vehicle that follows, m/s, at each status since the command.
    speed_excess: TimeWindow<f32>,
}

impl StuckDetector {
    fn update(&mut self, status: &Status, pose: Option<&Pose>, now: Monotonic) {
        let driven = status.teleop.as_ref();
        let driven = driven.filter(|teleop| teleop.state == TeleopState::Driving);
        let commanded = driven.map(|teleop| {
            let Velocity {
                linear_mps,
                lateral_mps,
                ..
            } = teleop.applied;
            (linear_mps.hypot(lateral_mps), linear_mps, lateral_mps)
        });
        let commanded = commanded.filter(|(speed_mps, ..)| *speed_mps >= MIN_COMMAND_MPS);
        let Some(((commanded_mps, linear_mps, lateral_mps), pose)) = commanded.zip(pose) else {
            return self.speed_excess.clear();
        };
        // In the direction of the command.
        let goes_mps =
            (pose.speed_mps * linear_mps + pose.lateral_mps * lateral_mps) / commanded_mps;
        let least_mps = SHARE * commanded_mps;
        // A vehicle that moves the other way is not stuck; it has to turn about.
        if goes_mps >= least_mps.max(NOISE_MPS) || goes_mps <= -NOISE_MPS {
            return self.speed_excess.clear();
        }
        self.speed_excess.add(goes_mps - least_mps, PATIENCE, now);
    }

    /// By the last status: a lost link does not make a vehicle stuck.
    pub(super) fn is_stuck(&self) -> bool {
        self.speed_excess.spans(PATIENCE)
            && self.speed_excess.iter().sum::<f32>() < 0.0
            && !self.is_accelerating()
    }

    fn is_accelerating(&self) -> bool {
        let half = self.speed_excess.iter().count() / 2;
        let newer: f32 = self.speed_excess.iter().rev().take(half).sum();
        let older: f32 = self.speed_excess.iter().take(half).sum();
        newer - older >= ACCELERATING_MPS * half as f32
    }
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::tile::BootId;

    use super::*;
    use crate::model::{ConsoleModel, RequestId};
    use crate::test_support::{
        STORED_ESTOP, announce_boot, at, idle_teleop_status, inject, inject_reply, pose_at_rest,
        scout, status_of,
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

    /// At `ms` the vehicle has this speed, and its motors have this command, m/s.
    fn hears(
        model: &mut ConsoleModel,
        ms: u64,
        state: TeleopState,
        [speed_mps, linear_mps]: [f32; 2],
    ) {
        inject(model, Topic::Pose, &pose(speed_mps), at(ms));
        let status = commanded(state, linear_mps);
        inject(model, Topic::Status, &status, at(ms));
    }

    #[test]
    fn braking_lasts_for_the_stopping_ramp_of_any_stop() {
        for (cut, after) in [
            // The collision monitor, before the key is released.
            (TeleopState::Driving, TeleopState::Held),
            (TeleopState::EStop, TeleopState::EStop),
            (TeleopState::Held, TeleopState::Idle),
        ] {
            let mut model = robot(false);
            hears(&mut model, 500, TeleopState::Driving, [1.0, 1.0]);
            assert!(!model.brakes(at(500)), "it is commanded to move");
            hears(&mut model, 1_000, cut, [0.8, 0.0]);
            hears(&mut model, 1_500, after, [0.5, 0.0]);
            // 0.8 s of braking and 1 s of lag.
            let brakes = [1_000, 1_500, 2_790, 2_810].map(|ms| model.brakes(at(ms)));
            assert_eq!(brakes, [true, true, true, false], "{after:?}");
            hears(&mut model, 2_000, after, [0.01, 0.0]);
            assert!(!model.brakes(at(2_000)), "at rest");
        }
    }

    #[test]
    fn undriven_vehicles_and_boats_do_not_brake() {
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
    fn uncommanded_motion_is_known_with_live_data() {
        let moved_by = |is_boat, state, speeds, ms| {
            let mut model = robot(is_boat);
            hears(&mut model, 1_000, TeleopState::Idle, [0.0; 2]);
            hears(&mut model, 1_500, state, speeds);
            model.uncommanded_motion(at(ms))
        };
        let idle = TeleopState::Idle;
        let by_itself = Some(UncommandedMotion::Autonomous);
        assert_eq!(moved_by(false, idle, [-0.5, 0.0], 1_600), by_itself);
        assert_eq!(moved_by(false, idle, [0.01, 0.0], 1_600), None, "at rest");
        assert_eq!(moved_by(false, TeleopState::Held, [0.5, 0.0], 1_600), None);
        assert_eq!(moved_by(false, idle, [0.5, 0.0], 9_000), None, "silent");
        assert_eq!(moved_by(true, idle, [0.4, 0.0], 1_600), None, "it drifts");
        let or_adrift = Some(UncommandedMotion::MaybeDrifting);
        assert_eq!(moved_by(true, idle, [1.5, 0.0], 1_600), or_adrift);
        // A simulated boat on the route of its world, until an operator drives or stops it.
        for (source, epoch, is_stopped, expected) in [
            ("lake", 0, false, by_itself),
            ("", 0, false, or_adrift),
            ("lake", 1, false, or_adrift),
            ("lake", 0, true, or_adrift),
        ] {
            let mut boat = scout();
            let info = Info {
                is_boat: true,
                source: source.to_owned(),
                ..Info::default()
            };
            inject_reply(&mut boat, RequestId(0), Topic::Info, &info, at(0));
            if is_stopped {
                let mut teleop = idle_teleop_status();
                teleop.state = TeleopState::EStop;
                teleop.estop = Some(STORED_ESTOP);
                inject(&mut boat, Topic::Status, &status_of(teleop), at(1_000));
            }
            inject(&mut boat, Topic::Pose, &pose(1.5), at(1_500));
            let mut teleop = idle_teleop_status();
            teleop.lease.epoch = epoch;
            inject(&mut boat, Topic::Status, &status_of(teleop), at(1_500));
            let moved_by = boat.uncommanded_motion(at(1_600));
            assert_eq!(moved_by, expected, "{source} {epoch} {is_stopped}");
        }
        // A vehicle that brakes after a release is not autonomous.
        let mut left = robot(false);
        hears(&mut left, 1_000, TeleopState::Driving, [1.0, 1.0]);
        hears(&mut left, 1_500, idle, [0.5, 0.0]);
        assert_eq!(left.uncommanded_motion(at(1_500)), None);
        // After a restart the motion is unknown until the first status.
        let mut restarted = robot(false);
        hears(&mut restarted, 1_000, idle, [0.5, 0.0]);
        assert_eq!(restarted.uncommanded_motion(at(1_100)), by_itself);
        announce_boot(&mut restarted, BootId([9; 16]), at(1_200));
        assert!(restarted.awaits_status());
        assert_eq!(restarted.uncommanded_motion(at(1_200)), None);
    }

    /// Whether a vehicle stands still that was at these positions, metres forward and left, at 2 Hz, with this measured
    /// speed, m/s.
    fn is_still(places_m: &[[f64; 2]], speed_mps: f32) -> bool {
        let mut detector = StandstillDetector::default();
        for (half_s, [x_m, y_m]) in (0_u64..).zip(places_m) {
            let pose = Pose {
                position_m: [*x_m, *y_m, 0.0],
                speed_mps,
                ..pose_at_rest()
            };
            detector.update(Some(&pose), at(500 * half_s));
        }
        detector.is_still
    }

    #[test]
    fn constant_position_is_standstill_at_any_measured_speed() {
        let noisy: Vec<_> = (0..8).map(|n| [0.03 * f64::from(n % 2), 0.0]).collect();
        assert!(is_still(&noisy, 0.12));
        let drifts_aside: Vec<_> = (0..8).map(|n| [0.0, 0.04 * f64::from(n)]).collect();
        assert!(
            !is_still(&drifts_aside, 0.0),
            "0.08 m/s, none of it forwards"
        );
        let mut came: Vec<_> = vec![[1.0, 0.0]; 3];
        came.extend([[0.0; 2]; 6]);
        assert!(!is_still(&came, 0.0), "not for long enough");
        came.push([0.0; 2]);
        assert!(is_still(&came, 0.0));
    }

    #[test]
    fn standstill_after_joining_uses_the_speed() {
        assert!(is_still(&[[0.0; 2]], 0.04));
        assert!(!is_still(&[[0.0; 2]], -0.2));
        let mut detector = StandstillDetector::default();
        detector.update(Some(&pose_at_rest()), at(0));
        detector.update(None, at(500));
        assert!(!detector.is_still, "new run");
        let swings = Pose {
            turn_rate_radps: 0.1,
            ..pose_at_rest()
        };
        detector.update(Some(&swings), at(1_000));
        assert!(!detector.is_still);
    }

    fn commanded(state: TeleopState, linear_mps: f32) -> Status {
        let mut teleop = idle_teleop_status();
        teleop.state = state;
        teleop.applied = Velocity {
            linear_mps,
            lateral_mps: 0.0,
            angular_radps: 0.0,
        };
        status_of(teleop)
    }

    fn pose(speed_mps: f32) -> Pose {
        Pose {
            speed_mps,
            ..pose_at_rest()
        }
    }

    #[test]
    fn commanded_vehicle_without_motion_is_stuck() {
        let stuck_after = |status: &Status, speed_mps: f32| {
            let mut detector = StuckDetector::default();
            (0..20_u64).find(|half_s| {
                let now = at(500 * half_s);
                detector.update(status, Some(&pose(speed_mps)), now);
                detector.is_stuck()
            })
        };
        let driving = TeleopState::Driving;
        for (state, commanded_mps, speed_mps, expected) in [
            // Aground, ahead and astern.
            (driving, 1.68, -0.05, Some(6)),
            (driving, -1.68, 0.1, Some(6)),
            // It goes.
            (driving, 1.68, 0.2, None),
            (driving, -1.68, -0.2, None),
            // It creeps.
            (driving, 0.2, 0.0, None),
            (TeleopState::Held, 1.68, 0.0, None),
        ] {
            let status = commanded(state, commanded_mps);
            let after = stuck_after(&status, speed_mps);
            assert_eq!(after, expected, "{commanded_mps} {speed_mps}");
        }
    }

    #[test]
    fn motion_in_between_is_not_stuck() {
        let status = commanded(TeleopState::Driving, 1.0);
        let mut detector = StuckDetector::default();
        for (ms, speed_mps, is_stuck) in [
            (0, 0.0, false),
            (2_500, 0.0, false),
            (2_900, 0.5, false),
            (3_400, 0.0, false),
            (6_300, 0.0, false),
            (6_400, 0.0, true),
        ] {
            detector.update(&status, Some(&pose(speed_mps)), at(ms));
            assert_eq!(detector.is_stuck(), is_stuck, "{ms}");
        }
        // No pose.
        detector.update(&status, None, at(7_000));
        assert!(!detector.is_stuck());
    }

    #[test]
    fn noise_is_no_motion_but_creeping_is() {
        // Commanded 0.6 m/s, twice a second: which of these statuses report that it is stuck?
        let stuck_at = |speeds_mps: &[f32]| -> Vec<usize> {
            let mut detector = StuckDetector::default();
            let heard = (0_u64..).zip(speeds_mps).map(|(half_s, speed_mps)| {
                let status = commanded(TeleopState::Driving, 0.6);
                detector.update(&status, Some(&pose(*speed_mps)), at(500 * half_s));
                detector.is_stuck()
            });
            let heard: Vec<_> = heard.collect();
            (0..heard.len()).filter(|status| heard[*status]).collect()
        };
        let aground = [0.0, 0.11, -0.12, 0.08, -0.07, 0.02, -0.05, 0.15, -0.13, 0.3];
        assert_eq!(stuck_at(&aground), [6, 7, 8], "then it is free");
        assert_eq!(stuck_at(&[0.1; 10]), [0; 0], "of 0.6 that is going");
    }

    #[test]
    fn reversing_boat_is_not_stuck_while_it_accelerates() {
        let is_ever_stuck = |commanded_mps: f32, speeds_mps: &[f32]| {
            let mut detector = StuckDetector::default();
            (0_u64..).zip(speeds_mps).any(|(half_s, speed_mps)| {
                let status = commanded(TeleopState::Driving, commanded_mps);
                detector.update(&status, Some(&pose(*speed_mps)), at(500 * half_s));
                detector.is_stuck()
            })
        };
        // From forward to 0.3 m/s backward, at the pace of the simulated boat.
        let turns_about = [
            1.2, 0.9, 0.65, 0.45, 0.3, 0.2, 0.1, 0.02, -0.05, -0.11, -0.15, -0.19, -0.22, -0.24,
        ];
        assert!(!is_ever_stuck(-0.3, &turns_about));
        let mirrored = turns_about.map(|speed_mps| -speed_mps);
        assert!(!is_ever_stuck(0.3, &mirrored));
        // A vehicle that a strong current carries the other way is not stuck.
        assert!(!is_ever_stuck(0.5, &[-0.4; 12]));
        let run_aground = [-1.0, -0.3, 0.0, 0.02, -0.03, 0.0, 0.01, 0.0, -0.02, 0.0];
        assert!(is_ever_stuck(0.5, &run_aground));
    }

    #[test]
    fn lost_link_is_not_stuck() {
        let mut detector = StuckDetector::default();
        let driving = commanded(TeleopState::Driving, 1.0);
        for ms in [0, 500] {
            detector.update(&driving, Some(&pose(0.0)), at(ms));
        }
        assert!(!detector.is_stuck(), "whatever the time is now");
    }
}
