//! Benchmarks of a console that joins late, on emulated links. Needs root; each prints rows of a table.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::rig::Conditions;
use foreshore_tests::rig::tun::{Namespaces, Side};
use network::clock;
use operator_console::model::ConsoleModel;
use protocol::layer::LayerId;
use protocol::tile::{TILE_SIDE, TileKey};
use tempfile::tempdir;

use super::shaped::{inside, namespaces, recording, shaped};
use super::{connect_to, open_session};
use crate::processes::{Running, rooms, start};

/// How long a console waits for the whole map, seconds.
const LONGEST_WAIT_S: u32 = 60;

/// For the helper process: the robot's endpoint, and how long it waits at most, seconds.
const JOINS: &str = "FORESHORE_TEST_JOINS";
const LONGEST_WAIT_VARIABLE: &str = "FORESHORE_TEST_LONGEST_WAIT_S";

/// What a window shows at first.
const SHOWN: [LayerId; 6] = [
    LayerId::Occupancy,
    LayerId::Elevation,
    LayerId::Depth,
    LayerId::Cost,
    LayerId::Obstacle,
    LayerId::Shore,
];
/// Slower is standing: positions of a boat are noisy, m/s.
const STANDING_MPS: f32 = 0.2;
/// The robot announces all changes within this time: 11 s, and up to the next round of 1.9 s.
const HOLD: Duration = Duration::from_secs(13);
/// Half the sides of the visible rectangle, metres: a window of 1280 × 800 points.
const VISIBLE_M: [f64; 2] = [32.0, 20.0];

/// 64 kbit/s, 600 ms round trip, as over a satellite.
fn satellite() -> Conditions {
    Conditions {
        delay: Duration::from_millis(300),
        rate_bytes_per_s: Some(8_000),
        queue_bytes: 16_000,
        ..Conditions::default()
    }
}

/// Times after the control session has opened.
#[derive(Debug, Default)]
struct Joined {
    pose: Option<Duration>,
    /// When each tile was first shown, by an overview at least, and when it last changed.
    tiles: BTreeMap<TileKey, [Duration; 2]>,
    /// When the end of the robot's data was reported, and when the map was as it was at that end.
    ended: Option<Duration>,
    synchronized: Option<Duration>,
    /// Since when the vehicle stands, and when the map was synchronized after all that had changed by then was announced.
    stands: Option<Duration>,
    settled: Option<Duration>,
}

impl Joined {
    fn update(&mut self, model: &mut ConsoleModel, after: Duration) {
        if let Some((pose, _)) = model.vehicle().pose() {
            self.pose.get_or_insert(after);
            let [x, y, _] = pose.position_m;
            let [width, height] = VISIBLE_M;
            let visible_m = [x - width, y - height, x + width, y + height];
            model.set_view(visible_m.map(|edge_m| edge_m as f32), SHOWN.into());
            if pose.ground_speed_mps().abs() > STANDING_MPS {
                (self.stands, self.settled) = (None, None);
            } else {
                let stands = *self.stands.get_or_insert(after);
                if after >= stands + HOLD && model.is_synchronized(clock::now()) {
                    self.settled.get_or_insert(after);
                }
            }
        }
        for key in model.take_changed_tiles() {
            let store = model.map().store();
            if store.shown(key).is_some() {
                self.tiles.entry(key).or_insert([after; 2])[1] = after;
            }
        }
        if model.reports_ended() {
            self.ended.get_or_insert(after);
            if model.has_ended() && model.is_synchronized(clock::now()) {
                self.synchronized.get_or_insert(after);
            }
        }
    }

    /// When the last visible tile was first shown, and when it last changed; and the number of these tiles.
    fn visible(&self, model: &ConsoleModel) -> ([Duration; 2], usize) {
        let Some((pose, _)) = model.vehicle().pose() else {
            return <_>::default();
        };
        let is_visible = |key: &TileKey| {
            let side_m = model.map().store().cell_m(key.layer).unwrap() * TILE_SIDE as f64;
            let center_m = key.center_m(side_m / TILE_SIDE as f64);
            (0..2).all(|axis| {
                let apart_m = (center_m[axis] - pose.position_m[axis]).abs();
                apart_m <= VISIBLE_M[axis] + 0.5 * side_m
            })
        };
        let mut last = [Duration::ZERO; 2];
        let visible = self.tiles.iter().filter(|(key, _)| is_visible(key));
        let tiles = visible.map(|(_, times)| last = [0, 1].map(|n: usize| last[n].max(times[n])));
        let tiles = tiles.count();
        (last, tiles)
    }
}

