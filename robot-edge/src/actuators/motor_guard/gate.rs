//! Which of the velocities that arrive the motors may be told: the part of the guard that decides, without a clock.

use super::WATCHDOG;
use super::frame::{COMMAND_BYTES, MotorCommand};
use crate::actuators::report::{Counters, Hold};
use measurement::time::Monotonic;
use teleop::Velocity;

/// Bytes of garbage in a row, as many as three frames have, after which what came before no longer counts.
const GARBAGE_LIMIT: usize = 3 * COMMAND_BYTES;

/// Lets a velocity pass only while it is young.
///
/// A velocity holds for [`WATCHDOG`] from the moment on at which the edge decided on it, by the clock that both share:
/// how long it was on the way counts, and what comes late is not obeyed at all. After a gap, and at the start, motors
/// stand until the edge has asked for zero.
#[derive(Clone, Debug)]
pub(super) struct Gate {
    newest: Option<MotorCommand>,
    greatest_sequence: u64,
    hold: Option<Hold>,
    garbage_in_a_row: usize,
    dropouts: u32,
    stale: u32,
    garbage: u32,
}

impl Gate {
    pub(super) const fn new() -> Self {
        Self {
            newest: None,
            greatest_sequence: 0,
            hold: Some(Hold::Start),
            garbage_in_a_row: 0,
            dropouts: 0,
            stale: 0,
            garbage: 0,
        }
    }

    /// A frame that is whole.
    pub(super) fn take(&mut self, motor_command: &MotorCommand, now: Monotonic) {
        self.expire(now);
        if !is_current(motor_command, now) || motor_command.sequence <= self.greatest_sequence {
            self.stale = self.stale.saturating_add(1);
            return;
        }
        self.greatest_sequence = motor_command.sequence;
        self.garbage_in_a_row = 0;
        if !motor_command.velocity.is_finite() {
            return self.close(Hold::Garbage);
        }
        self.newest = Some(*motor_command);
        if motor_command.velocity.is_zero() {
            self.hold = None;
        }
    }

    /// A byte that belongs to no frame.
    pub(super) fn take_garbage(&mut self) {
        self.garbage = self.garbage.saturating_add(1);
        self.garbage_in_a_row += 1;
        if self.garbage_in_a_row >= GARBAGE_LIMIT {
            self.garbage_in_a_row = 0;
            self.close(Hold::Garbage);
        }
    }

    /// Lets nothing pass until zero has been asked for.
    pub(super) fn close(&mut self, hold: Hold) {
        if self.hold.is_none() {
            self.dropouts = self.dropouts.saturating_add(1);
        }
        self.newest = None;
        self.hold = Some(hold);
    }

    /// What the motors are to be told at `now`.
    pub(super) fn velocity(&mut self, now: Monotonic) -> Velocity {
        self.expire(now);
        match (self.hold, self.newest) {
            (None, Some(motor_command)) => motor_command.velocity,
            (Some(_), _) | (None, None) => Velocity::ZERO,
        }
    }

    /// When what is held grows too old.
    pub(super) fn deadline(&self) -> Option<Monotonic> {
        self.newest
            .map(|motor_command| motor_command.decided_at + WATCHDOG)
    }

    pub(super) const fn hold(&self) -> Option<Hold> {
        self.hold
    }

    pub(super) const fn sequence(&self) -> u64 {
        self.greatest_sequence
    }

    pub(super) const fn counters(&self, reconnects: u32) -> Counters {
        Counters {
            dropouts: self.dropouts,
            stale: self.stale,
            garbage: self.garbage,
            reconnects,
        }
    }

    fn expire(&mut self, now: Monotonic) {
        if self
            .newest
            .is_some_and(|motor_command| !is_current(&motor_command, now))
        {
            self.newest = None;
            // While it held for another reason, that one is the one to tell.
            if self.hold.is_none() {
                self.close(Hold::Silence);
            }
        }
    }
}

