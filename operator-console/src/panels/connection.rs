//! State of the link, and whether the map is synchronized.

use std::path::PathBuf;
use std::time::Duration;

use eframe::egui::{TextStyle, Ui};
use measurement::time::Monotonic;
use protocol::keys::RobotId;

use super::formatting::{age, count, with_monospace_options};
use super::rows::{Row, row, rows_ui};
use crate::link::Transport;
use crate::model::{ConsoleModel, LinkState, MapSync};
use crate::theme::{Tone, long_state_ui, state_ui};

/// Map heads are compared once a second. A map that was equal so recently counts as synchronized.
pub(super) const SYNCHRONIZED_FOR: Duration = Duration::from_secs(5);
const SYNCHRONIZED: &str = "Synchronized";
const BEHIND: &str = "Behind";
const NO_MAP: &str = "No map";
const OLD: &str = "Old";
const FETCHED_ON_RECONNECTION: &str = "Its map is fetched on reconnection";
/// All short texts of the map state, for the width of the top bar.
pub(super) const SHORT_MAP_STATES: [&str; 4] = [SYNCHRONIZED, BEHIND, NO_MAP, OLD];
const DRAWING: &str = "Drawing";
const ENDED: &str = "Ended";
pub(super) const FAILED: &str = "Failed";
/// All short texts of a recording's map state.
pub(super) const SHORT_RECORDING_MAP_STATES: [&str; 3] = [SYNCHRONIZED, DRAWING, NO_MAP];

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LinkStatus {
    pub is_connected: bool,
    pub problem: Option<String>,
    /// File name if a recording is replayed in this program.
    pub recording: Option<String>,
    pub failure: Option<String>,
    pub transport: Option<Transport>,
    /// Folder of the robot's recordings, if it is on this machine.
    pub recordings: Option<PathBuf>,
}

