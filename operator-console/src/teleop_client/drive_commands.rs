//! When drive commands are sent, one for each token, 50 a second at most, and three within 20 ms after a change of the input, and with
//! which input:
//! a press is delayed until the robot accepts it, so that the robot does not take it for a held key.
//!
//! - After 200 ms of neutral commands a press counts.
//! - Before that, while the motors still brake after a release, a press resumes driving, so that a key that slips does
//!   not stop the vehicle.
//! - In between, the robot would ignore the key until everything is released. The press is therefore delayed until it
//!   counts. The same holds where the collision monitor holds the vehicle, whose motors are at zero even if a boat
//!   coasts: an operator who then reverses changes keys within 200 ms.
//!
//! A goal is named after 200 ms of neutral commands without one, too, and a press while it runs takes over at once.
//!
//! The input is read again in each iteration: a press that was released meanwhile is never sent.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{MapPose, StopReason, TeleopState, TeleopStatus, Velocity};

use super::messages::LatestPose;
use crate::teleop_input::DriveInput;

/// 200 ms of the robot's rule plus the jitter of the link.
const NEUTRAL: Duration = Duration::from_millis(250);
/// A slower vehicle stands still, m/s and rad/s.
const STANDING: f32 = 0.02;
/// A smaller movement of a stick is not sent three times.
const CHANGE: f32 = 0.1;

/// Drive commands under one grant: which input is sent, and when.
pub(super) struct DriveCommands {
    send_rate: SendRateLimiter,
    sent: DriveInput,
    /// Since when only neutral commands were sent.
    neutral_since: Option<Monotonic>,
    /// Until when a command finds the motors still moving, by the last status.
    pub(super) moving_until: Option<Monotonic>,
    /// The goal of the last command.
    sent_goal: Option<MapPose>,
    /// By the last status: then a press takes over at once.
    pub(super) is_goal_running: bool,
}

impl DriveCommands {
    pub(super) const fn new(now: Monotonic) -> Self {
        Self {
            send_rate: SendRateLimiter::new(now),
            sent: DriveInput::NEUTRAL,
            neutral_since: None,
            moving_until: None,
            sent_goal: None,
            is_goal_running: false,
        }
    }

    pub(super) const fn due(&self) -> Monotonic {
        self.send_rate.due()
    }

    /// The input was locked: the robot needs neutral commands again.
    pub(super) const fn interrupt(&mut self) {
        self.neutral_since = None;
    }

    /// The input and the goal to send now, if a command is due: those that are wanted, or neutral and none if the robot would not
    /// accept them yet.
    pub(super) fn next(
        &mut self,
        (input, goal): (DriveInput, Option<MapPose>),
        newest: Option<LatestPose>,
        now: Monotonic,
    ) -> Option<(DriveInput, Option<MapPose>)> {
        let takes_over = self.sent_goal.is_some() && self.is_goal_running;
        let is_accepted = input.is_neutral()
            || !self.sent.is_neutral()
            || takes_over
            || self.is_press_taken(newest, now);
        let input = if is_accepted {
            input
        } else {
            DriveInput::NEUTRAL
        };
        let is_neutral_long = self
            .neutral_since
            .is_some_and(|since| now.since(since) >= NEUTRAL);
        let goal =
            goal.filter(|_| input.is_neutral() && (self.sent_goal.is_some() || is_neutral_long));
        let is_changed = input.is_neutral() != self.sent.is_neutral()
            || goal != self.sent_goal
            || (input.forward - self.sent.forward).abs() >= CHANGE
            || (input.sideways - self.sent.sideways).abs() >= CHANGE
            || (input.left - self.sent.left).abs() >= CHANGE;
        let token = newest.and_then(|newest| newest.token).map(|token| token.n);
        if !self.send_rate.is_due(now, is_changed, token) {
            return None;
        }
        self.sent = input;
        self.sent_goal = goal;
        if input.is_neutral() && goal.is_none() {
            self.neutral_since.get_or_insert(now);
        } else {
            self.neutral_since = None;
        }
        Some((input, goal))
    }

    /// Whether the robot would accept a press now.
    fn is_press_taken(&self, newest: Option<LatestPose>, now: Monotonic) -> bool {
        let Some(since) = self.neutral_since else {
            return false;
        };
        let goes_on = self.moving_until.is_some_and(|until| now < until);
        now.since(since) >= NEUTRAL || goes_on && newest.is_some_and(moves)
    }
}

fn moves(newest: LatestPose) -> bool {
    newest.velocity.iter().any(|speed| speed.abs() >= STANDING)
}

