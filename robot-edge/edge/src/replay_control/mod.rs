//! Shared handle to pause, seek and change the speed of a replay.
//!
//! A console commands through it and reads the progress; [`crate::runtime::play`] maps. The published map is always the
//! map of the recording from its start to [`ReplayStatus::position`]: a seek backward and a loop restart it.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::lock;
use crate::pacer::Rate;
use measurement::time::{Monotonic, RobotDuration};
use network::clock;

/// Slowest and fastest multiple of the recording's own speed.
pub const RATES: [f64; 2] = [0.1, 20.0];
/// Maximum sleep: an interrupt does not wake a thread.
const MAX_WAIT: Duration = Duration::from_millis(50);

/// Clones are handles of the same replay.
#[derive(Clone, Debug)]
pub struct ReplayControl(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug)]
struct State {
    commands: ReplayCommands,
    progress: ReplayProgress,
    rate_reached: Option<f64>,
    length: Option<Length>,
    has_no_clock: bool,
    marks: TimelineMarks,
    trail: ReplayTrail,
    restarts: u64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ReplayCommands {
    /// Pause at the current position, or after the seek.
    pub(crate) is_paused: bool,
    pub(crate) rate: Rate,
    pub(crate) is_looping: bool,
    /// Time of the data since the first scan to seek to; the replay takes it.
    pub(crate) seek: Option<RobotDuration>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ReplayProgress {
    /// The recording is being surveyed; nothing is mapped yet.
    pub(crate) is_opening: bool,
    /// Time of the data in the map, since the first scan.
    pub(crate) position: RobotDuration,
    /// Target of a seek that is not complete.
    pub(crate) seeking: Option<RobotDuration>,
    pub(crate) has_ended: bool,
    /// Everything up to the position is in the published map.
    pub(crate) is_settled: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReplayState {
    /// The recording is being surveyed.
    Opening,
    Playing,
    Paused,
    /// Mapping as fast as possible up to the target of a seek.
    Seeking {
        /// Target, since the first scan.
        to: RobotDuration,
    },
    /// The whole recording is in the map.
    Ended,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Length {
    /// From the first scan to the last mapped data: poses may follow the last scan.
    pub duration: RobotDuration,
    /// The recording was not read to its end yet; the length is extrapolated.
    pub is_estimate: bool,
}

#[derive(Clone, Debug, PartialEq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "they are independent of each other"
)]
pub struct ReplayStatus {
    pub state: ReplayState,
    /// Time of the data in the map, since the first scan.
    pub position: RobotDuration,
    pub length: Option<Length>,
    /// The stamps of the scans cannot be used: they are mapped in the order of the file, without times.
    pub has_no_clock: bool,
    pub rate: Rate,
    /// Time of the data per wall time, over the last second; `None` while paused.
    pub rate_reached: Option<f64>,
    /// Pause after the seek.
    pub is_paused: bool,
    pub is_looping: bool,
    /// Paused, and everything up to the position is in the published map: exactly the map of `robot-edge replay
    /// --duration` with the position.
    pub is_settled: bool,
    /// Marks of the part that was replayed so far, in the order of the recording.
    pub marks: Vec<TimelineMark>,
    /// Number of restarts and restores of the maps.
    pub restarts: u64,
}

impl ReplayControl {
    /// A replay that starts at once, at this rate (see [`Self::set_rate`]).
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
                has_no_clock: false,
                marks: TimelineMarks::default(),
                trail: ReplayTrail::default(),
                restarts: 0,
            }),
            changed: Condvar::new(),
        }))
    }

    /// Plays; at the end, from the beginning.
    pub fn play(&self) {
        self.update(|state| {
            state.commands.is_paused = false;
            if state.progress.has_ended && state.commands.seek.is_none() {
                state.commands.seek = Some(RobotDuration::ZERO);
            }
        });
    }

    pub fn pause(&self) {
        self.update(|state| state.commands.is_paused = true);
    }

    /// Sets the rate. Multiples are clamped to [`RATES`].
    pub fn set_rate(&self, rate: Rate) {
        self.update(|state| state.commands.rate = within_limits(rate));
    }

    pub fn set_looping(&self, is_looping: bool) {
        self.update(|state| state.commands.is_looping = is_looping);
    }

    /// Seeks to a time of the data since the first scan, and plays or pauses there as before. A replay at its end
    /// stays paused.
    pub fn seek(&self, to: RobotDuration) {
        self.update(|state| state.seek(to));
    }

    /// Seeks relative to the position, or to the target of a running seek.
    pub fn step(&self, by: RobotDuration) {
        self.update(|state| {
            let seeking = state.commands.seek.or(state.progress.seeking);
            state.seek(seeking.unwrap_or(state.progress.position) + by);
        });
    }

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
            has_no_clock: state.has_no_clock,
            rate: commands.rate,
            rate_reached: state.rate_reached.filter(|_| is_going),
            is_paused: commands.is_paused,
            is_looping: commands.is_looping,
            is_settled: progress.is_settled && !is_going,
            marks: state.marks.all().to_vec(),
            restarts: state.restarts,
        }
    }

    /// The trajectory up to the position, oldest point first, metres in `odom`, and its version, if that differs
    /// from `known`; version 0 is no trajectory.
    pub fn trail(&self, known: u64) -> Option<(u64, Vec<[f64; 2]>)> {
        self.lock().trail.newer_than(known)
    }

    fn update(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.lock());
        self.0.changed.notify_all();
    }

    /// The current commands. The target of a seek is returned once.
    pub(crate) fn take_commands(&self) -> ReplayCommands {
        let mut state = self.lock();
        let commands = state.commands;
        if let Some(to) = state.commands.seek.take() {
            // Otherwise the target would be unknown until the next report.
            state.progress.seeking = Some(to);
            state.progress.has_ended = false;
        }
        commands
    }

    /// Sleeps until `deadline`, or until the commands differ from `known`. Returns whether the deadline was
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

    pub(crate) fn report_progress(&self, progress: ReplayProgress, rate_reached: Option<f64>) {
        let mut state = self.lock();
        state.progress = progress;
        state.rate_reached = rate_reached;
    }

    /// Sets the length. An estimate does not replace a known one.
    pub(crate) fn set_length(&self, length: Length) {
        let mut state = self.lock();
        let is_known = state.length.is_some_and(|known| !known.is_estimate);
        if !(is_known && length.is_estimate) {
            state.length = Some(length);
        }
    }

    pub(crate) fn set_no_clock(&self) {
        self.lock().has_no_clock = true;
    }

    pub(crate) fn restart(&self) {
        let mut state = self.lock();
        state.restarts += 1;
        state.trail.restart();
    }

    /// The maps were restored to where this trail was copied.
    pub(crate) fn restore(&self, trail: &ReplayTrail) {
        let mut state = self.lock();
        state.restarts += 1;
        state.trail.restore(trail);
    }

    pub(crate) fn trail_snapshot(&self) -> ReplayTrail {
        self.lock().trail.clone()
    }

    /// Adds a position of the vehicle, metres in `odom`.
    pub(crate) fn add_point(&self, point_m: [f64; 2]) {
        self.lock().trail.add_point(point_m);
    }

    /// Adds a mark. Returns whether it is new, and not a repetition of an earlier loop.
    pub(crate) fn mark(&self, mark: TimelineMark) -> bool {
        self.lock().marks.add(mark)
    }

    /// A poisoned lock is taken: every change is a single assignment.
    fn lock(&self) -> MutexGuard<'_, State> {
        lock(&self.0.state)
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
        // A replay that seeks or is about to restart is not paused.
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