impl LinkStatus {
    pub fn name_of(&self, robot: &RobotId) -> String {
        self.recording.clone().unwrap_or_else(|| robot.to_string())
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct ConnectionData {
    pub tone: Tone,
    pub state: String,
    pub advice: Option<String>,
    pub map_tone: Tone,
    pub map: String,
    pub map_short: &'static str,
    pub rows: Vec<(String, String)>,
}

impl ConnectionData {
    pub fn new(model: &ConsoleModel, link: &LinkStatus, now: Monotonic) -> Self {
        let connection = model.connection();
        let state = match (connection.state(now), &link.recording) {
            // A recording has no link. The timeline shows why it ended.
            (LinkState::Silent, Some(_)) => LinkState::Live,
            (state, _) => state,
        };
        let robot = model.robot();
        let has_ended = model.reports_ended();
        let (tone, word, advice) = match state {
            _ if link.failure.is_some() => (Tone::Warning, FAILED.to_owned(), link.failure.clone()),
            // A recording is never live.
            LinkState::Live if link.recording.is_some() => {
                (Tone::Waiting, "Recording".to_owned(), None)
            }
            LinkState::Waiting if link.recording.is_some() => {
                let advice = "The recording is scanned before it is mapped.";
                (Tone::Waiting, "Opening".to_owned(), Some(advice.to_owned()))
            }
            LinkState::Live => {
                let (word, tone, advice) = if has_ended {
                    let advice = "Its data has ended: nothing new will come.";
                    (ENDED, Tone::Waiting, Some(advice.to_owned()))
                } else {
                    ("Live", Tone::Good, None)
                };
                let tone = link.problem.as_ref().map_or(tone, |_| Tone::Warning);
                (tone, word.to_owned(), link.problem.clone().or(advice))
            }
            LinkState::Waiting => {
                let advice = match (&link.problem, link.is_connected) {
                    (Some(problem), _) => problem.clone(),
                    (None, true) => format!("Connected. Waiting for data of {robot}."),
                    (None, false) => format!("Connecting to {robot}."),
                };
                (Tone::Waiting, "Waiting".to_owned(), Some(advice))
            }
            LinkState::Silent if model.is_silence_expected() => {
                let advice = "Its data has ended.";
                (Tone::Waiting, ENDED.to_owned(), Some(advice.to_owned()))
            }
            LinkState::Silent => {
                let advice = match (&link.problem, connection.is_present()) {
                    (Some(problem), _) => problem.clone(),
                    (None, Some(false)) => {
                        format!("{robot} is not on the network. It is reconnected when it is.")
                    }
                    (None, Some(true) | None) => {
                        format!("{robot} does not answer. It is reconnected when it does.")
                    }
                };
                (Tone::Warning, "Silent".to_owned(), Some(advice))
            }
        };
        let last_contact = connection.age(now).unwrap_or_default();
        let (map_tone, map, map_short) = match map_state(model.map(), (state, last_contact), now) {
            // The replay has failed: no map will come.
            (_, _, NO_MAP) if link.failure.is_some() => (Tone::Warning, NO_MAP.to_owned(), NO_MAP),
            (tone, _, BEHIND) if link.recording.is_some() => drawing(tone, missing(model.map())),
            (Tone::Warning, text, short) if model.is_silence_expected() => {
                (Tone::Waiting, text, short)
            }
            state => state,
        };
        Self {
            tone,
            state: word,
            advice,
            map_tone,
            map,
            map_short,
            rows: match link.recording {
                Some(_) => Vec::new(),
                None => rows(model, state, now),
            },
        }
    }
}

fn rows(model: &ConsoleModel, state: LinkState, now: Monotonic) -> Vec<Row> {
    let connection = model.connection();
    let last_contact = connection
        .age(now)
        .map_or_else(|| "–".to_owned(), |time| format!("{} ago", age(time)));
    let mut rows = vec![row("Last message", last_contact)];
    // Measurements of a silent link are not shown.
    if state != LinkState::Silent {
        rows.push(row("Round trip", round_trip(model, now)));
        let receiving = format!("{:.0} kbit/s", connection.kbps(now));
        rows.push(row("Receiving", receiving));
    }
    rows
}

pub(super) fn round_trip(model: &ConsoleModel, now: Monotonic) -> String {
    let connection = model.connection();
    let is_live = connection.state(now) == LinkState::Live;
    match connection.round_trip().filter(|_| is_live) {
        None => "–".to_owned(),
        Some(time) if time.as_millis() == 0 => "< 1 ms".to_owned(),
        Some(time) => format!("{} ms", time.as_millis()),
    }
}

pub(super) fn is_shown_synchronized(map: &MapSync, now: Monotonic) -> bool {
    let last_contact = (LinkState::Live, Duration::ZERO);
    map_state(map, last_contact, now).2 == SYNCHRONIZED
}

fn map_state(
    map: &MapSync,
    (state, last_contact): (LinkState, Duration),
    now: Monotonic,
) -> (Tone, String, &'static str) {
    let Some(_announced) = map.head_at() else {
        if state == LinkState::Silent {
            return (Tone::Warning, FETCHED_ON_RECONNECTION.to_owned(), NO_MAP);
        }
        return (Tone::Waiting, format!("{NO_MAP} yet"), NO_MAP);
    };
    let equal_at = map
        .layer_states()
        .map(|step| step.last_equal)
        .min()
        .flatten();
    if state == LinkState::Silent {
        // A map that was equal at the last contact counts as equal at the time the link was lost.
        let before = equal_at.map(|at| now.since(at).saturating_sub(last_contact));
        let text = match before {
            _ if map.matches_head() => "Was synchronized at last contact".to_owned(),
            Some(before) if before < SYNCHRONIZED_FOR => {
                format!("Was synchronized {} before the link was lost", age(before))
            }
            Some(_) | None => "Was not synchronized at last contact".to_owned(),
        };
        return (Tone::Warning, text, OLD);
    }
    if map.matches_head() {
        return (Tone::Good, SYNCHRONIZED.to_owned(), SYNCHRONIZED);
    }
    let missing = missing(map);
    if missing > 0 {
        let text = format!("{} missing", tiles(missing));
        return (Tone::Waiting, text, BEHIND);
    }
    match equal_at.map(|at| now.since(at)) {
        Some(since) if since < SYNCHRONIZED_FOR => {
            let text = format!("{SYNCHRONIZED} {} ago", age(since));
            (Tone::Good, text, SYNCHRONIZED)
        }
        Some(_) | None => {
            let text = format!("{BEHIND}, asking what is missing");
            (Tone::Waiting, text, BEHIND)
        }
    }
}

fn missing(map: &MapSync) -> usize {
    map.layer_states().map(|step| step.missing).sum()
}

fn tiles(number: usize) -> String {
    let tiles = if number == 1 { "tile" } else { "tiles" };
    format!("{} {tiles}", count(number as u64))
}

fn drawing(tone: Tone, missing: usize) -> (Tone, String, &'static str) {
    let text = match missing {
        0 => "Being drawn".to_owned(),
        1.. => format!("Being drawn: {} to come", tiles(missing)),
    };
    (tone, text, DRAWING)
}

pub fn connection_ui(ui: &mut Ui, data: &ConnectionData) {
    state_ui(ui, data.tone, &data.state, 24.0);
    if let Some(advice) = &data.advice {
        let ink = ui.visuals().text_color();
        ui.label(with_monospace_options(ui, advice, &TextStyle::Small, ink));
    }
    long_state_ui(ui, data.map_tone, &data.map, 16.0);
    rows_ui(ui, "connection", &data.rows);
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::layer::LayerId;
    use protocol::message::Status;
    use protocol::tile::{TileCells, TileKey};

    use super::*;
    use crate::test_support::{
        announce_map, at, console, ended_status, idle_teleop_status, inject, store_of,
    };

    /// A robot or recording that announces a map with one tile of these layers.
    fn announced(robot: &str, wanted: &[LayerId]) -> ConsoleModel {
        let layer = LayerId::Occupancy;
        let mut store = store_of(&[layer]);
        let key = TileKey {
            layer,
            tx: 0,
            ty: 0,
        };
        let cells = TileCells::from_fn(|_, _| 251);
        drop(store.publish(key, cells).unwrap());
        let mut model = console(robot, wanted);
        announce_map(&mut model, &store, at(1_000));
        model
    }

    #[test]
    fn docs_contain_the_map_states() {
        let handbook = include_str!("../../../docs/console.md");
        let handbook = handbook.split_whitespace().collect::<Vec<_>>().join(" ");
        let unknown = console("scout", &[]);
        let equal = announced("scout", &[]);
        let behind = announced("scout", &[LayerId::Occupancy]);
        let mut all = vec![drawing(Tone::Waiting, 0)];
        for model in [unknown, equal, behind] {
            for link in [LinkState::Live, LinkState::Silent] {
                let contact = (link, Duration::from_millis(100));
                all.push(map_state(model.map(), contact, at(1_100)));
            }
        }
        for (_, long, short) in all {
            for words in [long.as_str(), short] {
                assert!(handbook.contains(&format!("*{words}*")), "{words}");
            }
        }
    }

    #[test]
    fn the_map_of_a_recording_is_drawn_not_fetched() {
        let model = announced("recording-1", &[LayerId::Occupancy]);
        let reported = |link: &LinkStatus| {
            let data = ConnectionData::new(&model, link, at(1_100));
            (data.map_tone, data.map, data.map_short)
        };
        let behind = "Behind, asking what is missing".to_owned();
        let robot = LinkStatus::default();
        assert_eq!(reported(&robot), (Tone::Waiting, behind, "Behind"));
        let recording = LinkStatus {
            recording: Some("rooms.mcap".to_owned()),
            ..LinkStatus::default()
        };
        let drawn = (Tone::Waiting, "Being drawn".to_owned(), "Drawing");
        assert_eq!(reported(&recording), drawn);
        for (missing, text) in [
            (1, "Being drawn: 1 tile to come"),
            (1_200, "Being drawn: 1\u{a0}200 tiles to come"),
        ] {
            let expected = (Tone::Waiting, text.to_owned(), "Drawing");
            assert_eq!(drawing(Tone::Waiting, missing), expected);
        }
    }

    #[test]
    fn a_recording_is_not_live() {
        let model = console("recording-1", &[]);
        let link = LinkStatus {
            transport: None,
            recordings: None,
            recording: Some("rooms.mcap".to_owned()),
            failure: None,
            problem: Some("no answer at tcp/127.0.0.1:9".to_owned()),
            is_connected: false,
        };
        let data = ConnectionData::new(&model, &link, Monotonic::default());
        assert_eq!((data.tone, &*data.state), (Tone::Waiting, "Opening"));
        let failed = LinkStatus {
            failure: Some("it has no scans".to_owned()),
            ..link.clone()
        };
        let of_failed = ConnectionData::new(&model, &failed, Monotonic::default());
        let text = (of_failed.tone, &*of_failed.state, &*of_failed.map);
        assert_eq!(text, (Tone::Warning, "Failed", "No map"));
        assert_eq!(of_failed.advice, failed.failure);
        let advice = data.advice.unwrap();
        assert!(!advice.contains("nobody"), "{advice}");
        assert_eq!(data.rows, []);
        assert_eq!(link.name_of(model.robot()), "rooms.mcap");
        let robot = LinkStatus::default().name_of(model.robot());
        assert_eq!(robot, "recording-1");
    }

    #[test]
    fn problem_of_the_bulk_session_is_shown() {
        let mut model = console("scout", &[]);
        inject(&mut model, Topic::Status, &Status::default(), at(1_000));
        let of = |problem: Option<&str>| {
            let link = LinkStatus {
                is_connected: true,
                problem: problem.map(str::to_owned),
                ..LinkStatus::default()
            };
            let data = ConnectionData::new(&model, &link, at(1_100));
            (data.tone, data.state, data.advice)
        };
        assert_eq!(of(None), (Tone::Good, "Live".to_owned(), None));
        let why = "no answer at tcp/boat:7448, where maps come from; trying again";
        let reported = (Tone::Warning, "Live".to_owned(), Some(why.to_owned()));
        assert_eq!(of(Some(why)), reported);
    }

    #[test]
    fn ended_data_is_not_live() {
        let mut model = console("scout", &[]);
        let ended = ended_status();
        inject(&mut model, Topic::Status, &ended, at(1_000));
        let mut link = LinkStatus::default();
        let data = ConnectionData::new(&model, &link, at(1_100));
        assert_eq!((data.tone, &*data.state), (Tone::Waiting, "Ended"));
        assert!(data.rows.contains(&row("Last message", "0.1 s ago")));
        let advice = "Its data has ended: nothing new will come.";
        assert_eq!(data.advice.as_deref(), Some(advice));
        link.problem = Some("no answer at tcp/boat:7448".to_owned());
        let data = ConnectionData::new(&model, &link, at(1_100));
        assert_eq!((data.tone, &*data.state), (Tone::Warning, "Ended"));
        assert_eq!(data.advice, link.problem);
        let data = ConnectionData::new(&model, &LinkStatus::default(), at(9_000));
        assert_eq!((data.tone, &*data.state), (Tone::Waiting, "Ended"));
        assert_eq!(data.advice.as_deref(), Some("Its data has ended."));
        assert!(data.rows.contains(&row("Last message", "8.0 s ago")));
        let teleop = Some(idle_teleop_status());
        inject(
            &mut model,
            Topic::Status,
            &Status { teleop, ..ended },
            at(9_100),
        );
        let data = ConnectionData::new(&model, &LinkStatus::default(), at(19_000));
        assert_eq!((data.tone, &*data.state), (Tone::Waiting, "Ended"));
    }
}
