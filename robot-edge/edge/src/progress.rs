//! The progress bar on standard error.

use std::io::IsTerminal as _;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use recording::Position;

const DRAWS_HZ: u8 = 5;
const WITH_LENGTH: &str = "{wide_bar} {percent:>3} %  {msg}";
const WITHOUT_LENGTH: &str = "{spinner} {msg}";

#[derive(Debug)]
pub struct Progress(ProgressBar);

#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct ProgressFigures {
    pub data_s: f64,
    pub wall_s: f64,
    pub scans: u64,
    /// Dropped scans and losses of the recording.
    pub drops: u64,
}

impl Progress {
    /// Hidden if standard error is no terminal or `is_quiet`.
    pub fn new(is_quiet: bool) -> Self {
        if is_quiet || !std::io::stderr().is_terminal() {
            return Self(ProgressBar::hidden());
        }
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(DRAWS_HZ));
        set_template(&bar, WITHOUT_LENGTH);
        Self(bar)
    }

    /// Shows new figures; `position` is `None` if there is no end (simulation, `--loop`). Cheap enough for every
    /// scan.
    pub fn update(&self, position: Option<Position>, figures: &ProgressFigures) {
        if self.0.is_hidden() {
            return;
        }
        if let Some(position) = position {
            if self.0.length() != Some(position.bytes_total) {
                self.0.set_length(position.bytes_total);
                set_template(&self.0, WITH_LENGTH);
            }
            self.0
                .set_position(position.bytes_read.min(position.bytes_total));
        }
        self.0.set_message(figures.to_string());
    }

    /// Runs `write` while the bar is hidden, so that its lines stay complete.
    pub fn suspend<T>(&self, write: impl FnOnce() -> T) -> T {
        self.0.suspend(write)
    }

    pub fn finish(&self) {
        self.0.finish_and_clear();
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.finish();
    }
}

impl std::fmt::Display for ProgressFigures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let speed_up = self.data_s / self.wall_s;
        if speed_up.is_finite() {
            write!(f, "{speed_up:.1}×  ")?;
        }
        write!(
            f,
            "{:.0} s  {} scans  {} dropped",
            self.data_s, self.scans, self.drops
        )
    }
}

fn set_template(bar: &ProgressBar, template: &str) {
    // An invalid template leaves the plain bar; a test checks them.
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use indicatif::InMemoryTerm;

    const FIGURES: ProgressFigures = ProgressFigures {
        data_s: 61.0,
        wall_s: 0.5,
        scans: 910,
        drops: 2,
    };

    #[test]
    fn figures_read_in_one_line() {
        assert_eq!(FIGURES.to_string(), "122.0×  61 s  910 scans  2 dropped");
        assert_eq!(
            ProgressFigures::default().to_string(),
            "0 s  0 scans  0 dropped"
        );
    }

    #[test]
    fn the_bar_shows_position_and_figures() {
        let screen = InMemoryTerm::new(4, 80);
        let target = ProgressDrawTarget::term_like(Box::new(screen.clone()));
        let bar = ProgressBar::with_draw_target(None, target);
        set_template(&bar, WITHOUT_LENGTH);
        let progress = Progress(bar);
        let position = Position {
            bytes_read: 30,
            bytes_total: 120,
        };
        progress.update(None, &FIGURES);
        assert!(
            screen.contents().contains("910 scans"),
            "{}",
            screen.contents()
        );
        progress.update(Some(position), &FIGURES);
        progress.0.force_draw();
        assert!(
            screen.contents().contains(" 25 %  122.0×"),
            "{}",
            screen.contents()
        );
        progress.finish();
        assert_eq!(screen.contents(), "");
    }

    #[test]
    fn nothing_is_drawn_when_it_is_to_be_quiet() {
        assert!(Progress::new(true).0.is_hidden());
    }

    #[test]
    fn templates_can_be_read() {
        for template in [WITH_LENGTH, WITHOUT_LENGTH] {
            assert!(ProgressStyle::with_template(template).is_ok(), "{template}");
        }
    }
}
