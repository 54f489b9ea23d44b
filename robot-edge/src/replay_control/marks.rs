//! What happened at which time of a recording.

use measurement::time::RobotDuration;

/// Marks that are kept; of more, the first.
pub const MAX_MARKS: usize = 500;

/// Something that happened at a time of the data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TimelineMark {
    /// When, from the first scan.
    pub at: RobotDuration,
    /// What, in one word: those of [`crate::pipeline::MapEvent`], `gap`, `clock` and `loss`.
    pub kind: &'static str,
    /// What, in a sentence.
    pub message: String,
}

/// Marks in the order of the data, each once however often it is replayed.
#[derive(Clone, Debug, Default)]
pub(super) struct TimelineMarks(Vec<TimelineMark>);

impl TimelineMarks {
    pub(super) fn all(&self) -> &[TimelineMark] {
        &self.0
    }

    /// Whether it is not known yet: replaying is deterministic, so that what happens again is the same.
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

#[cfg(test)]
mod tests {
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
