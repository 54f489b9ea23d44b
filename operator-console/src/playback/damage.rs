//! What of a recording could not be read, as it is reached: told once each, however often that part is replayed.

use robot_edge::replay_control::Mark;

/// The kind of marks of what could not be read.
const LOSS: &str = "loss";

/// What was told, and what is to be.
#[derive(Debug, Default)]
pub(super) struct Damage {
    known: Vec<Mark>,
    untold: Vec<Mark>,
}

impl Damage {
    /// Looks at all marks of the time line.
    pub(super) fn look(&mut self, marks: &[Mark]) {
        let losses = marks.iter().filter(|mark| mark.kind == LOSS);
        if losses.clone().count() == self.known.len() {
            return;
        }
        for mark in losses {
            if !self.known.contains(mark) {
                self.known.push(mark.clone());
                self.untold.push(mark.clone());
            }
        }
    }

    /// What nobody was told of yet, in words: where in the recording, and what.
    pub(super) fn take_news(&mut self, clock: impl Fn(&Mark) -> String) -> Vec<String> {
        let untold = std::mem::take(&mut self.untold);
        let words = |mark: &Mark| format!("damaged at {}: {}", clock(mark), mark.message);
        untold.iter().map(words).collect()
    }
}

#[cfg(test)]
mod tests {
    use robot_edge::robot_time::RobotDuration;

    use super::*;

    #[test]
    fn each_loss_is_told_once_and_nothing_else_is() {
        let mark = |s: i64, kind| Mark {
            at: RobotDuration::from_millis(1000 * s),
            kind,
            message: format!("byte {s}"),
        };
        let mut damage = Damage::default();
        let mut told = |marks: &[Mark]| {
            damage.look(marks);
            damage.take_news(|mark| format!("{} s", mark.at.as_secs_f64()))
        };
        assert_eq!(told(&[mark(3, "gap")]), [""; 0]);
        assert_eq!(
            told(&[mark(3, "gap"), mark(9, LOSS)]),
            ["damaged at 9 s: byte 9"]
        );
        // Marks stand in the order of the data, not in that in which they came.
        let all = [mark(3, "gap"), mark(5, LOSS), mark(9, LOSS)];
        assert_eq!(told(&all), ["damaged at 5 s: byte 5"]);
        assert_eq!(told(&all), [""; 0]);
    }
}
