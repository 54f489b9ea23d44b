//! A day with the console, from the first window to the last, with real keys and a real pointer, and a picture of each step.

mod desk;
mod probe;
mod raster;

use std::fs;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::rig::relay::Relay;
use protocol::message::{TeleopState, TeleopStatus};
use robot_edge::clock::Monotonic;
use tempfile::tempdir;

use super::controls::Control;
use super::driver::{holds, take_lease};
use super::processes::{Running, free_port, program};
use super::screen::Key;
use super::witness::{PATIENCE, Witness};
use desk::{Desk, rest};
use probe::{Reading, place_m, readings};
use raster::Raster;

const ROBOT: &str = "barge";
/// The inner faces of the yard's walls on the left and on the right: `worlds/yard.toml`.
const WALLS_M: [f64; 2] = [8.55, -8.55];
/// Side of a cell of the yard's maps.
const CELL_M: f64 = 0.1;
/// A step of the pointer is so much on this map, at most.
const STEP_M: f64 = 0.1;
/// Driven so far at least.
const WAY_M: f64 = 0.5;
/// Points of the map that are read, and of which so many must be known.
const PROBES: i16 = 7;
const MIN_KNOWN: usize = 3;

#[test]
fn a_day_with_the_console() {
    // Whoever names an address is shown nobody whom other tests have on this network.
    let yesterdays = format!("tcp/127.0.0.1:{}", free_port());
    let arguments = ["--operator", "anna", "--robot", ROBOT, "--connect"];
    let Some(mut desk) = Desk::new(&arguments, &yesterdays) else {
        return;
    };
    let recordings = tempdir().unwrap();
    let port = free_port();
    let relay = Relay::pair(port).unwrap();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let mut command = program("robot-edge");
    command.args([
        "simulate", "yard", "--rate", "1", "--stay", "--quiet", "--robot", ROBOT,
    ]);
    command.args(["--listen", &endpoint, "--recordings"]);
    let _edge = Running::start(command.arg(recordings.path()), "edge");
    let witness = Witness::of(ROBOT, &endpoint);

    finds_the_robot(&desk, &relay);
    starts_recording(&desk);
    switches_layers(&desk);
    saves_pictures(&desk);
    drives(&desk, &witness);
    measures(&desk);
    loses_the_link(&desk, &relay);
    let recording = stops_recording(&desk, recordings.path());
    scrubs(&desk, &recording);
    let read = probes(&desk);
    exports(&desk, &read);
    comes_back(&mut desk, &relay);
}

fn finds_the_robot(desk: &Desk, relay: &Relay) {
    desk.controls.beginning("Looking for robots");
    desk.controls.beginning(&format!("Looking for {ROBOT}"));
    desk.picture("01_open");
    desk.until_seen("Remembered addresses", || {
        // What is typed before the field is there waits for it.
        desk.screen.tap_with(Key::Control, Key::L);
        desk.screen.write(&relay.endpoint());
        desk.screen.tap(Key::Enter);
    });
    desk.controls.beginning("Live");
    desk.controls.beginning("In step");
    desk.picture("02_found");
}

/// What stands below the name of a layer in its panel.
fn state_of<'a>(all: &'a [Control], layer: &str) -> Option<&'a str> {
    let name = all
        .iter()
        .find(|control| control.role == "CheckBox" && control.words == layer)?;
    let below = all.iter().filter(|control| {
        let [left, top, right, _] = control.edges;
        control.role == "Label"
            && top >= name.edges[3] - 2
            && left <= name.edges[0] + 20
            && right > name.edges[0]
    });
    let next = below.min_by_key(|control| control.edges[1])?;
    Some(&next.words)
}

fn switches_layers(desk: &Desk) {
    let is_hidden = |layer: &'static str, is_hidden: bool| {
        desk.controls
            .wait_for(&format!("{layer} hidden: {is_hidden}"), |all| {
                let state = state_of(all, layer)?;
                (state.starts_with("hidden") == is_hidden).then_some(())
            });
    };
    is_hidden("Rigidity", true);
    desk.controls
        .beginning("Slope cost: 0 flat or clear, 1 fatal");
    desk.screen.tap_with(Key::Alt, Key::Digit5);
    is_hidden("Rigidity", false);
    desk.controls.beginning("Rigidity");
    desk.controls.wait_for("rigidity in step", |all| {
        let state = state_of(all, "Rigidity")?;
        state.contains("in step").then_some(())
    });
    desk.picture("03_layers");
    desk.screen.tap_with(Key::Alt, Key::Digit5);
    is_hidden("Rigidity", true);
}

