//! Who replays a recording pauses it, winds it and changes its speed: a handle that both sides share.
//!
//! One side says what is wanted and looks at how far it is; the other ([`crate::app::play`]) maps. The map that is
//! published is at every moment the map of the recording from its start to [`ReplayStatus::position`]: winding back begins
//! it anew, and so does a round.

mod marks;
mod rate_meter;
mod trail;

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::clock;
use crate::pacer::Rate;
use measurement::time::Monotonic;
use measurement::time::RobotDuration;

pub use marks::{MAX_MARKS, TimelineMark};
pub(crate) use rate_meter::RateMeter;
pub(crate) use trail::ReplayTrail;

use marks::TimelineMarks;

/// Slowest and fastest multiple of the recording's own speed.
pub const RATES: [f64; 2] = [0.1, 20.0];
/// Whoever waits for a wish looks up at least this often: an interrupt wakes nobody.
const MAX_WAIT: Duration = Duration::from_millis(50);

/// Pauses, winds and paces a replay, and says how far it is. Clones are handles of the same replay.
#[derive(Clone, Debug)]
pub struct ReplayControl(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    state: Mutex<State>,
    /// Something else is wanted.
    changed: Condvar,
}

#[derive(Debug)]
struct State {
    commands: ReplayCommands,
    progress: ReplayProgress,
    rate_reached: Option<f64>,
    length: Option<Length>,
    marks: TimelineMarks,
    trail: ReplayTrail,
    restarts: u64,
}

/// What is wanted of a replay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ReplayCommands {
    /// It stands still where it is, or where it was wound to.
    pub(crate) is_paused: bool,
    /// How fast it goes.
    pub(crate) rate: Rate,
    /// At the end it begins anew.
    pub(crate) is_looping: bool,
    /// Where it is wound to, from the first scan. Taken by who replays.
    pub(crate) seek: Option<RobotDuration>,
}

/// How far a replay is, as who replays tells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ReplayProgress {
    /// The recording is being looked through; nothing is mapped yet.
    pub(crate) is_opening: bool,
    /// Time of the data that is in the map, from the first scan.
    pub(crate) position: RobotDuration,
    /// Where it is being wound to.
    pub(crate) seeking: Option<RobotDuration>,
    /// There is no more.
    pub(crate) has_ended: bool,
    /// All that was read up to the position is in the published map.
    pub(crate) is_settled: bool,
}

/// What a replay is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReplayState {
    /// The recording is being looked through.
    Opening,
    /// It goes on at its rate.
    Playing,
    /// It stands still.
    Paused,
    /// It maps as fast as it can up to a time of the data.
    Seeking {
        /// Up to where, from the first scan.
        to: RobotDuration,
    },
    /// All of it is in the map.
    Ended,
}

/// How long a recording is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Length {
    /// From the first scan to the end of what is mapped: poses may go on behind the last scan.
    pub duration: RobotDuration,
    /// It was not read to its end yet, and this is a guess from the part that was.
    pub is_estimate: bool,
}

/// How a replay is going.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayStatus {
    /// What it is doing.
    pub state: ReplayState,
    /// Time of the data that is in the map, from the first scan.
    pub position: RobotDuration,
    /// How long the recording is, where that is known.
    pub length: Option<Length>,
    /// The speed that is wanted.
    pub rate: Rate,
    /// Time of the data per time, over the last second; `None` where it stands still.
    pub rate_reached: Option<f64>,
    /// Whether it is to stand still once it is where it was wound to.
    pub is_paused: bool,
    /// Whether it begins anew at the end.
    pub is_looping: bool,
    /// Whether it stands still and all up to its position is in the published map: exactly the map of
    /// `robot-edge replay --duration` with the position.
    pub is_settled: bool,
    /// What happened in the part that was replayed so far, in the order of the recording.
    pub marks: Vec<TimelineMark>,
    /// How often the maps began anew or went back.
    pub restarts: u64,
}

impl ReplayControl {
    /// Of a replay that begins at once, at this rate (see [`Self::set_rate`]).
    pub fn new(rate: Rate) -> Self {
        Self(Arc::new(Inner {
            state: Mutex::new(State {
                commands: ReplayCommands {
                    is_paused: false,
                    rate: within_limits(rate),
                    is_looping: false,
                    seek: None,
                },
                progress: ReplayProgress {
                    is_opening: true,
                    position: RobotDuration::ZERO,
                    seeking: None,
                    has_ended: false,
                    is_settled: false,
                },
                rate_reached: None,
                length: None,
                marks: TimelineMarks::default(),
                trail: ReplayTrail::default(),
                restarts: 0,
            }),
            changed: Condvar::new(),
        }))
    }

    /// Goes on; at the end, from the beginning.
    pub fn play(&self) {
        self.update(|state| {
            state.commands.is_paused = false;
            if state.progress.has_ended && state.commands.seek.is_none() {
                state.commands.seek = Some(RobotDuration::ZERO);
            }
        });
    }

    /// Stands still.
    pub fn pause(&self) {
        self.update(|state| state.commands.is_paused = true);
    }

    /// Goes on at this rate. Multiples are kept within [`RATES`].
    pub fn set_rate(&self, rate: Rate) {
        self.update(|state| state.commands.rate = within_limits(rate));
    }

    /// Whether to begin anew at the end.
    pub fn set_looping(&self, is_looping: bool) {
        self.update(|state| state.commands.is_looping = is_looping);
    }