/// Until when a command certainly finds the motors of a driven or released vehicle moving, by a status that arrived at
/// `now`. The output falls no faster than `stop_decel`, m/s² and rad/s², and the collision monitor brakes by the same.
/// `None` if the motors stand, may stand by then, or stop for another reason than release.
pub(super) fn moving_until(
    status: &TeleopStatus,
    stop_decel: Velocity,
    now: Monotonic,
) -> Option<Monotonic> {
    let is_driven = matches!(
        status.state,
        TeleopState::Driving | TeleopState::Stopping(StopReason::Released)
    );
    let Velocity {
        linear_mps,
        lateral_mps,
        angular_radps,
    } = status.applied;
    // Each axis prolongs the stop.
    let braking_s = (linear_mps.abs() / stop_decel.linear_mps)
        .max(lateral_mps.abs() / stop_decel.lateral_mps)
        .max(angular_radps.abs() / stop_decel.angular_radps);
    let braking = Duration::try_from_secs_f32(braking_s).ok()?;
    // The age of a command is the delay of its token plus its own: the delays of this status and of the next press.
    let ways = Duration::from_millis(status.peak_age_ms?.into());
    let left = braking.checked_sub(ways)?;
    is_driven.then(|| now + left)
}

pub(super) const PERIOD: Duration = Duration::from_millis(20);
/// Without a new token a command is as old as the last one: it waits for one, so that a thin link carries as many commands as tokens,
/// but not for longer than this.
const LONGEST_PERIOD: Duration = Duration::from_millis(100);
/// Tokens are slow if none of the last ones was quick. While some are held up (TCP after a loss), commands go on: the more follow, the
/// sooner a lost one is sent again.
const TOKENS: usize = 8;
/// Interval of looking for a new token.
const TOKEN_POLL: Duration = Duration::from_millis(5);
/// Each change of the input is sent three times within 20 ms.
const SENDINGS: u32 = 3;
/// The third leaves 14 ms after the first.
const BETWEEN: Duration = Duration::from_millis(7);
/// The robot accepts 100 messages a second of one operator: ten for an emergency stop, a few for requests.
const PER_SECOND: f64 = 80.0;
/// Commands at once beyond that rate: three changes.
const BURST: f64 = 9.0;

#[derive(Clone, Debug)]
pub(super) struct SendRateLimiter {
    due: Monotonic,
    sent: Monotonic,
    /// The number of the newest token.
    token: Option<u64>,
    token_at: Monotonic,
    is_token_sent: bool,
    /// From token to token.
    token_intervals: [Duration; TOKENS],
    /// Repetitions of the last change that are still due.
    left: u32,
    allowance: f64,
    counted: Monotonic,
}

impl SendRateLimiter {
    pub(super) const fn new(now: Monotonic) -> Self {
        Self {
            due: now,
            sent: now,
            token: None,
            token_at: now,
            is_token_sent: false,
            token_intervals: [PERIOD; TOKENS],
            left: 0,
            allowance: BURST,
            counted: now,
        }
    }

    /// Whether to send a command now, with the token of this number; if so, it counts as sent.
    pub(super) fn is_due(&mut self, now: Monotonic, is_changed: bool, token: Option<u64>) -> bool {
        if token != self.token {
            self.token_intervals.rotate_left(1);
            self.token_intervals[TOKENS - 1] = now.since(self.token_at);
            (self.token, self.token_at, self.is_token_sent) = (token, now, false);
        }
        let elapsed_s = now.since(self.counted).as_secs_f64();
        self.counted = self.counted.max(now);
        self.allowance = (self.allowance + PER_SECOND * elapsed_s).min(BURST);
        if is_changed {
            self.left = SENDINGS;
            self.due = self.due.min(now);
        }
        if now < self.due {
            return false;
        }
        let quickest = self
            .token_intervals
            .into_iter()
            .fold(LONGEST_PERIOD, Duration::min);
        if self.left == 0 && self.is_token_sent && now.since(self.sent) < quickest {
            self.due = now + TOKEN_POLL;
            return false;
        }
        if self.allowance < 1.0 {
            self.due = now + Duration::from_secs_f64((1.0 - self.allowance) / PER_SECOND);
            return false;
        }
        self.allowance -= 1.0;
        self.sent = now;
        self.is_token_sent = true;
        self.left = self.left.saturating_sub(1);
        // A slightly late loop keeps the rate; a suspended one restarts.
        let on_time = self.due + PERIOD;
        self.due = if self.left > 0 {
            now + BETWEEN
        } else if on_time > now {
            on_time
        } else {
            now + PERIOD
        };
        true
    }

