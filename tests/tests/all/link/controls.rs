//! The accessibility tree of a console's window, which `--controls` writes to a file.

use std::fs;
use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;

use robot_edge::clock;

/// Longer than any step takes on a busy machine.
const TIMEOUT: Duration = Duration::from_mins(1);

/// A control.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Control {
    pub(crate) role: String,
    /// Left, top, right and bottom, pixels.
    pub(crate) edges: [i16; 4],
    /// Its label, or else its value.
    pub(crate) words: String,
}

impl Control {
    pub(crate) fn middle(&self) -> [i16; 2] {
        let [left, top, right, bottom] = self.edges;
        [left.midpoint(right), top.midpoint(bottom)]
    }
}

/// The file with all controls.
pub(crate) struct Controls(pub(crate) PathBuf);

impl Controls {
    /// All controls; none before the first frame.
    pub(crate) fn all(&self) -> Vec<Control> {
        let text = fs::read_to_string(&self.0).unwrap_or_default();
        let rows = text.lines().map(|line| line.split('\t').collect());
        // A text run is part of another control.
        rows.filter(|fields: &Vec<&str>| fields[0] != "TextRun")
            .map(|fields| {
                let edge = |at: usize| fields[at].parse().unwrap();
                Control {
                    role: fields[0].to_owned(),
                    edges: [edge(1), edge(2), edge(3), edge(4)],
                    words: if fields[5].is_empty() {
                        fields[6]
                    } else {
                        fields[5]
                    }
                    .to_owned(),
                }
            })
            .collect()
    }

    /// Waits until `find` returns a value.
    pub(crate) fn wait_for<T>(&self, what: &str, find: impl Fn(&[Control]) -> Option<T>) -> T {
        let started = clock::now();
        loop {
            let all = self.all();
            if let Some(found) = find(&all) {
                return found;
            }
            if clock::elapsed(started) > TIMEOUT {
                let printed: Vec<_> = all
                    .iter()
                    .map(|control| format!("{}: {}", control.role, control.words))
                    .collect();
                panic!("timed out: {what}. Controls:\n{}", printed.join("\n"));
            }
            sleep(Duration::from_millis(10));
        }
    }

    /// Waits for a control whose text begins with `words`.
    pub(crate) fn beginning(&self, words: &str) -> Control {
        self.wait_for(words, |all| {
            let mut all = all.iter();
            all.find(|control| control.words.starts_with(words))
                .cloned()
        })
    }

    /// Waits until no control's text begins with `words`.
    pub(crate) fn without(&self, words: &str) {
        self.wait_for(&format!("the end of {words:?}"), |all| {
            let is_there = all.iter().any(|control| control.words.starts_with(words));
            (!is_there).then_some(())
        });
    }

    /// Waits for a control of this role and text.
    pub(crate) fn named(&self, role: &str, words: &str) -> Control {
        self.wait_for(&format!("{role} {words}"), |all| {
            let mut all = all.iter();
            all.find(|control| control.role == role && control.words == words)
                .cloned()
        })
    }
}
