//! What the time line shows, in words and seconds.

use measurement::time::RobotDuration;
use robot_edge::pacer::Rate;
use robot_edge::replay_control::{ReplayState, ReplayStatus, TimelineMark};

use crate::event_log::kind_label;
use crate::playback::is_playing;
use crate::theme::Tone;

/// A rate that is reached by less than this share is said.
const NEARLY_REACHED: f64 = 0.9;

/// What the time line shows.
#[derive(Clone, Debug, PartialEq)]
pub struct TimelineData {
    /// The file's name.
    pub name: String,
    /// Why nothing more comes.
    pub failure: Option<String>,
    /// What it is doing, as a mark.
    pub tone: Tone,
    /// What it is doing, in a few words.
    pub state: String,
    /// The recording is still being looked through.
    pub is_opening: bool,
    /// Whether it is not to stand still: the button says so.
    pub is_playing: bool,
    /// What is in the map, seconds from the first scan.
    pub position_s: f64,
    /// The same in words.
    pub position: String,
    /// Where it is being wound to, seconds.
    pub target_s: Option<f64>,
    /// How long it is, seconds.
    pub length_s: Option<f64>,
    /// The same in words.
    pub length: Option<String>,
    /// The speed that is wanted.
    pub rate: Rate,
    /// Whether it begins anew at the end.
    pub is_looping: bool,
    /// What happened when.
    pub marks: Vec<DrawnMark>,
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnMark {
    /// When, seconds.
    pub at_s: f64,
    /// Data is missing or wrong, in contrast to what only happened.
    pub is_fault: bool,
    /// When and what, in words.
    pub words: String,
}

impl TimelineData {
    /// Of the recording called `name`.
    pub fn new(name: &str, status: &ReplayStatus, failure: Option<&str>) -> Self {
        let (tone, state) = state(name, status);
        let target = match status.state {
            ReplayState::Seeking { to } => Some(to),
            ReplayState::Opening
            | ReplayState::Playing
            | ReplayState::Paused
            | ReplayState::Ended => None,
        };
        Self {
            name: name.to_owned(),
            failure: failure.map(str::to_owned),
            tone,
            state,
            is_opening: status.state == ReplayState::Opening,
            is_playing: is_playing(status),
            position_s: status.position.as_secs_f64(),
            position: clock(status.position),
            target_s: target.map(RobotDuration::as_secs_f64),
            // What is behind a guess of the end is no guess.
            length_s: status
                .length
                .map(|length| length.duration.max(status.position).as_secs_f64()),
            length: status.length.map(|length| {
                let words = clock(length.duration.max(status.position));
                if length.is_estimate {
                    format!("about {words}")
                } else {
                    words
                }
            }),
            rate: status.rate,
            is_looping: status.is_looping,
            marks: status.marks.iter().map(mark).collect(),
        }
    }
}

fn state(name: &str, status: &ReplayStatus) -> (Tone, String) {
    match status.state {
        ReplayState::Opening => (Tone::Waiting, format!("Looking through {name}")),
        ReplayState::Paused => (Tone::Waiting, "Paused".to_owned()),
        ReplayState::Ended => (Tone::Waiting, "At the end".to_owned()),
        ReplayState::Seeking { to } => {
            let words = format!("Mapping up to {}", clock(to));
            (Tone::Waiting, with_speed(words, status.rate_reached))
        }
        ReplayState::Playing => match (status.rate, status.rate_reached) {
            (Rate::Max, reached) => (Tone::Good, with_speed("Playing".to_owned(), reached)),
            (Rate::Times(wanted), Some(reached)) if reached < NEARLY_REACHED * wanted => (
                Tone::Warning,
                format!("Only {} of {} reached", rounded(reached), times(wanted)),
            ),
            (Rate::Times(_), _) => (Tone::Good, "Playing".to_owned()),
        },
    }
}

fn with_speed(words: String, reached: Option<f64>) -> String {
    match reached {
        Some(reached) => format!("{words} at {}", rounded(reached)),
        None => words,
    }
}

fn mark(mark: &TimelineMark) -> DrawnMark {
    let kind = kind_label(mark.kind);
    DrawnMark {
        at_s: mark.at.as_secs_f64(),
        is_fault: matches!(mark.kind, "gap" | "clock" | "loss" | "pose_jump"),
        words: format!("{}  {kind}: {}", clock(mark.at), mark.message),
    }
}

/// A rate in words.
pub(super) fn rate_text(rate: Rate) -> String {
    match rate {
        Rate::Times(wanted) => times(wanted),
        Rate::Max => "max".to_owned(),
    }
}

/// A rate as it is measured: it is never quite the same.
fn rounded(rate: f64) -> String {
    let decimals = usize::from(rate < 9.95);
    format!("{rate:.decimals$}×")
}

fn times(rate: f64) -> String {
    if rate >= 9.95 {
        format!("{rate:.0}×")
    } else {
        let digits = format!("{rate:.2}");
        let digits = digits.trim_end_matches('0').trim_end_matches('.');
        format!("{digits}×")
    }
}

/// Minutes, seconds and tenths, and hours where there are any. What has not passed yet is not said: tenths are cut.
pub(crate) fn clock(time: RobotDuration) -> String {
    let tenths = time.as_nanos().max(0) / 100_000_000;
    let (seconds, tenth) = (tenths / 10, tenths % 10);
    let (minutes, second) = (seconds / 60, seconds % 60);
    let (hours, minute) = (minutes / 60, minutes % 60);
    if hours > 0 {
        format!("{hours}:{minute:02}:{second:02}.{tenth}")
    } else {
        format!("{minute}:{second:02}.{tenth}")
    }
}
