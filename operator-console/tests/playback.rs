//! A recording over a real session: seek, pause, loop.

#![allow(clippy::unwrap_used, reason = "all of it is tests")]

use std::cell::Cell;
use std::collections::BTreeSet;
use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::thread::sleep;
use std::time::Duration;

use clap::Parser as _;
use edge::cli::VehicleOptions;
use edge::pacer::Rate;
use edge::replay_control::{ReplayState, ReplayStatus};
use measurement::time::RobotDuration;
use network::clock;
use network::sessions::Endpoints;
use operator_console::export::{ExportPart, Fetcher, export_parts};
use operator_console::link::RobotSession;
use operator_console::map_view::{LayerStack, ProbeData};
use operator_console::model::{ConsoleModel, ModelSettings};
use operator_console::playback::{Playback, PlaybackCommand};
use protocol::layer::LayerId;
use protocol::tile::BootId;

/// Limit of each wait in these tests.
const TIMEOUT: Duration = Duration::from_mins(2);

fn rooms() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings/rooms.mcap")
}

const fn seconds(s: i64) -> RobotDuration {
    RobotDuration::from_millis(1000 * s)
}

/// A recording, and a console that views the whole map.
struct Rig {
    playback: Playback,
    session: RobotSession,
}

impl Rig {
    fn open(path: &Path, rate: Rate) -> Self {
        Self::open_with(path, &VehicleOptions::default(), rate)
    }

    fn open_with(path: &Path, setup: &VehicleOptions, rate: Rate) -> Self {
        let playback = Playback::open(path, setup, rate).unwrap();
        let settings = ModelSettings {
            robot: playback.robot().robot.clone(),
            session: BootId([5; 16]),
            tile_store_mb: 64,
            layers: BTreeSet::from([LayerId::Occupancy]),
        };
        let endpoints = Endpoints {
            connect: vec![playback.robot().endpoint.clone()],
            ..Endpoints::default()
        };
        let session = RobotSession::open(settings, &endpoints, || {});
        Self { playback, session }
    }

    fn ask(&self, command: PlaybackCommand) {
        assert!(self.playback.execute(command));
    }

    /// Waits until the recording has this state and the console has its map.
    #[track_caller]
    fn wait(
        &mut self,
        what: &str,
        is_so: impl Fn(&ReplayStatus, &ConsoleModel) -> bool,
    ) -> ReplayStatus {
        let started = clock::now();
        loop {
            if let Some(why) = self.playback.failure() {
                panic!("{what}: {}", why.text);
            }
            let status = self.playback.status();
            let mut model = self.session.model();
            model.set_view([-1e3, -1e3, 1e3, 1e3], BTreeSet::from([LayerId::Occupancy]));
            if is_so(&status, &model) {
                return status;
            }
            assert!(clock::elapsed(started) < TIMEOUT, "{what}: {status:?}");
            drop(model);
            sleep(Duration::from_millis(20));
        }
    }

    /// The console's export equals, byte for byte, that of `robot-edge replay` in `edge`.
    #[track_caller]
    fn assert_exports(&self, edge: &Path, folder: &Path) {
        let model = self.session.handle();
        let fetcher = Fetcher::begin(&model, ExportPart::all(), TIMEOUT);
        let exported = export_parts(folder, ExportPart::all(), |part, _| {
            fetcher.fetch(part, |_| ControlFlow::Continue(()))
        });
        exported.unwrap().outcome(folder).unwrap();
        for file in ["tif", "pgm", "yaml", "png"]
            .map(|kind| format!("occupancy.{kind}"))
            .into_iter()
            .chain(["tum", "geojson"].map(|kind| format!("trajectory.{kind}")))
        {
            let [edge, console] = [edge, folder].map(|at| fs::read(at.join(&file)).unwrap());
            assert!(edge == console, "{file}");
        }
    }

    /// Waits until the recording is paused at `position` with this digest of the console's map.
    #[track_caller]
    fn wait_for_map(&mut self, position: RobotDuration, digest: &str) {
        self.wait(digest, |status, model| {
            let known = model.map().store().root_digest(LayerId::Occupancy);
            status.is_settled
                && status.position == position
                && known.is_some_and(|known| known.to_string() == digest)
        });
    }
}

fn run<'a>(line: impl Iterator<Item = &'a str>) {
    let cli = edge::cli::Cli::try_parse_from(line).unwrap();
    edge::runtime::run_until(&cli, &AtomicBool::new(false), &mut std::io::sink()).unwrap();
}

/// Maps of `robot-edge replay` after this part of a recording, and the digest of the occupancy layer.
fn replayed(recording: &Path, duration_s: &str, folder: &Path) -> String {
    let recording = recording.to_str().unwrap();
    let summary = folder.join("summary.json");
    let line = ["robot-edge", "replay", recording, "--duration", duration_s];
    let line = line
        .into_iter()
        .chain(["--no-network", "--quiet", "--export"]);
    let line = line.chain([
        folder.to_str().unwrap(),
        "--summary",
        summary.to_str().unwrap(),
    ]);
    run(line);
    let summary = fs::read_to_string(summary).unwrap();
    let (_, digest) = summary.split_once("\"digest\": \"").unwrap();
    digest.split_once('"').unwrap().0.to_owned()
}