/// Hands let go of Ctrl before the letter as often as after it; S is a key that drives as well.
fn saves_pictures(desk: &Desk) {
    let folder = desk.home.path().join("pictures");
    let saved = || fs::read_dir(&folder).map_or(0, Iterator::count);
    for count in 1..=3 {
        desk.screen.press(Key::Control);
        desk.screen.press(Key::S);
        desk.screen.release(Key::Control);
        desk.screen.release(Key::S);
        let started = Monotonic::now();
        while saved() < count {
            assert!(started.elapsed() < PATIENCE, "{count} pictures");
            rest();
        }
    }
    assert_eq!(saved(), 3);
}

fn starts_recording(desk: &Desk) {
    desk.until_seen("Start recording", || desk.click("Button", "Recording"));
    desk.until_seen("Stop recording", || desk.click("Button", "Start recording"));
}

fn drives(desk: &Desk, witness: &Witness) {
    take_lease(&desk.screen, witness);
    witness.sees("held", |status| status.state == TeleopState::Held);
    let (from, _) = witness.place();
    let way_m = || {
        let ([x, y], _) = witness.place();
        nalgebra::distance(&from.into(), &[x, y].into())
    };
    let mut presses = 0;
    // The guard of a laser that tilts knows little just ahead, and may stop it before.
    while way_m() < WAY_M {
        assert!(presses < 10, "{} m", way_m());
        presses += 1;
        let forward = |status: &TeleopStatus| status.applied.linear_mps > 0.1;
        holds(&desk.screen, witness, Key::W, forward);
        if presses == 1 {
            desk.picture("04_driving");
        }
        sleep(Duration::from_secs(1));
        desk.screen.release(Key::W);
        witness.sees("standing", |status| status.state == TeleopState::Held);
    }
    // A machine that is busy with other tests may be behind with telling where it is.
    witness.hears_that_it_stands();
    let stood = way_m();
    sleep(Duration::from_secs(1));
    assert!((way_m() - stood).abs() < 0.02, "it stands");
    println!("driven {stood:.2} m with {presses} presses");
    // Given back.
    desk.screen.tap_with(Key::Control, Key::G);
    witness.sees("nobody's", |status| status.lease.holder.is_none());
}

/// Where the pointer reads on the map, metres in `odom`, once it points there: elsewhere than before.
fn reads_at(desk: &Desk, at: [i16; 2]) -> [f64; 2] {
    let before = place_m(&desk.controls.all());
    desk.screen.point(at);
    let first = desk.controls.wait_for("another place", |all| {
        place_m(all).filter(|place_m| Some(*place_m) != before)
    });
    rest();
    assert_eq!(place_m(&desk.controls.all()), Some(first), "the map moves");
    first
}

fn measures(desk: &Desk) {
    // The whole map grows while one looks; the vehicle stands.
    desk.screen.tap(Key::V);
    rest();
    let [left, top, right, bottom] = desk.map().edges;
    let corner = [left + (right - left) / 4, top + (bottom - top) / 3];
    let other = [right - (right - left) / 4, bottom - (bottom - top) / 3];
    let (from_m, to_m) = (reads_at(desk, corner), reads_at(desk, other));
    // North is up: the two are all there is to know of the view.
    let pixels_per_m = f64::from(other[0] - corner[0]) / (to_m[0] - from_m[0]);
    assert!(
        pixels_per_m > 1.0 / STEP_M,
        "{pixels_per_m} pixels per metre"
    );
    let place = |[x_m, y_m]: [f64; 2]| {
        let [dx, dy] =
            [x_m - from_m[0], from_m[1] - y_m].map(|m| (m * pixels_per_m).round() as i16);
        [corner[0] + dx, corner[1] + dy]
    };
    desk.screen.tap(Key::M);
    for y_m in WALLS_M {
        desk.screen.click(place([12.0, y_m]));
        rest();
    }
    let label = desk.controls.beginning("Map, measured: ").words;
    desk.picture("05_measured");
    desk.screen.tap(Key::Escape);
    let words = label.trim_start_matches("Map, measured: ");
    let length_m: f64 = words.split(' ').next().unwrap().parse().unwrap();
    println!(
        "from wall to wall: {words}; it is {} m",
        WALLS_M[0] - WALLS_M[1]
    );
    assert!(
        (length_m - (WALLS_M[0] - WALLS_M[1])).abs() < 2.0 * STEP_M,
        "{label}"
    );
}

