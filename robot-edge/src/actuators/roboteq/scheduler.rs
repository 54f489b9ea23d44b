//! What is said to a controller that is ready, and in which order.

use std::time::Duration;

use super::wire::Power;
use measurement::time::Monotonic;

/// Speeds that have not changed are repeated after this: a command that got lost, or a controller that was reset, must
/// not last.
const REPEAT: Duration = Duration::from_millis(50);

/// Least time between two pairs of motor commands: a quick line must not be flooded.
const MIN_PAUSE: Duration = Duration::from_millis(10);

const STATUS_EVERY: Duration = Duration::from_millis(200);
const VOLTAGES_EVERY: Duration = Duration::from_secs(1);
const ENCODERS_EVERY: Duration = Duration::from_millis(100);

/// The next thing to say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Task {
    RunOne,
    RunTwo,
    Status,
    Voltages,
    Encoders,
}

/// Motor commands in pairs, and at most one question between two pairs.
#[derive(Clone, Debug)]
pub(super) struct Scheduler {
    /// The first of a pair was said.
    is_half: bool,
    /// A question may come before the next pair.
    may_poll: bool,
    pair_at: Monotonic,
    must_repeat: bool,
    polls: [Poll; 3],
}

#[derive(Clone, Copy, Debug)]
struct Poll {
    task: Task,
    every: Duration,
    /// Absent where it is never asked.
    due: Option<Monotonic>,
}

impl Scheduler {
    pub(super) fn new(has_encoders: bool, now: Monotonic) -> Self {
        let poll = |task, every, is_asked: bool| Poll {
            task,
            every,
            due: is_asked.then_some(now),
        };
        Self {
            is_half: false,
            may_poll: false,
            pair_at: now,
            must_repeat: true,
            polls: [
                poll(Task::Status, STATUS_EVERY, true),
                poll(Task::Encoders, ENCODERS_EVERY, has_encoders),
                poll(Task::Voltages, VOLTAGES_EVERY, true),
            ],
        }
    }

    /// The next thing to say, if it is time for any.
    pub(super) fn next(
        &mut self,
        wanted: [Power; 2],
        acknowledged: [Option<Power>; 2],
        now: Monotonic,
    ) -> Option<Task> {
        if self.is_half {
            self.is_half = false;
            self.may_poll = true;
            return Some(Task::RunTwo);
        }
        let is_acknowledged = acknowledged == wanted.map(Some);
        let is_stop = wanted == [Power::ZERO; 2];
        // No question delays a stop.
        if self.may_poll && (is_acknowledged || !is_stop) {
            let due = |poll: &&mut Poll| poll.due.is_some_and(|due| now >= due);
            if let Some(poll) = self.polls.iter_mut().find(due) {
                poll.due = Some(now + poll.every);
                self.may_poll = false;
                return Some(poll.task);
            }
        }
        let pause = if is_acknowledged && !self.must_repeat {
            REPEAT
        } else {
            MIN_PAUSE
        };
        if now < self.pair_at + pause {
            return None;
        }
        self.pair_at = now;
        self.must_repeat = false;
        self.is_half = true;
        Some(Task::RunOne)
    }

    /// Both motors are told zero, whatever was to be said next.
    pub(super) fn stop_both(&mut self, now: Monotonic) {
        self.is_half = false;
        self.may_poll = true;
        self.must_repeat = false;
        self.pair_at = now;
    }

    /// What was said last went wrong: both motors are told anew.
    pub(super) fn repeat(&mut self, now: Monotonic) {
        self.is_half = false;
        self.must_repeat = true;
        self.pair_at = now;
    }

    /// When there is something to say at the latest, or it must be asked whether there is.
    pub(super) fn deadline(&self) -> Monotonic {
        if self.is_half {
            return self.pair_at;
        }
        self.pair_at + MIN_PAUSE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STOP: [Power; 2] = [Power::ZERO; 2];

    fn at(ms: u64) -> Monotonic {
        Monotonic::from_nanos(1_000_000_000 + ms * 1_000_000)
    }

    fn ahead() -> [Power; 2] {
        [Power::from_fraction(0.5); 2]
    }

    /// With every question due, and a pair just said.
    fn busy() -> Scheduler {
        let mut scheduler = Scheduler::new(true, at(0));
        let tasks = [10, 11].map(|ms| scheduler.next(ahead(), [None; 2], at(ms)));
        assert_eq!(tasks, [Some(Task::RunOne), Some(Task::RunTwo)]);
        scheduler
    }

    #[test]
    fn one_question_comes_between_two_pairs() {
        let mut scheduler = busy();
        let acknowledged = ahead().map(Some);
        let mut tasks = Vec::new();
        for ms in 12..250 {
            tasks.extend(scheduler.next(ahead(), acknowledged, at(ms)));
        }
        let polls = tasks
            .iter()
            .filter(|task| !matches!(task, Task::RunOne | Task::RunTwo));
        assert_eq!(tasks[0], Task::Status);
        assert_eq!(tasks[1..3], [Task::RunOne, Task::RunTwo]);
        assert_eq!(tasks[3], Task::Encoders);
        assert!(polls.count() >= 4, "{tasks:?}");
    }

    #[test]
    fn no_question_delays_a_stop() {
        let acknowledged = ahead().map(Some);
        let mut scheduler = busy();
        assert_eq!(
            scheduler.next(STOP, acknowledged, at(19)),
            None,
            "a pair was said just now"
        );
        assert_eq!(
            scheduler.next(STOP, acknowledged, at(20)),
            Some(Task::RunOne)
        );
        assert_eq!(
            scheduler.next(STOP, acknowledged, at(21)),
            Some(Task::RunTwo)
        );
        let mut scheduler = busy();
        assert_eq!(
            scheduler.next(ahead(), [None; 2], at(20)),
            Some(Task::Status)
        );
    }

    #[test]
    fn a_standing_vehicle_is_told_so_again_and_again() {
        let mut scheduler = busy();
        let pairs = (12..1012)
            .filter(|&ms| scheduler.next(STOP, STOP.map(Some), at(ms)) == Some(Task::RunOne));
        assert!((19..=21).contains(&pairs.count()));
    }
}