/// Grey values of an exported map, and the `odom` cell of its upper left corner.
fn exported(folder: &Path) -> (usize, Vec<u8>, [f64; 2]) {
    let pgm = fs::read(folder.join("occupancy.pgm")).unwrap();
    let mut lines = pgm.splitn(4, |&byte| byte == b'\n');
    let size = String::from_utf8(lines.nth(1).unwrap().to_vec()).unwrap();
    let (width, height) = size.split_once(' ').unwrap();
    let pixels = lines.nth(1).unwrap().to_vec();
    let yaml = fs::read_to_string(folder.join("occupancy.yaml")).unwrap();
    let origin = yaml
        .lines()
        .find(|line| line.starts_with("origin:"))
        .unwrap();
    let mut numbers = origin.split(['[', ',', ']']).skip(1);
    let mut number = || numbers.next().unwrap().trim().parse::<f64>().unwrap();
    let (left, bottom) = (number(), number());
    let height: f64 = height.parse().unwrap();
    (
        width.parse().unwrap(),
        pixels,
        [left, bottom + 0.1 * height],
    )
}

#[test]
fn seek_shows_the_map_of_a_replay_to_that_time() {
    let folder = tempfile::tempdir().unwrap();
    let maps = |name: &str| folder.path().join(name);
    let at_60 = replayed(&rooms(), "60", &maps("60"));
    let at_20 = replayed(&rooms(), "20", &maps("20"));
    assert_ne!(at_60, at_20);

    let mut rig = Rig::open(&rooms(), Rate::Times(1.0));
    rig.wait("it plays", |status, _| {
        status.state == ReplayState::Playing && status.position > RobotDuration::ZERO
    });
    rig.ask(PlaybackCommand::Pause);
    rig.ask(PlaybackCommand::Seek(seconds(60)));
    rig.wait_for_map(seconds(60), &at_60);
    let status = rig.playback.status();
    assert_eq!(status.state, ReplayState::Paused);
    let length_s = status.length.unwrap().duration.as_secs_f64();
    assert!((115.0..117.0).contains(&length_s), "{length_s}");

    // Each value under the pointer equals that of the export.
    let (width, pixels, [left, top]) = exported(&maps("60"));
    let model = rig.session.model();
    let mut probed = [0; 3];
    for (index, &grey) in pixels.iter().enumerate().step_by(7) {
        let (column, row) = ((index % width) as f64, (index / width) as f64);
        let point_m = [left + 0.1 * (column + 0.5), top - 0.1 * (row + 0.5)];
        let probe = ProbeData::new(&model, &LayerStack::default(), point_m, clock::now());
        let mut cells = probe.cells.iter();
        let occupancy = cells.find(|cell| cell.layer == LayerId::Occupancy);
        let p = occupancy.and_then(|cell| cell.value);
        let (class, is_so) = match grey {
            0 => (0, p.is_some_and(|p| p >= 0.65)),
            254 => (1, p.is_some_and(|p| p <= 0.20)),
            _ => (2, p.is_none_or(|p| (0.19..=0.65).contains(&p))),
        };
        assert!(is_so, "{grey} and {probe:?}");
        probed[class] += 1;
    }
    assert!(probed.iter().all(|&count| count > 50), "{probed:?}");
    drop(model);
    rig.assert_exports(&maps("60"), &maps("console at 60"));

    // Back, and one step forward.
    rig.ask(PlaybackCommand::Seek(seconds(20)));
    rig.wait_for_map(seconds(20), &at_20);
    assert!(rig.playback.status().restarts >= 1);
    rig.assert_exports(&maps("20"), &maps("console at 20"));
    rig.ask(PlaybackCommand::Seek(seconds(59)));
    rig.ask(PlaybackCommand::Step(seconds(1)));
    rig.wait_for_map(seconds(60), &at_60);
}

#[test]
fn looped_recording_restarts_other_ends() {
    let folder = tempfile::tempdir().unwrap();
    let short = folder.path().join("short.mcap");
    let line = [
        "robot-edge",
        "simulate",
        "rooms",
        "--duration",
        "4",
        "--no-network",
    ];
    let line = line
        .into_iter()
        .chain(["--rate", "max", "--quiet", "--record"]);
    run(line.chain([short.to_str().unwrap()]));
    let mut rig = Rig::open(&short, Rate::Max);
    rig.ask(PlaybackCommand::SetLooping(true));
    rig.wait("the third round", |status, _| status.restarts >= 2);
    rig.ask(PlaybackCommand::SetLooping(false));
    rig.wait("the end", |status, model| {
        let known = model.map().store().cells_known(LayerId::Occupancy);
        status.state == ReplayState::Ended && status.is_settled && known > 0
    });
    let restarts = rig.playback.status().restarts;
    rig.ask(PlaybackCommand::SetRate(Rate::Times(1.0)));
    rig.ask(PlaybackCommand::Play);
    rig.wait("it restarts", |status, _| {
        status.restarts == restarts + 1 && status.state == ReplayState::Playing
    });
    assert!(!rig.playback.execute(PlaybackCommand::Close));
}