/// How far from grey a part of the screen is on average: the greatest less the least of red, green and blue.
fn colourfulness(desk: &Desk, edges: [i16; 4]) -> f64 {
    let ([width, _], pixels) = desk.screen.pixels();
    let [left, top, right, bottom] = edges.map(|edge| usize::try_from(edge).unwrap());
    let mut sum = 0.0;
    for y in top..bottom {
        for pixel in &pixels[y * usize::from(width) + left..y * usize::from(width) + right] {
            let (most, least) = (pixel.iter().max().unwrap(), pixel.iter().min().unwrap());
            sum += f64::from(most - least);
        }
    }
    sum / ((right - left) * (bottom - top)) as f64
}

fn loses_the_link(desk: &Desk, relay: &Relay) {
    let [left, top, right, bottom] = desk.map().edges;
    // Without what stands at the edges of the map.
    let middle = [
        left + (right - left) / 4,
        top + (bottom - top) / 4,
        right - (right - left) / 4,
        bottom - (bottom - top) / 4,
    ];
    let live = colourfulness(desk, middle);
    let cut = Monotonic::now();
    relay.cut().unwrap();
    let banner = desk.controls.beginning("Link lost: nothing heard for");
    println!(
        "from the cut to the banner in the window: {:?}; {}",
        cut.elapsed(),
        banner.words
    );
    desk.controls.beginning("Silent");
    sleep(Duration::from_secs(3));
    let old = colourfulness(desk, middle);
    println!("colours of the map: {live:.1} live, {old:.1} without a link");
    assert!(old < 0.6 * live, "{old} of {live}");
    desk.picture("06_link_lost");
    relay.pass().unwrap();
    desk.controls.without("Link lost");
    desk.controls.beginning("Live");
    desk.controls.beginning("In step");
    desk.picture("07_back");
}

fn stops_recording(desk: &Desk, folder: &Path) -> PathBuf {
    desk.until_seen("Start recording", || desk.click("Button", "Stop recording"));
    let mut files: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|end| end == "mcap"))
        .collect();
    files.sort();
    files.remove(0)
}

/// Where the recording is, seconds, and how long.
fn position_s(all: &[Control]) -> Option<[f64; 2]> {
    let clock_s = |words: &str| {
        let mut parts = words.split(':').map(str::parse::<f64>);
        parts.try_fold(0.0, |sum, part| Some(60.0 * sum + part.ok()?))
    };
    all.iter().find_map(|control| {
        let words = control.words.strip_prefix("Position in the recording: ")?;
        let (position, length) = words.split_once(" of ")?;
        Some([clock_s(position)?, clock_s(length)?])
    })
}

/// Opens the recording and winds it: paused, the last time forward.
fn scrubs(desk: &Desk, recording: &Path) {
    desk.screen.tap_with(Key::Control, Key::O);
    desk.controls.beginning("MCAP, ROS 1 bag");
    rest();
    desk.screen.write(recording.to_str().unwrap());
    desk.screen.tap(Key::Enter);
    let [_, length_s] = desk.controls.wait_for("a time line", position_s);
    desk.screen.tap(Key::P);
    desk.controls.named("Button", "Play");
    let slider = desk.controls.beginning("Position in the recording");
    let [left, top, right, _] = slider.edges;
    for share in [0.9, 0.3, 0.8] {
        let x = f64::from(left) + share * f64::from(right - left);
        desk.screen.click([x as i16, top + 11]);
        let (wanted_s, clicked) = (share * length_s, Monotonic::now());
        desk.controls.wait_for(&format!("{wanted_s:.1} s"), |all| {
            let [position_s, _] = position_s(all)?;
            ((position_s - wanted_s).abs() < 0.02 * length_s + 0.2).then_some(())
        });
        println!(
            "wound to {wanted_s:.1} s of {length_s:.1} s in {:?}",
            clicked.elapsed()
        );
    }
    desk.controls.beginning("In step");
}