    /// Winds to this time of the data, from the first scan, and there goes on or stands still as before. What stood at
    /// the end stands still there, too: an earlier moment can be looked at for as long as one likes.
    pub fn seek(&self, to: RobotDuration) {
        self.update(|state| state.seek(to));
    }

    /// Winds on, or back where negative, from where it is or is being wound to.
    pub fn step(&self, by: RobotDuration) {
        self.update(|state| {
            let seeking = state.commands.seek.or(state.progress.seeking);
            state.seek(seeking.unwrap_or(state.progress.position) + by);
        });
    }

    /// How it is going.
    pub fn status(&self) -> ReplayStatus {
        let state = self.lock();
        let State {
            commands, progress, ..
        } = *state;
        let now = match commands.seek.or(progress.seeking) {
            _ if progress.is_opening => ReplayState::Opening,
            Some(to) => ReplayState::Seeking { to },
            None if progress.has_ended => ReplayState::Ended,
            None if commands.is_paused => ReplayState::Paused,
            None => ReplayState::Playing,
        };
        let is_going = matches!(now, ReplayState::Playing | ReplayState::Seeking { .. });
        ReplayStatus {
            state: now,
            position: progress.position,
            length: state.length,
            rate: commands.rate,
            rate_reached: state.rate_reached.filter(|_| is_going),
            is_paused: commands.is_paused,
            is_looping: commands.is_looping,
            is_settled: progress.is_settled && !is_going,
            marks: state.marks.all().to_vec(),
            restarts: state.restarts,
        }
    }

    /// Where the vehicle was up to the position, oldest first, metres in `odom`, and the version of that, if it is another
    /// than `known`; 0 is that of no trail.
    pub fn trail(&self, known: u64) -> Option<(u64, Vec<[f64; 2]>)> {
        self.lock().trail.newer_than(known)
    }

    fn update(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.lock());
        self.0.changed.notify_all();
    }

    /// What is wanted now. Where to wind to is said once.
    pub(crate) fn take_commands(&self) -> ReplayCommands {
        let mut state = self.lock();
        let commands = state.commands;
        if let Some(to) = state.commands.seek.take() {
            // Or there would be a moment in which nobody knows of it.
            state.progress.seeking = Some(to);
            state.progress.has_ended = false;
        }
        commands
    }

    /// Sleeps until `deadline`, or until something else is wanted than was taken with `known`; whether the deadline was
    /// reached.
    pub(crate) fn sleep_until(
        &self,
        deadline: Monotonic,
        known: ReplayCommands,
        is_interrupted: impl Fn() -> bool,
    ) -> bool {
        let known = ReplayCommands {
            seek: None,
            ..known
        };
        let mut state = self.lock();
        loop {
            if state.commands != known || is_interrupted() {
                return false;
            }
            let rest = deadline.since(clock::now());
            if rest.is_zero() {
                return true;
            }
            let woken = self
                .0
                .changed
                .wait_timeout(state, rest.min(MAX_WAIT))
                .unwrap_or_else(PoisonError::into_inner);
            state = woken.0;
        }
    }

    /// Tells how far it is.
    pub(crate) fn report_progress(&self, progress: ReplayProgress, rate_reached: Option<f64>) {
        let mut state = self.lock();
        state.progress = progress;
        state.rate_reached = rate_reached;
    }

    /// Tells how long the recording is. A guess gives way to what is known.
    pub(crate) fn set_length(&self, length: Length) {
        let mut state = self.lock();
        let is_known = state.length.is_some_and(|known| !known.is_estimate);
        if !(is_known && length.is_estimate) {
            state.length = Some(length);
        }
    }

    /// Tells that the maps began anew.
    pub(crate) fn restart(&self) {
        let mut state = self.lock();
        state.restarts += 1;
        state.trail.restart();
    }

    /// Tells that the maps went back to where this trail was taken.
    pub(crate) fn restore(&self, trail: &ReplayTrail) {
        let mut state = self.lock();
        state.restarts += 1;
        state.trail.restore(trail);
    }

    /// The trail so far.
    pub(crate) fn trail_snapshot(&self) -> ReplayTrail {
        self.lock().trail.clone()
    }

    /// The vehicle was here, metres in `odom`.
    pub(crate) fn add_point(&self, point_m: [f64; 2]) {
        self.lock().trail.add_point(point_m);
    }

    /// Keeps a mark; whether it is a new one, and not the same as in an earlier round.
    pub(crate) fn mark(&self, mark: TimelineMark) -> bool {
        self.lock().marks.add(mark)
    }

    /// Whoever fails with it in his hands leaves nothing half done: every change is a single assignment.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn seek(&mut self, to: RobotDuration) {
        let end = self
            .length
            .filter(|length| !length.is_estimate)
            .map_or(RobotDuration::from_nanos(i64::MAX), |length| {
                length.duration
            });
        let to = to.clamp(RobotDuration::ZERO, end.max(RobotDuration::ZERO));
        // What is wound already, or begins anew, does not stand there.
        let stands_at_end =
            self.progress.has_ended && self.commands.seek.is_none() && !self.commands.is_looping;
        if stands_at_end && to >= self.progress.position {
            return;
        }
        self.commands.is_paused |= stands_at_end;
        self.commands.seek = Some(to);
    }
}

fn within_limits(rate: Rate) -> Rate {
    match rate {
        Rate::Times(times) => Rate::Times(times.clamp(RATES[0], RATES[1])),
        Rate::Max => Rate::Max,
    }
}

#[cfg(test)]
mod tests;
