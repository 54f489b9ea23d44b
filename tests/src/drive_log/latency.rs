//! From a key to the motors.

use std::time::Duration;

use super::DriveLog;
use crate::operator::{Input, Journal};

/// For each press of a journal, the time from when its first command was built to the end of the first round in which
/// the motors were told to move by it; `None` where it was let go before they were.
pub fn press_latencies(log: &DriveLog, journal: &Journal) -> Vec<Option<Duration>> {
    let sent = journal.sent();
    let presses = sent.windows(2).filter_map(|pair| {
        let is_press = pair[0].input == Input::NEUTRAL && pair[1].input != Input::NEUTRAL;
        is_press.then_some(pair[1])
    });
    presses
        .map(|press| {
            let released = journal
                .between(press.seq, u64::MAX)
                .iter()
                .find(|later| later.input == Input::NEUTRAL)
                .map_or(u64::MAX, |later| later.seq);
            let is_moved_by_it =
                |seq: Option<u64>| seq.is_some_and(|seq| (press.seq..released).contains(&seq));
            let mut rounds = log.since(press.at).iter();
            let moved = rounds.find(|round| {
                round.epoch == press.epoch && is_moved_by_it(round.seq) && !round.is_stopped()
            })?;
            Some(moved.at.since(press.at))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use measurement::time::Monotonic;

    use super::*;
    use crate::drive_log::Round;
    use crate::operator::Sent;

    #[test]
    fn presses_are_found_and_those_without_effect_too() {
        let at_ms = |millis: u64| Monotonic::from_nanos(millis * 1_000_000);
        let pressed = Input::of(0.1, 0.0);
        let mut journal = Journal::default();
        for (seq, input) in [
            (1, Input::NEUTRAL),
            (2, pressed),
            (3, pressed),
            (4, Input::NEUTRAL),
            (5, pressed),
            (6, Input::NEUTRAL),
        ] {
            journal.push(Sent {
                at: at_ms(100 * seq),
                seq,
                epoch: 1,
                token: seq,
                token_received: at_ms(100 * seq),
                input,
            });
        }
        let round = |at, seq, output| Round {
            at: at_ms(at),
            mode: "driving".to_owned(),
            requested: [0.0; 2],
            output: [output, 0.0],
            age: None,
            epoch: 1,
            seq: Some(seq),
            clamp: String::new(),
            guard: String::new(),
        };
        // Command 2 was lost, and 5 came when the vehicle was to stand.
        let log = DriveLog {
            rounds: vec![
                round(150, 1, 0.0),
                round(250, 1, 0.0),
                round(307, 3, 0.01),
                round(407, 4, 0.005),
                round(507, 5, 0.0),
                round(607, 6, 0.0),
            ],
            missing: 0,
        };
        let millis = Duration::from_millis;
        assert_eq!(press_latencies(&log, &journal), [Some(millis(107)), None]);
    }
}