/// Maximum number of marks; later ones are dropped.
pub const MAX_MARKS: usize = 500;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TimelineMark {
    /// Since the first scan.
    pub at: RobotDuration,
    /// A kind of [`crate::runtime::MapEvent`], `gap`, `clock` or `loss`.
    pub kind: &'static str,
    pub message: String,
}

/// Marks in the order of the data. A mark that is replayed again is kept once.
#[derive(Clone, Debug, Default)]
pub(super) struct TimelineMarks(Vec<TimelineMark>);

impl TimelineMarks {
    pub(super) fn all(&self) -> &[TimelineMark] {
        &self.0
    }

    /// Returns whether it is new. Replaying is deterministic, so that a repeated event is equal.
    pub(super) fn add(&mut self, mark: TimelineMark) -> bool {
        let place = self.0.partition_point(|known| known.at < mark.at);
        let of_the_time = self.0[place..]
            .iter()
            .take_while(|known| known.at == mark.at);
        if of_the_time.into_iter().any(|known| *known == mark) {
            return false;
        }
        if self.0.len() < MAX_MARKS {
            self.0.insert(place, mark);
        }
        true
    }
}

/// Initial distance between points.
const STEP_M: f64 = 0.1;
/// Maximum number of points; beyond it, every second one is removed.
const MAX_POINTS: usize = 10_000;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ReplayTrail {
    points_m: Vec<[f64; 2]>,
    step_m: f64,
    /// Increases with every point.
    version: u64,
}

impl Default for ReplayTrail {
    fn default() -> Self {
        Self {
            points_m: Vec::new(),
            step_m: STEP_M,
            version: 0,
        }
    }
}

impl ReplayTrail {
    pub(super) fn add_point(&mut self, point_m: [f64; 2]) {
        let is_far = self.points_m.last().is_none_or(|last| {
            let [dx, dy] = [point_m[0] - last[0], point_m[1] - last[1]];
            dx * dx + dy * dy >= self.step_m * self.step_m
        });
        if !is_far {
            return;
        }
        self.points_m.push(point_m);
        self.version += 1;
        if self.points_m.len() > MAX_POINTS {
            let mut index = 0;
            self.points_m.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.step_m *= 2.0;
        }
    }

    pub(super) fn restart(&mut self) {
        self.points_m.clear();
        self.step_m = STEP_M;
        self.version += 1;
    }

    pub(super) fn restore(&mut self, then: &Self) {
        let version = self.version + 1;
        self.clone_from(then);
        self.version = version;
    }