/// Younger than the watchdog, and not of the future: that would stay young for ever.
fn is_current(motor_command: &MotorCommand, now: Monotonic) -> bool {
    motor_command.decided_at <= now && now.since(motor_command.decided_at) < WATCHDOG
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use proptest::prelude::*;

    use super::*;

    const START_MS: u64 = 1_000_000;

    fn at(ms: u64) -> Monotonic {
        Monotonic::from_nanos((START_MS + ms) * 1_000_000)
    }

    fn ask(gate: &mut Gate, sequence: u64, decided_ms: u64, linear_mps: f64, now_ms: u64) {
        let motor_command = MotorCommand {
            sequence,
            decided_at: at(decided_ms),
            velocity: Velocity {
                linear_mps,
                angular_radps: 0.0,
            },
        };
        gate.take(&motor_command, at(now_ms));
    }

    fn moves(gate: &mut Gate, now_ms: u64) -> bool {
        gate.velocity(at(now_ms)) != Velocity::ZERO
    }

    /// Open, at 1 m/s decided at 20 ms.
    fn open() -> Gate {
        let mut gate = Gate::new();
        ask(&mut gate, 1, 0, 0.0, 0);
        ask(&mut gate, 2, 20, 1.0, 20);
        assert!(moves(&mut gate, 20));
        gate
    }

    #[test]
    fn nothing_moves_before_zero_was_asked_for() {
        let mut gate = Gate::new();
        ask(&mut gate, 1, 0, 1.0, 0);
        assert!(!moves(&mut gate, 0));
        ask(&mut gate, 2, 20, 0.0, 20);
        assert!(!moves(&mut gate, 20));
        ask(&mut gate, 3, 40, 1.0, 40);
        assert!(moves(&mut gate, 40));
    }

    #[test]
    fn a_velocity_holds_for_200_ms_from_its_decision() {
        let mut gate = open();
        assert_eq!(gate.deadline(), Some(at(220)));
        assert!(moves(&mut gate, 219));
        assert!(!moves(&mut gate, 220));
        assert_eq!(gate.hold(), Some(Hold::Silence));
        assert_eq!(gate.counters(0).dropouts, 1);
        // On its way for 150 ms: 50 ms are left.
        let mut gate = open();
        ask(&mut gate, 3, 50, 1.0, 200);
        assert!(moves(&mut gate, 249));
        assert!(!moves(&mut gate, 250));
    }

    #[test]
    fn late_repeated_and_future_ones_are_refused() {
        let mut gate = open();
        ask(&mut gate, 3, 30, -1.0, 230);
        assert!(!moves(&mut gate, 230), "too old when it came");
        let mut gate = open();
        ask(&mut gate, 2, 100, -1.0, 100);
        ask(&mut gate, 1, 100, -1.0, 100);
        ask(&mut gate, 9, 101, -1.0, 100);
        assert!((gate.velocity(at(100)).linear_mps - 1.0).abs() < 1e-9);
        assert_eq!(gate.counters(0).stale, 3);
    }

    #[test]
    fn after_a_gap_zero_comes_first() {
        let mut gate = open();
        ask(&mut gate, 3, 400, 1.0, 400);
        assert!(!moves(&mut gate, 400), "the key was down all the time");
        ask(&mut gate, 4, 420, 0.0, 420);
        ask(&mut gate, 5, 440, 1.0, 440);
        assert!(moves(&mut gate, 440));
    }

    #[test]
    fn garbage_closes() {
        let mut gate = open();
        (0..119).for_each(|_| gate.take_garbage());
        assert!(moves(&mut gate, 30));
        gate.take_garbage();
        assert!(!moves(&mut gate, 30));
        assert_eq!(gate.hold(), Some(Hold::Garbage));
        let mut gate = open();
        ask(&mut gate, 3, 30, f64::NAN, 30);
        assert!(!moves(&mut gate, 30), "a number that is none is no zero");
        ask(&mut gate, 4, 40, 1.0, 40);
        assert!(!moves(&mut gate, 40));
    }

    #[test]
    fn a_frame_between_resets_the_count_of_garbage() {
        let mut gate = open();
        for sequence in 3..50 {
            (0..100).for_each(|_| gate.take_garbage());
            ask(&mut gate, sequence, sequence * 10, 1.0, sequence * 10);
            assert!(moves(&mut gate, sequence * 10));
        }
    }

    proptest! {
        /// Whatever comes, in whatever order and however late: what passes was asked for within the last 200 ms.
        #[test]
        fn what_passes_is_young(
            events in prop::collection::vec((0..8u8, 0..120u64, 0..500u64, 0..60u64, any::<bool>()), 1..200),
        ) {
            let mut gate = Gate::new();
            let mut now_ms = 1000;
            let mut taken: Vec<(u64, f64)> = Vec::new();
            for (number, (kind, pass_ms, age_ms, sequence, is_zero)) in events.into_iter().enumerate() {
                now_ms += pass_ms;
                let speed = if is_zero { 0.0 } else { number as f64 + 1.0 };
                match kind {
                    0 => gate.take_garbage(),
                    1 => ask(&mut gate, sequence, now_ms + 1 + age_ms, speed, now_ms),
                    _ => {
                        ask(&mut gate, sequence, now_ms - age_ms, speed, now_ms);
                        taken.push((now_ms - age_ms, speed));
                    }
                }
                let passes = gate.velocity(at(now_ms));
                let is_young = taken.iter().any(|&(decided_ms, motor_command)| {
                    passes.linear_mps.to_bits() == motor_command.to_bits() && now_ms - decided_ms < 200
                });
                prop_assert!(passes == Velocity::ZERO || is_young);
                let later = gate.clone().velocity(at(now_ms) + Duration::from_millis(200));
                prop_assert_eq!(later, Velocity::ZERO);
            }
        }
    }
}