    pub(super) const fn due(&self) -> Monotonic {
        self.due
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::LeaseEnd;

    use super::*;
    use crate::test_support::{at, idle_teleop_status};

    const STOP_DECEL: Velocity = Velocity {
        linear_mps: 1.0,
        lateral_mps: 0.0,
        angular_radps: 4.0,
    };

    fn after(change: impl FnOnce(&mut TeleopStatus)) -> Option<Monotonic> {
        let mut status = TeleopStatus {
            state: TeleopState::Driving,
            applied: Velocity {
                linear_mps: -0.5,
                lateral_mps: 0.0,
                angular_radps: 0.0,
            },
            peak_age_ms: Some(60),
            ..idle_teleop_status()
        };
        change(&mut status);
        moving_until(&status, STOP_DECEL, at(1_000))
    }

    #[test]
    fn motors_move_for_braking_time_minus_delays() {
        assert_eq!(after(|_| {}), Some(at(1_440)));
        assert_eq!(after(|status| status.applied.linear_mps = 0.05), None);
        // 3 rad/s at 4 rad/s² take 0.75 s: the longer of the two counts.
        let turning = after(|status| status.applied.angular_radps = 3.0);
        assert_eq!(turning, Some(at(1_690)));
        assert_eq!(after(|status| status.peak_age_ms = Some(600)), None);
        assert_eq!(after(|status| status.peak_age_ms = None), None);
        for nonsense in [f32::INFINITY, f32::NAN] {
            let actual = after(|status| {
                status.applied = Velocity {
                    linear_mps: nonsense,
                    lateral_mps: 0.0,
                    angular_radps: nonsense,
                };
            });
            assert_eq!(actual, None, "{nonsense}");
        }
        let unknown = Velocity::default();
        let driving = TeleopStatus {
            state: TeleopState::Driving,
            applied: STOP_DECEL,
            peak_age_ms: Some(60),
            ..idle_teleop_status()
        };
        assert_eq!(moving_until(&driving, unknown, at(1_000)), None);
    }

    #[test]
    fn only_stop_by_release_is_taken_back() {
        for (state, is_taken_back) in [
            (TeleopState::Stopping(StopReason::Released), true),
            (TeleopState::Stopping(StopReason::Age), false),
            (
                TeleopState::Stopping(StopReason::CollisionMonitorStale),
                false,
            ),
            (
                TeleopState::Stopping(StopReason::LeaseEnded(LeaseEnd::TakenOver)),
                false,
            ),
            (TeleopState::Held, false),
            (TeleopState::EStop, false),
        ] {
            let until = after(|status| status.state = state);
            assert_eq!(until.is_some(), is_taken_back, "{state:?}");
        }
    }

    fn sent(changes: impl Fn(u64) -> bool, until_ms: u64) -> Vec<u64> {
        let mut send_rate = SendRateLimiter::new(at(0));
        let times = (0..until_ms).filter(|ms| send_rate.is_due(at(*ms), changes(*ms), Some(*ms)));
        times.collect()
    }

    #[test]
    fn fifty_a_second_without_a_change() {
        assert_eq!(sent(|_| false, 100), [0, 20, 40, 60, 80]);
        assert_eq!(sent(|_| false, 10_000).len(), 500);
    }

    #[test]
    fn thin_link_carries_a_command_for_each_token() {
        let times = |token_at: fn(u64) -> u64| {
            let mut send_rate = SendRateLimiter::new(at(0));
            let is_due = |ms: &u64| {
                let is_changed = *ms == 1_031;
                send_rate.is_due(at(*ms), is_changed, Some(token_at(*ms)))
            };
            let times: Vec<_> = (0..1_250).filter(is_due).collect();
            times[times.partition_point(|ms| *ms < 1_000)..].to_vec()
        };
        // The change does not wait.
        assert_eq!(times(|ms| ms / 80), [1_031, 1_038, 1_045, 1_120, 1_200]);
        // Some tokens that are held up are no reason.
        let held_up = |ms| if ms < 900 { ms / 20 } else { 45 };
        let all = [
            1_000, 1_020, 1_031, 1_038, 1_045, 1_065, 1_085, 1_105, 1_125, 1_145, 1_165, 1_185,
            1_205, 1_225, 1_245,
        ];
        assert_eq!(times(held_up), all);
    }

    #[test]
    fn late_loop_still_sends_50_hz() {
        let mut send_rate = SendRateLimiter::new(at(0));
        let (mut ms, mut sent) = (0, 0);
        while ms < 10_000 {
            sent += usize::from(send_rate.is_due(at(ms), false, Some(ms)));
            ms = send_rate.due().since(at(0)).as_millis() as u64 + 3;
        }
        assert!((498..=500).contains(&sent), "{sent}");
    }

    #[test]
    fn change_is_sent_three_times_within_20_ms() {
        assert_eq!(sent(|ms| ms == 31, 80), [0, 20, 31, 38, 45, 65]);
        assert_eq!(
            sent(|ms| ms == 31 || ms == 36, 80),
            [0, 20, 31, 36, 43, 50, 70]
        );
    }

    #[test]
    fn moving_stick_stays_within_the_rate_limit() {
        for every_ms in [1, 10, 15] {
            let sent = sent(|ms| ms % every_ms == 0, 10_000).len();
            assert!((500..=809).contains(&sent), "{every_ms}: {sent}");
        }
    }
}