    /// The points, oldest first, and their version, if that differs from `known`.
    pub(super) fn newer_than(&self, known: u64) -> Option<(u64, Vec<[f64; 2]>)> {
        (self.version != known).then(|| (self.version, self.points_m.clone()))
    }
}

const WINDOW: Duration = Duration::from_secs(1);
/// Minimum time for a rate.
const MIN_SPAN: Duration = Duration::from_millis(100);
const SAMPLE_INTERVAL: Duration = Duration::from_millis(20);

/// Time of the data per wall time, over the last second.
#[derive(Clone, Debug, Default)]
pub(crate) struct RateMeter {
    samples: VecDeque<(Monotonic, RobotDuration)>,
}

impl RateMeter {
    pub(crate) fn record(&mut self, position: RobotDuration, now: Monotonic) {
        let is_due = self
            .samples
            .back()
            .is_none_or(|(at, _)| now.since(*at) >= SAMPLE_INTERVAL);
        if is_due {
            self.samples.push_back((now, position));
        }
        while self
            .samples
            .front()
            .is_some_and(|(at, _)| now.since(*at) > WINDOW)
        {
            self.samples.pop_front();
        }
    }

    /// The rate; `None` before there are enough samples.
    pub(crate) fn rate(&self) -> Option<f64> {
        let ((start, from), (end, to)) = (*self.samples.front()?, *self.samples.back()?);
        let time = end.since(start);
        let data_s = to.as_secs_f64() - from.as_secs_f64();
        (time >= MIN_SPAN).then(|| data_s / time.as_secs_f64())
    }

    /// Restarts after a pause or a seek.
    pub(crate) fn reset(&mut self) {
        self.samples.clear();
    }
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod marks_tests {
    use super::*;

    fn mark(s: i64, kind: &'static str) -> TimelineMark {
        TimelineMark {
            at: RobotDuration::from_millis(1000 * s),
            kind,
            message: format!("{kind} at {s}"),
        }
    }

    #[test]
    fn a_mark_is_kept_once_and_in_its_place() {
        let mut marks = TimelineMarks::default();
        for (mark, is_new) in [
            (mark(5, "gap"), true),
            (mark(9, "gap"), true),
            (mark(5, "gap"), false),
            (mark(5, "loss"), true),
            (mark(1, "gap"), true),
        ] {
            assert_eq!(marks.add(mark.clone()), is_new, "{mark:?}");
        }
        let order: Vec<_> = marks.all().iter().map(|mark| &*mark.message).collect();
        assert_eq!(order, ["gap at 1", "loss at 5", "gap at 5", "gap at 9"]);
    }

    #[test]
    fn marks_are_bounded() {
        let mut marks = TimelineMarks::default();
        for s in 0..1000 {
            marks.add(mark(s, "gap"));
        }
        assert_eq!(marks.all().len(), MAX_MARKS);
    }
}

#[cfg(test)]
mod trail_tests {
    use super::*;

    #[test]
    fn a_trail_is_bounded_and_known_once() {
        let mut trail = ReplayTrail::default();
        assert_eq!(trail.newer_than(0), None);
        for x in 0..3 {
            trail.add_point([0.06 * f64::from(x), 0.0]);
        }
        let (version, points_m) = trail.newer_than(0).unwrap();
        assert_eq!(points_m, [[0.0, 0.0], [0.12, 0.0]]);
        assert_eq!(trail.newer_than(version), None);
        for x in 1..100_000 {
            trail.add_point([f64::from(x), 0.0]);
            assert!(trail.points_m.len() <= MAX_POINTS);
        }
        assert_eq!(trail.points_m.first(), Some(&[0.0, 0.0]));
        let then = trail.clone();
        trail.restart();
        trail.restore(&then);
        let (newer, points_m) = trail.newer_than(then.version).unwrap();
        assert_eq!(Some((then.version, points_m)), then.newer_than(0));
        trail.restart();
        assert!(trail.newer_than(newer).is_some());
        let (_, points_m) = trail.newer_than(version).unwrap();
        assert_eq!(points_m, [[0.0; 2]; 0]);
    }
}

#[cfg(test)]
mod rate_meter_tests {
    use super::*;

    #[test]
    fn the_rate_is_that_of_the_last_second() {
        let mut meter = RateMeter::default();
        let mut position_ms = 0;
        let mut record = |meter: &mut RateMeter, at_ms: u64, step_ms: i64| {
            position_ms += step_ms;
            meter.record(
                RobotDuration::from_millis(position_ms),
                Monotonic::from_nanos(at_ms * 1_000_000),
            );
        };
        record(&mut meter, 0, 0);
        record(&mut meter, 50, 500);
        assert_eq!(meter.rate(), None, "too early to tell");
        for at_ms in (100..=1000).step_by(50) {
            record(&mut meter, at_ms, 500);
        }
        assert!((meter.rate().unwrap() - 10.0).abs() < 1e-9);
        for at_ms in (1050..=2100).step_by(50) {
            record(&mut meter, at_ms, 100);
        }
        assert!((meter.rate().unwrap() - 2.0).abs() < 1e-9);
        meter.reset();
        assert_eq!(meter.rate(), None);
    }
}