/// Not a test: a console that joins `scout`, and prints times in milliseconds.
#[test]
fn console_as_helper_process() {
    let (Ok(endpoint), Ok(longest_wait_s)) =
        (std::env::var(JOINS), std::env::var(LONGEST_WAIT_VARIABLE))
    else {
        return;
    };
    let longest_wait = Duration::from_secs(longest_wait_s.parse().unwrap());
    let session = open_session(&connect_to(endpoint), &SHOWN, || {});
    let started = clock::now();
    while !session.is_connected() && clock::elapsed(started) < longest_wait {
        sleep(Duration::from_millis(2));
    }
    let opened = clock::now();
    let mut joined = Joined::default();
    while joined.synchronized.is_none() && clock::elapsed(opened) < longest_wait {
        joined.update(&mut session.model(), clock::elapsed(opened));
        sleep(Duration::from_millis(5));
    }
    let model = session.model();
    let ([useful, exact], tiles) = joined.visible(&model);
    let (bytes, _) = model.connection().totals();
    let ms = |after: Option<Duration>| after.map_or(-1.0, |after| after.as_secs_f64() * 1e3);
    let mut line = String::new();
    for ms in [
        opened.since(started).as_secs_f64() * 1e3,
        ms(joined.pose),
        ms(Some(useful)),
        ms(Some(exact)),
        ms(joined.synchronized),
        tiles as f64,
        joined.tiles.len() as f64,
        bytes as f64,
        ms(joined.ended),
        ms(joined.stands),
        ms(joined.settled),
    ] {
        write!(line, " {ms:.0}").unwrap();
    }
    println!("joined:{line}");
}

/// One join: milliseconds from the start to the opened session; from there to pose, useful and exact visible area and the whole
/// map; visible tiles, all tiles, bytes of messages; milliseconds to the end of the robot's data, since when it stands, and to the map
/// that it had then.
fn join(link: &Namespaces, longest_wait_s: u32) -> [f64; 11] {
    let mut console = link.command(Side::B, std::env::current_exe().unwrap());
    console
        .args("link::joining::console_as_helper_process --exact --nocapture".split(' '))
        .env(JOINS, endpoint())
        .env(LONGEST_WAIT_VARIABLE, longest_wait_s.to_string());
    let printed = Running::start(&mut console, "a console that joins").ends_well();
    let line = printed
        .lines()
        .find_map(|line| line.split("joined:").nth(1));
    let figures = line
        .unwrap_or_else(|| panic!("{printed}"))
        .split_whitespace();
    let figures: Vec<f64> = figures.map(|figure| figure.parse().unwrap()).collect();
    figures.try_into().unwrap()
}

pub(super) fn endpoint() -> String {
    format!("tcp/{}:7447", Side::A.address())
}

/// Recordings of more than a minute.
fn recordings(folder: &Path) -> Vec<(&'static str, PathBuf)> {
    let simulated = ["yard", "lake"].map(|world| {
        let path = folder.join(world).with_extension("mcap");
        start(&format!(
            "robot-edge simulate {world} --rate max --duration 90 --no-network --quiet --record {}",
            path.display()
        ))
        .ends_well();
        (world, path)
    });
    let clinic = recording("carmen/fr-clinic_robotlaser.clf");
    let recorded = [("rooms", Some(rooms())), ("fr-clinic", clinic)];
    let recorded = recorded.into_iter();
    let recorded = recorded.filter_map(|(name, path)| Some((name, PathBuf::from(path?))));
    recorded.chain(simulated).collect()
}

