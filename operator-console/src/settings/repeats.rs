//! What is tried again and again, and fails alike each time, is said once.

/// What was said last, as long as it holds.
#[derive(Debug, Default)]
pub(super) struct Repeats {
    said: Option<String>,
}

impl Repeats {
    /// The problem of one more try, `None` where there was none: what of it is to be said.
    pub(super) fn leave_out(&mut self, problem: Option<String>) -> Option<String> {
        if problem == self.said {
            return None;
        }
        self.said.clone_from(&problem);
        problem
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_problem_is_said_again_only_when_it_is_another_or_was_over() {
        let mut repeats = Repeats::default();
        let (full, readonly) = (Some("full".to_owned()), Some("read-only".to_owned()));
        for (problem, is_said) in [
            (&None, false),
            (&full, true),
            (&full, false),
            (&readonly, true),
            (&readonly, false),
            (&None, false),
            (&readonly, true),
        ] {
            let expected = problem.clone().filter(|_| is_said);
            assert_eq!(repeats.leave_out(problem.clone()), expected, "{problem:?}");
        }
    }
}