/// Reads the map in many places, the last of which stays pinned.
fn probes(desk: &Desk) -> Vec<([f64; 2], Vec<Reading>)> {
    desk.screen.tap_with(Key::Alt, Key::Digit5);
    desk.controls.beginning("Trespassable");
    desk.screen.tap(Key::V);
    desk.screen.tap(Key::Equals);
    rest();
    let [_, top, _, bottom] = desk.map().edges;
    let [middle, _] = desk.map().middle();
    let places = (1..PROBES).flat_map(|row| (0..PROBES).map(move |column| (column, row)));
    let mut read = Vec::new();
    for (column, row) in places {
        // Around the vehicle and ahead of it; not in step with cells.
        let at = [
            middle + 23 * column + 3 * row - 40,
            top + (bottom - top) * row / PROBES + 5 * column,
        ];
        let point_m = reads_at(desk, at);
        // The card rounds: a point at the edge of a cell could be in the next.
        let is_within = point_m.iter().all(|m| {
            let share = (m / CELL_M).rem_euclid(1.0);
            (0.1..0.9).contains(&share)
        });
        if is_within {
            read.push((point_m, readings(&desk.controls.all())));
        }
    }
    let [x, y] = desk.map().middle();
    desk.screen.click([x + 60, y]);
    desk.controls.named("Button", "Unpin");
    desk.picture("08_recording");
    desk.screen.tap(Key::Escape);
    read
}

/// Exports what is shown, and holds it to what was read.
fn exports(desk: &Desk, read: &[([f64; 2], Vec<Reading>)]) {
    desk.screen.tap_with(Key::Control, Key::E);
    desk.controls.named("Button", "Export");
    rest();
    // The keyboard is where the folder is.
    desk.screen.tap(Key::Enter);
    desk.controls.named("Button", "Open folder");
    desk.picture("09_exported");
    let mut known = 0;
    for (point_m, readings) in read {
        assert_eq!(readings.len(), 2, "{point_m:?}: {readings:?}");
        for reading in readings {
            let raster = Raster::read(&desk.find(&format!("/{}.tif", reading.layer.name())));
            let exported = raster.at(*point_m);
            assert!(
                reading.says(exported),
                "{point_m:?}: {reading:?}, exported {exported}"
            );
            known += usize::from(reading.value != "unknown");
        }
    }
    println!(
        "read and exported alike: {} points, {known} values known",
        read.len()
    );
    assert!(known >= MIN_KNOWN, "{read:?}");
    desk.screen.tap(Key::Escape);
}

/// Puts the window in another order, ends the day, and finds it so the next morning.
fn comes_back(desk: &mut Desk, relay: &Relay) {
    desk.until_seen("Live", || desk.click("Button", "Close recording"));
    desk.controls.beginning("In step");
    desk.screen.tap_with(Key::Control, Key::Equals);
    desk.until_seen("Reset layout", || desk.click("Button", "View"));
    desk.click("CheckBox", "Events");
    desk.controls.without("Reset layout");
    desk.controls.without("Events");
    rest();
    desk.picture("10_another_layout");
    let evening = desk.map().edges;
    desk.screen.tap_with(Key::Control, Key::Q);
    desk.ends();

    assert!(desk.start(&relay.endpoint()));
    desk.controls.beginning("Live");
    desk.controls.beginning("In step");
    // The layer that was shown last, too.
    desk.controls.beginning("Trespassable");
    desk.controls.without("Events");
    rest();
    desk.picture("11_the_next_day");
    assert_eq!(desk.map().edges, evening);
    desk.until_seen("Scale: ", || desk.click("Button", "View"));
    desk.controls.beginning("Scale: 110 %");
    desk.screen.tap(Key::Escape);
    rest();
    desk.screen.tap_with(Key::Control, Key::Q);
    desk.ends();
}
