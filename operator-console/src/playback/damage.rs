//! What of a recording could not be read, as it is reached: told once each, however often that part is replayed.

use robot_edge::replay_control::TimelineMark;

/// The kind of marks of what could not be read.
const LOSS: &str = "loss";

/// What was told, and what is to be.
#[derive(Debug, Default)]
pub(super) struct Damage {
    known: Vec<TimelineMark>,
    unreported: Vec<TimelineMark>,
}

impl Damage {
    /// Looks at all marks of the time line.
    pub(super) fn update(&mut self, marks: &[TimelineMark]) {
        let losses = marks.iter().filter(|mark| mark.kind == LOSS);
        if losses.clone().count() == self.known.len() {
            return;
        }
        for mark in losses {
            if !self.known.contains(mark) {
                self.known.push(mark.clone());
                self.unreported.push(mark.clone());
            }
        }
    }

    /// What nobody was told of yet, in words: where in the recording, and what.
    pub(super) fn take_unreported(
        &mut self,
        clock: impl Fn(&TimelineMark) -> String,
    ) -> Vec<String> {
        let unreported = std::mem::take(&mut self.unreported);
        let words = |mark: &TimelineMark| format!("damaged at {}: {}", clock(mark), mark.message);
        unreported.iter().map(words).collect()
    }
}

#[cfg(test)]
mod tests {
    use measurement::time::RobotDuration;

    use super::*;

    #[test]
    fn each_loss_is_told_once_and_nothing_else_is() {
        let mark = |s: i64, kind| TimelineMark {
            at: RobotDuration::from_millis(1000 * s),
            kind,
            message: format!("byte {s}"),
        };
        let mut damage = Damage::default();
        let mut reported = |marks: &[TimelineMark]| {
            damage.update(marks);
            damage.take_unreported(|mark| format!("{} s", mark.at.as_secs_f64()))
        };
        assert_eq!(reported(&[mark(3, "gap")]), [""; 0]);
        assert_eq!(
            reported(&[mark(3, "gap"), mark(9, LOSS)]),
            ["damaged at 9 s: byte 9"]
        );
        // Marks stand in the order of the data, not in that in which they came.
        let all = [mark(3, "gap"), mark(5, LOSS), mark(9, LOSS)];
        assert_eq!(reported(&all), ["damaged at 5 s: byte 5"]);
        assert_eq!(reported(&all), [""; 0]);
    }
}