/// Joins to robots that stand still with their maps.
///
/// `FORESHORE_ROUNDS` are the joins to each, else `tries`; `limits_s` are the targets for pose, useful and exact area.
fn measure(what: &str, conditions: Conditions, tries: usize, limits_s: [f64; 3]) {
    let Some(link) = namespaces(5) else { return };
    let rounds = std::env::var("FORESHORE_ROUNDS");
    let tries = rounds.map_or(tries, |rounds| rounds.parse().unwrap());
    let folder = tempdir().unwrap();
    println!(
        "| {what}, of {tries}: median, most, s | opened | pose | useful | exact | synchronized | tiles | bytes |"
    );
    for (name, recording) in recordings(folder.path()) {
        link.set_both(Conditions::default());
        let line = format!(
            "robot-edge replay {} --rate max --keep-serving --insecure --robot scout --listen {}",
            recording.display(),
            endpoint()
        );
        let edge = Running::start(&mut inside(&link, Side::A, &line), "edge");
        // Until the whole recording is mapped.
        join(&link, LONGEST_WAIT_S);
        link.set_both(conditions);
        let joins: Vec<[f64; 11]> = (0..tries).map(|_| join(&link, LONGEST_WAIT_S)).collect();
        let column = |at: usize| {
            let mut column: Vec<f64> = joins.iter().map(|join| join[at]).collect();
            column.sort_by(f64::total_cmp);
            column
        };
        let mut row = format!("| {name} |");
        for at in 0..5 {
            let column = column(at);
            let late = column.iter().filter(|ms| **ms < 0.0).count();
            write!(
                row,
                " {:.2}, {:.2}",
                column[tries / 2] * 1e-3,
                column[tries - 1] * 1e-3
            )
            .unwrap();
            if late > 0 {
                write!(row, " ({late} never)").unwrap();
            }
            if let Some(limit_s) = at.checked_sub(1).and_then(|at| limits_s.get(at)) {
                let in_time = column.iter().filter(|ms| **ms <= limit_s * 1e3).count();
                write!(row, ", {in_time} within {limit_s}").unwrap();
            }
            row += " |";
        }
        println!(
            "{row} {} of {} | {:.0} |",
            column(5)[0],
            column(6)[0],
            column(7)[tries / 2]
        );
        drop(edge);
        sleep(Duration::from_secs(1));
    }
}

#[test]
#[ignore = "five minutes, needs root: measures"]
fn late_joiners_on_the_shaped_link_in_release() {
    measure("2 Mbit/s, 150 ms, 2 %", shaped(0.02), 20, [1.0, 2.0, 3.0]);
}

#[test]
#[ignore = "five minutes, needs root: measures"]
fn late_joiners_by_satellite_in_release() {
    measure("64 kbit/s, 600 ms", satellite(), 5, [3.0, 10.0, 10.0]);
}

/// 256 kbit/s, 150 ms round trip.
fn thin() -> Conditions {
    Conditions {
        rate_bytes_per_s: Some(32_000),
        ..shaped(0.0)
    }
}

#[test]
#[ignore = "six minutes, needs root: measures"]
fn everything_is_there_after_standing_still_in_release() {
    let Some(link) = namespaces(6) else { return };
    link.set_both(thin());
    let folder = tempdir().unwrap();
    for (name, recording) in recordings(folder.path()) {
        let line = format!(
            "robot-edge replay {} --duration 75 --rate 1 --keep-serving --insecure --robot scout --listen {}",
            recording.display(),
            endpoint()
        );
        let edge = Running::start(&mut inside(&link, Side::A, &line), "edge");
        let [.., synchronized, _, tiles, bytes, ended, _, _] = join(&link, 2 * LONGEST_WAIT_S);
        println!(
            "{name}, 256 kbit/s: the whole map {:.2} s after the last measurement; {tiles} tiles, {bytes} bytes in {:.0} s",
            (synchronized - ended) * 1e-3,
            synchronized * 1e-3
        );
        assert!(ended > 0.0 && synchronized > 0.0);
        drop(edge);
        sleep(Duration::from_secs(1));
    }
}

#[test]
#[ignore = "five minutes, needs root: measures"]
fn what_stands_and_goes_on_measuring_is_synchronized_in_release() {
    let Some(link) = namespaces(6) else { return };
    link.set_both(thin());
    let mut late = Vec::new();
    // Until 20 s after they stand at the ends of their paths.
    for (world, duration_s) in [("yard", 75), ("meadow", 75), ("lake", 95)] {
        let line = format!(
            "robot-edge simulate {world} --duration {duration_s} --rate 1 --keep-serving --quiet --insecure --robot scout --listen {}",
            endpoint()
        );
        let edge = Running::start(&mut inside(&link, Side::A, &line), "edge");
        let [.., ended, stands, settled] = join(&link, 2 * LONGEST_WAIT_S);
        let took_s = (settled - stands) * 1e-3;
        println!(
            "{world}, 256 kbit/s: stands after {:.1} s, {:.1} s before its data ends; synchronized after {took_s:.2} s",
            stands * 1e-3,
            (ended - stands) * 1e-3
        );
        if settled < 0.0 || took_s > 15.0 {
            late.push(world);
        }
        drop(edge);
        sleep(Duration::from_secs(1));
    }
    assert!(late.is_empty(), "later than 15 s: {late:?}");
}