#[test]
fn looped_recording_has_no_sensor_fault() {
    let mut rig = Rig::open(&rooms(), Rate::Max);
    rig.ask(PlaybackCommand::SetLooping(true));
    let (reported, last) = (Cell::new(0), Cell::new(None));
    rig.wait("the third round is under way", |status, model| {
        if let Some((status, at)) = model.status()
            && last.replace(Some(*at)) != Some(*at)
        {
            for sensor in &status.sensors {
                assert_eq!(sensor.fault, None, "{sensor:?}");
                reported.set(reported.get() + 1);
            }
        }
        // Two statuses a second: from all parts of a round.
        status.restarts >= 3 && reported.get() >= 24
    });
}

#[test]
fn a_damaged_recording_is_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torn.mcap");
    // Valid first bytes, invalid content.
    let mut bytes = fs::read(rooms()).unwrap();
    bytes[8..].fill(0x5a);
    fs::write(&path, &bytes[..50_000]).unwrap();
    let mut playback = Playback::open(&path, &VehicleOptions::default(), Rate::Max).unwrap();
    let started = clock::now();
    let why = loop {
        if let Some(why) = playback.failure() {
            break why.to_owned();
        }
        assert!(clock::elapsed(started) < TIMEOUT);
        sleep(Duration::from_millis(10));
    };
    assert!(
        why.text.contains("torn.mcap") && why.text.contains("can be read"),
        "{why:?}"
    );
}

/// Measures the time from a click on the timeline until the console has the map of that time.
#[test]
#[ignore = "half a minute: measures"]
fn winding_takes_so_long() {
    let mut rig = Rig::open(&rooms(), Rate::Times(1.0));
    rig.ask(PlaybackCommand::Pause);
    rig.wait("known in length", |status, _| status.length.is_some());
    let mut took: Vec<(bool, Duration)> = Vec::new();
    // A fixed sequence over the whole length: 47 is coprime to the number of seconds.
    let mut at_s = 0;
    for step in 1..=40 {
        let to_s = step * 47 % 110;
        let (to, clicked) = (seconds(to_s), clock::now());
        rig.ask(PlaybackCommand::Seek(to));
        rig.wait("seek", |status, model| {
            status.is_settled && status.position == to && model.matches_last_head()
        });
        took.push((to_s > at_s, clock::elapsed(clicked)));
        at_s = to_s;
    }
    for is_forward in [true, false] {
        let mut times: Vec<_> = took
            .iter()
            .filter(|(forward, _)| *forward == is_forward)
            .map(|(_, time)| time.as_millis())
            .collect();
        times.sort_unstable();
        let (middle, last) = (times[times.len() / 2], times[times.len() - 1]);
        let way = if is_forward { "on" } else { "back" };
        println!(
            "{} times {way}: median {middle} ms, most {last} ms",
            times.len()
        );
    }
}

/// A log with a front and a rear laser.
fn two_lasers(path: &Path) {
    let ranges = (0..180).map(|beam| format!("{:.2} ", 2.0 + 0.01 * f64::from(beam)));
    let ranges = ranges.collect::<String>();
    let scan = |laser: &str, secs: u32| {
        let x_m = 0.1 * f64::from(secs);
        format!("{laser} 180 {ranges}{x_m} 0 0 {x_m} 0 0 {secs} robot {secs}\n")
    };
    let log: String = (1..=5)
        .map(|secs| scan("FLASER", secs) + &scan("RLASER", secs))
        .collect();
    fs::write(path, log).unwrap();
}

#[test]
fn a_recording_with_two_lasers_is_mapped_after_a_choice() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.log");
    two_lasers(&path);
    let mut asked = Playback::open(&path, &VehicleOptions::default(), Rate::Max).unwrap();
    let started = clock::now();
    let failure = loop {
        if let Some(failure) = asked.failure() {
            break failure.clone();
        }
        assert!(clock::elapsed(started) < TIMEOUT, "it asks nothing");
        sleep(Duration::from_millis(20));
    };
    assert_eq!(failure.text, "Which topic is the laser?");
    let labels: Vec<_> = failure
        .choices
        .iter()
        .map(|choice| &*choice.label)
        .collect();
    assert_eq!(labels, ["FLASER", "RLASER"]);
    for choice in 0..2 {
        let setup = asked.setup_with(choice).unwrap();
        let mut rig = Rig::open_with(&path, &setup, Rate::Max);
        rig.wait("it is mapped", |status, model| {
            status.state == ReplayState::Ended
                && model.map().store().tiles(LayerId::Occupancy).count() > 0
        });
    }
    assert_eq!(asked.setup_with(2), None);
}
