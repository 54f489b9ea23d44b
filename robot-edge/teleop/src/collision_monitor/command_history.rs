//! What the motors were told lately, and where that leads.

use std::time::Duration;

use crate::velocity::Velocity;
use measurement::time::Monotonic;

/// Commands that are remembered.
const CAPACITY: usize = 64;

/// The commands of the last moments, oldest first: what the vehicle has yet to obey.
#[derive(Clone, Debug)]
pub(super) struct CommandHistory {
    commands: [(Monotonic, Velocity); CAPACITY],
    len: usize,
    /// Commands that follow each other faster are remembered as one.
    spacing: Duration,
}

impl CommandHistory {
    /// Remembers at least `span` of commands.
    pub(super) fn new(span: Duration) -> Self {
        Self {
            commands: [(Monotonic::default(), Velocity::ZERO); CAPACITY],
            len: 0,
            spacing: span / (CAPACITY as u32 - 2),
        }
    }

    /// The motors were told this, from this moment on.
    pub(super) fn record(&mut self, from: Monotonic, velocity: Velocity) {
        if let Some((start, newest)) = self.commands[..self.len].last_mut()
            && from.since(*start) < self.spacing
        {
            *newest = velocity;
            return;
        }
        if self.len == CAPACITY {
            self.commands.copy_within(1.., 0);
            self.len -= 1;
        }
        self.commands[self.len] = (from, velocity);
        self.len += 1;
    }

    /// What they were told between two moments, in order, each with how long, seconds. Before the first that is
    /// remembered, it was the same.
    pub(super) fn between(
        &self,
        from: Monotonic,
        to: Monotonic,
    ) -> impl Iterator<Item = (Velocity, f64)> {
        let commands = &self.commands[..self.len];
        commands
            .iter()
            .enumerate()
            .map(move |(index, &(start, velocity))| {
                let start = if index == 0 { from } else { start.max(from) };
                let end = commands.get(index + 1).map_or(to, |next| next.0.min(to));
                (velocity, end.since(start).as_secs_f64())
            })
    }

    /// What they were told at a moment.
    pub(super) fn at(&self, moment: Monotonic) -> Option<Velocity> {
        let commands = &self.commands[..self.len];
        let newest = commands.iter().rev().find(|(start, _)| *start <= moment);
        newest.or(commands.first()).map(|(_, velocity)| *velocity)
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::float_cmp, reason = "these values are exact")]

    use super::*;

    fn at(millis: u64) -> Monotonic {
        Monotonic::from_nanos(millis * 1_000_000)
    }

    fn going(linear_mps: f64) -> Velocity {
        Velocity {
            linear_mps,
            angular_radps: 0.0,
        }
    }

    fn gone_m(commanded: &CommandHistory, from: u64, to: u64) -> f64 {
        let parts = commanded.between(at(from), at(to));
        parts
            .map(|(velocity, time_s)| velocity.linear_mps * time_s)
            .sum()
    }

    #[test]
    fn commands_hold_until_the_next() {
        let mut commanded = CommandHistory::new(Duration::from_millis(400));
        assert_eq!(commanded.at(at(100)), None);
        assert_eq!(gone_m(&commanded, 0, 1000), 0.0);
        for (millis, speed) in [(1000, 1.0), (1020, 2.0), (1040, 0.0)] {
            commanded.record(at(millis), going(speed));
        }
        for (millis, speed) in [
            (500, 1.0),
            (1010, 1.0),
            (1020, 2.0),
            (1039, 2.0),
            (2000, 0.0),
        ] {
            assert_eq!(commanded.at(at(millis)), Some(going(speed)), "{millis}");
        }
        assert!((gone_m(&commanded, 990, 1030) - (0.03 + 0.02)).abs() < 1e-12);
        assert!((gone_m(&commanded, 1030, 1100) - 0.02).abs() < 1e-12);
        assert_eq!(gone_m(&commanded, 1050, 1040), 0.0);
    }

    #[test]
    fn it_remembers_its_span_however_fast_commands_come() {
        for millis in [1, 2, 20, 100] {
            let mut commanded = CommandHistory::new(Duration::from_millis(400));
            let count = 5000;
            for n in 0..count {
                commanded.record(at(n * millis), going(if n % 2 == 0 { 1.0 } else { 3.0 }));
            }
            let end = count * millis;
            let gone_m = gone_m(&commanded, end - 400, end);
            assert!(commanded.commands[0].0 <= at(end - 400), "{millis}");
            // The newest of those that are one may stand for all.
            assert!((0.39..=1.21).contains(&gone_m), "{millis}: {gone_m}");
        }
    }
}
