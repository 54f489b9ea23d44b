//! What is tried again and again, and fails alike each time, is said once.

/// What was said last, as long as it holds.
#[derive(Debug, Default)]
pub(super) struct RepeatFilter {
    last: Option<String>,
}

impl RepeatFilter {
    /// The problem of one more try, `None` where there was none: what of it is to be said.
    pub(super) fn only_new(&mut self, problem: Option<String>) -> Option<String> {
        if problem == self.last {
            return None;
        }
        self.last.clone_from(&problem);
        problem
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_problem_is_said_again_only_when_it_is_another_or_was_over() {
        let mut repeats = RepeatFilter::default();
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
            assert_eq!(repeats.only_new(problem.clone()), expected, "{problem:?}");
        }
    }
}
